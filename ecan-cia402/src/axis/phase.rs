//! Phase, progress and error of an axis.

use std::fmt;
use std::time::Duration;

use ecan_canopen::{DriveState, NodeAddress, OperatingMode, Progress, StepFailure};
use thiserror::Error;

use super::homing::HomingState;
use super::stop::StopCause;
use crate::guard::input::HoldReason;
use crate::guard::terms::GuardState;

/// Failure of the last command to an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum AxisError {
    /// The configuration failed.
    #[error("configuration failed: {0}")]
    Setup(StepFailure),
    /// The drive restarted and lost its configuration.
    #[error("the drive restarted")]
    Restarted,
    /// The drive did not reach Operation Enabled in time.
    #[error("not enabled after {} ms: {guard}, the drive is {}", waited.as_millis(), StateText(*state))]
    EnableTimedOut {
        /// State of the drive.
        state: Option<DriveState>,
        /// State of the guard.
        guard: GuardState,
        /// Waiting time.
        waited: Duration,
    },
    /// The drive has a fault.
    #[error("the drive is in fault{}", CodeText(*error_code))]
    Fault {
        /// Error code of its last emergency message; 0 without one.
        error_code: u16,
    },
    /// The drive stays in fault after a reset.
    #[error("the drive stays in fault after a reset{}", CodeText(*error_code))]
    ResetFailed {
        /// Error code of its last emergency message; 0 without one.
        error_code: u16,
    },
    /// The axis held.
    #[error("{0}")]
    Held(HoldReason),
    /// Homing ended without a home position.
    #[error("homing: {0}")]
    Homing(HomingState),
    /// Homing did not end in time.
    #[error("homing is not done after {} ms: {state}", waited.as_millis())]
    HomingTimedOut {
        /// State in the statusword.
        state: HomingState,
        /// Waiting time.
        waited: Duration,
    },
    /// The mode could not be changed.
    #[error(transparent)]
    Mode(StepFailure),
    /// The drive was enabled when it reported last, does not answer, and cannot be configured. The
    /// stop is repeated until it answers.
    #[error("the drive does not answer and may be moving: {}; the stop is repeated", StateText(*state))]
    NotStopped {
        /// State that it reported last.
        state: Option<DriveState>,
    },
    /// The drive did not switch its power off in time.
    #[error("the drive does not switch off: {}", StateText(*state))]
    NotDisabled {
        /// State of the drive.
        state: Option<DriveState>,
    },
}

struct StateText(Option<DriveState>);

impl fmt::Display for StateText {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(state) => state.fmt(f),
            None => f.write_str("in an unknown state"),
        }
    }
}

struct CodeText(u16);

impl fmt::Display for CodeText {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            0 => Ok(()),
            code => {
                write!(f, ", error code 0x{code:04X}")?;
                match ecan_canopen::error_code_text(code) {
                    Some(text) => write!(f, " ({text})"),
                    None => Ok(()),
                }
            }
        }
    }
}

/// Phase of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum AxisPhase {
    /// Not configured yet, or no longer: the drive restarted.
    NotConfigured,
    /// The configuration steps run.
    Configuring,
    /// The mode is written, and the drive must display it.
    SettingMode(OperatingMode),
    /// The configuration failed.
    SetupFailed,
    /// Configured; no command.
    Standby,
    /// The actual position is being established; with the reason of a delay.
    Reading(GuardState, Option<HoldReason>),
    /// The actual position is known; the drive is not enabled.
    Ready,
    /// The drive is being brought to Operation Enabled.
    Enabling(Option<DriveState>),
    /// Follows targets.
    Running,
    /// At rest, or on the way to it, by [`halt`](crate::Cia402::halt).
    Halted,
    /// Gets no targets until it is activated again.
    Holding(HoldReason),
    /// The drive is being stopped.
    Stopping(StopCause),
    /// The drive has stopped: it is off, or at rest in Quick Stop Active.
    Stopped(StopCause),
    /// The drive is to be stopped, was enabled or unknown when it reported last, and reports nothing:
    /// it may be moving. The stop is repeated until it reports that it obeyed.
    Uncontrolled(StopCause),
    /// First contact: the state of the drive is read before anything else is sent.
    Inspecting,
    /// A fault is being reset.
    ResettingFault,
    /// The drive has a fault.
    Fault,
    /// The mode is being changed.
    ChangingMode(OperatingMode),
    /// Before and after homing: disabling, enabling, writing parameters.
    PreparingHoming,
    /// Homing.
    Homing(HomingState),
}

impl fmt::Display for AxisPhase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotConfigured => f.write_str("not configured"),
            Self::Configuring => f.write_str("being configured"),
            Self::SettingMode(mode) => write!(f, "waiting for mode {mode}"),
            Self::SetupFailed => f.write_str("configuration failed"),
            Self::Standby => f.write_str("configured"),
            Self::Reading(guard, None) => guard.fmt(f),
            Self::Reading(guard, Some(reason)) => write!(f, "{guard}: {reason}"),
            Self::Ready => f.write_str("ready at its actual position"),
            Self::Enabling(state) => write!(f, "being enabled, {}", StateText(*state)),
            Self::Running => f.write_str("following targets"),
            Self::Halted => f.write_str("halted"),
            Self::Holding(reason) => write!(f, "holding: {reason}"),
            Self::Stopping(cause) => write!(f, "being stopped: {cause}"),
            Self::Stopped(cause) => write!(f, "stopped: {cause}"),
            Self::Uncontrolled(cause) => {
                write!(f, "uncontrolled, may be moving; being stopped: {cause}")
            }
            Self::Inspecting => f.write_str("state of the drive being read"),
            Self::ResettingFault => f.write_str("fault being reset"),
            Self::Fault => f.write_str("fault"),
            Self::ChangingMode(mode) => write!(f, "changing to mode {mode}"),
            Self::PreparingHoming => f.write_str("preparing homing"),
            Self::Homing(state) => write!(f, "homing: {state}"),
        }
    }
}

/// Progress of an axis: phase, time in it, and error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AxisProgress {
    /// Index in the axis table.
    pub axis: usize,
    /// Address of the drive.
    pub address: NodeAddress,
    /// Phase.
    pub phase: AxisPhase,
    /// Time since the phase began.
    pub elapsed: Duration,
    /// Progress of the configuration, while it runs.
    pub setup: Option<Progress>,
    /// Failure of the last command.
    pub error: Option<AxisError>,
}

/// `axis 2, node 5 (slave 0, channel 1): being enabled, switched on, for 120 ms`, without the time in the
/// first millisecond. A hold is followed by what continues it.
impl fmt::Display for AxisProgress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "axis {}, ", self.axis)?;
        match (&self.setup, self.phase) {
            (Some(setup), AxisPhase::Configuring) => setup.fmt(f)?,
            _ => {
                write!(f, "{}: {}", self.address, self.phase)?;
                match self.elapsed.as_millis() {
                    0 => {}
                    ms => write!(f, ", for {ms} ms")?,
                }
            }
        }
        if let AxisPhase::Holding(reason) = self.phase {
            f.write_str("; next: ")?;
            if let Some(remedy) = reason.remedy() {
                write!(f, "{remedy}, then ")?;
            }
            f.write_str("enable the axis again")?;
        }
        match &self.error {
            Some(AxisError::Held(_)) | None => Ok(()),
            Some(error) => write!(f, " ({error})"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ecan_canopen::NodeId;

    #[test]
    fn progress_names_axis_phase_and_time() {
        let node = NodeId::new(5).unwrap();
        let progress = AxisProgress {
            axis: 2,
            address: NodeAddress { slave: 0, channel: 1, node },
            phase: AxisPhase::Enabling(Some(DriveState::SwitchedOn)),
            elapsed: Duration::from_millis(120),
            setup: None,
            error: None,
        };
        let text = progress.to_string();
        assert_eq!(
            text,
            "axis 2, node 5 (slave 0, channel 1): being enabled, switched on, for 120 ms"
        );
        let held = |elapsed| AxisProgress {
            phase: AxisPhase::Holding(HoldReason::GatewayLost),
            elapsed: Duration::from_millis(elapsed),
            ..progress
        };
        let start = "axis 2, node 5 (slave 0, channel 1): holding: the gateway was lost";
        let next = "; next: wait until the gateway is ready, then enable the axis again";
        assert_eq!(held(0).to_string(), format!("{start}{next}"));
        assert_eq!(held(7).to_string(), format!("{start}, for 7 ms{next}"));
        let commanded = AxisPhase::Holding(HoldReason::Commanded);
        let text = AxisProgress { phase: commanded, ..progress }.to_string();
        assert!(text.ends_with("holding: commanded, for 120 ms; next: enable the axis again"));
        let error = AxisError::Fault { error_code: 0x8611 };
        assert!(error.to_string().contains("0x8611"), "{error}");
    }
}
