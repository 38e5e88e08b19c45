//! What a sweep over Sync0 shifts and offsets found, and which point it recommends
//! (manual 15.6.1).

use std::fmt;

/// What one candidate brought.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct PhasePoint {
    /// Sync0 shift, in nanoseconds.
    pub shift_ns: u32,
    /// Offset of scheduled frames behind Sync0, in nanoseconds.
    pub offset_ns: u32,
    /// Cycles that were measured.
    pub cycles: u64,
    /// Frames that the Port took to be scheduled, for all gateways.
    pub scheduled: u64,
    /// Frames among them that the gateways took.
    pub taken: u64,
    /// Gateways for which the Port took less than one frame in a Sync0 period, although it was
    /// asked to.
    pub short_gateways: u32,
    /// Cycles whose working counter was not complete, over all gateways.
    pub incomplete_cycles: u64,
    /// Times that a gateway was lost.
    pub sessions_lost: u64,
    /// Frames that the gateways dropped as late, by their results.
    pub late_drops: u64,
    /// Frames that were lost for another reason, by their results.
    pub other_drops: u64,
    /// Frames that the Port refused or took back since the cycle came too late.
    pub host_drops: u64,
    /// Flags of 0xB000:06 that came up, of scheduled transmission only.
    pub flags: u16,
    /// Shortest distance from a Sync0 pulse to the next image that arrived, in nanoseconds
    /// (0x9011:04); none where the gateway does not tell.
    pub arrival_after_pulse_ns: Option<u32>,
    /// Shortest distance from an image that arrived to the next Sync0 pulse, in nanoseconds
    /// (0x9011:05).
    pub arrival_before_pulse_ns: Option<u32>,
    /// Reason that the gateways did not become ready with this shift.
    pub failure: Option<String>,
}

/// Distances of a good point to the next candidates that are not good, in nanoseconds; where there
/// is none, to the end of what was tried, and for shifts the whole period.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PhaseMargins {
    /// Towards smaller shifts.
    pub shift_below_ns: u32,
    /// Towards larger shifts.
    pub shift_above_ns: u32,
    /// Towards smaller offsets: what may be lost before frames come late.
    pub offset_below_ns: u32,
    /// Towards larger offsets.
    pub offset_above_ns: u32,
}

/// Everything that a sweep found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PhaseTable {
    /// The Sync0 period, in nanoseconds.
    pub period_ns: u32,
    /// What the arrival of images keeps from a pulse in a good point at least, in nanoseconds.
    pub arrival_margin_ns: u32,
    /// The offset margin that the recommended point has, if one does, in nanoseconds.
    pub offset_margin_ns: u32,
    /// The candidates, by shift and then by offset.
    pub points: Vec<PhasePoint>,
}

impl PhaseTable {
    /// Whether frames were sent at a point, none was lost or refused there, and no image came near
    /// a pulse.
    pub fn is_good(&self, point: &PhasePoint) -> bool {
        let keeps = |distance: Option<u32>| distance.is_none_or(|ns| ns >= self.arrival_margin_ns);
        let lost = point.incomplete_cycles
            + point.sessions_lost
            + point.late_drops
            + point.other_drops
            + point.host_drops;
        lost == 0
            && point.scheduled > 0
            && point.taken == point.scheduled
            && point.short_gateways == 0
            && point.failure.is_none()
            && point.flags == 0
            && keeps(point.arrival_after_pulse_ns)
            && keeps(point.arrival_before_pulse_ns)
    }

    /// The margins of a good point; none of one that is not.
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
            // The shift goes round.
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

    /// The point to run with: the smallest offset at which frames keep the offset margin, or else
    /// the largest margin, and there the shift that is farthest from every bad one. Of two that are
    /// exactly as far the one with more room below: cycles come late, not early, and some later than
    /// any that was measured. None where no point is good.
    pub fn recommended(&self) -> Option<&PhasePoint> {
        let rank = |point: &&PhasePoint| {
            let margins = self.margins(point).unwrap_or_default();
            let wanted = margins.offset_below_ns.min(self.offset_margin_ns);
            let shift = margins.shift_below_ns.min(margins.shift_above_ns);
            use std::cmp::Reverse;
            let below = margins.shift_below_ns;
            (wanted, Reverse(point.offset_ns), shift, below, Reverse(point.shift_ns))
        };
        self.points.iter().filter(|point| self.is_good(point)).max_by_key(rank)
    }
}

/// From `to` upwards to `from` on a ring of `period`; a whole period where they are the same.
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
            "{:>9} {:>9} {:>13} {:>7} {:>6} {:>6} {:>6} {:>6} {:>17} {:>17} {:>15}",
            "shift us",
            "offset us",
            "taken",
            "WC miss",
            "late",
            "other",
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
                _ => "not told".to_owned(),
            };
            let margins = self.margins(point);
            let shift = margins.map(|m| pair(us(m.shift_below_ns), us(m.shift_above_ns)));
            let offset = margins.map(|m| pair(us(m.offset_below_ns), us(m.offset_above_ns)));
            write!(
                f,
                "{:>13} {:>7} {:>6} {:>6} {:>6} {:>6} {arrival:>17} {:>17} {:>15}",
                format!("{}/{}", point.taken, point.scheduled),
                point.incomplete_cycles,
                point.late_drops,
                point.other_drops,
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
                    taken: 10,
                    late_drops: u64::from(!is_good(shift, offset)),
                    ..PhasePoint::default()
                });
            }
        }
        PhaseTable {
            period_ns: 1_000_000,
            arrival_margin_ns: 10_000,
            offset_margin_ns: 50_000,
            points,
        }
    }

    #[test]
    fn the_middle_of_the_good_shifts_is_recommended() {
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
    fn good_shifts_go_round_the_period() {
        let table = table(|shift, _| !(300..=600).contains(&shift));
        let best = table.recommended().unwrap();
        assert_eq!((best.shift_ns, best.offset_ns), (0, 50_000));
        let margins = table.margins(best).unwrap();
        assert_eq!((margins.shift_below_ns, margins.shift_above_ns), (400_000, 300_000));
    }

    #[test]
    fn nothing_good_recommends_nothing_and_everything_good_has_the_whole_period() {
        let none = table(|_, _| false);
        assert!(none.recommended().is_none() && none.to_string().contains("no point is good"));
        let all = table(|_, _| true);
        let margins = all.margins(all.recommended().unwrap()).unwrap();
        assert_eq!((margins.shift_below_ns, margins.shift_above_ns), (1_000_000, 1_000_000));
    }

    #[test]
    fn each_trouble_makes_a_point_bad() {
        let table = table(|_, _| true);
        let troubles: [fn(&mut PhasePoint); 11] = [
            |point| point.incomplete_cycles = 1,
            |point| (point.scheduled, point.taken) = (0, 0),
            |point| point.taken = 9,
            |point| point.short_gateways = 1,
            |point| point.sessions_lost = 1,
            |point| point.other_drops = 1,
            |point| point.host_drops = 1,
            |point| point.flags = 1 << 6,
            |point| point.arrival_after_pulse_ns = Some(9_999),
            |point| point.arrival_before_pulse_ns = Some(9_999),
            |point| point.failure = Some("no OP".into()),
        ];
        for trouble in troubles {
            let mut point = table.points[0].clone();
            assert!(table.is_good(&point));
            trouble(&mut point);
            assert!(!table.is_good(&point) && table.margins(&point).is_none(), "{point:?}");
        }
    }
}
