//! Distributed clock of the slave and the Sync0 pulses that it generates.

use super::config::Sync0;
use super::dc_clock::DcClock;
use super::pulse_train::PulseTrain;

#[derive(Clone, Debug)]
pub(super) struct DistributedClock {
    pub(super) clock: DcClock,
    pub(super) sync0: Option<Sync0>,
    pub(super) pulses: Option<PulseTrain>,
    /// Sync1 is active, too (0x0981 bit 2).
    pub(super) has_sync1: bool,
}

impl DistributedClock {
    pub(super) fn new(drift_ppb: i32) -> Self {
        Self { clock: DcClock::new(drift_ppb), sync0: None, pulses: None, has_sync1: false }
    }

    pub(super) fn set_sync0(&mut self, sync0: Option<Sync0>, now: u64) {
        self.sync0 = sync0;
        self.pulses = sync0.map(|sync0| PulseTrain::new(sync0, self.clock.line, now));
    }

    /// Changes the clock; the pulses follow it.
    pub(super) fn change(&mut self, now: u64, change: impl FnOnce(&mut DcClock)) {
        change(&mut self.clock);
        let line = self.clock.line;
        if let Some(pulses) = &mut self.pulses {
            pulses.set_line(line, now);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pulses_follow_a_changed_clock() {
        let mut clock = DistributedClock::new(0);
        clock.set_sync0(Some(Sync0 { start_ns: 1_000, cycle_ns: 1_000, shift_ns: 0 }), 0);
        assert_eq!(clock.pulses.map(|pulses| pulses.next_after(2_500)), Some(3_000));
        clock.change(2_500, |clock| clock.jump(100, 2_500));
        assert_eq!(clock.pulses.map(|pulses| pulses.next_after(2_500)), Some(2_900));
    }
}
