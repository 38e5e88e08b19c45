//! Distributed clock of a slave: a drifting oscillator with the corrections of the master.

/// Share of a difference that one correction removes at once.
const STEP_SHARE: i64 = 4;
/// Share of a difference that one correction adds to the rate, per interval.
const RATE_SHARE: i64 = 64;
/// Largest step of one correction.
const MAX_STEP_NS: i64 = 2_000;
/// Largest correction of the rate, in parts per billion: 500 ppm.
const MAX_RATE_PPB: i64 = 500_000;
/// Longest interval between corrections from which the rate is estimated.
const LONGEST_INTERVAL_NS: u64 = 1_000_000_000;
/// A shorter interval counts as this one: the jitter of the master would look like a rate.
const SHORTEST_INTERVAL_NS: u64 = 500_000;

const BILLION: i128 = 1_000_000_000;

/// System time as a linear function of simulated time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct LinearClock {
    simulated_ns: u64,
    system_ns: u64,
    /// Rate of system time above that of simulated time, in parts per billion.
    rate_ppb: i64,
}

impl LinearClock {
    pub(super) fn system(self, now: u64) -> u64 {
        let passed = i128::from(now) - i128::from(self.simulated_ns);
        let time =
            i128::from(self.system_ns) + passed + passed * i128::from(self.rate_ppb) / BILLION;
        u64::try_from(time).unwrap_or(0)
    }

    /// The simulated time of a system time, rounded up.
    pub(super) fn simulated(self, system: u64) -> u64 {
        let passed = i128::from(system) - i128::from(self.system_ns);
        let rate = BILLION + i128::from(self.rate_ppb);
        let time = i128::from(self.simulated_ns) + (passed * BILLION + rate - 1).div_euclid(rate);
        u64::try_from(time).unwrap_or(0)
    }
}

/// Clock of a slave. Until the master writes its time, system time is simulated time with the drift
/// of the oscillator.
#[derive(Clone, Copy, Debug)]
pub(super) struct DcClock {
    drift_ppb: i64,
    pub(super) line: LinearClock,
    is_written: bool,
    corrected_ns: Option<u64>,
    /// Difference found by the last correction, received time minus own (0x092C).
    pub(super) difference_ns: i64,
}

impl DcClock {
    pub(super) fn new(drift_ppb: i32) -> Self {
        let drift_ppb = i64::from(drift_ppb);
        let line = LinearClock { rate_ppb: drift_ppb, ..LinearClock::default() };
        Self { drift_ppb, line, is_written: false, corrected_ns: None, difference_ns: 0 }
    }

    /// System time, once the master has written it.
    pub(super) fn written_time(&self, now: u64) -> Option<u64> {
        self.is_written.then(|| self.line.system(now))
    }

    /// Sets system time, as a write of the offset (0x0920) does.
    pub(super) fn write(&mut self, system_ns: u64, now: u64) {
        self.line.system_ns = system_ns;
        self.line.simulated_ns = now;
        self.is_written = true;
        self.corrected_ns = None;
    }

    /// The master sends the reference time (0x0910).
    pub(super) fn correct(&mut self, system_ns: u64, now: u64) {
        let own = self.line.system(now);
        // limited by the register
        let limit = i128::from(i32::MAX);
        let apart = i128::from(system_ns) - i128::from(own);
        let difference = apart.clamp(-limit, limit) as i64;
        self.difference_ns = difference;
        let step = (difference / STEP_SHARE).clamp(-MAX_STEP_NS, MAX_STEP_NS);
        let interval = self.corrected_ns.replace(now).map(|before| now.saturating_sub(before));
        let rate = self.line.rate_ppb - self.drift_ppb;
        // A large difference does not show the rate. If it stays, the rate is wrong.
        let is_near = difference.abs() < MAX_STEP_NS * STEP_SHARE;
        let change = match interval.filter(|ns| *ns < LONGEST_INTERVAL_NS) {
            Some(interval) if is_near => {
                let interval = interval.max(SHORTEST_INTERVAL_NS) as i64;
                difference * BILLION as i64 / (RATE_SHARE * interval)
            }
            Some(_) => -rate / RATE_SHARE,
            None => 0,
        };
        let rate = (rate + change).clamp(-MAX_RATE_PPB, MAX_RATE_PPB);
        self.line.rate_ppb = self.drift_ppb + rate;
        self.line.system_ns = own.saturating_add_signed(step);
        self.line.simulated_ns = now;
    }

    /// Restarts the control loop, with the rate of the oscillator.
    pub(super) fn restart_control(&mut self, now: u64) {
        self.line.system_ns = self.line.system(now);
        self.line.simulated_ns = now;
        self.line.rate_ppb = self.drift_ppb;
        (self.corrected_ns, self.difference_ns) = (None, 0);
    }

    pub(super) fn jump(&mut self, by_ns: i64, now: u64) {
        self.line.system_ns = self.line.system(now).saturating_add_signed(by_ns);
        self.line.simulated_ns = now;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest difference to simulated time in the last `look` of `count` corrections.
    fn worst(clock: &mut DcClock, count: u64, look: u64) -> i64 {
        let mut worst = 0;
        for number in 1..=count {
            let now = number * 1_000_000;
            clock.correct(now, now);
            if number > count - look {
                worst = worst.max(clock.difference_ns.abs());
            }
        }
        worst
    }

    #[test]
    fn uncorrected_clock_drifts() {
        let mut clock = DcClock::new(50_000);
        clock.write(7_000, 1_000);
        assert_eq!(clock.written_time(1_000_001_000), Some(1_000_057_000));
        let line = clock.line;
        for now in [1_000, 1_001, 12_345_678, 5_000_000_123] {
            let there = line.simulated(line.system(now));
            assert!(there.abs_diff(now) <= 1, "{now} became {there}");
        }
    }

    #[test]
    fn corrections_remove_drift_and_offset() {
        for drift_ppb in [-50_000, 0, 50_000] {
            let mut clock = DcClock::new(drift_ppb);
            clock.write(300_000, 0);
            assert!(worst(&mut clock, 1_000, 100) < 20, "drift {drift_ppb}");
        }
    }

    /// The largest rate takes away what the largest step corrects in a cycle of 4 ms.
    #[test]
    fn wrong_rate_is_forgotten() {
        let mut clock = DcClock::new(60_000);
        let cycle_ns = 4_000_000;
        clock.line.rate_ppb += MAX_RATE_PPB;
        clock.jump(60_000, 0);
        for number in 1..=1_000 {
            clock.correct(number * cycle_ns, number * cycle_ns);
        }
        assert!(clock.difference_ns.abs() < 20, "{} ns", clock.difference_ns);
    }

    #[test]
    fn jump_is_pulled_back_slowly() {
        let mut clock = DcClock::new(0);
        clock.write(0, 0);
        clock.jump(100_000, 0);
        clock.correct(1_000_000, 1_000_000);
        assert_eq!(clock.written_time(1_000_000), Some(1_100_000 - MAX_STEP_NS as u64));
        assert!(worst(&mut clock, 2_000, 100) < 20);
    }
}
