//! Results of a sweep over Sync0 shifts and offsets, and the recommended point (manual 15.6.1).

use std::fmt;

use ecan_mcan_port::THIN_MARGIN_NS;

/// Results of a candidate.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct PhasePoint {
    pub shift_ns: u32,
    /// Offset of scheduled frames after Sync0, in nanoseconds.
    pub offset_ns: u32,
    pub cycles: u64,
    /// Scheduled frames, for all gateways.
    pub scheduled: u64,
    /// Frames among them that the gateways accepted.
    pub accepted: u64,
    /// Gateways with less than one scheduled frame per Sync0 period, although more were requested.
    pub short_gateways: u32,
    /// Cycles with an incomplete working counter, over all gateways.
    pub incomplete_cycles: u64,
    pub sessions_lost: u64,
    /// Frames that the gateways rejected, by their results.
    pub rejected: u64,
    /// Frames that the Port rejected or withdrew because the cycle was late.
    pub host_drops: u64,
    /// Flags of 0xB000:06 that were set, of scheduled transmission only.
    pub flags: u16,
    /// Shortest distance from a Sync0 pulse to the next arrival of an image, in nanoseconds
    /// (0x9011:04); `None` if the gateway does not report it.
    pub arrival_after_pulse_ns: Option<u32>,
    /// Shortest distance from the arrival of an image to the next Sync0 pulse, in nanoseconds
    /// (0x9011:05).
    pub arrival_before_pulse_ns: Option<u32>,
    /// Reason that the gateways did not become ready with this shift.
    pub failure: Option<String>,
}

/// Distances of a good point to the next candidates that are not good, in nanoseconds; without such
/// a candidate, to the last tested offset, and for shifts the whole period.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PhaseMargins {
    pub shift_below_ns: u32,
    pub shift_above_ns: u32,
    /// Towards smaller offsets: before frames are late.
    pub offset_below_ns: u32,
    pub offset_above_ns: u32,
}

/// Distance of arrivals from a pulse in a good point, at least, in nanoseconds.
const ARRIVAL_MARGIN_NS: u32 = THIN_MARGIN_NS;
/// Offset margin of the recommended point if possible, in nanoseconds.
const OFFSET_MARGIN_NS: u32 = 50_000;

/// Results of all candidates.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PhaseTable {
    pub period_ns: u32,
    /// The candidates, by shift and then by offset.
    pub points: Vec<PhasePoint>,
}

impl PhaseTable {
    /// Returns true if frames were sent at a point, none was lost or rejected there, and no image
    /// arrived near a pulse.
    pub fn is_good(&self, point: &PhasePoint) -> bool {
        let keeps = |distance: Option<u32>| distance.is_none_or(|ns| ns >= ARRIVAL_MARGIN_NS);
        let lost =
            point.incomplete_cycles + point.sessions_lost + point.rejected + point.host_drops;
        lost == 0
            && point.scheduled > 0
            && point.accepted == point.scheduled
            && point.short_gateways == 0
            && point.failure.is_none()
            && point.flags == 0
            && keeps(point.arrival_after_pulse_ns)
            && keeps(point.arrival_before_pulse_ns)
    }

    /// Margins of a good point.
    pub fn margins(&self, point: &PhasePoint) -> Option<PhaseMargins> {
        if !self.is_good(point) {
            return None;
        }
        let PhasePoint { shift_ns, offset_ns, .. } = *point;
        let mut margins = PhaseMargins {
            shift_below_ns: self.period_ns,
            shift_above_ns: self.period_ns,
            offset_below_ns: 0,
            offset_above_ns: 0,
        };
        let bad = |other: &&PhasePoint| !self.is_good(other);
        for other in self.points.iter().filter(|o| o.offset_ns == offset_ns).filter(bad) {
            // Shifts are cyclic.
            let below = around(shift_ns, other.shift_ns, self.period_ns);
            let above = around(other.shift_ns, shift_ns, self.period_ns);
            margins.shift_below_ns = margins.shift_below_ns.min(below);
            margins.shift_above_ns = margins.shift_above_ns.min(above);
        }
        let offsets = || self.points.iter().filter(|other| other.shift_ns == shift_ns);
        let (lower, upper) = (
            offsets().filter(bad).map(|o| o.offset_ns).filter(|o| *o < offset_ns).max(),
            offsets().filter(bad).map(|o| o.offset_ns).filter(|o| *o > offset_ns).min(),
        );
        let tried = |pick: fn(u32, u32) -> u32| {
            offsets().map(|o| o.offset_ns).reduce(pick).unwrap_or(offset_ns)
        };
        margins.offset_below_ns = offset_ns - lower.unwrap_or_else(|| tried(u32::min));
        margins.offset_above_ns = upper.unwrap_or_else(|| tried(u32::max)) - offset_ns;
        Some(margins)
    }

    /// The recommended point: the smallest offset with the offset margin, or else the largest
    /// margin, and there the shift that is farthest from every bad one. Of two equally distant ones
    /// the one with more distance below: cycles are late, not early, and some later than measured.
    pub fn recommended(&self) -> Option<&PhasePoint> {
        let rank = |point: &&PhasePoint| {
            let margins = self.margins(point).unwrap_or_default();
            let offset_margin = margins.offset_below_ns.min(OFFSET_MARGIN_NS);
            let shift = margins.shift_below_ns.min(margins.shift_above_ns);
            use std::cmp::Reverse;
            let below = margins.shift_below_ns;
            (offset_margin, Reverse(point.offset_ns), shift, below, Reverse(point.shift_ns))
        };
        self.points.iter().filter(|point| self.is_good(point)).max_by_key(rank)
    }
}

/// Cyclic distance from `to` upwards to `from`; a whole period if they are equal.
fn around(from: u32, to: u32, period: u32) -> u32 {
    if from > to { from - to } else { (period - to).saturating_add(from) }
}

impl fmt::Display for PhaseTable {
    /// A line for each point, and the recommended one.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let us = |ns: u32| f64::from(ns) / 1e3;
        let recommended = self.recommended();
        writeln!(
            f,
            "{:>9} {:>9} {:>13} {:>7} {:>6} {:>6} {:>6} {:>17} {:>17} {:>15}",
            "shift us",
            "offset us",
            "accepted",
            "WC miss",
            "reject",
            "host",
            "flags",
            "arrival to pulse",
            "shift margin",
            "offset margin"
        )?;
        for point in &self.points {
            write!(f, "{:>9.1} {:>9.1} ", us(point.shift_ns), us(point.offset_ns))?;
            if let Some(failure) = &point.failure {
                writeln!(f, "not ready: {failure}")?;
                continue;
            }
            let pair = |below: f64, above: f64| format!("-{below:.0}/+{above:.0}");
            let arrival = match (point.arrival_after_pulse_ns, point.arrival_before_pulse_ns) {
                (Some(after), Some(before)) => pair(us(after), us(before)),
                _ => "unknown".to_owned(),
            };
            let margins = self.margins(point);
            let shift = margins.map(|m| pair(us(m.shift_below_ns), us(m.shift_above_ns)));
            let offset = margins.map(|m| pair(us(m.offset_below_ns), us(m.offset_above_ns)));
            write!(
                f,
                "{:>13} {:>7} {:>6} {:>6} {:>6} {arrival:>17} {:>17} {:>15}",
                format!("{}/{}", point.accepted, point.scheduled),
                point.incomplete_cycles,
                point.rejected,
                point.host_drops,
                format!("{:#x}", point.flags),
                shift.as_deref().unwrap_or("-"),
                offset.as_deref().unwrap_or("-"),
            )?;
            f.write_str(match recommended {
                Some(best) if std::ptr::eq(best, point) => "  <- recommended\n",
                _ => "\n",
            })?;
        }
        match recommended {
            Some(best) => {
                let m = self.margins(best).unwrap_or_default();
                write!(
                    f,
                    "recommended: shift {:.1} us, offset {:.1} us; margin of the shift -{:.1}/+{:.1} \
                     us, of the offset -{:.1}/+{:.1} us",
                    us(best.shift_ns),
                    us(best.offset_ns),
                    us(m.shift_below_ns),
                    us(m.shift_above_ns),
                    us(m.offset_below_ns),
                    us(m.offset_above_ns)
                )
            }
            None => f.write_str("no point is good: try other offsets, or a longer cycle"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Shifts of 0, 100 .. 900 us, offsets of 0, 50, 100 us; good where `is_good` says.
    fn table(is_good: impl Fn(u32, u32) -> bool) -> PhaseTable {
        let mut points = Vec::new();
        for shift in (0..1_000).step_by(100) {
            for offset in [0, 50, 100] {
                points.push(PhasePoint {
                    shift_ns: shift * 1_000,
                    offset_ns: offset * 1_000,
                    cycles: 10,
                    scheduled: 10,
                    accepted: 10,
                    rejected: u64::from(!is_good(shift, offset)),
                    ..PhasePoint::default()
                });
            }
        }
        PhaseTable { period_ns: 1_000_000, points }
    }

    #[test]
    fn middle_of_the_good_shifts_is_recommended() {
        // Bad are 800, 900, 0 and 100 us, and an offset of 0.
        let table = table(|shift, offset| (200..800).contains(&shift) && offset > 0);
        let best = table.recommended().unwrap();
        assert_eq!((best.shift_ns, best.offset_ns), (500_000, 50_000));
        let margins = table.margins(best).unwrap();
        let expected = PhaseMargins {
            shift_below_ns: 400_000,
            shift_above_ns: 300_000,
            offset_below_ns: 50_000,
            offset_above_ns: 50_000,
        };
        assert_eq!(margins, expected);
        let text = table.to_string();
        assert!(text.contains("recommended: shift 500.0 us, offset 50.0 us"), "{text}");
        assert_eq!(text.matches("<- recommended").count(), 1);
    }

    #[test]
    fn good_shifts_are_cyclic() {
        let table = table(|shift, _| !(300..=600).contains(&shift));
        let best = table.recommended().unwrap();
        assert_eq!((best.shift_ns, best.offset_ns), (0, 50_000));
        let margins = table.margins(best).unwrap();
        assert_eq!((margins.shift_below_ns, margins.shift_above_ns), (400_000, 300_000));
    }

    #[test]
    fn no_or_all_good_points_have_no_limits() {
        let none = table(|_, _| false);
        assert!(none.recommended().is_none() && none.to_string().contains("no point is good"));
        let all = table(|_, _| true);
        let margins = all.margins(all.recommended().unwrap()).unwrap();
        assert_eq!((margins.shift_below_ns, margins.shift_above_ns), (1_000_000, 1_000_000));
    }

    #[test]
    fn each_fault_makes_a_point_bad() {
        let table = table(|_, _| true);
        let faults: [fn(&mut PhasePoint); 11] = [
            |point| point.incomplete_cycles = 1,
            |point| (point.scheduled, point.accepted) = (0, 0),
            |point| point.accepted = 9,
            |point| point.short_gateways = 1,
            |point| point.sessions_lost = 1,
            |point| point.rejected = 1,
            |point| point.host_drops = 1,
            |point| point.flags = 1 << 6,
            |point| point.arrival_after_pulse_ns = Some(9_999),
            |point| point.arrival_before_pulse_ns = Some(9_999),
            |point| point.failure = Some("no OP".into()),
        ];
        for fault in faults {
            let mut point = table.points[0].clone();
            assert!(table.is_good(&point));
            fault(&mut point);
            assert!(!table.is_good(&point) && table.margins(&point).is_none(), "{point:?}");
        }
    }
}
