//! Time from one effective target of an axis to the next.

/// Target periods after which the drive has ended its last motion: with fewer, a target may still be
/// on the path to it.
const PAUSE_PERIODS: u64 = 4;

/// Counts the cycles since the last target took effect: with the first SYNC after it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct TargetPeriod {
    cycles: u32,
    ns: u64,
    /// Cycles from a target to the SYNC that makes it effective: 0 if that follows in the same image, else the SYNC
    /// period.
    lead: u32,
    /// A target was sent, but no SYNC after it.
    awaits_sync: bool,
    elapsed: u32,
    effective_ns: u64,
}

impl TargetPeriod {
    /// Creates the period of an axis without targets: the first one is due at once.
    pub(crate) fn new(cycles: u32, ns: u64) -> Self {
        Self { cycles, ns, lead: 0, awaits_sync: false, elapsed: u32::MAX, effective_ns: 0 }
    }

    /// Returns this period for targets that take effect `lead` cycles after they were sent, with the next SYNC.
    pub(crate) fn with_lead(self, lead: u32) -> Self {
        Self { lead, ..self }
    }

    pub(crate) fn lead(&self) -> u32 {
        self.lead
    }

    pub(crate) fn ns(&self) -> u64 {
        self.ns
    }

    pub(crate) fn begin_cycle(&mut self) {
        self.elapsed = self.elapsed.saturating_add(1);
    }

    /// Returns whether a target of this cycle takes effect a whole period after the last one. With a lead, the
    /// SYNC of this cycle must have been sent before.
    pub(crate) fn is_over(&self) -> bool {
        !self.awaits_sync && self.elapsed.saturating_add(self.lead) >= self.cycles
    }

    /// Returns whether targets were missed for so long, also by a pause of the cycle, that a drive that follows
    /// positions is certainly at rest.
    pub(crate) fn is_paused(&self, now_ns: u64) -> bool {
        let elapsed_ns = now_ns.saturating_sub(self.effective_ns);
        !self.awaits_sync && elapsed_ns > self.ns.saturating_mul(PAUSE_PERIODS)
    }

    /// Notes that a target was sent.
    pub(crate) fn note_target(&mut self) {
        self.awaits_sync = true;
    }

    /// Notes a SYNC: the last target takes effect.
    pub(crate) fn note_sync(&mut self, now_ns: u64) {
        if std::mem::take(&mut self.awaits_sync) {
            self.elapsed = 0;
            self.effective_ns = now_ns;
        }
    }
}

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
    fn period_begins_with_the_sync_after_a_target() {
        let mut period = TargetPeriod::new(2, 200);
        assert!(period.is_over());
        period.note_target();
        for _ in 0..5 {
            period.begin_cycle();
            assert!(!period.is_over(), "no SYNC yet");
        }
        period.note_sync(1_000);
        period.begin_cycle();
        assert!(!period.is_over());
        period.note_sync(1_100);
        period.begin_cycle();
        assert!(period.is_over(), "a SYNC without a target starts no period");
        assert!(!period.is_paused(1_800) && period.is_paused(1_801));
    }

    /// SYNC every 2 cycles, targets every 4.
    #[test]
    fn target_with_a_lead_takes_effect_with_the_next_sync() {
        let mut period = TargetPeriod::new(4, 400).with_lead(2);
        period.note_sync(0);
        period.note_target();
        for (cycle, has_sync, is_over) in
            [(1, false, false), (2, true, false), (3, false, false), (4, true, true)]
        {
            period.begin_cycle();
            if has_sync {
                period.note_sync(cycle * 100);
            }
            assert_eq!(period.is_over(), is_over, "cycle {cycle}");
        }
        period.note_target();
        period.begin_cycle();
        // The SYNC of the next period is late: the target waits for it.
        for _ in 0..6 {
            period.begin_cycle();
            assert!(!period.is_over());
        }
    }

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
