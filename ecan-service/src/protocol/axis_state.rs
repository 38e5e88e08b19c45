//! Status of an axis as the service reports it.

use serde::{Deserialize, Serialize};

/// Declares each field once: with its type and its value in the status of an axis.
macro_rules! axis_state {
    ($status:ident; $($(#[$meta:meta])* $field:ident: $type:ty = $value:expr;)*) => {
        /// Status of an axis. Positions in steps.
        #[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
        pub struct AxisState {
            $($(#[$meta])* pub $field: $type,)*
        }

        #[cfg(feature = "server")]
        impl From<&ecan_cia402::AxisStatus> for AxisState {
            fn from($status: &ecan_cia402::AxisStatus) -> Self {
                Self { $($field: $value,)* }
            }
        }
    };
}

axis_state! { status;
    /// Index of the gateway.
    gateway: u16 = status.address.slave as u16;
    /// Channel, 0 to 3.
    channel: u8 = status.address.channel;
    /// Node-ID of the drive.
    node_id: u8 = status.address.node.get();
    /// Phase of the axis.
    phase: String = status.phase.to_string();
    /// Time since the phase began, in nanoseconds.
    elapsed_ns: u64 = u64::try_from(status.elapsed.as_nanos()).unwrap_or(u64::MAX);
    /// Failure of the last command.
    error: Option<String> = text(status.error);
    /// Mode of operation.
    mode: String = status.mode.to_string();
    /// The last statusword.
    statusword: Option<u16> = status.statusword.map(|word| word.0);
    /// State in the statusword.
    drive_state: Option<String> = text(status.drive_state());
    /// Error code of the last emergency message; 0 for none.
    error_code: u16 = status.error_code;
    /// Last NMT state of the node.
    nmt_state: Option<String> = text(status.nmt_state);
    /// State of the heartbeat.
    heartbeat: String = status.heartbeat.to_string();
    /// The last usable actual position.
    actual: Option<i32> = status.actual;
    /// Age of the actual position in cycles; 65535 is more or never.
    actual_age: u16 = status.actual_age;
    /// The actual position in degrees.
    actual_degrees: Option<f64> = status.actual_degrees();
    /// The last target sent.
    target: Option<i32> = status.target;
    /// Target minus actual position.
    following_error: Option<i64> = status.following_error();
    /// Reason of a hold.
    hold_reason: Option<String> = text(status.hold_reason);
    /// Cause of a stop.
    stop_cause: Option<String> = text(status.stop_cause);
    /// The drive is configured.
    is_configured: bool = status.is_configured;
    /// The axis follows targets.
    is_running: bool = status.is_running;
    /// A halted axis is at rest.
    is_at_rest: bool = status.is_at_rest;
    /// The drive has reached its target.
    is_target_reached: bool = status.is_target_reached;
    /// The axis has stopped.
    is_stopped: bool = status.is_stopped;
    /// A recovery continues.
    is_recovering: bool = status.is_recovering;
}

#[cfg(feature = "server")]
fn text(value: Option<impl ToString>) -> Option<String> {
    value.map(|value| value.to_string())
}

fn optional(value: Option<impl ToString>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| value.to_string())
}

impl AxisState {
    /// Lines for people, with a text of the errors of the axis and of its drive.
    pub fn details(&self, error: Option<String>) -> Vec<String> {
        let Self { gateway, channel, node_id, phase, elapsed_ns, .. } = self;
        let drive = match (self.statusword, &self.drive_state) {
            (Some(word), Some(state)) => format!("drive {state} (statusword 0x{word:04X})"),
            (Some(word), None) => format!("drive in an unknown state (statusword 0x{word:04X})"),
            (None, _) => "no statusword received".to_owned(),
        };
        let actual = match (self.actual, self.actual_degrees, self.actual_age) {
            (None, ..) => "no actual position received".to_owned(),
            (Some(actual), degrees, age) => {
                let degrees =
                    degrees.map_or_else(String::new, |degrees| format!(" ({degrees:.3} degrees)"));
                let age = match age {
                    0 => String::new(),
                    u16::MAX => ", age above 65534 cycles".to_owned(),
                    age => format!(", age {age} cycles"),
                };
                format!("actual {actual} steps{degrees}{age}")
            }
        };
        // The phase usually has them.
        let reason = |name: &str, text: &Option<String>| {
            let text = text.as_ref().filter(|text| !phase.contains(text.as_str()))?;
            Some(format!("{name}: {text}"))
        };
        let nmt = self.nmt_state.as_deref().unwrap_or("unknown");
        let elapsed_s = *elapsed_ns as f64 / 1e9;
        let (target, following) = (optional(self.target), optional(self.following_error));
        let lines = [
            Some(format!(
                "gateway {gateway} can{channel} node {node_id}, for {elapsed_s:.1} s: {phase}"
            )),
            error.map(|text| format!("error: {text}")),
            Some(format!("{drive}, NMT {nmt}, heartbeat {}", self.heartbeat)),
            Some(actual),
            Some(format!("target {target}, following error {following}")),
            reason("hold", &self.hold_reason),
            reason("stop", &self.stop_cause),
        ];
        lines.into_iter().flatten().collect()
    }
}
