//! Arrival of the next frame of a cyclic master.
//!
//! A wake-up by a frame takes longer than all the rest of a response: another CPU has to be
//! interrupted, and may have to leave a sleep state. A master sends in cycles, so the program can
//! wake up shortly before a frame by its own timer, and poll for it.

/// Shortest pause before the first frame of a cycle, ns; the other frames follow it at once.
const SHORTEST_PAUSE_NS: u64 = 100_000;
/// Range of cycles, ns.
const CYCLES_NS: std::ops::RangeInclusive<u64> = 200_000..=20_000_000;
/// Equal cycles before the first prediction.
const EQUAL_CYCLES: u32 = 2;
/// Frames in sequence at another time after which the cycle is measured again.
const MOST_OUTLIERS: u32 = 3;
/// A cycle is equal to the others within this part of the period.
const TOLERANCE: u64 = 8;
/// Longest polling before a frame, as a part of the period.
const POLLED_PART: u64 = 8;
/// Changes of the margin: after a frame that came before the polling began, and after one that came
/// during it. With their ratio one frame in 500 comes before.
const STEP_UP_NS: u64 = 25_000;
const STEP_DOWN_NS: u64 = 50;
const LEAST_MARGIN_NS: u64 = 5_000;
/// Polling without a frame so often in sequence ends the predictions for a pause.
const MOST_FAILURES: u32 = 8;
const PAUSED_CYCLES: u32 = 1000;

/// Prediction of the next first frame of a cycle.
#[derive(Debug, Clone)]
pub struct FramePrediction {
    /// Longest polling before the expected arrival, and after it, ns; 0: no prediction.
    limit_ns: u64,
    /// Arrival of the last frame, and of the last one after a pause.
    last_ns: u64,
    first_ns: u64,
    /// Start of the last cycle, smoothed.
    cycle_ns: u64,
    period_ns: u64,
    equal_cycles: u32,
    /// Frames in sequence that came at another time.
    outliers: u32,
    /// Time before the expected arrival at which polling begins.
    margin_ns: u64,
    failures: u32,
    paused_cycles: u32,
}

impl FramePrediction {
    /// Predicts frames for polling of at most `limit_ns` before each; 0 for none.
    pub fn new(limit_ns: u64) -> Self {
        Self {
            limit_ns,
            last_ns: 0,
            first_ns: 0,
            cycle_ns: 0,
            period_ns: 0,
            equal_cycles: 0,
            outliers: 0,
            margin_ns: limit_ns / 2,
            failures: 0,
            paused_cycles: 0,
        }
    }

    /// Counts a frame that arrived at `arrived_ns`. `is_polled`: the program was polling for it.
    pub fn count(&mut self, arrived_ns: u64, is_polled: bool) {
        if self.limit_ns == 0 {
            return;
        }
        let pause_ns = arrived_ns.saturating_sub(self.last_ns);
        self.last_ns = self.last_ns.max(arrived_ns);
        if pause_ns < SHORTEST_PAUSE_NS {
            return;
        }
        self.adapt(arrived_ns, is_polled);
        let expected_ns = self.cycle_ns.saturating_add(self.period_ns);
        let error_ns = arrived_ns.abs_diff(expected_ns);
        if self.period_ns > 0 && error_ns <= self.period_ns / TOLERANCE {
            // The master's grid is regular, its frames are late at random.
            let move_by = |value: u64, part: u64| match arrived_ns >= expected_ns {
                true => value + error_ns / part,
                false => value.saturating_sub(error_ns / part),
            };
            self.cycle_ns = move_by(expected_ns, 4);
            self.period_ns = move_by(self.period_ns, 16);
            self.equal_cycles = self.equal_cycles.saturating_add(1);
            self.outliers = 0;
        } else if self.equal_cycles >= EQUAL_CYCLES && self.outliers < MOST_OUTLIERS {
            // late, or between two cycles: the grid continues
            self.outliers += 1;
            let since_ns = arrived_ns.saturating_sub(self.cycle_ns);
            let cycles = (since_ns + self.period_ns / 2) / self.period_ns;
            self.cycle_ns += cycles * self.period_ns;
        } else {
            let period_ns = arrived_ns.saturating_sub(self.first_ns);
            self.period_ns = if CYCLES_NS.contains(&period_ns) { period_ns } else { 0 };
            self.cycle_ns = arrived_ns;
            self.equal_cycles = 0;
            self.outliers = 0;
        }
        self.first_ns = arrived_ns;
    }

    /// Adapts margin and pause to the outcome of the last prediction.
    fn adapt(&mut self, arrived_ns: u64, is_polled: bool) {
        if self.paused_cycles > 0 {
            self.paused_cycles -= 1;
        } else if self.equal_cycles < EQUAL_CYCLES {
            // nothing was predicted
        } else if is_polled {
            self.margin_ns = self.margin_ns.saturating_sub(STEP_DOWN_NS).max(LEAST_MARGIN_NS);
            self.failures = 0;
        } else {
            if self.polling_ns(arrived_ns).is_some() {
                self.margin_ns = (self.margin_ns + STEP_UP_NS).min(self.limit_ns);
            }
            self.failures += 1;
            if self.failures >= MOST_FAILURES {
                self.failures = 0;
                self.paused_cycles = PAUSED_CYCLES;
            }
        }
    }

    /// Start and end of polling for the next frame, if there is a prediction that has not ended at
    /// `now_ns`.
    pub fn polling_ns(&self, now_ns: u64) -> Option<(u64, u64)> {
        if self.equal_cycles < EQUAL_CYCLES || self.paused_cycles > 0 {
            return None;
        }
        let limit_ns = self.limit_ns.min(self.period_ns / POLLED_PART);
        let expected_ns = self.cycle_ns.saturating_add(self.period_ns);
        let end_ns = expected_ns.saturating_add(limit_ns);
        let start_ns = expected_ns.saturating_sub(self.margin_ns.min(limit_ns));
        (now_ns < end_ns).then_some((start_ns, end_ns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NS: u64 = 1_000_000;
    const LIMIT_NS: u64 = 100_000;

    /// After frames of a regular master; returns the arrival of the last one.
    fn regular(cycles: u64) -> (FramePrediction, u64) {
        let mut prediction = FramePrediction::new(LIMIT_NS);
        let start_ns = 7_000_000;
        for cycle in 0..cycles {
            prediction.count(start_ns + cycle * PERIOD_NS, true);
        }
        (prediction, start_ns + (cycles - 1) * PERIOD_NS)
    }

    #[test]
    fn regular_frames_are_predicted_after_some_cycles() {
        let (prediction, last_ns) = regular(3);
        assert_eq!(prediction.polling_ns(last_ns), None);
        let (prediction, last_ns) = regular(4);
        let expected_ns = last_ns + PERIOD_NS;
        let (from_ns, to_ns) = prediction.polling_ns(last_ns).unwrap();
        assert_eq!((expected_ns - from_ns, to_ns - expected_ns), (LIMIT_NS / 2, LIMIT_NS));
        assert_eq!(prediction.polling_ns(to_ns), None, "the frame did not come");
        let mut off = FramePrediction::new(0);
        for cycle in 0..20 {
            off.count(cycle * PERIOD_NS, false);
        }
        assert_eq!(off.polling_ns(0), None);
    }

    #[test]
    fn frames_of_one_cycle_count_once() {
        let mut prediction = FramePrediction::new(LIMIT_NS);
        for cycle in 1..8 {
            for frame in 0..5 {
                prediction.count(cycle * PERIOD_NS + frame * 30_000, true);
            }
        }
        let (_, to_ns) = prediction.polling_ns(7 * PERIOD_NS + 120_000).unwrap();
        assert_eq!(to_ns - LIMIT_NS, 8 * PERIOD_NS);
    }

    #[test]
    fn irregular_frames_are_not_predicted() {
        let mut prediction = FramePrediction::new(LIMIT_NS);
        let mut now_ns = 0;
        for pause_ns in [300, 900, 2_000, 500, 1_400].into_iter().cycle().take(200) {
            now_ns += pause_ns * 1_000;
            prediction.count(now_ns, false);
            assert_eq!(prediction.polling_ns(now_ns), None);
        }
        let mut back_to_back = FramePrediction::new(LIMIT_NS);
        for frame in 0..200 {
            back_to_back.count(frame * 40_000, false);
            assert_eq!(back_to_back.polling_ns(frame * 40_000), None);
        }
    }

    #[test]
    fn late_frames_move_the_grid_little() {
        let (mut prediction, mut last_ns) = regular(20);
        for cycle in 0..400 {
            last_ns += PERIOD_NS;
            let late_ns = if cycle % 4 == 0 { 40_000 } else { 0 };
            prediction.count(last_ns + late_ns, true);
            let (_, to_ns) = prediction.polling_ns(last_ns + late_ns).unwrap();
            let expected_ns = to_ns - LIMIT_NS;
            assert!(expected_ns.abs_diff(last_ns + PERIOD_NS) < 30_000, "{cycle}: {expected_ns}");
        }
    }

    #[test]
    fn margin_follows_the_outcome_within_its_limits() {
        let margin_ns = |prediction: &FramePrediction, now_ns| {
            let (from_ns, to_ns) = prediction.polling_ns(now_ns).unwrap();
            to_ns - LIMIT_NS - from_ns
        };
        let (mut prediction, mut last_ns) = regular(4);
        let mut next = |prediction: &mut FramePrediction, is_polled| {
            last_ns += PERIOD_NS;
            prediction.count(last_ns, is_polled);
            last_ns
        };
        for _ in 0..100 {
            next(&mut prediction, true);
        }
        let now_ns = next(&mut prediction, false);
        assert_eq!(margin_ns(&prediction, now_ns), LIMIT_NS / 2 - 100 * STEP_DOWN_NS + STEP_UP_NS);
        for _ in 0..2_000 {
            next(&mut prediction, true);
        }
        let now_ns = next(&mut prediction, true);
        assert_eq!(margin_ns(&prediction, now_ns), LEAST_MARGIN_NS);
        for _ in 0..MOST_FAILURES - 1 {
            next(&mut prediction, false);
        }
        let now_ns = next(&mut prediction, true);
        assert_eq!(margin_ns(&prediction, now_ns), LIMIT_NS - STEP_DOWN_NS);
    }

    #[test]
    fn polling_without_frames_pauses() {
        let (mut prediction, mut last_ns) = regular(4);
        for _ in 0..MOST_FAILURES {
            assert!(prediction.polling_ns(last_ns).is_some());
            last_ns += PERIOD_NS;
            prediction.count(last_ns, false);
        }
        for _ in 0..PAUSED_CYCLES {
            assert_eq!(prediction.polling_ns(last_ns), None);
            last_ns += PERIOD_NS;
            prediction.count(last_ns, false);
        }
        assert!(prediction.polling_ns(last_ns).is_some());
    }

    #[test]
    fn single_frames_at_another_time_keep_the_grid() {
        let (mut prediction, last_ns) = regular(20);
        let expected_ns = |prediction: &FramePrediction, now_ns| {
            prediction.polling_ns(now_ns).unwrap().1 - LIMIT_NS
        };
        prediction.count(last_ns + 400_000, false);
        assert_eq!(expected_ns(&prediction, last_ns + 400_000), last_ns + PERIOD_NS);
        prediction.count(last_ns + PERIOD_NS, true);
        // a late frame after two that were lost
        prediction.count(last_ns + 4 * PERIOD_NS + 300_000, false);
        let now_ns = last_ns + 4 * PERIOD_NS + 300_000;
        assert_eq!(expected_ns(&prediction, now_ns), last_ns + 5 * PERIOD_NS);
    }

    #[test]
    fn another_cycle_time_is_followed() {
        let (mut prediction, mut last_ns) = regular(20);
        for period_ns in [4_000_000, 500_000, 1_000_000] {
            for _ in 0..8 {
                last_ns += period_ns;
                prediction.count(last_ns, true);
            }
            let (from_ns, to_ns) = prediction.polling_ns(last_ns).unwrap();
            assert!((from_ns..to_ns).contains(&(last_ns + period_ns)), "{period_ns}");
        }
    }

    #[test]
    fn short_periods_are_polled_for_a_part_only() {
        let mut prediction = FramePrediction::new(LIMIT_NS);
        let mut now_ns = 0;
        for _ in 0..8 {
            now_ns += 250_000;
            prediction.count(now_ns, false);
        }
        let (from_ns, to_ns) = prediction.polling_ns(now_ns).unwrap();
        assert_eq!((to_ns - from_ns) / 2, 250_000 / POLLED_PART);
        assert_eq!(to_ns - 250_000 / POLLED_PART, now_ns + 250_000);
    }
}
