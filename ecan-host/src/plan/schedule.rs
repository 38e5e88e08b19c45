//! How much time scheduled frames have to get to their phase (manual 8.4, 13.8).

use super::finding::{PlanRefusal, PlanWarning};
use crate::config::DcSync;

/// Smallest offset that the manual recommends to begin with (13.8), in nanoseconds.
pub const RECOMMENDED_OFFSET_NS: u32 = 100_000;
/// An image that arrives less than this before Sync0 is warned of, in nanoseconds.
const THIN_NS: u64 = 100_000;

/// When the scheduled frames of one slave's image arrive and leave. Times count from the start of
/// the cycle that sends the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ScheduleMargin {
    /// Slave index.
    pub slave: usize,
    /// The image has arrived, in nanoseconds.
    pub arrives_ns: u64,
    /// The Sync0 pulse behind that, in nanoseconds.
    pub pulse_ns: u64,
    /// The phase: when the frames leave, in nanoseconds.
    pub leaves_ns: u64,
}

impl ScheduleMargin {
    pub(super) fn new(
        slave: usize,
        arrives_ns: u64,
        dc: Option<DcSync>,
        offset_ns: u32,
    ) -> Result<Self, PlanRefusal> {
        let dc = dc.ok_or(PlanRefusal::ScheduleWithoutSync0 { offset_ns })?;
        if offset_ns >= dc.cycle_ns {
            return Err(PlanRefusal::ScheduleBeyondPeriod { offset_ns, sync0_ns: dc.cycle_ns });
        }
        // infallible: the period is above the offset, so not 0
        let period = u64::from(dc.cycle_ns).max(1);
        let first = u64::from(dc.shift_ns);
        let passed = arrives_ns.saturating_add(period).saturating_sub(first) / period;
        let pulse_ns = passed.saturating_mul(period).saturating_add(first);
        let leaves_ns = pulse_ns.saturating_add(offset_ns.into());
        Ok(Self { slave, arrives_ns, pulse_ns, leaves_ns })
    }

    /// Nanoseconds by which an image may come later without missing its Sync0 pulse.
    pub fn to_pulse_ns(&self) -> u64 {
        self.pulse_ns.saturating_sub(self.arrives_ns)
    }

    /// Nanoseconds between the arrival and the phase.
    pub fn to_phase_ns(&self) -> u64 {
        self.leaves_ns.saturating_sub(self.arrives_ns)
    }

    pub(super) fn warning(&self, sync0_ns: u32) -> Option<PlanWarning> {
        let (slave, to_pulse_ns) = (self.slave, self.to_pulse_ns());
        (to_pulse_ns < THIN_NS).then_some(PlanWarning::ThinSchedule {
            slave,
            to_pulse_ns,
            sync0_ns,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn margin(arrives_ns: u64, shift_ns: u32) -> (u64, u64) {
        let dc = Some(DcSync::new(1_000_000, shift_ns));
        let margin = ScheduleMargin::new(0, arrives_ns, dc, 100_000).unwrap();
        (margin.pulse_ns, margin.to_phase_ns())
    }

    #[test]
    fn frames_leave_behind_the_pulse_that_follows_their_arrival() {
        assert_eq!(margin(70_000, 700_000), (700_000, 730_000));
        assert_eq!(margin(70_000, 0), (1_000_000, 1_030_000));
        assert_eq!(margin(700_000, 700_000), (1_700_000, 1_100_000), "strictly behind");
        assert_eq!(margin(699_999, 700_000), (700_000, 100_001));
        assert_eq!(margin(2_500_000, 700_000), (2_700_000, 300_000));
        // A shift beyond the period, which the check refuses, is no reason to panic: the pulse is
        // at 300 us, too.
        assert_eq!(margin(0, 1_300_000), (1_300_000, 1_400_000));
    }
}
