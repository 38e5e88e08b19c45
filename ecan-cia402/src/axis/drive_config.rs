//! Configuration of a drive: plain data.

use std::sync::Arc;
use std::time::Duration;

use ecan_canopen::{
    FaultReaction, GuardingConfig, HaltOption, IdentityCheck, NodeLossReaction, ParameterSet,
    QuickStopOption, Step, StopOption,
};

/// Reset of a node at the start of its configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum NodeReset {
    /// None; the node is commanded to Pre-operational.
    #[default]
    None,
    /// Reset Communication: parameters of 0x1000.. as at power-on.
    Communication,
    /// Reset Node.
    Node,
}

/// Parameters of the velocity mode (VL) in a drive; `None` does not write an object. Velocities are
/// those of 0x6042, by default revolutions per minute.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct VlConfig {
    /// Smallest and largest amount of the velocity, 0x6046:01 and :02.
    pub limits: Option<(u32, u32)>,
    /// Acceleration 0x6048: change of the velocity, and its time in seconds.
    pub acceleration: Option<(u32, u16)>,
    /// Deceleration 0x6049, likewise.
    pub deceleration: Option<(u32, u16)>,
}

/// Configuration of a drive before it is enabled. Objects marked (optional) are skipped if the
/// drive does not have them.
#[derive(Debug, Clone, PartialEq)]
pub struct DriveConfig {
    /// Reset at the start.
    pub reset: NodeReset,
    /// Longest time for the boot-up message after a reset.
    pub boot_timeout: Duration,
    /// Identity that it must have.
    pub identity: IdentityCheck,
    /// True if the low half of 0x1000 must be 402.
    pub expect_profile_402: bool,
    /// Producer heartbeat time 0x1017 in milliseconds (optional); 0 disables it. The host
    /// watches it with three and a half times this value.
    pub heartbeat_ms: u16,
    /// Node guarding in both directions (CiA 301, 7.2.8.3.2.1) in place of the producer heartbeat, for
    /// a drive that has none: `heartbeat_ms` is not used then, and 0x1017 is set to 0. The host guards
    /// the drive from the end of its configuration on, and the drive detects by the requests that the
    /// host has stopped. `None` uses the heartbeat.
    pub guarding: Option<GuardingConfig>,
    /// Consumer heartbeat time of the host, 0x1016:01, in milliseconds (optional); 0 does not
    /// write the object. By it a drive detects that the host has stopped.
    pub host_heartbeat_ms: u16,
    /// Reaction of the drive to that, 0x6007 (optional); `None` does not write the object.
    pub host_loss: Option<NodeLossReaction>,
    /// Quick stop option 0x605A (optional); `None` does not write it.
    pub quick_stop: Option<QuickStopOption>,
    /// Shutdown option 0x605B (optional); `None` does not write it.
    pub shutdown: Option<StopOption>,
    /// Disable operation option 0x605C (optional), by which a disabled axis stops; `None` does not
    /// write it.
    pub disable_operation: Option<StopOption>,
    /// Halt option 0x605D (optional), by which an axis halts in PP, PV and PT; `None` does not
    /// write it.
    pub halt: Option<HaltOption>,
    /// Fault reaction option 0x605E (optional); `None` does not write it.
    pub fault_reaction: Option<FaultReaction>,
    /// Following error window 0x6065 in steps and time 0x6066 in milliseconds (optional); `None`
    /// does not write them, so that a window of the drive's commissioning stays in force; a larger one
    /// here would widen it. Should not be below [`AxisConfig::following_window`](crate::AxisConfig::following_window) in normal motion.
    ///
    /// It is the protection that the host cannot give: a drive that receives several targets at once
    /// after a fault of the bus moves faster than the step limit for up to one target period (see
    /// [`Cia402`](crate::Cia402)), and stops with a fault if its motor does not follow.
    pub following_error: Option<(u32, u16)>,
    /// Mask of the digital outputs 0x60FE:02: a bit that is set lets the host set this output. `None`
    /// does not write it.
    pub output_mask: Option<u32>,
    /// Set-points that wait in the drive in IP, 0x60C4:02; `None` leaves it as it is. When targets end,
    /// the drive still goes through those that wait: at most this number of step limits.
    pub interpolation_buffer: Option<u16>,
    /// Torque slope of PT, 0x6087, in thousandths of the rated torque per second; `None` does not
    /// write it.
    pub torque_slope: Option<u32>,
    /// Limits and ramps of VL.
    pub vl: VlConfig,
    /// Writes [`AxisConfig::bounds`](crate::AxisConfig::bounds) to 0x607D too, in a position mode (optional).
    pub write_position_limits: bool,
    /// Largest torque 0x6072, in thousandths of the rated torque; `None` does not write it.
    pub max_torque: Option<u16>,
    /// Largest speed of the motor 0x6080, in revolutions per minute; `None` does not write it.
    pub max_motor_speed: Option<u32>,
    /// Reads 0x6072, 0x607D and 0x6080, and narrows the limits of the axis to those of the drive:
    /// bounds in position and torque modes, in CSP and IP the step limit, in CSV and PV the bounds, by
    /// the motor speed and the [units](crate::DriveUnits) of the drive. Also done if one of the two above is
    /// set. The limits of the axis are never widened.
    pub use_limits: bool,
    /// Disables the other TPDOs (optional), so that they take no bus time.
    pub silence_other_tpdos: bool,
    /// Values that are written, and read back, before the mapping, for example those of a DCF. What
    /// the axis configures itself, it writes afterwards.
    pub parameters: Arc<ParameterSet>,
    /// Further steps, done after the mapping and before the mode, while Pre-operational.
    pub further: Vec<Step>,
}

impl Default for DriveConfig {
    /// No reset; heartbeats of 100 ms from the drive, a consumer time of 250 ms for the host's, and a
    /// quick stop if the host is lost.
    fn default() -> Self {
        Self {
            reset: NodeReset::None,
            boot_timeout: Duration::from_secs(5),
            identity: IdentityCheck::default(),
            expect_profile_402: true,
            heartbeat_ms: 100,
            guarding: None,
            host_heartbeat_ms: 250,
            host_loss: Some(NodeLossReaction::QuickStop),
            quick_stop: None,
            shutdown: None,
            disable_operation: None,
            halt: None,
            fault_reaction: None,
            following_error: None,
            output_mask: None,
            interpolation_buffer: None,
            torque_slope: None,
            vl: VlConfig::default(),
            write_position_limits: false,
            max_torque: None,
            max_motor_speed: None,
            use_limits: false,
            silence_other_tpdos: true,
            parameters: Arc::default(),
            further: Vec::new(),
        }
    }
}
