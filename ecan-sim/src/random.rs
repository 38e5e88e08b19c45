//! Random numbers of a simulation, and the delays of the application's sleeps.

/// A SplitMix64 generator: the same seed gives the same numbers on every machine.
#[derive(Clone, Debug, Default)]
pub(crate) struct Random {
    state: u64,
}

impl Random {
    pub(crate) const fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    pub(crate) const fn next(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.state;
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ z >> 31
    }

    /// A number below `limit`; 0 for a limit of 0.
    pub(crate) const fn below(&mut self, limit: u64) -> u64 {
        // The high half of the product; its bias is negligible here.
        ((self.next() as u128 * limit as u128) >> 64) as u64
    }

    /// True with a probability of `per_mille` / 1000.
    pub(crate) const fn chance(&mut self, per_mille: u16) -> bool {
        self.below(1000) < per_mille as u64
    }
}

/// Delay of the application's sleeps in stepped time.
///
/// Half of the sleeps end between half of `typical_ns` and `typical_ns` late, 49 of 100 between
/// that and `p99_ns`, and one of 100 between that and `longest_ns`; the longer the delay, the
/// rarer. This is the long tail of a loaded machine (manual 13.9).
///
/// The scenario's seed determines the delays. Nothing else is delayed: neither the master's
/// blocking calls nor [`Simulation::pass_ns`](crate::Simulation::pass_ns). The real clock has its
/// own delays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WakeUpDelay {
    /// Median, ns.
    pub typical_ns: u64,
    /// Limit of 99 of 100 sleeps, ns; at least `typical_ns`.
    pub p99_ns: u64,
    /// Limit of all sleeps, ns; at least `p99_ns`.
    pub longest_ns: u64,
}

const DRAWS: u64 = 1_000_000;
const HALF: u64 = DRAWS / 2;
const P99: u64 = DRAWS / 100 * 99;

impl WakeUpDelay {
    /// The delay that this many of [`DRAWS`] random numbers do not exceed.
    fn quantile_ns(self, rank: u64) -> u64 {
        let Self { typical_ns, p99_ns, longest_ns } = self;
        match rank {
            0..HALF => between(typical_ns / 2, typical_ns, rank, HALF, 1),
            HALF..P99 => between(typical_ns, p99_ns, rank - HALF, P99 - HALF, 3),
            _ => between(p99_ns, longest_ns, rank.min(DRAWS) - P99, DRAWS - P99, 2),
        }
    }
}

/// Interpolates from `low` to `high` by `part / whole` to the power `power`.
fn between(low: u64, high: u64, part: u64, whole: u64, power: u32) -> u64 {
    const ONE: u128 = 1 << 32;
    let share = ONE * u128::from(part) / u128::from(whole.max(1));
    let bent = (1..power).fold(share, |bent, _| bent * share / ONE);
    let added = u128::from(high.saturating_sub(low)) * bent / ONE;
    low.saturating_add(u64::try_from(added).unwrap_or(u64::MAX))
}

#[derive(Debug)]
pub(crate) struct WakeUps {
    delay: WakeUpDelay,
    random: Random,
}

impl WakeUps {
    pub(crate) fn new(delay: WakeUpDelay, seed: u64) -> Self {
        Self { delay, random: Random::new(seed ^ 0x5EE9_0000_1A7E_57A9) }
    }

    pub(crate) fn next_ns(&mut self) -> u64 {
        self.delay.quantile_ns(self.random.below(DRAWS))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DELAY: WakeUpDelay =
        WakeUpDelay { typical_ns: 10_000, p99_ns: 80_000, longest_ns: 600_000 };

    #[test]
    fn delays_have_configured_quantiles() {
        let mut wake_ups = WakeUps::new(DELAY, 1);
        let mut drawn: Vec<u64> = (0..100_000).map(|_| wake_ups.next_ns()).collect();
        drawn.sort_unstable();
        let near = |rank: usize, ns: u64| drawn[rank].abs_diff(ns) * 100 < ns * 3;
        assert!(
            near(50_000, 10_000) && near(99_000, 80_000),
            "{} {}",
            drawn[50_000],
            drawn[99_000]
        );
        assert!(drawn[0] >= 5_000 && drawn[99_999] <= 600_000 && drawn[99_999] > 550_000);
    }

    #[test]
    fn quantiles_are_monotonic_and_continuous() {
        let all: Vec<u64> = (0..=DRAWS).step_by(97).map(|r| DELAY.quantile_ns(r)).collect();
        assert!(all.is_sorted());
        assert_eq!(DELAY.quantile_ns(HALF), 10_000);
        assert_eq!(DELAY.quantile_ns(P99), 80_000);
        assert_eq!(DELAY.quantile_ns(DRAWS), 600_000);
        let exact = WakeUpDelay { typical_ns: 0, p99_ns: 0, longest_ns: 0 };
        assert_eq!(exact.quantile_ns(DRAWS), 0);
    }
}
