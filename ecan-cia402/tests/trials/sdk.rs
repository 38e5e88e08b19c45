//! The part of the SDK whose names the trials depend on.

use ecan_cia402::{AxisCommand, AxisPhase, AxisRef, Cia402, CommandError};

/// Phase of an axis, without the details that neither monitor nor operator distinguishes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Class {
    /// First contact with the drive.
    Inspecting,
    NotConfigured,
    Configuring,
    SetupFailed,
    /// Configured, and no command.
    Idle,
    /// The position is being established.
    Reading,
    Enabling,
    Running,
    Halted,
    /// Mode change or homing.
    Procedure,
    /// Does not follow targets until it is activated again.
    Holding,
    Stopping,
    Stopped,
    /// To be stopped, and the drive does not answer.
    Uncontrolled,
    Fault,
    Resetting,
}

impl Class {
    pub fn of(cia402: &Cia402, axis: usize) -> Self {
        match cia402.axis(axis).map(AxisRef::phase) {
            None | Some(AxisPhase::NotConfigured) => Self::NotConfigured,
            Some(AxisPhase::Inspecting) => Self::Inspecting,
            Some(AxisPhase::Configuring | AxisPhase::SettingMode(_)) => Self::Configuring,
            Some(AxisPhase::SetupFailed) => Self::SetupFailed,
            Some(AxisPhase::Standby | AxisPhase::Ready) => Self::Idle,
            Some(AxisPhase::Reading(..)) => Self::Reading,
            Some(AxisPhase::Enabling(_)) => Self::Enabling,
            Some(AxisPhase::Running) => Self::Running,
            Some(AxisPhase::Halted) => Self::Halted,
            Some(
                AxisPhase::ChangingMode(_) | AxisPhase::PreparingHoming | AxisPhase::Homing(_),
            ) => Self::Procedure,
            Some(AxisPhase::Holding(_)) => Self::Holding,
            Some(AxisPhase::Stopping(_)) => Self::Stopping,
            Some(AxisPhase::Stopped(_)) => Self::Stopped,
            Some(AxisPhase::Uncontrolled(_)) => Self::Uncontrolled,
            Some(AxisPhase::Fault) => Self::Fault,
            Some(AxisPhase::ResettingFault) => Self::Resetting,
            Some(other) => panic!("phase {other} has no class"),
        }
    }

    pub fn is_running(self) -> bool {
        matches!(self, Self::Running | Self::Halted)
    }

    /// A command runs that may enable the drive.
    pub fn is_busy(self) -> bool {
        matches!(self, Self::Procedure | Self::Enabling | Self::Reading)
    }

    /// The SDK gives no targets and does not work towards it.
    pub fn is_stopped(self) -> bool {
        !self.is_running() && !self.is_busy()
    }

    /// Name for the shares of a recovery.
    pub fn share(self) -> &'static str {
        match self {
            Self::NotConfigured | Self::SetupFailed | Self::Idle | Self::Holding => {
                "waiting for the operator"
            }
            Self::Inspecting => "first contact",
            Self::Configuring => "configuration",
            Self::Reading => "drain, reading and verification",
            Self::Enabling => "enabling",
            Self::Running => "confirmation",
            Self::Halted => "halted",
            Self::Procedure => "procedure",
            Self::Stopping | Self::Stopped => "stopping",
            Self::Uncontrolled => "uncontrolled",
            Self::Fault | Self::Resetting => "drive fault",
        }
    }
}

/// The next step back to following targets, as an application wrote it before `recover`.
pub fn next_step(
    cia402: &mut Cia402,
    axis: usize,
) -> Option<(&'static str, Result<(), CommandError>)> {
    let is_configured = cia402.axis(axis)?.is_configured();
    let (name, command) = match Class::of(cia402, axis) {
        Class::NotConfigured | Class::SetupFailed => ("configure", AxisCommand::Configure),
        Class::Fault => ("reset_fault", AxisCommand::ResetFault),
        Class::Halted => ("resume", AxisCommand::Resume),
        Class::Idle | Class::Holding | Class::Stopping | Class::Stopped | Class::Uncontrolled => {
            if is_configured {
                ("enable", AxisCommand::Enable)
            } else {
                ("configure", AxisCommand::Configure)
            }
        }
        _ => return None,
    };
    Some((name, cia402.axis_mut(axis).and_then(|mut axis| axis.command(command))))
}

/// The recovery by one call.
pub fn recover(
    cia402: &mut Cia402,
    axis: usize,
) -> Option<(&'static str, Result<(), CommandError>)> {
    match Class::of(cia402, axis) {
        Class::Running | Class::Procedure => None,
        _ if cia402.axis(axis)?.is_recovering() => None,
        _ => Some(("recover", cia402.axis_mut(axis).and_then(|mut axis| axis.recover()))),
    }
}
