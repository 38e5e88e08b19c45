//! State of one axis of a drive, for tests.

use ecan_canopen::{DriveState, OperatingMode, Statusword};

use super::axis_unit::AxisUnit;
use super::device::Device;
use super::history::TargetHistory;
use super::trace::DriveTrace;

/// State of one axis of a [`Drive`](super::Drive): the actual state, not what the drive sent.
#[derive(Clone, Copy, Debug)]
pub struct DriveAxis<'a> {
    device: &'a Device,
    unit: &'a AxisUnit,
}

impl<'a> DriveAxis<'a> {
    pub(super) const fn new(device: &'a Device, unit: &'a AxisUnit) -> Self {
        Self { device, unit }
    }

    /// State of the power stage.
    #[must_use]
    pub const fn state(&self) -> DriveState {
        self.unit.axis.power.state
    }

    /// Present statusword.
    #[must_use]
    pub fn statusword(&self) -> Statusword {
        self.device.statusword(self.unit)
    }

    /// Active mode of operation; `None` is no mode.
    #[must_use]
    pub const fn mode(&self) -> Option<OperatingMode> {
        self.unit.axis.mode
    }

    /// Actual position (0x6064) in increments.
    #[must_use]
    pub fn position(&self) -> i32 {
        self.unit.axis.position()
    }

    /// Velocity in increments per second.
    #[must_use]
    pub const fn velocity(&self) -> f64 {
        self.unit.axis.motor.velocity
    }

    /// The received targets.
    #[must_use]
    pub const fn targets(&self) -> &'a TargetHistory {
        &self.unit.axis.history
    }

    /// The last events.
    #[must_use]
    pub const fn trace(&self) -> &'a DriveTrace {
        &self.unit.axis.trace
    }
}
