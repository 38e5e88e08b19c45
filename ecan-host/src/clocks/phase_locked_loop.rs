//! The phase-locked loop that makes the host's cycle follow a clock on the bus.

/// Share of the phase error that the next cycle takes away.
const PROPORTIONAL: f64 = 1.0 / 16.0;
/// Share of it that every later cycle takes away too: the rate that the loop learns. A quarter of
/// the proportional share squared damps it critically.
const INTEGRAL: f64 = PROPORTIONAL * PROPORTIONAL / 4.0;
/// Longest correction of a cycle for its phase, as a share of the cycle. Larger errors are worked
/// off at this pace, so that no cycle becomes much shorter than the others.
const MAX_SHIFT: f64 = 0.01;
/// Largest difference of two oscillators that is believed: 1000 ppm.
const MAX_RATE: f64 = 0.001;
/// Mean size of the phase error below which the loop is locked, as a share of the cycle, and how
/// many errors that mean follows.
const LOCKED: f64 = 0.002;
const MEAN_OVER: f64 = 32.0;

/// A proportional and integral loop over the phase error of each cycle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PhaseLockedLoop {
    cycle_ns: f64,
    /// Correction of every cycle for the difference of the rates.
    rate_ns: f64,
    /// Part of a nanosecond that no correction has carried yet.
    rest_ns: f64,
    /// Mean size of the phase error; none before the first.
    mean_ns: Option<f64>,
    /// The next phase error is of a cycle before the first correction took effect.
    is_stale: bool,
}

impl PhaseLockedLoop {
    pub(crate) fn new(cycle_ns: u32) -> Self {
        let cycle_ns = f64::from(cycle_ns);
        Self { cycle_ns, rate_ns: 0.0, rest_ns: 0.0, mean_ns: None, is_stale: false }
    }

    /// Takes the phase error of a cycle, positive where the host is late, and gives what is to be
    /// added to the next deadline, in nanoseconds. The first error is taken away at once: no slave
    /// is in OP yet.
    pub(crate) fn update(&mut self, error_ns: i64) -> i64 {
        let error = error_ns as f64;
        let Some(mean) = self.mean_ns else {
            self.mean_ns = Some(self.cycle_ns);
            self.is_stale = true;
            return -error_ns;
        };
        if std::mem::take(&mut self.is_stale) {
            return self.coast();
        }
        self.mean_ns = Some(mean + (error.abs() - mean) / MEAN_OVER);
        let limit = self.cycle_ns * MAX_SHIFT;
        let unlimited = -error * PROPORTIONAL;
        let shift = unlimited.clamp(-limit, limit);
        // An error that is corrected at the limit contains no information about the rate.
        if shift == unlimited {
            let limit = self.cycle_ns * MAX_RATE;
            self.rate_ns = (self.rate_ns - error * INTEGRAL).clamp(-limit, limit);
        }
        self.correct_by(shift + self.rate_ns)
    }

    /// Correction without a phase error: the rates still differ.
    pub(crate) fn coast(&mut self) -> i64 {
        self.correct_by(self.rate_ns)
    }

    fn correct_by(&mut self, ns: f64) -> i64 {
        let whole = (ns + self.rest_ns).round();
        self.rest_ns += ns - whole;
        whole as i64
    }

    pub(crate) fn is_locked(&self) -> bool {
        self.mean_ns.is_some_and(|mean| mean < self.cycle_ns * LOCKED)
    }

    /// Rate of the host's clock relative to the other, in parts per billion.
    pub(crate) fn rate_ppb(&self) -> i32 {
        (self.rate_ns / self.cycle_ns * 1e9).round() as i32
    }
}

#[cfg(test)]
mod tests {
    use super::PhaseLockedLoop;

    const CYCLE_NS: u32 = 1_000_000;

    /// Phase errors of a host whose clock is `fast_ppm` fast and whose first cycle is `start_ns`
    /// late. A correction acts on the cycle after the next, as in the field.
    fn errors(
        start_ns: f64,
        fast_ppm: f64,
        cycles: usize,
        lost: std::ops::Range<usize>,
    ) -> Vec<f64> {
        let mut pll = PhaseLockedLoop::new(CYCLE_NS);
        pll.update(0);
        pll.update(0);
        let (mut phase, mut pending) = (start_ns, 0);
        let mut errors = Vec::new();
        for cycle in 0..cycles {
            errors.push(phase);
            let correction =
                if lost.contains(&cycle) { pll.coast() } else { pll.update(phase.round() as i64) };
            // A fast clock reaches its deadline early.
            phase += f64::from(std::mem::replace(&mut pending, correction as i32));
            phase -= f64::from(CYCLE_NS) * fast_ppm / 1e6;
        }
        errors
    }

    #[test]
    fn loop_settles_from_any_phase_and_drift() {
        for start_ns in [-499_000.0, -20_000.0, 0.0, 3_000.0, 499_000.0] {
            for fast_ppm in [-200.0, -50.0, 0.0, 50.0, 200.0] {
                let errors = errors(start_ns, fast_ppm, 1_500, 0..0);
                let worst = errors[1_000..].iter().fold(0.0_f64, |worst, e| worst.max(e.abs()));
                assert!(worst <= 1.0, "{start_ns} ns, {fast_ppm} ppm: {worst} ns");
            }
        }
    }

    #[test]
    fn loop_measures_the_rate_and_reports_the_lock() {
        let mut pll = PhaseLockedLoop::new(CYCLE_NS);
        assert!(!pll.is_locked());
        let mut phase = 100_000;
        for _ in 0..1_500 {
            phase += pll.update(phase) - 50;
        }
        assert!(pll.is_locked());
        assert!(pll.rate_ppb().abs_diff(50_000) < 1_000, "{}", pll.rate_ppb());
        pll.update(400_000);
        assert!(!pll.is_locked());
    }

    #[test]
    fn loop_holds_the_rate_during_lost_frames() {
        let errors = errors(100_000.0, 50.0, 2_000, 1_000..1_100);
        let worst = errors[1_000..].iter().fold(0.0_f64, |worst, e| worst.max(e.abs()));
        assert!(worst < 50.0, "{worst} ns after a hundred cycles without a reading");
    }

    #[test]
    fn only_the_first_shift_exceeds_a_hundredth_of_the_cycle() {
        let mut pll = PhaseLockedLoop::new(CYCLE_NS);
        assert_eq!(pll.update(300_000), -300_000);
        assert_eq!(pll.update(300_000), 0, "still of a cycle from before");
        assert_eq!(pll.update(500_000), -10_000);
        assert_eq!(pll.update(-500_000), 10_000);
    }
}
