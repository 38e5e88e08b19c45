//! The Sync0 shift against the arrival of the outputs (manual 15.6.1, 16.1).

use std::time::Duration;

use super::{BYTE_NS, Plan, PlanWarning, SlavePlan};
use crate::config::{AdapterConfig, DcSync};

/// Times of an image in host and firmware, in nanoseconds, without its time on the wire. The manual
/// gives none; docs/ASSUMPTIONS.md states where the defaults come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageTimes {
    /// Latest time after the deadline at which the application ends its cycle: wake-up delay and run
    /// time.
    pub latest_send_ns: u32,
    /// Through host and network card.
    pub transport_ns: u32,
    /// Time of the firmware for an image after its arrival.
    pub processing_ns: u32,
}

impl Default for ImageTimes {
    /// 100 us until the send, 30 us through the host, 50 us in the firmware.
    fn default() -> Self {
        Self { latest_send_ns: 100_000, transport_ns: 30_000, processing_ns: 50_000 }
    }
}

/// A planned shift is a multiple of this, in nanoseconds: programs take microseconds.
const SHIFT_STEP_NS: u64 = 1_000;

/// Arrival of the outputs of all slaves in a cycle, and the firmware's work on them, in nanoseconds
/// after its deadline.
///
/// ```text
///   deadline                          next deadline
///      |     [earliest..latest]             |     [..
///      |                       '---usable shifts--'
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OutputArrivals {
    /// Earliest arrival in any slave: no earlier than the bytes of its image have passed.
    pub earliest_ns: u64,
    /// Latest time at which the firmware of any slave has them, by [`ImageTimes`].
    pub latest_ns: u64,
    /// The cycle.
    pub cycle_ns: u32,
}

impl OutputArrivals {
    /// Margin of a Sync0 shift, in nanoseconds: the distance of the pulses from the arrivals before
    /// and after them. Negative if a pulse falls into the arrivals: the distance to the next usable
    /// shift.
    ///
    /// In a longer Sync0 period the shift counts from the deadline before it.
    #[must_use]
    pub fn margin_ns(&self, shift_ns: u32) -> i64 {
        let cycle = i64::from(self.cycle_ns.max(1));
        let signed = |ns: u64| i64::try_from(ns).unwrap_or(i64::MAX / 4);
        let (earliest, latest) = (signed(self.earliest_ns), signed(self.latest_ns));
        // From the latest arrival to the first pulse after it.
        let before = (i64::from(shift_ns) - latest).rem_euclid(cycle);
        // From that pulse to the earliest arrival of the next cycle.
        let after = earliest + cycle - latest - before;
        if after >= 0 { before.min(after) } else { -(cycle - before).min(-after) }
    }

    /// The first and the last usable shift, in nanoseconds, below the cycle. The first is the larger
    /// one if the usable shifts continue in the next cycle. `None` if the arrivals fill the cycle.
    #[must_use]
    pub fn usable_shifts_ns(&self) -> Option<(u32, u32)> {
        let cycle = u64::from(self.cycle_ns.max(1));
        let last = self.earliest_ns + cycle;
        let in_cycle = |ns: u64| u32::try_from(ns % cycle).unwrap_or(0);
        (self.latest_ns <= last).then(|| (in_cycle(self.latest_ns), in_cycle(last)))
    }

    /// The shift with the largest margin, in nanoseconds: the middle of the usable ones, in whole
    /// microseconds. `None` if no shift is usable.
    #[must_use]
    pub fn best_shift_ns(&self) -> Option<u32> {
        self.usable_shifts_ns()?;
        let cycle = u64::from(self.cycle_ns.max(1));
        let middle = (self.latest_ns + self.earliest_ns + cycle) / 2 % cycle;
        let rounded = u32::try_from(middle - middle % SHIFT_STEP_NS).unwrap_or(0);
        // Rounding may leave a narrow range.
        let exact = u32::try_from(middle).unwrap_or(0);
        Some(if self.margin_ns(rounded) >= 0 { rounded } else { exact })
    }
}

impl Plan {
    /// Arrival of the outputs in the slaves; `None` without slaves.
    #[must_use]
    pub fn output_arrivals(&self) -> Option<OutputArrivals> {
        self.arrivals
    }

    pub(super) fn check_sync0(&mut self, dc: Option<DcSync>, times: impl Fn(usize) -> ImageTimes) {
        let earliest = |slave: &SlavePlan| slave.layout.rx_bytes as u64 * BYTE_NS;
        let latest = |(number, slave): (usize, &SlavePlan)| {
            let ImageTimes { latest_send_ns, transport_ns, processing_ns } = times(number);
            let times = [latest_send_ns, transport_ns, processing_ns];
            slave.outputs_arrive_ns + times.map(u64::from).iter().sum::<u64>()
        };
        let earliest_ns = self.slaves.iter().map(earliest).min();
        let latest_ns = self.slaves.iter().enumerate().map(latest).max();
        self.arrivals = earliest_ns.zip(latest_ns).map(|(earliest_ns, latest_ns)| OutputArrivals {
            earliest_ns,
            latest_ns,
            cycle_ns: self.cycle_ns,
        });
        let (Some(dc), Some(arrivals)) = (dc, self.arrivals) else { return };
        let shift_ns = dc.shift_ns();
        let margin_ns = arrivals.margin_ns(shift_ns);
        if margin_ns < 0 {
            self.warnings.push(PlanWarning::Sync0Shift {
                shift_ns,
                lacking_ns: margin_ns.unsigned_abs(),
                best_ns: arrivals.best_shift_ns(),
            });
        }
    }
}

impl DcSync {
    /// Sync0 once per `cycle` with the shift that the plan of `config` recommends: the middle of the
    /// usable ones ([`OutputArrivals::best_shift_ns`]). If none is usable, the end of the latest
    /// arrival, about which the plan warns. Everything else as [`DcSync::new`].
    ///
    /// Uses the slaves, their N and the cycle that `config` has now: call it after they are set, and
    /// again when one of them changes. Its `dc` is ignored.
    ///
    /// The plan assumes the times of [`ImageTimes::default`]; [`planned_with`](Self::planned_with)
    /// takes others. A product measures its shift on the machine (manual 15.6.1) and sets it with
    /// [`DcSync::new`].
    ///
    /// ```
    /// use std::time::Duration;
    ///
    /// use ecan_host::{AdapterConfig, DcSync};
    ///
    /// let mut config = AdapterConfig::new(3).with_cycle(Duration::from_millis(1));
    /// config.dc = Some(DcSync::planned(config.cycle, &config));
    /// assert_eq!(config.dc.unwrap().shift, Duration::from_micros(705));
    /// ```
    #[must_use]
    pub fn planned(cycle: Duration, config: &AdapterConfig) -> Self {
        Self::planned_with(cycle, config, |_| ImageTimes::default())
    }

    /// [`planned`](Self::planned) with the times of each slave by its index.
    #[must_use]
    pub fn planned_with(
        cycle: Duration,
        config: &AdapterConfig,
        times: impl Fn(usize) -> ImageTimes,
    ) -> Self {
        let dc = Some(Self::new(cycle, Duration::ZERO));
        let plan = Plan::with_times(&AdapterConfig { dc, ..*config }, times);
        let shift_ns = plan.output_arrivals().map_or(0, |arrivals| {
            let latest = || arrivals.latest_ns % u64::from(arrivals.cycle_ns.max(1));
            arrivals.best_shift_ns().map_or_else(latest, u64::from)
        });
        Self::new(cycle, Duration::from_nanos(shift_ns))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn margin_is_the_distance_from_the_arrivals() {
        let arrivals = OutputArrivals { earliest_ns: 30, latest_ns: 200, cycle_ns: 1_000 };
        assert_eq!(
            [200, 300, 615, 900, 0, 30].map(|shift| arrivals.margin_ns(shift)),
            [0, 100, 415, 130, 30, 0]
        );
        assert_eq!([31, 80, 150, 199].map(|shift| arrivals.margin_ns(shift)), [-1, -50, -50, -1]);
        assert_eq!(arrivals.margin_ns(2_300), 100, "third cycle of a Sync0 period");
        assert_eq!(arrivals.usable_shifts_ns(), Some((200, 30)));
    }

    #[test]
    fn arrivals_that_fill_the_cycle_leave_no_shift() {
        let arrivals = OutputArrivals { earliest_ns: 30, latest_ns: 1_100, cycle_ns: 1_000 };
        assert_eq!((arrivals.usable_shifts_ns(), arrivals.best_shift_ns()), (None, None));
        assert!((0..1_000).all(|shift| arrivals.margin_ns(shift) < 0));
    }

    /// The stable points of the manual (15.6.1), three slaves. One lies 52.6 us before the end of the
    /// latest processing, which assumes that the application sends 100 us late.
    #[test]
    fn stable_points_of_the_manual_have_margins() {
        for (cycle_ms, multiplier, points) in [
            (1, 3, &[(700, 320_320), (800, 230_720)][..]),
            (1, 4, &[(0, 40_960)]),
            (1, 5, &[(450, -52_560), (650, 147_440), (800, 251_200)]),
            (2, 6, &[(600, 92_960)]),
            (2, 10, &[(1600, 502_400)]),
        ] {
            let cycle = Duration::from_millis(cycle_ms);
            let mut config = AdapterConfig::new(3).with_multiplier(multiplier).with_cycle(cycle);
            config.dc = Some(DcSync::new(cycle, Duration::ZERO));
            let arrivals = Plan::of(&config).output_arrivals().unwrap();
            for (shift_us, margin_ns) in points {
                let found = arrivals.margin_ns(shift_us * 1_000);
                assert_eq!(found, *margin_ns, "N = {multiplier}, {shift_us} us");
            }
        }
    }

    #[test]
    fn shift_among_the_arrivals_is_a_warning() {
        let mut config = AdapterConfig::new(3).with_cycle(Duration::from_millis(1));
        let mut warnings = |dc| {
            config.dc = dc;
            Plan::of(&config).warnings
        };
        let at = |us| Some(DcSync::new(Duration::from_millis(1), Duration::from_micros(us)));
        assert_eq!(warnings(None), []);
        assert_eq!(warnings(at(700)), []);
        let expected = PlanWarning::Sync0Shift {
            shift_ns: 150_000,
            lacking_ns: 150_000 - 30_720,
            best_ns: Some(705_000),
        };
        assert_eq!(warnings(at(150)), [expected]);
        assert!(expected.to_string().ends_with("use a shift of 705.0 us (manual 16.1)"));
    }

    #[test]
    fn sync0_without_slaves_has_no_arrivals() {
        let config = AdapterConfig::new(0);
        assert_eq!(Plan::of(&config).output_arrivals(), None);
        assert_eq!(DcSync::planned(config.cycle, &config).shift, Duration::ZERO);
    }

    proptest! {
        /// No shift has a larger margin than the best one, apart from its rounding.
        #[test]
        fn best_shift_has_the_largest_margin(
            slaves in 1u16..6,
            multiplier in 1u8..12,
            cycle_us in 100u32..20_000,
            other: u32,
        ) {
            let config = AdapterConfig::new(slaves)
                .with_multiplier(multiplier)
                .with_cycle(Duration::from_micros(cycle_us.into()));
            let planned = DcSync::planned(config.cycle, &config);
            let with_dc = AdapterConfig { dc: Some(planned), ..config };
            let arrivals = Plan::of(&with_dc).output_arrivals().unwrap();
            let other = other % arrivals.cycle_ns;
            let Some(best) = arrivals.best_shift_ns() else {
                prop_assert!(arrivals.margin_ns(other) < 0);
                return Ok(());
            };
            prop_assert!(best < arrivals.cycle_ns);
            prop_assert!(arrivals.margin_ns(best) >= 0);
            prop_assert!(arrivals.margin_ns(other) <= arrivals.margin_ns(best) + 1_000);
            prop_assert_eq!(planned.shift_ns(), best);
        }
    }
}
