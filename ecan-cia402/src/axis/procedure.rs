//! A command that takes an axis through several stages: mode change, homing.

use std::time::Duration;

use ecan_canopen::OperatingMode;

use super::homing::{HomingConfig, HomingWatch};
use super::script::{Script, axis_script, mode_steps};
use super::status::AxisError;
use crate::guard::terms::HoldReason;

/// Stages of a mode change and of homing, in order. The mode is only changed while the drive is
/// not enabled: an enabled drive would go from the target of one mode to an old one of the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stage {
    /// The axis comes to rest and is switched off.
    Disabling,
    /// Parameters and mode are written.
    Writing(Script),
    /// Homing: the drive is enabled.
    Enabling,
    /// Homing: the start bit is set.
    Homing(HomingWatch),
    /// Homing: the drive is switched off, so that the mode can change back.
    Ending,
    /// Homing: the previous mode is written.
    Restoring(Script),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Procedure {
    /// Mode in force at the end.
    pub(crate) mode: OperatingMode,
    pub(crate) mode_before: OperatingMode,
    /// Homing, before that.
    pub(crate) homing: Option<HomingConfig>,
    /// True if the axis followed targets before and is enabled again afterwards.
    pub(crate) then_enable: bool,
    pub(crate) stage: Stage,
    pub(crate) error: Option<AxisError>,
    stage_since_ns: u64,
}

impl Procedure {
    /// Creates a change from one mode to another, or, with homing, back to the same.
    pub(crate) fn new(
        (mode_before, mode): (OperatingMode, OperatingMode),
        homing: Option<HomingConfig>,
        then_enable: bool,
        now_ns: u64,
    ) -> Self {
        let (stage, stage_since_ns) = (Stage::Disabling, now_ns);
        Self { mode, mode_before, homing, then_enable, stage, error: None, stage_since_ns }
    }

    /// Steps for an axis of the node.
    pub(crate) fn script(&self, axis: u8) -> Script {
        match &self.homing {
            Some(homing) => homing.script(axis),
            None => axis_script(axis, mode_steps(self.mode)),
        }
    }

    pub(crate) fn enter(&mut self, stage: Stage, now_ns: u64) {
        self.stage = stage;
        self.stage_since_ns = now_ns;
    }

    /// The axis holds. Before the drive is off, this ends the procedure: later it could enable a drive
    /// that stopped without a command.
    pub(crate) fn held(&mut self, reason: HoldReason) {
        if self.stage == Stage::Disabling {
            self.error = Some(AxisError::Held(reason));
        }
    }

    pub(crate) fn waited(&self, now_ns: u64) -> Duration {
        Duration::from_nanos(now_ns.saturating_sub(self.stage_since_ns))
    }
}
