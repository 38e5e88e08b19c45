//! Targets of an axis: their source, which is the application or the host's own ramp, and their period.

use super::ramp::{FRACTION_BITS, Profile, Ramp, RampLimits};
use crate::guard::feed_forward::FeedForward;
use crate::guard::terms::{GuardLimits, TargetKind};

/// Target periods in a row without a target after which a drive is certainly at rest, so that a motion
/// of the host must not continue.
pub(crate) const MOST_GAP: u8 = 2;

/// Most steps in half of a [`StepHistory`].
const MOST_STEPS: usize = 16;

/// The last steps of an axis, newest first, to estimate the motion of an application: its targets are
/// rounded to increments, so that two steps alone hide a change of less than an increment per
/// target.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct StepHistory {
    steps: [i64; 2 * MOST_STEPS],
}

impl StepHistory {
    const REST: Self = Self { steps: [0; 2 * MOST_STEPS] };

    fn push(&mut self, step: i64) {
        self.steps.rotate_right(1);
        if let Some(newest) = self.steps.first_mut() {
            *newest = step;
        }
    }

    fn last(&self) -> i64 {
        self.steps.first().copied().unwrap_or_default()
    }

    /// The ramp that continues this motion.
    ///
    /// Without a jerk limit it continues the last step. With one, it continues the change between two
    /// means, each over enough steps that the error by the rounding of targets, at most 2
    /// increments by the square of their number, is an eighth of the largest change or less, if
    /// 16 steps suffice for that. The rate is less than an increment below the last step, and
    /// never above it: an axis that rests stays there.
    fn ramp(&self, limits: &RampLimits) -> Ramp {
        let last = i128::from(self.last()) << FRACTION_BITS;
        if limits.jerk() == 0 {
            return Ramp::following(last, 0);
        }
        let squared = (16 << FRACTION_BITS) / limits.change();
        let half = usize::try_from(squared.isqrt() + 1).unwrap_or(MOST_STEPS).min(MOST_STEPS);
        let sum = |steps: &[i64]| steps.iter().map(|step| i128::from(*step)).sum::<i128>();
        let newer = sum(self.steps.get(..half).unwrap_or_default());
        let older = sum(self.steps.get(half..2 * half).unwrap_or_default());
        let half = half as i128;
        let change = ((newer - older) << FRACTION_BITS) / (half * half);
        let rate = (newer << FRACTION_BITS) / half + change * (half - 1) / 2;
        let below = last - last.signum() * ((1 << FRACTION_BITS) - 1);
        Ramp::following(rate.clamp(last.min(below), last.max(below)), change)
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct TargetSource {
    pub(crate) requested: Option<i32>,
    /// Feed-forward of the requested target, until that is sent.
    pub(crate) feed_forward: Option<FeedForward>,
    /// True if the axis is brought to rest, or rests, instead of following the application.
    pub(crate) is_halted: bool,
    pub(crate) limits: RampLimits,
    /// The ramp that made the last target; `None` if the application made it.
    ramp: Option<Ramp>,
    /// Part in a stop of all axes on their path.
    path: Option<PathShare>,
    /// Target periods without a target since the last one.
    gap: u8,
    history: StepHistory,
}

impl TargetSource {
    pub(crate) fn new(limits: RampLimits) -> Self {
        Self {
            requested: None,
            feed_forward: None,
            is_halted: false,
            limits,
            ramp: None,
            path: None,
            gap: 0,
            history: StepHistory::REST,
        }
    }

    pub(crate) fn request(&mut self, target: Option<i32>, feed_forward: Option<FeedForward>) {
        self.requested = target;
        self.feed_forward = feed_forward;
    }

    pub(crate) fn clear(&mut self) {
        self.request(None, None);
        self.is_halted = false;
        self.stop();
    }

    /// Nothing moves any more.
    pub(crate) fn stop(&mut self) {
        self.ramp = None;
        self.history = StepHistory::REST;
    }

    pub(crate) fn halt(&mut self) {
        self.is_halted = true;
        self.request(None, None);
    }

    pub(crate) fn join_path(&mut self) {
        self.path = Some(PathShare { rate: self.motion().profile().rate, step: None });
    }

    pub(crate) fn leave_path(&mut self) {
        self.path = None;
    }

    pub(crate) fn is_in_path(&self) -> bool {
        self.path.is_some()
    }

    /// Sets the rate of the common profile in this cycle; `None` if no axis moves in it.
    pub(crate) fn set_path_step(&mut self, step: Option<Profile>) {
        if let Some(path) = &mut self.path {
            path.step = step;
        }
    }

    /// Returns whether the axis waits for others of a stop on the path.
    pub(crate) fn waits_for_path(&self) -> bool {
        self.is_halted && self.path.is_some_and(|path| path.step.is_none())
    }

    /// The ramp one target further on the path; `None` if the axis is not on it.
    pub(crate) fn on_path(&self, common: Profile) -> Option<Ramp> {
        let path = self.path.filter(|_| self.is_halted)?;
        Some(self.motion().moved(path.of(common)))
    }

    /// The motion of the last target, as a ramp that continues it.
    pub(crate) fn motion(&self) -> Ramp {
        self.ramp.unwrap_or_else(|| self.history.ramp(&self.limits))
    }

    pub(crate) fn is_at_rest(&self) -> bool {
        match self.ramp {
            Some(ramp) => ramp.is_at_rest(),
            None => self.history.last() == 0,
        }
    }

    /// Notes a sent target: `ramp` is the host's own one that made it, `step` its distance from the last
    /// one; a rate is a step of itself.
    pub(crate) fn note_sent(&mut self, ramp: Option<Ramp>, step: i64) {
        self.ramp = ramp;
        self.gap = 0;
        self.history.push(step);
    }

    /// Notes a target period without a target. After some, a position axis is at rest; all axes of a stop on
    /// the path end it together.
    pub(crate) fn note_gap(&mut self) {
        self.gap = self.gap.saturating_add(1);
        if self.gap > MOST_GAP && self.path.is_none() {
            self.stop();
        }
    }

    /// Returns the next target after `last`, and the host's own ramp if that makes it. `own_step` is
    /// the step that the host is to make.
    pub(crate) fn next(
        &self,
        limits: &GuardLimits,
        last: i32,
        own_step: Option<i32>,
    ) -> (Option<i32>, Option<Ramp>) {
        let own_step = if self.is_halted { Some(0) } else { own_step };
        match (limits.kind, own_step) {
            (TargetKind::Position, Some(goal)) => {
                let on_path = self.path.and_then(|path| self.on_path(path.step?));
                let ramp = on_path
                    .unwrap_or_else(|| self.motion().next(goal.into(), limits.step, &self.limits));
                match limits.range.add(last, ramp.step()) {
                    Some(next) => (Some(next), Some(ramp)),
                    // The counter ends here.
                    None => (Some(last), Some(Ramp::default())),
                }
            }
            (TargetKind::Rate, _) if self.is_halted => {
                let ramp = self.rate_to_zero(limits, last);
                (i32::try_from(ramp.rounded_rate()).ok(), Some(ramp))
            }
            _ => (self.requested, None),
        }
    }

    /// A rate returns to 0 by a ramp in which the rate is what the step is for a position.
    fn rate_to_zero(&self, limits: &GuardLimits, last: i32) -> Ramp {
        let ramp = self.motion();
        let is_continued = ramp.rounded_rate().abs_diff(last.into()) <= 1;
        // After a rejection the motion is unknown, but not the rate.
        let ramp =
            if is_continued { ramp } else { Ramp::following(i128::from(last) << FRACTION_BITS, 0) };
        let most = limits.bounds.map_or(i32::MAX as u32, |(min, max)| {
            if last < 0 { min.unsigned_abs() } else { max.unsigned_abs() }
        });
        let change = RampLimits::increments(limits.step).with_jerk(self.limits.jerk());
        ramp.next(0, most, &change)
    }
}

/// Binary places of the profile that the axes have in common: its rate at the call is 2^44 units.
pub(crate) const ONE_BITS: u32 = 44;

/// Part of an axis in a stop on the path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PathShare {
    /// Rate of the axis at the call, in units.
    pub(crate) rate: i128,
    /// Rate of the common profile in this cycle; `None` if no axis moves in it.
    pub(crate) step: Option<Profile>,
}

impl PathShare {
    /// The profile of the axis at one of the common profile.
    pub(crate) fn of(&self, common: Profile) -> Profile {
        let share = |common: i128| (self.rate * common) >> ONE_BITS;
        Profile { rate: share(common.rate), change: share(common.change) }
    }
}

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
    use crate::guard::terms::PositionRange;

    const ONE: i128 = 1 << FRACTION_BITS;

    fn limits(kind: TargetKind, step: u32) -> GuardLimits {
        GuardLimits {
            kind,
            range: PositionRange::Linear,
            step,
            window: 10_000,
            bounds: None,
            standstill: 20,
            tpdo_timeout: 5,
            wc_misses: 3,
            drain_images: 3,
        }
    }

    fn rate(source: &TargetSource, last: i32) -> (Option<i32>, Option<Ramp>) {
        source.next(&limits(TargetKind::Rate, 50), last, None)
    }

    fn position(source: &TargetSource, last: i32, step: i32) -> (Option<i32>, Option<Ramp>) {
        source.next(&limits(TargetKind::Position, 1_000), last, Some(step))
    }

    /// The motion that a ramp continues after these steps, whose means are over eight of them.
    fn continued(steps: impl Iterator<Item = i64>) -> (i128, i128) {
        let mut history = StepHistory::REST;
        steps.for_each(|step| history.push(step));
        let Profile { rate, change } = history.ramp(&RampLimits::new(16 * ONE / 50, 1)).profile();
        (rate, change)
    }

    #[test]
    fn ramp_continues_the_motion_of_the_application() {
        for sign in [1, -1] {
            let one = i128::from(sign) * ONE;
            let faster = (1..=40).map(|nth| sign * 10 * nth);
            assert_eq!(continued(faster.clone()), (400 * one, 10 * one));
            assert_eq!(continued(faster.rev()), (10 * one, -10 * one));
            // 2.75 increments per target, rounded.
            let constant = (0..40_i64).map(|nth| sign * if nth % 4 == 2 { 2 } else { 3 });
            assert_eq!(continued(constant), (11 * one / 4, 0));
        }
        // The last step bounds a change that the means cannot follow.
        assert_eq!(continued((0..40).map(|nth| if nth < 39 { 100 } else { 20 })).0, 20 * ONE);
        assert_eq!(continued([100; 40].into_iter().chain([0])).0, 0);
        // A mean below it moves the rate by less than an increment.
        assert_eq!(continued([20; 40].into_iter().chain([100])).0, 99 * ONE + 1);
    }

    #[test]
    fn halted_rate_returns_to_zero_by_its_limit() {
        let mut source = TargetSource::new(RampLimits::increments(10));
        source.requested = Some(500);
        assert_eq!(rate(&source, 120), (Some(500), None));
        for (last, next) in [(120, 70), (-20, 0)] {
            source.halt();
            source.note_sent(None, last.into());
            assert_eq!(rate(&source, last).0, Some(next));
            source.stop();
            assert_eq!(rate(&source, last).0, Some(next), "after a rejection");
        }
    }

    #[test]
    fn halted_rate_returns_to_zero_by_its_jerk() {
        let mut source = TargetSource::new(RampLimits::new(ONE, 20 * ONE));
        for _ in 0..20 {
            source.note_sent(None, 120);
        }
        source.halt();
        let mut rates = vec![120];
        while let Some(last) = rates.last().copied()
            && let (Some(next), ramp) = rate(&source, last)
            && last != 0
        {
            source.note_sent(ramp, next.into());
            rates.push(next);
        }
        assert_eq!(rates, [120, 100, 60, 20, 0]);
    }

    #[test]
    fn accelerating_rate_stays_inside_its_bounds() {
        let mut source = TargetSource::new(RampLimits::new(ONE, ONE));
        for n in 0..20 {
            source.note_sent(None, 40 * n);
        }
        source.halt();
        let limits = GuardLimits { bounds: Some((-9, 770)), ..limits(TargetKind::Rate, 50) };
        let mut last = 760;
        for _ in 0..200 {
            let (next, ramp) = source.next(&limits, last, None);
            assert!((0..=770).contains(&next.unwrap()), "{next:?}");
            last = next.unwrap();
            source.note_sent(ramp, last.into());
        }
        assert_eq!(last, 0);
    }

    #[test]
    fn own_step_uses_the_ramp_and_ends_with_the_counter() {
        let source = TargetSource::new(RampLimits::increments(10));
        assert_eq!(position(&source, 5, 100).0, Some(15));
        let at_the_end = position(&source, i32::MAX, 100);
        assert_eq!(at_the_end, (Some(i32::MAX), Some(Ramp::default())));
    }

    #[test]
    fn motion_ends_after_a_gap() {
        let mut source = TargetSource::new(RampLimits::increments(10));
        source.note_sent(None, 100);
        for _ in 0..MOST_GAP {
            source.note_gap();
        }
        assert_eq!(position(&source, 0, 0).0, Some(90));
        source.note_gap();
        assert_eq!(position(&source, 0, 0).0, Some(0), "it is at rest, and stays there");
        assert_eq!(position(&source, 0, 100).0, Some(10), "or starts again");
    }

    #[test]
    fn unsent_step_does_not_advance_the_ramp() {
        let mut source = TargetSource::new(RampLimits::increments(10));
        let next = |source: &TargetSource| position(source, 0, 100);
        assert_eq!([next(&source).0, next(&source).0], [Some(10), Some(10)]);
        let (_, ramp) = next(&source);
        source.note_sent(ramp, 10);
        assert_eq!(next(&source).0, Some(20));
        source.stop();
        assert!(source.is_at_rest());
        assert_eq!(next(&source).0, Some(10));
    }

    /// Motion of an application at a rate and a change that are no whole increments.
    fn source_after(limits: RampLimits, rate: f64, change: f64) -> TargetSource {
        let position = |n: f64| (rate * n + change * n * n / 2.0).round() as i64;
        let mut source = TargetSource::new(limits);
        for n in -40..0 {
            source.note_sent(None, position(f64::from(n + 1)) - position(f64::from(n)));
        }
        source
    }

    #[test]
    fn motion_of_the_application_is_estimated_from_rounded_targets() {
        let limits = RampLimits::new(ONE / 4, ONE / 1_000);
        for (rate, change) in [(32.4, -0.17), (32.4, 0.2), (-7.7, 0.1), (0.3, 0.0), (900.0, 0.25)] {
            let profile = source_after(limits, rate, change).motion().profile();
            let (found, slope) = (profile.rate as f64, profile.change as f64);
            assert!((found / ONE as f64 - rate).abs() < 1.0, "{rate}: {profile:?}");
            assert!((slope / ONE as f64 - change).abs() <= 0.25 / 8.0, "{change}: {profile:?}");
        }
    }

    #[test]
    fn axis_that_the_application_stopped_stays_at_rest() {
        let limits = RampLimits::new(ONE / 4, ONE / 1_000);
        let mut source = source_after(limits, 100.0, 0.0);
        source.note_sent(None, 0);
        assert!(source.is_at_rest());
        source.halt();
        let (next, ramp) = position(&source, 7, 0);
        assert_eq!((next, ramp.map(|ramp| ramp.profile())), (Some(7), Some(Profile::default())));
    }

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
        assert_eq!(period.lead(), 2);
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
