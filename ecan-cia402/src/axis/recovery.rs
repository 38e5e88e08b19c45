//! Recovery of one axis: from a hold, a stop, a fault or a lost configuration back to its targets.

use super::event::AxisEvent;
use super::setup::SetupState;
use super::status::AxisError;

/// Most attempts to enable: a hold on the path may occur again while the bus comes back.
const ENABLE_ATTEMPTS: u8 = 3;

/// Most configurations: the drive may restart while it is configured.
const CONFIGURE_ATTEMPTS: u8 = 2;

/// A recovery in progress. It issues the commands that an application would, each when the one before
/// is complete.
///
/// | the axis | step |
/// | --- | --- |
/// | is being stopped, configured, reset or enabled | wait |
/// | is not configured | configure; not more than twice |
/// | has a fault | reset; a fault after that ends the recovery |
/// | holds, has stopped, or has no command | enable; not more than three times, and not after a timeout |
/// | is halted | resume |
/// | follows targets | the recovery is complete |
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Recovery {
    configured: u8,
    enabled: u8,
    is_reset: bool,
}

/// Situation of an axis in a cycle of its recovery.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RecoverySituation {
    pub(crate) setup: SetupState,
    pub(crate) error: Option<AxisError>,
    pub(crate) is_in_fault: bool,
    pub(crate) is_resetting: bool,
    /// The axis has no command, or has stopped.
    pub(crate) may_enable: bool,
    /// The drive is enabled and the guard follows targets.
    pub(crate) is_active: bool,
}

/// Step of a recovery.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum RecoveryStep {
    Wait,
    Command(AxisEvent),
    /// The recovery ends with a command, or without one.
    End(Option<AxisEvent>),
}

impl Recovery {
    pub(crate) fn step(&mut self, situation: &RecoverySituation) -> RecoveryStep {
        match situation.setup {
            SetupState::Requested { .. } | SetupState::Configuring | SetupState::SettingMode(_) => {
                RecoveryStep::Wait
            }
            SetupState::Unconfigured | SetupState::Failed => self.configure(situation),
            SetupState::Complete if situation.is_in_fault => self.reset(situation),
            SetupState::Complete if situation.may_enable => self.enable(situation),
            SetupState::Complete if situation.is_active => {
                RecoveryStep::End(Some(AxisEvent::Resume))
            }
            SetupState::Complete => RecoveryStep::Wait,
        }
    }

    fn configure(&mut self, situation: &RecoverySituation) -> RecoveryStep {
        // A drive that does not answer and may be moving is not configured.
        let is_rejected = matches!(situation.error, Some(AxisError::NotStopped { .. }));
        if self.configured >= CONFIGURE_ATTEMPTS || self.configured > 0 && is_rejected {
            return RecoveryStep::End(None);
        }
        self.configured += 1;
        RecoveryStep::Command(AxisEvent::Configure)
    }

    fn reset(&mut self, situation: &RecoverySituation) -> RecoveryStep {
        if situation.is_resetting {
            return RecoveryStep::Wait;
        }
        if self.is_reset {
            return RecoveryStep::End(None);
        }
        self.is_reset = true;
        RecoveryStep::Command(AxisEvent::ResetFault)
    }

    fn enable(&mut self, situation: &RecoverySituation) -> RecoveryStep {
        let has_timed_out = matches!(situation.error, Some(AxisError::EnableTimedOut { .. }));
        if self.enabled >= ENABLE_ATTEMPTS || self.enabled > 0 && has_timed_out {
            return RecoveryStep::End(None);
        }
        self.enabled += 1;
        RecoveryStep::Command(AxisEvent::Enable)
    }
}
