//! Indices of the objects that a master uses (CiA 301, CiA 402-2).

/// Device type, U32.
pub const DEVICE_TYPE: u16 = 0x1000;
/// Error register, U8.
pub const ERROR_REGISTER: u16 = 0x1001;
/// Error history, array of U32.
pub const ERROR_HISTORY: u16 = 0x1003;
/// COB-ID of SYNC, U32.
pub const SYNC_COB_ID: u16 = 0x1005;
/// Communication cycle period in microseconds, U32.
pub const COMMUNICATION_CYCLE: u16 = 0x1006;
/// Device name, string.
pub const DEVICE_NAME: u16 = 0x1008;
/// Hardware version, string.
pub const HARDWARE_VERSION: u16 = 0x1009;
/// Software version, string.
pub const SOFTWARE_VERSION: u16 = 0x100A;
/// Guard time in milliseconds, U16.
pub const GUARD_TIME: u16 = 0x100C;
/// Life time factor, U8.
pub const LIFE_TIME_FACTOR: u16 = 0x100D;
/// Store parameters, array of U32.
pub const STORE_PARAMETERS: u16 = 0x1010;
/// Restore default parameters, array of U32.
pub const RESTORE_PARAMETERS: u16 = 0x1011;
/// COB-ID of TIME, U32; bit 31: the node consumes it, bit 30: it produces it.
pub const TIME_COB_ID: u16 = 0x1012;
/// COB-ID of EMCY, U32.
pub const EMCY_COB_ID: u16 = 0x1014;
/// Inhibit time of EMCY in 100 us, U16.
pub const EMCY_INHIBIT: u16 = 0x1015;
/// Consumer heartbeat time, array of U32.
pub const CONSUMER_HEARTBEAT: u16 = 0x1016;
/// Producer heartbeat time in milliseconds, U16.
pub const PRODUCER_HEARTBEAT: u16 = 0x1017;
/// Identity, record of U32.
pub const IDENTITY: u16 = 0x1018;
/// Counter overflow of SYNC, U8.
pub const SYNC_COUNTER_OVERFLOW: u16 = 0x1019;
/// Date and time of the configuration, array of U32: 1 days since 1984-01-01, 2 milliseconds after
/// midnight.
pub const CONFIGURATION_DATE: u16 = 0x1020;
/// Error behaviour, array of U8.
pub const ERROR_BEHAVIOUR: u16 = 0x1029;
/// Communication of the first RPDO; the others follow.
pub const RPDO_COMMUNICATION: u16 = 0x1400;
/// Mapping of the first RPDO; the others follow.
pub const RPDO_MAPPING: u16 = 0x1600;
/// Communication of the first TPDO; the others follow.
pub const TPDO_COMMUNICATION: u16 = 0x1800;
/// Mapping of the first TPDO; the others follow.
pub const TPDO_MAPPING: u16 = 0x1A00;
/// Software identification of the programs of a node (CiA 302-3), array of U32.
pub const PROGRAM_IDENTIFICATION: u16 = 0x1F56;
/// First object scanner list of MPDOs in source address mode, array of U32.
pub const SCANNER_LIST: u16 = 0x1FA0;
/// First object dispatcher list of MPDOs in source address mode, array of U64.
pub const DISPATCHER_LIST: u16 = 0x1FD0;
/// Reaction to a loss of communication, I16 (abort connection option code).
pub const ABORT_CONNECTION_OPTION: u16 = 0x6007;
/// Error code, U16.
pub const ERROR_CODE: u16 = 0x603F;
/// Controlword, U16.
pub const CONTROLWORD: u16 = 0x6040;
/// Statusword, U16.
pub const STATUSWORD: u16 = 0x6041;
/// Target velocity of the velocity mode (vl), I16.
pub const VL_TARGET_VELOCITY: u16 = 0x6042;
/// Velocity demand of the velocity mode, I16.
pub const VL_VELOCITY_DEMAND: u16 = 0x6043;
/// Actual velocity of the velocity mode, I16.
pub const VL_VELOCITY_ACTUAL: u16 = 0x6044;
/// Velocity limits of the velocity mode: 1 smallest amount, 2 largest amount, U32.
pub const VL_VELOCITY_LIMITS: u16 = 0x6046;
/// Acceleration of the velocity mode: 1 change of velocity (U32), 2 its time in seconds (U16).
pub const VL_ACCELERATION: u16 = 0x6048;
/// Deceleration of the velocity mode, as the acceleration.
pub const VL_DECELERATION: u16 = 0x6049;
/// Quick stop option code, I16.
pub const QUICK_STOP_OPTION: u16 = 0x605A;
/// Shutdown option code, I16.
pub const SHUTDOWN_OPTION: u16 = 0x605B;
/// Disable operation option code, I16.
pub const DISABLE_OPERATION_OPTION: u16 = 0x605C;
/// Halt option code, I16.
pub const HALT_OPTION: u16 = 0x605D;
/// Fault reaction option code, I16.
pub const FAULT_REACTION_OPTION: u16 = 0x605E;
/// Modes of operation, I8.
pub const MODE_OF_OPERATION: u16 = 0x6060;
/// Modes of operation display, I8.
pub const MODE_DISPLAY: u16 = 0x6061;
/// Position demand value, I32.
pub const POSITION_DEMAND: u16 = 0x6062;
/// Position actual internal value, I32.
pub const POSITION_ACTUAL_INTERNAL: u16 = 0x6063;
/// Position actual value, I32.
pub const POSITION_ACTUAL: u16 = 0x6064;
/// Following error window, U32.
pub const FOLLOWING_ERROR_WINDOW: u16 = 0x6065;
/// Following error time out in milliseconds, U16.
pub const FOLLOWING_ERROR_TIME: u16 = 0x6066;
/// Position window, U32.
pub const POSITION_WINDOW: u16 = 0x6067;
/// Position window time in milliseconds, U16.
pub const POSITION_WINDOW_TIME: u16 = 0x6068;
/// Velocity demand value, I32.
pub const VELOCITY_DEMAND: u16 = 0x606B;
/// Velocity actual value, I32.
pub const VELOCITY_ACTUAL: u16 = 0x606C;
/// Velocity window, U16.
pub const VELOCITY_WINDOW: u16 = 0x606D;
/// Target torque in thousandths of the rated torque, I16.
pub const TARGET_TORQUE: u16 = 0x6071;
/// Maximum torque in thousandths, U16.
pub const MAX_TORQUE: u16 = 0x6072;
/// Torque demand in thousandths, I16.
pub const TORQUE_DEMAND: u16 = 0x6074;
/// Rated torque, U32.
pub const RATED_TORQUE: u16 = 0x6076;
/// Actual torque in thousandths, I16.
pub const TORQUE_ACTUAL: u16 = 0x6077;
/// Target position, I32.
pub const TARGET_POSITION: u16 = 0x607A;
/// Home offset, I32.
pub const HOME_OFFSET: u16 = 0x607C;
/// Software position limit, array of I32: 1 minimum, 2 maximum.
pub const SOFTWARE_POSITION_LIMIT: u16 = 0x607D;
/// Maximum profile velocity, U32.
pub const MAX_PROFILE_VELOCITY: u16 = 0x607F;
/// Maximum motor speed, U32.
pub const MAX_MOTOR_SPEED: u16 = 0x6080;
/// Profile velocity, U32.
pub const PROFILE_VELOCITY: u16 = 0x6081;
/// Profile acceleration, U32.
pub const PROFILE_ACCELERATION: u16 = 0x6083;
/// Profile deceleration, U32.
pub const PROFILE_DECELERATION: u16 = 0x6084;
/// Quick stop deceleration, U32.
pub const QUICK_STOP_DECELERATION: u16 = 0x6085;
/// Torque slope in thousandths of the rated torque per second, U32.
pub const TORQUE_SLOPE: u16 = 0x6087;
/// Position encoder resolution, array of U32.
pub const ENCODER_RESOLUTION: u16 = 0x608F;
/// Gear ratio: 1 motor revolutions, 2 shaft revolutions, U32.
pub const GEAR_RATIO: u16 = 0x6091;
/// Feed constant: 1 feed in position units, 2 shaft revolutions, U32.
pub const FEED_CONSTANT: u16 = 0x6092;
/// Homing method, I8.
pub const HOMING_METHOD: u16 = 0x6098;
/// Homing speeds, array of U32: 1 to the switch, 2 to the zero.
pub const HOMING_SPEEDS: u16 = 0x6099;
/// Homing acceleration, U32.
pub const HOMING_ACCELERATION: u16 = 0x609A;
/// SI unit of positions, U32.
pub const SI_UNIT_POSITION: u16 = 0x60A8;
/// SI unit of velocities, U32.
pub const SI_UNIT_VELOCITY: u16 = 0x60A9;
/// Position offset, I32.
pub const POSITION_OFFSET: u16 = 0x60B0;
/// Velocity offset, I32.
pub const VELOCITY_OFFSET: u16 = 0x60B1;
/// Torque offset, I16.
pub const TORQUE_OFFSET: u16 = 0x60B2;
/// Touch probe function, U16.
pub const PROBE_FUNCTION: u16 = 0x60B8;
/// Touch probe status, U16.
pub const PROBE_STATUS: u16 = 0x60B9;
/// Position at the positive edge of touch probe 1, I32.
pub const PROBE_1_POSITIVE: u16 = 0x60BA;
/// Position at the negative edge of touch probe 1, I32.
pub const PROBE_1_NEGATIVE: u16 = 0x60BB;
/// Position at the positive edge of touch probe 2, I32.
pub const PROBE_2_POSITIVE: u16 = 0x60BC;
/// Position at the negative edge of touch probe 2, I32.
pub const PROBE_2_NEGATIVE: u16 = 0x60BD;
/// Interpolation sub mode, I16; 0 is linear.
pub const INTERPOLATION_MODE: u16 = 0x60C0;
/// Interpolation data record: 1 position (I32).
pub const INTERPOLATION_DATA: u16 = 0x60C1;
/// Interpolation time: 1 value (U8), 2 power of ten of seconds (I8).
pub const INTERPOLATION_TIME: u16 = 0x60C2;
/// Interpolation data configuration: 1 largest size, 2 size (U32), 3 organisation, 4 position
/// (U16), 5 size of a record, 6 clear (U8).
pub const INTERPOLATION_BUFFER: u16 = 0x60C4;
/// Following error actual value, I32.
pub const FOLLOWING_ERROR: u16 = 0x60F4;
/// Digital inputs, U32.
pub const DIGITAL_INPUTS: u16 = 0x60FD;
/// Digital outputs: 1 outputs, 2 mask, U32.
pub const DIGITAL_OUTPUTS: u16 = 0x60FE;
/// Target velocity, I32.
pub const TARGET_VELOCITY: u16 = 0x60FF;
/// Supported drive modes, U32.
pub const SUPPORTED_MODES: u16 = 0x6502;
