use super::config::Sync0;
use super::dc_clock::LinearClock;

/// Sync0 pulses (manual 8.4), equidistant in the slave's system time; results are simulated time.
#[derive(Clone, Copy, Debug)]
pub(super) struct PulseTrain {
    /// In system time; `None` if the start had passed when Sync0 was set: no pulse ever comes.
    first_system_ns: Option<u64>,
    cycle_ns: u64,
    line: LinearClock,
}

impl PulseTrain {
    pub(super) fn new(sync0: Sync0, line: LinearClock, now: u64) -> Self {
        let first = sync0.start_ns.saturating_add_signed(i64::from(sync0.shift_ns));
        Self {
            first_system_ns: (first >= line.system(now)).then_some(first),
            cycle_ns: u64::from(sync0.cycle_ns).max(1),
            line,
        }
    }

    /// The slave's clock was corrected or set. If it jumps over the first pulse, none ever comes.
    pub(super) fn set_line(&mut self, line: LinearClock, now: u64) {
        let has_begun = self.pulses_until(now) > 0;
        self.line = line;
        let is_jumped_over =
            !has_begun && self.first_system_ns.is_some_and(|first| first < line.system(now));
        if is_jumped_over {
            self.first_system_ns = None;
        }
    }

    pub(super) fn first_ns(self) -> u64 {
        self.first_system_ns.map_or(u64::MAX, |first| self.line.simulated(first))
    }

    pub(super) fn cycle_ns(self) -> u64 {
        self.cycle_ns
    }

    /// The first pulse strictly after `now`.
    pub(super) fn next_after(self, now: u64) -> u64 {
        self.next_system_after(now).map_or(u64::MAX, |next| self.line.simulated(next))
    }

    /// The same in system time; `None` if no pulse comes.
    pub(super) fn next_system_after(self, now: u64) -> Option<u64> {
        let passed = self.pulses_until(now).checked_mul(self.cycle_ns)?;
        self.first_system_ns?.checked_add(passed)
    }

    fn since_first(self, now: u64) -> Option<u64> {
        self.line.system(now).checked_sub(self.first_system_ns?)
    }

    /// Number of pulses from the first one up to and including `now`.
    pub(super) fn pulses_until(self, now: u64) -> u64 {
        self.since_first(now).map_or(0, |ns| (ns / self.cycle_ns).saturating_add(1))
    }

    /// Distance from the last pulse at or before `now`; 0 before the first one.
    pub(super) fn phase(self, now: u64) -> u64 {
        self.since_first(now).map_or(0, |ns| ns % self.cycle_ns)
    }
}
