//! Status of an axis: its phase, its errors and its counters.

use std::fmt;
use std::time::Duration;

use ecan_canopen::{DriveState, NodeAddress, OperatingMode, Progress, Statusword, StepFailure};
use thiserror::Error;

use super::power::StopCause;
use crate::guard::terms::{Actual, Decision, GuardState, HoldReason, TargetRejection, WaitReason};

ecan_protocol::text_enum! {
    /// Kind of the failure of the last command to an axis: an [`AxisError`] without its details.
    #[non_exhaustive]
    pub enum AxisErrorKind: u8;
    /// The configuration failed.
    Setup = 1, "configuration failed";
    /// The drive restarted and lost its configuration.
    Restarted = 2, "the drive restarted";
    /// The drive did not reach Operation Enabled in time.
    EnableTimedOut = 3, "not enabled in time";
    /// The drive has a fault.
    Fault = 4, "the drive is in fault";
    /// The drive stays in fault after a reset.
    ResetFailed = 5, "the drive stays in fault after a reset";
    /// The axis held.
    Held = 6, "the axis held";
    /// Homing ended without a home position.
    Homing = 7, "homing failed";
    /// Homing did not end in time.
    HomingTimedOut = 8, "homing timed out";
    /// The mode could not be changed.
    Mode = 9, "the drive rejected a mode";
    /// The drive did not switch its power off in time.
    NotDisabled = 10, "the drive does not switch off";
    /// The drive does not answer and may be moving.
    NotStopped = 11, "the drive does not answer and may be moving";
}

impl From<AxisError> for AxisErrorKind {
    fn from(error: AxisError) -> Self {
        match error {
            AxisError::Setup(_) => Self::Setup,
            AxisError::Restarted => Self::Restarted,
            AxisError::EnableTimedOut { .. } => Self::EnableTimedOut,
            AxisError::Fault { .. } => Self::Fault,
            AxisError::ResetFailed { .. } => Self::ResetFailed,
            AxisError::Held(_) => Self::Held,
            AxisError::Homing(_) => Self::Homing,
            AxisError::HomingTimedOut { .. } => Self::HomingTimedOut,
            AxisError::Mode(_) => Self::Mode,
            AxisError::NotDisabled { .. } => Self::NotDisabled,
            AxisError::NotStopped { .. } => Self::NotStopped,
        }
    }
}

ecan_protocol::text_enum! {
    /// State of a started homing, by the statusword.
    pub enum HomingState;
    Running = "looking for the home position";
    /// Interrupted or not begun: at rest without a home position.
    Waiting = "interrupted or not started";
    /// The home position is found, the axis still moves.
    Found = "found, not at rest yet";
    Attained = "home position attained";
    Failing = "homing error, still moving";
    Failed = "homing error";
}

impl HomingState {
    /// Decodes bits 10, 12 and 13 of the statusword of a drive in homing mode.
    pub fn of(status: Statusword) -> Self {
        let rests = status.has(Statusword::TARGET_REACHED);
        match (status.has(Statusword::MODE_13), status.has(Statusword::MODE_12), rests) {
            (true, _, false) => Self::Failing,
            (true, _, true) => Self::Failed,
            (false, false, false) => Self::Running,
            (false, false, true) => Self::Waiting,
            (false, true, false) => Self::Found,
            (false, true, true) => Self::Attained,
        }
    }
}

/// SYNC periods after which a TPDO counts as lost: out through the gateway,
/// over the bus and back, with the reply of one cycle lost.
const IN_FLIGHT: u32 = 8;

/// Counters of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct AxisStatistics {
    /// Targets handed to the gateway, the first ones included.
    pub targets_sent: u64,
    /// Times that the axis was activated while enabled: first targets.
    pub activations: u64,
    /// Targets of the application that were rejected, for any reason.
    pub targets_rejected: u64,
    /// Targets of the application that were rejected because of the step limit.
    pub rejected_step: u64,
    /// Targets of the application that were rejected because of the following-error window.
    pub rejected_window: u64,
    /// Cycles in which a running axis got no target although one was due: an incomplete working
    /// counter, an unconfirmed image, no space, or earlier frames that wait in the gateway.
    pub waits: u64,
    /// Times that the axis held.
    pub holds: u64,
    /// Reason of its last hold.
    pub last_hold: Option<HoldReason>,
    /// Times that the axis became uncontrolled: to be stopped, possibly moving, and silent.
    pub uncontrolled: u64,
    /// TPDOs received.
    pub tpdos: u64,
    /// TPDOs too short for the mapping.
    pub malformed_tpdos: u64,
    /// TPDOs that were not received, by the number of SYNCs sent.
    pub lost_tpdos: u64,
    /// Most cycles in a row without a usable TPDO while the axis was enabled.
    pub longest_gap: u16,
    /// Cycles with an unusable actual position: in an incomplete image, after a backlog.
    pub unusable_positions: u64,
    /// Largest distance between target and actual position while targets went out, in steps.
    pub max_following_error: u64,
    /// Targets that the gateway reported as not sent.
    pub targets_lost: u64,
    /// Feed-forwards that a limit changed.
    pub feed_forwards_limited: u64,
    /// Emergency messages.
    pub emergencies: u32,
    /// Faults of the drive.
    pub faults: u64,
    outstanding: u32,
}

impl AxisStatistics {
    pub(crate) fn count_sync(&mut self) {
        self.outstanding += 1;
        if self.outstanding > IN_FLIGHT {
            self.outstanding -= 1;
            self.lost_tpdos += 1;
        }
    }

    pub(crate) fn count_tpdo(&mut self) {
        self.tpdos += 1;
        self.outstanding = self.outstanding.saturating_sub(1);
    }

    /// The count of SYNCs and TPDOs starts over: the drive was not Operational, or is not any more.
    pub(crate) fn restart_tpdo_count(&mut self) {
        self.outstanding = 0;
    }

    pub(crate) fn count_position(&mut self, actual: Actual, had_tpdo: bool) {
        self.unusable_positions += u64::from(had_tpdo && matches!(actual, Actual::None(_)));
    }

    pub(crate) fn count_hold(&mut self, reason: HoldReason) {
        self.holds += 1;
        self.last_hold = Some(reason);
    }

    pub(crate) fn count_decision(&mut self, decision: Decision, is_running: bool) {
        match decision {
            Decision::Reject(rejection) => {
                self.targets_rejected += 1;
                match rejection {
                    TargetRejection::Step { .. } => self.rejected_step += 1,
                    TargetRejection::Window { .. } => self.rejected_window += 1,
                    _ => {}
                }
            }
            Decision::Wait(WaitReason::NotDue) => {}
            Decision::Wait(_) if is_running => self.waits += 1,
            _ => {}
        }
    }
}

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
    /// The drive is not configured: it was not yet, or it has restarted.
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
    /// At rest, or on the way to it, by [`halt`](crate::AxisHandle::halt).
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
            Some(AxisError::Setup(failure)) if self.phase == AxisPhase::SetupFailed => {
                write!(f, " ({failure})")
            }
            Some(error) => write!(f, " ({error})"),
        }
    }
}

/// Report of an axis: its counters, its phase, and the failure of its last command.
#[derive(Debug)]
pub(crate) struct AxisReport {
    pub(crate) statistics: AxisStatistics,
    pub(crate) error: Option<AxisError>,
    phase: AxisPhase,
    phase_since_ns: u64,
}

impl AxisReport {
    pub(crate) fn new() -> Self {
        Self {
            statistics: AxisStatistics::default(),
            error: None,
            phase: AxisPhase::NotConfigured,
            phase_since_ns: 0,
        }
    }

    pub(crate) fn phase(&self) -> AxisPhase {
        self.phase
    }

    pub(crate) fn phase_since_ns(&self) -> u64 {
        self.phase_since_ns
    }

    /// Time since the phase began.
    pub(crate) fn elapsed(&self, now_ns: u64) -> Duration {
        Duration::from_nanos(now_ns.saturating_sub(self.phase_since_ns))
    }

    /// Stores the phase of the axis with this index.
    #[inline]
    pub(crate) fn set_phase(&mut self, axis: usize, phase: AxisPhase, now_ns: u64) {
        if phase == self.phase {
            return;
        }
        let is_uncontrolled = |phase| matches!(phase, AxisPhase::Uncontrolled(_));
        if is_uncontrolled(phase) && !is_uncontrolled(self.phase) {
            self.statistics.uncontrolled += 1;
            tracing::warn!(axis, "axis {axis}: {phase}");
        }
        self.phase = phase;
        self.phase_since_ns = now_ns;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ecan_canopen::NodeId;

    #[test]
    fn missing_tpdo_is_counted_once() {
        let mut statistics = AxisStatistics::default();
        for n in 0..100 {
            statistics.count_sync();
            // Two cycles late, and the one of cycle 50 is lost.
            if n >= 2 && n != 52 {
                statistics.count_tpdo();
            }
        }
        assert_eq!(statistics.lost_tpdos, 0, "it may still be under way");
        for _ in 0..IN_FLIGHT {
            statistics.count_sync();
        }
        assert_eq!(statistics.lost_tpdos, 3, "two under way and the lost one");
    }

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
