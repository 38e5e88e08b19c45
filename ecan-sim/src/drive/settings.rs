//! What a simulated drive is like.

use ecan_canopen::NodeId;
use ecan_protocol::object::AbortCode;

/// A simulated drive. Plain data; the default of everything but the node id is a well-behaved servo
/// drive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DriveConfig {
    /// Node id.
    pub node: NodeId,
    /// Serial number (0x1018:04).
    pub serial: u32,
    /// Milliseconds from supply or NMT reset node to the boot-up message.
    pub boot_ms: u32,
    /// Microseconds that an SDO answer takes.
    pub sdo_delay_us: u32,
    /// Milliseconds from the command to enable to Operation Enabled, as a brake needs them.
    pub enable_ms: u32,
    /// Targets that the history keeps.
    pub history: usize,
    /// The motor and the machine around it.
    pub motor: MotorConfig,
    /// In what the drive differs from others.
    pub quirks: DriveQuirks,
}

impl DriveConfig {
    /// A drive with this node id.
    #[must_use]
    pub fn new(node: NodeId) -> Self {
        Self {
            node,
            serial: 1,
            boot_ms: 40,
            sdo_delay_us: 200,
            enable_ms: 0,
            history: 1024,
            motor: MotorConfig::default(),
            quirks: DriveQuirks::default(),
        }
    }
}

/// The motor, its encoder and the machine. Positions are increments of the encoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MotorConfig {
    /// Increments of a revolution (0x608F); the index pulse comes once in so many.
    pub increments_per_revolution: u32,
    /// Greatest speed in increments per second.
    pub max_velocity: u32,
    /// Acceleration in increments per second squared at the greatest torque.
    pub max_acceleration: u32,
    /// Greatest torque in thousandths of the rated torque.
    pub max_torque: u16,
    /// Deceleration by friction in increments per second squared: what slows a motor without
    /// current, and what torque has to overcome.
    pub friction: u32,
    /// Gain of the position controller in 1/s.
    pub position_gain: u16,
    /// Share of the demanded speed that is fed forward, in thousandths. What is missing shows as
    /// following error.
    pub feed_forward: u16,
    /// Period of the controller in microseconds, at least 1.
    pub period_us: u32,
    /// Where the motor stands when the simulation begins.
    pub start_position: i32,
    /// Whether the encoder knows its position after a loss of supply; one that does not begins
    /// at 0.
    pub absolute_encoder: bool,
    /// Mechanical positions of the negative limit switch, active there and below, and the
    /// positive one, active there and above. Only homing stops at them; elsewhere they just show in
    /// 0x60FD.
    pub limit_switches: (i32, i32),
    /// Mechanical position from which on upwards the home switch is active.
    pub home_switch: i32,
}

impl Default for MotorConfig {
    /// 65536 increments, 6000 revolutions a minute.
    fn default() -> Self {
        Self {
            increments_per_revolution: 65_536,
            max_velocity: 6_553_600,
            max_acceleration: 200_000_000,
            max_torque: 3_000,
            friction: 5_000_000,
            position_gain: 200,
            feed_forward: 980,
            period_us: 1_000,
            start_position: 0,
            absolute_encoder: true,
            limit_switches: (-500_000, 500_000),
            home_switch: 100_000,
        }
    }
}

/// Whether a rule counts for reading, writing or both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SdoDirection {
    /// Uploads.
    Read,
    /// Downloads.
    Write,
    /// Both.
    Both,
}

/// What happens to an SDO transfer that a [`SdoRule`] is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SdoEffect {
    /// It is aborted with this code.
    Abort(AbortCode),
    /// It is not answered.
    Silence,
}

/// An object whose transfers go wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SdoRule {
    /// Index.
    pub index: u16,
    /// Subindex; `None` is every one.
    pub subindex: Option<u8>,
    /// Which transfers.
    pub direction: SdoDirection,
    /// What happens.
    pub effect: SdoEffect,
    /// How many transfers it strikes; `None` is all.
    pub times: Option<u32>,
}

/// In what a drive differs from a well-behaved one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DriveQuirks {
    /// Mapping objects are locked while the PDO is valid, as CiA 301 has it. Some drives allow a
    /// change as soon as the number of entries is 0. Default `true`.
    pub refuses_mapping_while_valid: bool,
    /// Mapping is fixed: every write to a mapping object is refused.
    pub fixed_mapping: bool,
    /// Operation Enabled is refused while no mode is chosen.
    pub needs_mode: bool,
    /// Modes (0x6060) that are accepted, but never taken: 0x6061 does not follow.
    pub ignored_modes: Vec<i8>,
    /// Milliseconds from a new mode in 0x6060 to 0x6061.
    pub mode_delay_ms: u32,
    /// The boot-up message never comes.
    pub never_boots: bool,
    /// Faults cannot be reset.
    pub stuck_in_fault: bool,
    /// Acknowledges frames, but sends nothing.
    pub silent: bool,
    /// Block transfers are refused.
    pub no_block_transfer: bool,
    /// A block upload is answered as a segmented one, which the protocol allows.
    pub block_upload_falls_back: bool,
    /// Enabled, it goes for whatever 0x607A holds, in place of waiting for a target.
    pub follows_old_target: bool,
    /// Objects that the drive does not have, as 0x1016.
    pub missing: Vec<u16>,
    /// Objects whose transfers go wrong.
    pub sdo_rules: Vec<SdoRule>,
}

impl Default for DriveQuirks {
    fn default() -> Self {
        Self {
            refuses_mapping_while_valid: true,
            fixed_mapping: false,
            needs_mode: false,
            ignored_modes: Vec::new(),
            mode_delay_ms: 0,
            never_boots: false,
            stuck_in_fault: false,
            silent: false,
            no_block_transfer: false,
            block_upload_falls_back: false,
            follows_old_target: false,
            missing: Vec::new(),
            sdo_rules: Vec::new(),
        }
    }
}
