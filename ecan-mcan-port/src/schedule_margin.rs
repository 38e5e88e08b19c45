//! Whether a phase of Sync0 is reached in time (manual 8.4, 13.8, 16.1).

use std::fmt;

use ecan_host::{BYTE_NS, DcSync, Plan};

use crate::port::Port;
use crate::schedule_settings::ScheduleSettings;
use crate::send::NotSchedulable;

/// Times of a cycle around the Sync0 pulse that the offset of a scheduled frame counts from, all
/// in nanoseconds from the point of the cycle grid.
///
/// ```text
///   pulse before     image arrives           pulse        phase
///        |         [earliest..latest]          |  offset    |
///        '--after-->'              '--before-->'            |
///                                  '--processing, before---->
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ScheduleMargin {
    /// Earliest arrival of the image in the gateway.
    pub earliest_arrival_ns: u64,
    /// Latest arrival of the image in the gateway.
    pub latest_arrival_ns: u64,
    /// The pulse that the offset counts from.
    pub pulse_ns: u64,
    /// The phase at which the frame is sent.
    pub release_ns: u64,
    /// From the pulse before to the earliest arrival.
    pub after_pulse_ns: i64,
    /// From the latest arrival to the pulse. Negative where the pulse falls into the arrivals:
    /// then some images meet this pulse and some the next one, and frames leave a period late.
    pub before_pulse_ns: i64,
    /// From the end of the firmware's work to the phase. Negative where frames may come too late
    /// and be dropped.
    pub before_release_ns: i64,
}

impl ScheduleMargin {
    /// Reckons the margin of an offset behind Sync0. The cycle and the Sync0 period are those of
    /// the configuration, `wire_ns` is the time on the wire of all process data before and with
    /// those of the gateway, and `own_wire_ns` that of the gateway's outputs alone.
    pub fn new(
        settings: &ScheduleSettings,
        cycle_ns: u32,
        dc: DcSync,
        offset_ns: u32,
        (own_wire_ns, wire_ns): (u64, u64),
    ) -> Self {
        let cycle = u64::from(cycle_ns.max(1));
        let earliest = own_wire_ns;
        let latest =
            u64::from(settings.latest_send_ns) + u64::from(settings.transport_ns) + wire_ns;
        // Whatever the number of cycles in a Sync0 period: in one of them a pulse stands here.
        let shift = u64::from(dc.shift_ns) % cycle;
        // The first pulse that is not before every arrival.
        let periods = if shift >= earliest { 0 } else { (earliest - shift).div_ceil(cycle) };
        let pulse = shift + periods * cycle;
        let release = pulse + u64::from(offset_ns);
        let ready = latest + u64::from(settings.processing_ns);
        let signed = |ns: u64| i64::try_from(ns).unwrap_or(i64::MAX);
        Self {
            earliest_arrival_ns: earliest,
            latest_arrival_ns: latest,
            pulse_ns: pulse,
            release_ns: release,
            after_pulse_ns: signed(earliest) - (signed(pulse) - signed(cycle)),
            before_pulse_ns: signed(pulse) - signed(latest),
            before_release_ns: signed(release) - signed(ready),
        }
    }

    /// The smallest of the three distances, in nanoseconds; negative where there is no margin.
    pub fn least_ns(&self) -> i64 {
        self.after_pulse_ns.min(self.before_pulse_ns).min(self.before_release_ns)
    }

    /// Whether the phase is reached in time whenever the times of the settings are kept.
    pub fn is_sufficient(&self) -> bool {
        self.least_ns() >= 0
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

/// Times of a gateway's process data on the wire: its own outputs, and everything up to them.
pub(crate) fn wire_ns(plan: &Plan, slave: usize) -> (u64, u64) {
    plan.slaves
        .get(slave)
        .map_or((0, 0), |slave| (slave.layout.rx_bytes as u64 * BYTE_NS, slave.outputs_arrive_ns))
}

impl Port {
    /// The margin that a phase has against the cycle and the times of
    /// [`ScheduleSettings`]. Real-time safe.
    ///
    /// # Errors
    /// Why a frame cannot be scheduled at this phase at all: without Sync0, on a gateway without
    /// the capability, beyond the Sync0 period. A slave index out of range is not supported.
    pub fn schedule_margin(
        &self,
        slave: usize,
        offset_ns: u32,
    ) -> Result<ScheduleMargin, NotSchedulable> {
        let gateway = self.gateways.get(slave).ok_or(NotSchedulable::NotSupported)?;
        let config = self.adapter.config();
        let dc = config.dc.ok_or(NotSchedulable::NoSync0)?;
        if !gateway.can_schedule {
            return Err(NotSchedulable::NotSupported);
        }
        if offset_ns >= dc.cycle_ns {
            return Err(NotSchedulable::BeyondPeriod);
        }
        let settings = &gateway.schedule;
        Ok(ScheduleMargin::new(settings, config.cycle_ns, dc, offset_ns, gateway.wire_ns))
    }
}

#[cfg(test)]
mod tests {
    use ecan_host::AdapterConfig;

    use super::*;

    fn margin(shift_ns: u32, offset_ns: u32) -> ScheduleMargin {
        let settings = ScheduleSettings::default();
        let dc = DcSync::new(1_000_000, shift_ns);
        ScheduleMargin::new(&settings, 1_000_000, dc, offset_ns, (30_000, 70_000))
    }

    #[test]
    fn a_pulse_behind_the_arrivals_leaves_three_distances() {
        let margin = margin(500_000, 100_000);
        assert_eq!((margin.earliest_arrival_ns, margin.latest_arrival_ns), (30_000, 200_000));
        assert_eq!((margin.pulse_ns, margin.release_ns), (500_000, 600_000));
        assert_eq!((margin.after_pulse_ns, margin.before_pulse_ns), (530_000, 300_000));
        assert_eq!(margin.before_release_ns, 350_000);
        assert!(margin.is_sufficient() && margin.least_ns() == 300_000);
    }

    #[test]
    fn a_pulse_among_the_arrivals_has_no_margin() {
        let margin = margin(100_000, 400_000);
        assert_eq!(margin.before_pulse_ns, -100_000);
        assert!(!margin.is_sufficient());
    }

    #[test]
    fn a_pulse_before_the_arrivals_means_the_next_one() {
        let margin = margin(10_000, 0);
        assert_eq!(margin.pulse_ns, 1_010_000);
        assert_eq!((margin.after_pulse_ns, margin.before_pulse_ns), (20_000, 810_000));
        assert!(margin.is_sufficient());
    }

    #[test]
    fn the_firmware_needs_time_before_the_phase() {
        let short = margin(210_000, 20_000);
        assert_eq!((short.before_pulse_ns, short.before_release_ns), (10_000, -20_000));
        assert!(!short.is_sufficient());
        assert!(margin(210_000, 40_000).is_sufficient());
    }

    #[test]
    fn a_longer_sync0_period_has_its_pulse_in_one_of_its_cycles() {
        let settings = ScheduleSettings::default();
        let dc = DcSync::new(4_000_000, 2_500_000);
        let margin = ScheduleMargin::new(&settings, 1_000_000, dc, 3_000_000, (30_000, 70_000));
        assert_eq!((margin.pulse_ns, margin.release_ns), (500_000, 3_500_000));
    }

    #[test]
    fn wire_time_counts_the_slaves_before() {
        let plan = Plan::of(&AdapterConfig::new(2));
        let ((own, first), (_, second)) = (wire_ns(&plan, 0), wire_ns(&plan, 1));
        assert_eq!(own, 384 * 80);
        assert!(first > own && second > 2 * own, "{first} and {second} ns");
        assert_eq!(wire_ns(&plan, 2), (0, 0));
    }
}
