//! Whether a phase of Sync0 is reached in time (manual 8.4, 13.8, 16.1).

use std::fmt;

use ecan_host::{AdapterConfig, BYTE_NS, ClockSource, SlavePlan};
use thiserror::Error;

use crate::config::ScheduleConfig;

/// Smallest offset after Sync0 that the manual recommends to begin with (13.8), in nanoseconds.
pub const RECOMMENDED_OFFSET_NS: u32 = 100_000;
/// A margin below this is [thin](ScheduleMargin::is_thin), in nanoseconds.
pub const THIN_MARGIN_NS: u32 = 20_000;

/// Times of a cycle around the Sync0 pulse that the offset of a scheduled frame counts from, all
/// in nanoseconds from the point of the cycle grid.
///
/// ```text
///   pulse before     image arrives           pulse        phase
///        |         [earliest..latest]          |  offset    |
///        '--after-->'              '--before-->'            |
///                                  '--processing, before---->
/// ```
///
/// [`Port::schedule_margin`](crate::Port::schedule_margin) gives it for gateways that are ready,
/// [`PortPlan::schedule_margin`](crate::PortPlan::schedule_margin) beforehand; both reckon alike.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ScheduleMargin {
    /// Earliest arrival of the image in the gateway: no earlier than its own bytes have passed.
    pub earliest_arrival_ns: u64,
    /// Latest arrival of the image in the gateway.
    pub latest_arrival_ns: u64,
    /// The pulse that the offset counts from: the first that an image sent at the point of the grid
    /// is there for, with the time through the host and on the wire.
    pub pulse_ns: u64,
    /// The phase at which the frame is sent.
    pub release_ns: u64,
    /// From the pulse before to the earliest arrival. Negative where the pulse before falls into
    /// the time between the image's own bytes and the way that is reckoned with: then some images
    /// meet that one, and frames leave a period early.
    pub after_pulse_ns: i64,
    /// From the latest arrival to the pulse. Negative where the pulse falls into the arrivals:
    /// then some images meet this pulse and some the next one, and frames leave a period late.
    pub before_pulse_ns: i64,
    /// From the end of the firmware's work to the phase. Negative where frames may come too late
    /// and be dropped.
    pub before_release_ns: i64,
}

/// Reason for which a frame cannot be scheduled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum NotSchedulable {
    /// Distributed clocks are not configured.
    #[error(
        "distributed clocks with Sync0 are not configured; configure them, or send frames at once"
    )]
    NoSync0,
    /// The gateway does not have the capability.
    #[error(
        "the gateway does not report scheduled transmission (0xF000:16 bit 8; assumption H42: 0 if \
             the firmware lacks the entry)"
    )]
    NotSupported,
    /// The offset is not below the Sync0 period.
    #[error(
        "the offset is not below the Sync0 period of {:.1} us; use a smaller one",
        f64::from(*sync0_ns) / 1e3
    )]
    BeyondPeriod {
        /// The Sync0 period, in nanoseconds.
        sync0_ns: u32,
    },
    /// The margin of the phase does not suffice, and
    /// [`MarginCheck::Reject`](crate::MarginCheck::Reject) is configured.
    #[error(
        "the margin is short by {:.1} us; move the Sync0 shift away from the arrival of the images, \
         or increase the offset", *lacking_ns as f64 / 1e3
    )]
    NoMargin {
        /// Time missing, in nanoseconds.
        lacking_ns: u64,
    },
}

impl ScheduleMargin {
    /// The smallest of the three distances, in nanoseconds; negative where there is no margin.
    pub fn least_ns(&self) -> i64 {
        self.after_pulse_ns.min(self.before_pulse_ns).min(self.before_release_ns)
    }

    /// Returns whether the phase is reached in time whenever the times of the settings are kept.
    pub fn is_sufficient(&self) -> bool {
        self.lacking_ns() == 0
    }

    /// Returns whether it suffices with less than [`THIN_MARGIN_NS`] to spare.
    pub fn is_thin(&self) -> bool {
        (0..i64::from(THIN_MARGIN_NS)).contains(&self.least_ns())
    }

    /// Missing margin, in nanoseconds; 0 if it suffices.
    pub fn lacking_ns(&self) -> u64 {
        self.least_ns().min(0).unsigned_abs()
    }
}

impl fmt::Display for ScheduleMargin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let us = |ns: i64| ns as f64 / 1e3;
        write!(
            f,
            "margin {:.1} us: image in the gateway {:.1} us after a pulse at the earliest and {:.1} \
             us before the next at the latest, frame ready {:.1} us before its phase",
            us(self.least_ns()),
            us(self.after_pulse_ns),
            us(self.before_pulse_ns),
            us(self.before_release_ns)
        )
    }
}

/// Basis of the margins of a gateway: times in nanoseconds from the point of the
/// cycle grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ScheduleTimes {
    earliest_arrival_ns: u64,
    latest_arrival_ns: u64,
    /// The firmware has done with the image that came latest.
    ready_ns: u64,
    /// From the send of an image to its arrival.
    way_ns: u64,
    cycle_ns: u64,
    sync0: Option<Sync0>,
}

/// The pulse that offsets count from, and the period that they lie in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Sync0 {
    pulse_ns: u64,
    shift_ns: u32,
    period_ns: u32,
}

impl ScheduleTimes {
    /// Of a gateway with these settings and this position on the line. At the latest an image comes
    /// with the last of its Ethernet frames in the order of the plan; however the master packs
    /// them, never before its own bytes have passed.
    pub(crate) fn new(
        settings: &ScheduleConfig,
        adapter: &AdapterConfig,
        slave: &SlavePlan,
    ) -> Self {
        let cycle_ns = u64::from(adapter.cycle_ns().max(1));
        let earliest_arrival_ns = slave.layout.rx_bytes as u64 * BYTE_NS;
        let way_ns = u64::from(settings.transport_ns) + slave.outputs_arrive_ns;
        let latest_arrival_ns = u64::from(settings.latest_send_ns) + way_ns;
        let sync0 = adapter.dc.map(|dc| {
            // Whatever the number of cycles in a Sync0 period: in one of them a pulse stands here.
            let shift = u64::from(dc.shift_ns()) % cycle_ns;
            // The first pulse that an image sent at once is there for by the times of the settings.
            let periods = (way_ns + 1).saturating_sub(shift).div_ceil(cycle_ns);
            Sync0 {
                pulse_ns: shift + periods * cycle_ns,
                shift_ns: dc.shift_ns(),
                period_ns: dc.cycle_ns(),
            }
        });
        Self {
            earliest_arrival_ns,
            latest_arrival_ns,
            ready_ns: latest_arrival_ns + u64::from(settings.processing_ns),
            way_ns,
            cycle_ns,
            sync0,
        }
    }

    /// The margin of an offset after Sync0. Real-time safe.
    pub(crate) fn margin(&self, offset_ns: u32) -> Result<ScheduleMargin, NotSchedulable> {
        let Sync0 { pulse_ns, period_ns, .. } = self.sync0.ok_or(NotSchedulable::NoSync0)?;
        if offset_ns >= period_ns {
            return Err(NotSchedulable::BeyondPeriod { sync0_ns: period_ns });
        }
        let release_ns = pulse_ns + u64::from(offset_ns);
        let signed = |ns: u64| i64::try_from(ns).unwrap_or(i64::MAX);
        let [earliest, latest, pulse] =
            [self.earliest_arrival_ns, self.latest_arrival_ns, pulse_ns].map(signed);
        Ok(ScheduleMargin {
            earliest_arrival_ns: self.earliest_arrival_ns,
            latest_arrival_ns: self.latest_arrival_ns,
            pulse_ns,
            release_ns,
            after_pulse_ns: earliest - (pulse - signed(self.cycle_ns)),
            before_pulse_ns: pulse - latest,
            before_release_ns: signed(release_ns) - signed(self.ready_ns),
        })
    }

    /// The pulse that scheduled frames of a cycle count from: the first that an image sent at its
    /// point is there for. Both in application time since the first cycle.
    pub(crate) fn pulse_of(&self, since_first_ns: u64) -> Option<u64> {
        let Sync0 { shift_ns, period_ns, .. } = self.sync0?;
        let (shift_ns, period_ns) = (u64::from(shift_ns), u64::from(period_ns.max(1)));
        let arrival_ns = since_first_ns.saturating_add(self.way_ns);
        // Strictly after the arrival.
        let periods = (arrival_ns.saturating_add(1)).saturating_sub(shift_ns).div_ceil(period_ns);
        Some(shift_ns.saturating_add(periods.saturating_mul(period_ns)))
    }

    /// Returns true if an image of this cycle, sent this time after the point of the cycle grid, arrives
    /// after the pulse that its scheduled frames count from.
    pub(crate) fn misses_pulse(&self, since_first_ns: u64, sent_ns: u64) -> bool {
        let arrival_ns = since_first_ns.saturating_add(sent_ns).saturating_add(self.way_ns);
        self.pulse_of(since_first_ns).is_some_and(|pulse_ns| arrival_ns >= pulse_ns)
    }
}

/// Calculates the application time since the first cycle: the library keeps Sync0 in phase with the
/// first application time.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Sync0Phase {
    /// Deadline of the last cycle, and its time since the first one.
    last: Option<(u64, u64)>,
}

impl Sync0Phase {
    /// Begin of a cycle with this deadline; returns the application time since the first one, in
    /// nanoseconds.
    pub(crate) fn begin(&mut self, time_ns: u64, adapter: &AdapterConfig) -> u64 {
        let cycle_ns = u64::from(adapter.cycle_ns().max(1));
        let follows = adapter.dc.is_some_and(|dc| dc.source == ClockSource::Reference);
        let since_first_ns = match self.last {
            None => 0,
            Some((last_ns, since_first_ns)) => {
                let passed_ns = time_ns.saturating_sub(last_ns);
                // Shifted deadlines: the number of cycles counts, not their length.
                let whole_ns = (passed_ns + cycle_ns / 2) / cycle_ns * cycle_ns;
                since_first_ns + if follows { whole_ns } else { passed_ns }
            }
        };
        self.last = Some((time_ns, since_first_ns));
        since_first_ns
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use ecan_host::{DcSync, Plan};
    use proptest::prelude::*;

    use super::*;

    fn settings() -> ScheduleConfig {
        ScheduleConfig { latest_send_ns: 100_000, ..ScheduleConfig::default() }
    }

    /// An image of 30 us, in the gateway 70 us after the send.
    fn times(settings: ScheduleConfig, dc: Option<DcSync>) -> ScheduleTimes {
        let mut adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
        adapter.dc = dc;
        let mut slave = Plan::of(&adapter).slaves[0];
        (slave.layout.rx_bytes, slave.outputs_arrive_ns) = (375, 70_000);
        ScheduleTimes::new(&settings, &adapter, &slave)
    }

    fn margin(shift_ns: u32, offset_ns: u32) -> ScheduleMargin {
        let dc = DcSync::new(Duration::from_millis(1), Duration::from_nanos(shift_ns.into()));
        times(settings(), Some(dc)).margin(offset_ns).unwrap()
    }

    #[test]
    fn pulse_behind_the_arrivals_leaves_three_distances() {
        let margin = margin(500_000, 100_000);
        assert_eq!((margin.earliest_arrival_ns, margin.latest_arrival_ns), (30_000, 200_000));
        assert_eq!((margin.pulse_ns, margin.release_ns), (500_000, 600_000));
        assert_eq!((margin.after_pulse_ns, margin.before_pulse_ns), (530_000, 300_000));
        assert_eq!(margin.before_release_ns, 350_000);
        assert!(margin.is_sufficient() && margin.least_ns() == 300_000);
        assert!(!margin.is_thin() && margin.lacking_ns() == 0);
    }

    #[test]
    fn pulse_among_the_arrivals_has_no_margin() {
        let margin = margin(110_000, 400_000);
        assert_eq!((margin.before_pulse_ns, margin.lacking_ns()), (-90_000, 90_000));
        assert!(!margin.is_sufficient() && !margin.is_thin());
    }

    #[test]
    fn pulse_before_the_arrivals_means_the_next_one() {
        let margin = margin(10_000, 0);
        assert_eq!(margin.pulse_ns, 1_010_000);
        assert_eq!((margin.after_pulse_ns, margin.before_pulse_ns), (20_000, 810_000));
        assert!(margin.is_sufficient() && !margin.is_thin());
    }

    /// Frames leave after the pulse that follows their arrival, also where that is the shift 0 or
    /// one of a later cycle.
    #[test]
    fn pulse_is_the_first_behind_the_arrival() {
        let pulse = |shift_ns| margin(shift_ns, 100_000).pulse_ns;
        assert_eq!(
            [700_000, 100_001, 100_000, 29_999, 0].map(pulse),
            [700_000, 100_001, 1_100_000, 1_029_999, 1_000_000]
        );
        // A shift beyond the period, which the check rejects, is no reason to panic: the pulse is
        // at 300 us, too.
        assert_eq!(pulse(1_300_000), 300_000);
    }

    /// The image is there 30 us after the point of the grid at the earliest, but 100 us are assumed
    /// with: a pulse between is met by none that keeps to the times, so offsets count from the next.
    #[test]
    fn pulse_during_the_transfer_means_the_next_one() {
        for shift_ns in [30_001, 65_000, 100_000] {
            let times = times(
                settings(),
                Some(DcSync::new(Duration::from_millis(1), Duration::from_nanos(shift_ns))),
            );
            let margin = times.margin(100_000).unwrap();
            assert_eq!(margin.pulse_ns, shift_ns + 1_000_000);
            assert!(!times.misses_pulse(0, 0) && !times.misses_pulse(0, 100_000));
            assert_eq!(margin.lacking_ns(), shift_ns - 30_000);
        }
    }

    #[test]
    fn firmware_needs_time_before_the_phase() {
        let short = margin(210_000, 20_000);
        assert_eq!((short.before_pulse_ns, short.before_release_ns), (10_000, -20_000));
        assert!(!short.is_sufficient());
        let thin = margin(210_000, 69_999);
        assert_eq!((thin.before_release_ns, thin.least_ns()), (29_999, 10_000));
        assert!(thin.is_sufficient() && thin.is_thin());
        assert!(margin(219_999, 100_000).is_thin() && !margin(220_000, 100_000).is_thin());
    }

    #[test]
    fn longer_sync0_period_has_its_pulse_in_one_of_its_cycles() {
        let dc = DcSync::new(Duration::from_millis(4), Duration::from_micros(2500));
        let margin = times(settings(), Some(dc)).margin(3_000_000).unwrap();
        assert_eq!((margin.pulse_ns, margin.release_ns), (500_000, 3_500_000));
        // It is missed in that cycle only, and images of the others meet the same one.
        let times = times(settings(), Some(dc));
        let cycles = [0, 1_000_000, 2_000_000, 3_000_000, 6_000_000];
        let pulses = cycles.map(|place_ns| times.pulse_of(place_ns).unwrap());
        assert_eq!(pulses, [2_500_000, 2_500_000, 2_500_000, 6_500_000, 6_500_000]);
        let missed = cycles.map(|place_ns| times.misses_pulse(place_ns, 450_000));
        assert_eq!(missed, [false, false, true, false, true]);
    }

    #[test]
    fn without_a_pulse_or_beyond_the_period_there_is_no_phase() {
        let times = |dc| times(settings(), dc);
        assert_eq!(times(None).margin(100_000), Err(NotSchedulable::NoSync0));
        assert!(!times(None).misses_pulse(0, u64::MAX));
        let times = times(Some(DcSync::new(Duration::from_millis(1), Duration::from_micros(700))));
        let beyond = NotSchedulable::BeyondPeriod { sync0_ns: 1_000_000 };
        assert_eq!(times.margin(1_000_000), Err(beyond));
        assert!(times.margin(999_999).is_ok());
        // 30 us through the host and 70 us on the wire.
        assert!(times.misses_pulse(0, 600_000) && !times.misses_pulse(0, 599_999));
    }

    #[test]
    fn wire_time_counts_the_slaves_before() {
        let mut adapter = AdapterConfig::new(2);
        adapter.dc = Some(DcSync::new(adapter.cycle, Duration::from_millis(5)));
        let slaves = Plan::of(&adapter).slaves;
        let of = |slave: usize| {
            ScheduleTimes::new(&settings(), &adapter, &slaves[slave]).margin(0).unwrap()
        };
        let sent_ns = 100_000 + 30_000;
        assert_eq!(of(0).earliest_arrival_ns, 384 * 80);
        assert_eq!(of(0).latest_arrival_ns, sent_ns + slaves[0].outputs_arrive_ns);
        assert_eq!(of(1).latest_arrival_ns, sent_ns + slaves[1].outputs_arrive_ns);
        assert!(slaves[1].outputs_arrive_ns > 2 * 384 * 80);
    }

    proptest! {
        /// Every configuration has its margins or a reason: the pulse is the first after the
        /// earliest arrival, on the grid of Sync0, and the distances are those between the times.
        #[test]
        fn times_of_a_margin_belong_together(
            sizes in prop::collection::vec(any::<u8>(), 1..8),
            (cycle_ns, offset_ns) in any::<(u32, u32)>(),
            dc: Option<(u32, u32)>,
            (latest_send_ns, transport_ns, processing_ns) in any::<(u32, u32, u32)>(),
            (sent_ns, is_valid) in any::<(u64, bool)>(),
        ) {
            let mut adapter = AdapterConfig::new(sizes.len() as u16);
            for (slave, rx) in adapter.slaves.iter_mut().zip(&sizes) {
                slave.rx_multiplier = *rx;
            }
            adapter.cycle = Duration::from_nanos(cycle_ns.into());
            // Half of them as a configuration has to be.
            adapter.dc = dc.map(|(period, shift)| match cycle_ns {
                1.. if is_valid => {
                    let period = period % (u32::MAX / cycle_ns) * cycle_ns;
                    let period = period.max(cycle_ns);
                    DcSync::new(Duration::from_nanos(period.into()), Duration::from_nanos(u64::from(shift % period)))
                }
                _ => DcSync::new(Duration::from_nanos(period.into()), Duration::from_nanos(shift.into())),
            });
            let settings = ScheduleConfig {
                latest_send_ns,
                transport_ns,
                processing_ns,
                ..ScheduleConfig::default()
            };
            for slave in Plan::of(&adapter).slaves {
                let times = ScheduleTimes::new(&settings, &adapter, &slave);
                let Ok(margin) = times.margin(offset_ns) else {
                    prop_assert!(adapter.dc.is_none_or(|dc| offset_ns >= dc.cycle_ns()));
                    continue;
                };
                let dc = adapter.dc.unwrap();
                prop_assert!(offset_ns < dc.cycle_ns());
                let cycle = u64::from(cycle_ns.max(1));
                prop_assert!(margin.earliest_arrival_ns <= margin.latest_arrival_ns);
                let way = u64::from(transport_ns) + slave.outputs_arrive_ns;
                prop_assert!(margin.pulse_ns > way && margin.pulse_ns <= way + cycle);
                prop_assert!(!times.misses_pulse(0, 0));
                // The same in the cycle of the period that has a pulse there.
                let start = u64::from(dc.shift_ns()) / cycle * cycle;

                prop_assert_eq!(margin.pulse_ns % cycle, u64::from(dc.shift_ns()) % cycle);
                prop_assert_eq!(margin.release_ns - margin.pulse_ns, u64::from(offset_ns));
                // From pulse to pulse is a cycle: arrivals and both distances fill it.
                let arrivals = margin.latest_arrival_ns - margin.earliest_arrival_ns;
                let filled =
                    i128::from(margin.after_pulse_ns) + i128::from(margin.before_pulse_ns);
                prop_assert_eq!(filled + i128::from(arrivals), i128::from(cycle));
                let work = i128::from(offset_ns) - i128::from(processing_ns);
                let ready = i128::from(margin.before_pulse_ns) + work;
                prop_assert_eq!(i128::from(margin.before_release_ns), ready);
                prop_assert_eq!(margin.is_sufficient(), margin.least_ns() >= 0);
                // An image that is sent in time meets the pulse where there is a margin to it.
                if margin.before_pulse_ns > 0 && is_valid && cycle_ns > 0 {
                    prop_assert!(!times.misses_pulse(start, u64::from(latest_send_ns)));
                }
                let _ = times.misses_pulse(sent_ns, sent_ns);
            }
        }
    }

    #[test]
    fn cycles_are_counted_from_the_first_one_also_on_a_shifted_grid() {
        let mut adapter = AdapterConfig::new(1).with_cycle(Duration::from_millis(1));
        adapter.dc = Some(DcSync::new(Duration::from_millis(4), Duration::ZERO));
        for source in [ClockSource::Host, ClockSource::Reference] {
            adapter.dc = adapter.dc.map(|dc| DcSync { source, ..dc });
            let mut phase = Sync0Phase::default();
            let mut begin = |time_ns| phase.begin(time_ns, &adapter);
            assert_eq!([700, 1_000_700, 4_000_700].map(&mut begin), [0, 1_000_000, 4_000_000]);
            let shifted = [5_000_500, 6_000_300].map(&mut begin);
            assert_eq!(
                shifted,
                match source {
                    ClockSource::Host => [4_999_800, 5_999_600],
                    ClockSource::Reference => [5_000_000, 6_000_000],
                }
            );
        }
    }
}
