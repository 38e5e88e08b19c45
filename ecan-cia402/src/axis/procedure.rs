//! What takes an axis several stages: a change of mode, homing.

use ecan_canopen::OperatingMode;

use super::homing::{HomingConfig, HomingWatch};
use super::phase::AxisError;
use super::script::{Script, mode_steps, script};

/// Stages of a change of mode and of homing, in their order. The mode is only ever changed while
/// the drive is not enabled: an enabled one would go from the target of one mode to a stale one of
/// the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stage {
    /// Rest and power off.
    Disabling,
    /// Parameters and mode by SDO.
    Writing(Script),
    /// Homing: power on.
    Enabling,
    /// Homing: the start bit is up.
    Homing(HomingWatch),
    /// Homing: power off, so that the mode can go back.
    WindingUp,
    /// Homing: the mode that was before.
    Restoring(Script),
}

/// A procedure under way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Procedure {
    /// The mode that is in force at the end.
    pub(super) mode: OperatingMode,
    /// The mode before.
    pub(super) mode_before: OperatingMode,
    /// Homing, before that.
    pub(super) homing: Option<HomingConfig>,
    /// Whether the axis was enabled and is to be so again.
    pub(super) then_enable: bool,
    pub(super) stage: Stage,
    /// What went wrong.
    pub(super) trouble: Option<AxisError>,
    /// When the stage began.
    pub(super) since_ns: u64,
}

impl Procedure {
    /// From a mode to another, or by way of homing back to the same.
    pub(super) fn new(
        (mode_before, mode): (OperatingMode, OperatingMode),
        homing: Option<HomingConfig>,
        then_enable: bool,
        now_ns: u64,
    ) -> Self {
        Self {
            mode,
            mode_before,
            homing,
            then_enable,
            stage: Stage::Disabling,
            trouble: None,
            since_ns: now_ns,
        }
    }

    /// The transfers of the first writing.
    pub(super) fn script(&self) -> Script {
        match &self.homing {
            Some(homing) => homing.script(),
            None => script(mode_steps(self.mode)),
        }
    }

    pub(super) fn enter(&mut self, stage: Stage, now_ns: u64) {
        self.stage = stage;
        self.since_ns = now_ns;
    }

    pub(super) fn waited_ms(&self, now_ns: u64) -> u64 {
        now_ns.saturating_sub(self.since_ns) / 1_000_000
    }
}
