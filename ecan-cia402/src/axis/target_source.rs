//! Source of the targets of an axis: the application, or the host's own ramp.

use super::ramp::Ramp;
use crate::guard::position_range::PositionRange;
use crate::guard::terms::TargetKind;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct TargetSource {
    pub(crate) requested: Option<i32>,
    /// Whether the axis is brought to rest, or rests, instead of following the application.
    pub(crate) is_halted: bool,
    pub(crate) ramp: Ramp,
}

impl TargetSource {
    pub(crate) fn new(ramp: u32) -> Self {
        Self { requested: None, is_halted: false, ramp: Ramp::new(ramp) }
    }

    pub(crate) fn clear(&mut self) {
        self.requested = None;
        self.is_halted = false;
        self.ramp.stop();
    }

    pub(crate) fn halt(&mut self) {
        self.is_halted = true;
        self.requested = None;
    }

    /// Returns the next target after `last`, and the step of the host's own ramp that makes it.
    /// `own_step` is the step that the host is to make by itself; a rate returns to 0 by at most
    /// `rate_limit`.
    pub(crate) fn next(
        &self,
        kind: TargetKind,
        range: PositionRange,
        last: i32,
        own_step: Option<i32>,
        rate_limit: u32,
    ) -> (Option<i32>, Option<i64>) {
        let own_step = if self.is_halted { Some(0) } else { own_step };
        match (kind, own_step) {
            (TargetKind::Position, Some(goal)) => {
                let step = self.ramp.next(goal.into());
                match range.add(last, step) {
                    Some(next) => (Some(next), Some(step)),
                    // The counter ends here.
                    None => (Some(last), Some(0)),
                }
            }
            (TargetKind::Rate, _) if self.is_halted => {
                let limit = i32::try_from(rate_limit).unwrap_or(i32::MAX);
                (Some(last - last.clamp(-limit, limit)), None)
            }
            _ => (self.requested, None),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LINEAR: PositionRange = PositionRange::Linear;

    #[test]
    fn halted_rate_returns_to_zero_by_its_limit() {
        let mut source = TargetSource::new(10);
        source.requested = Some(500);
        assert_eq!(source.next(TargetKind::Rate, LINEAR, 120, None, 50), (Some(500), None));
        source.halt();
        assert_eq!(source.next(TargetKind::Rate, LINEAR, 120, None, 50), (Some(70), None));
        assert_eq!(source.next(TargetKind::Rate, LINEAR, -20, None, 50), (Some(0), None));
    }

    #[test]
    fn own_step_uses_the_ramp_and_ends_with_the_counter() {
        let source = TargetSource::new(10);
        let next = |last| source.next(TargetKind::Position, LINEAR, last, Some(100), 0);
        assert_eq!(next(5), (Some(15), Some(10)));
        assert_eq!(next(i32::MAX), (Some(i32::MAX), Some(0)));
    }
}
