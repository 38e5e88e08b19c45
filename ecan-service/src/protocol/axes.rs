//! Method `axes`.

use serde::{Deserialize, Serialize};

/// Result of `axes`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Axes {
    /// Number of the cycle.
    pub cycle: u64,
    /// Start of the cycle, in nanoseconds, as in a frame record.
    pub time_ns: u64,
    /// The axes; empty if the application has none.
    pub axes: Vec<AxisState>,
}

/// Status of an axis. Positions in steps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AxisState {
    /// Index of the gateway.
    pub gateway: u16,
    /// Channel, 0 to 3.
    pub channel: u8,
    /// Node-ID of the drive.
    pub node_id: u8,
    /// Phase of the axis.
    pub phase: String,
    /// Time since the phase began, in nanoseconds.
    pub elapsed_ns: u64,
    /// Failure of the last command.
    pub error: Option<String>,
    /// Mode of operation.
    pub mode: String,
    /// The last statusword.
    pub statusword: Option<u16>,
    /// State in the statusword.
    pub drive_state: Option<String>,
    /// Error code of the last emergency message; 0 for none.
    pub error_code: u16,
    /// Last NMT state of the node.
    pub nmt_state: Option<String>,
    /// State of the heartbeat.
    pub heartbeat: String,
    /// The last usable actual position.
    pub actual: Option<i32>,
    /// Age of the actual position in cycles; 65535 is more or never.
    pub actual_age: u16,
    /// The actual position in degrees.
    pub actual_degrees: Option<f64>,
    /// The last target sent.
    pub target: Option<i32>,
    /// Target minus actual position.
    pub following_error: Option<i64>,
    /// Reason of a hold.
    pub hold_reason: Option<String>,
    /// Cause of a stop.
    pub stop_cause: Option<String>,
    /// The drive is configured.
    pub is_configured: bool,
    /// The axis follows targets.
    pub is_running: bool,
    /// A halted axis is at rest.
    pub is_at_rest: bool,
    /// The drive has reached its target.
    pub is_target_reached: bool,
    /// The axis has stopped.
    pub is_stopped: bool,
    /// A recovery continues.
    pub is_recovering: bool,
}
