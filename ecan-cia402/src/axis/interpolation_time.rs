//! Target period as the drive has it: 0x60C2.

/// Powers of ten of 0x60C2, with their nanoseconds. Milliseconds first, since every drive has those.
const TIME_UNITS: [(i8, u64); 6] = [
    (-3, 1_000_000),
    (-4, 100_000),
    (-5, 10_000),
    (-6, 1_000),
    (-2, 10_000_000),
    (-1, 100_000_000),
];

/// A period as 0x60C2 has it: a value of 1 to 255 and a power of ten of seconds; `None` if it has no
/// such value. It is not rounded: the motion would stop or overlap a little in each period.
pub(crate) fn interpolation_time(period_ns: u64) -> Option<(u8, i8)> {
    TIME_UNITS.into_iter().find_map(|(power, unit_ns)| {
        let value = u8::try_from(period_ns / unit_ns).ok()?;
        (value > 0 && period_ns.is_multiple_of(unit_ns)).then_some((value, power))
    })
}

/// Text about a target period that 0x60C2 cannot have, with the nearest ones that it can.
pub(crate) struct InvalidPeriod(pub(crate) u64);

impl std::fmt::Display for InvalidPeriod {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let period_ns = self.0;
        let units = || TIME_UNITS.into_iter().map(|(_, unit_ns)| unit_ns);
        let below = units().map(|unit| (period_ns / unit).min(255) * unit).max().unwrap_or(0);
        let above = units().map(|unit| (period_ns.div_ceil(unit).max(1), unit));
        let above =
            above.filter(|(value, _)| *value <= 255).map(|(value, unit)| value * unit).min();
        write!(
            f,
            "target period {period_ns} ns cannot be set as interpolation time 0x60C2; allowed: 1 to \
             255 times a power of ten from 1 us to 100 ms, nearest: {below} ns"
        )?;
        if let Some(above) = above {
            write!(f, " or {above} ns")?;
        }
        f.write_str("; change the cycle, the SYNC period or motion_div")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn periods_as_drives_take_them() {
        let times = [
            (1_000_000, Some((1, -3))),
            (10_000_000, Some((10, -3))),
            (500_000, Some((5, -4))),
            (250_000, Some((25, -5))),
            (125_000, Some((125, -6))),
            (2_500_000, Some((25, -4))),
            (300_000_000, Some((30, -2))),
            (25_500_000_000, Some((255, -1))),
            (0, None),
            (333_333, None),
            (25_600_000_000, None),
        ];
        for (period, expected) in times {
            assert_eq!(interpolation_time(period), expected, "{period} ns");
        }
    }

    #[test]
    fn invalid_period_names_the_nearest_ones() {
        let text = InvalidPeriod(333_333).to_string();
        assert!(text.contains("nearest: 330000 ns or 340000 ns;"), "{text}");
        let text = InvalidPeriod(30_000_000_000).to_string();
        assert!(text.contains("nearest: 25500000000 ns;"), "{text}");
    }
}
