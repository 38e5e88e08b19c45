//! Next step of an axis in a stop of all axes on their path.

use super::axis::Axis;
use super::ramp::{FRACTION_BITS, Profile};
use crate::guard::terms::Decision;

/// Next step of an axis on the path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PathStep {
    Ready,
    /// The axis gets no target in this cycle.
    Waits,
    /// The axis is no longer part of the stop, or cannot make the step.
    Left,
}

impl Axis {
    /// Largest rate in units per target.
    pub(crate) fn most_rate(&self) -> i128 {
        i128::from(self.guard.limits().step) << FRACTION_BITS
    }

    /// Returns whether the axis can make the next step of the common profile.
    pub(crate) fn path_step(&self, common: Profile) -> PathStep {
        let next = self
            .target()
            .zip(self.targets.on_path(common))
            .and_then(|(last, ramp)| self.config.range.add(last, ramp.step()));
        let Some(next) = next else { return PathStep::Left };
        match self.guard.evaluate(Some(next)) {
            Decision::Target(_) => PathStep::Ready,
            Decision::Wait(_) => PathStep::Waits,
            _ => PathStep::Left,
        }
    }
}
