//! CAN bit timing of the MCAN core, and its transmitter delay compensation (manual 13.4).
//!
//! In automatic mode the firmware solves the timing from bit rate and sample point window. This solver
//! predicts the result, or that there is none. It selects from the divisors of the source clock by:
//!
//! 1. the smallest deviation from the bit rate (normally none),
//! 2. the smallest prescaler, that is the finest quanta,
//! 3. the sample point closest to the middle of the window, the later one of two.
//!
//! The jump width is the largest that phase segment 2 and the register allow.
//!
//! Bit timing that the public MCAN driver of the controller's vendor (HPMicro SDK) chooses from a
//! sample point window.
//!
//! The manual does not state how the firmware chooses (13.4); it names this driver for the
//! delay compensation only. The result is a hint, not a fact about the device.

use core::fmt;

/// Default source clock of each MCAN in Hz (0x8000:06..09, manual 13.3).
pub const MCAN_CLOCK_HZ: u32 = 80_000_000;

/// From this data bit rate the firmware always enables TDC (manual 13.4).
pub const TDC_FORCED_FROM: u32 = 5_000_000;

/// Largest data prescaler with which the MCAN core can compensate the transmitter delay.
pub const TDC_MAX_PRESCALER: u16 = 2;

/// Allowed deviation of the solved bit rate, in parts per million. Both ends of a CAN bus together may
/// differ by several thousand; 500 leaves a reserve for crystals.
pub const BITRATE_TOLERANCE_PPM: u32 = 500;

crate::text_enum! {
    /// One of the two bit timings of CAN FD.
    pub enum Phase;
    /// Arbitration phase, and all of a classic frame.
    Nominal = "nominal";
    /// Data phase of a CAN FD frame with bit rate switch.
    Data = "data";
}

/// Limits of the MCAN registers; every minimum is 1, except 2 of the nominal segments.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimingLimits {
    /// Largest prescaler.
    pub brp_max: u16,
    /// Smallest and largest segment before the sample point, in quanta.
    pub tseg1: (u16, u16),
    /// Smallest and largest segment after the sample point, in quanta.
    pub tseg2: (u16, u16),
    /// Largest jump width, in quanta.
    pub sjw_max: u16,
}

impl Phase {
    /// Register limits of the phase.
    pub const fn limits(self) -> TimingLimits {
        match self {
            Self::Nominal => {
                TimingLimits { brp_max: 512, tseg1: (2, 256), tseg2: (2, 128), sjw_max: 128 }
            }
            Self::Data => TimingLimits { brp_max: 32, tseg1: (1, 32), tseg2: (1, 16), sjw_max: 16 },
        }
    }
}

/// A bit timing in physical values (the registers hold each value minus one).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BitTiming {
    /// Prescaler: source clock periods per quantum.
    pub brp: u16,
    /// Quanta between the sync segment and the sample point.
    pub tseg1: u16,
    /// Quanta after the sample point.
    pub tseg2: u16,
    /// Jump width in quanta.
    pub sjw: u16,
}

impl BitTiming {
    /// Quanta per bit, the sync segment included.
    pub const fn quanta(&self) -> u32 {
        1 + self.tseg1 as u32 + self.tseg2 as u32
    }

    /// Source clock periods per bit.
    pub const fn clocks_per_bit(&self) -> u32 {
        (self.brp as u32).saturating_mul(self.quanta())
    }

    /// Bit rate in bit/s at a source clock in Hz, rounded down; 0 for a prescaler of 0.
    pub const fn bitrate(&self, clock_hz: u32) -> u32 {
        match clock_hz.checked_div(self.clocks_per_bit()) {
            Some(bitrate) => bitrate,
            None => 0,
        }
    }

    /// Sample point in 0.01 %, rounded to the nearest.
    pub const fn sample_point(&self) -> SamplePoint {
        SamplePoint::of(1 + self.tseg1 as u32, self.quanta())
    }

    /// True if the registers of a phase can hold the timing and the jump width is at most phase
    /// segment 2.
    pub const fn fits(&self, phase: Phase) -> bool {
        let l = phase.limits();
        self.brp >= 1
            && self.brp <= l.brp_max
            && self.tseg1 >= l.tseg1.0
            && self.tseg1 <= l.tseg1.1
            && self.tseg2 >= l.tseg2.0
            && self.tseg2 <= l.tseg2.1
            && self.sjw >= 1
            && self.sjw <= l.sjw_max
            && self.sjw <= self.tseg2
    }

    /// Offset of the secondary sample point that the driver uses for TDC offset 0: the data sample
    /// point in clock periods (minimum time quanta). `None` if the prescaler is above
    /// [`TDC_MAX_PRESCALER`], with which the core cannot compensate.
    pub const fn automatic_tdc_offset(&self) -> Option<u8> {
        let offset = self.brp as u32 * (1 + self.tseg1 as u32);
        if self.brp >= 1 && self.brp <= TDC_MAX_PRESCALER && offset <= 127 {
            Some(offset as u8)
        } else {
            None
        }
    }
}

/// True if the transmitter delay compensation is active: enabled, or forced by a data bit rate of
/// [`TDC_FORCED_FROM`] or more (manual 13.4, "TDC Strategy").
pub const fn tdc_active(enabled: bool, data_bitrate: u32) -> bool {
    enabled || data_bitrate >= TDC_FORCED_FROM
}

/// A sample point in 0.01 % of the bit time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SamplePoint(pub u16);

impl SamplePoint {
    const fn of(before: u32, quanta: u32) -> Self {
        Self(((20_000 * before + quanta) / (2 * quanta)) as u16)
    }
}

impl fmt::Display for SamplePoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (whole, hundredths) = (self.0 / 100, self.0 % 100);
        match hundredths {
            0 => write!(f, "{whole} %"),
            h if h % 10 == 0 => write!(f, "{whole}.{} %", h / 10),
            h => write!(f, "{whole}.{h:02} %"),
        }
    }
}

/// Error: there is no bit timing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BitTimingError {
    /// Clock or bit rate is 0.
    #[error("clock and bit rate must not be 0")]
    Zero,
    /// The window's bounds (0.1 %) are reversed or beyond 100 %.
    #[error(
        "sample point window {}..{} is not a range inside 0..100 %",
        Permille(*.min_permille), Permille(*.max_permille)
    )]
    Window {
        /// Lower bound in 0.1 %.
        min_permille: u16,
        /// Upper bound in 0.1 %.
        max_permille: u16,
    },
    /// No divisor of the clock comes close enough to the bit rate.
    #[error(
        "{bitrate} bit/s cannot be divided from a clock of {clock_hz} Hz{}",
        Nearest(*.below, *.above, " bit/s")
    )]
    Bitrate {
        /// Source clock in Hz.
        clock_hz: u32,
        /// The requested bit rate, bit/s.
        bitrate: u32,
        /// Closest possible bit rate below, if any.
        below: Option<u32>,
        /// Closest possible bit rate above, if any.
        above: Option<u32>,
    },
    /// The bit rate is possible, but with no sample point inside the window.
    #[error(
        "no sample point between {} and {} at {bitrate} bit/s{}",
        Permille(*.min_permille), Permille(*.max_permille), Nearest(*.below, *.above, "")
    )]
    SamplePoint {
        /// The bit rate in bit/s.
        bitrate: u32,
        /// Lower bound in 0.1 %.
        min_permille: u16,
        /// Upper bound in 0.1 %.
        max_permille: u16,
        /// Closest possible sample point before the window, if any.
        below: Option<SamplePoint>,
        /// Closest possible sample point after the window, if any.
        above: Option<SamplePoint>,
    },
}

/// The nearest possible values and their unit, printed after a comma.
struct Nearest<T>(Option<T>, Option<T>, &'static str);

impl<T: fmt::Display> fmt::Display for Nearest<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let unit = self.2;
        match (&self.0, &self.1) {
            (Some(below), Some(above)) => {
                write!(f, ", nearest are {below}{unit} and {above}{unit}")
            }
            (Some(one), None) | (None, Some(one)) => write!(f, ", nearest is {one}{unit}"),
            (None, None) => Ok(()),
        }
    }
}

/// A sample point bound in 0.1 %, printed in percent.
struct Permille(u16);

impl fmt::Display for Permille {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 % 10 {
            0 => write!(f, "{} %", self.0 / 10),
            tenth => write!(f, "{}.{tenth} %", self.0 / 10),
        }
    }
}

/// Solves the timing of a phase for a clock (Hz), a bit rate (bit/s) and a sample point window
/// (0.1 %, bounds included); equal bounds request exactly that sample point.
///
/// # Errors
/// [`BitTimingError`], with the nearest possible values.
pub fn solve_bit_timing(
    phase: Phase,
    clock_hz: u32,
    bitrate: u32,
    min_permille: u16,
    max_permille: u16,
) -> Result<BitTiming, BitTimingError> {
    if clock_hz == 0 || bitrate == 0 {
        return Err(BitTimingError::Zero);
    }
    if min_permille > max_permille || max_permille > 1000 {
        return Err(BitTimingError::Window { min_permille, max_permille });
    }
    let window = (u32::from(min_permille), u32::from(max_permille));
    let mut best: Option<(u64, BitTiming)> = None;
    let mut bitrate_possible = false;
    let mut below = None;
    let mut above = None;
    for brp in 1..=phase.limits().brp_max {
        let Some((quanta, deviation)) = quanta_for(phase, clock_hz, bitrate, brp) else {
            continue;
        };
        bitrate_possible = true;
        match place_sample_point(phase, brp, quanta, window) {
            // A later prescaler is selected only for a smaller deviation.
            Placed::Inside(timing) if best.is_none_or(|(least, _)| deviation < least) => {
                best = Some((deviation, timing));
            }
            Placed::Inside(_) => {}
            Placed::Outside { before, after } => {
                below = below.max(before);
                above = match (above, after) {
                    (Some(a), Some(b)) => Some(core::cmp::min::<SamplePoint>(a, b)),
                    (a, b) => a.or(b),
                };
            }
        }
    }
    match best {
        Some((_, timing)) => Ok(timing),
        None if bitrate_possible => {
            Err(BitTimingError::SamplePoint { bitrate, min_permille, max_permille, below, above })
        }
        None => Err(nearest_bitrates(phase, clock_hz, bitrate)),
    }
}

/// Quanta per bit that come closest to the bit rate with a prescaler, and the deviation (clock
/// periods times bit rate); `None` outside the registers or the tolerance.
fn quanta_for(phase: Phase, clock_hz: u32, bitrate: u32, brp: u16) -> Option<(u32, u64)> {
    let (clock, rate) = (u64::from(clock_hz), u64::from(bitrate));
    let per_quantum = rate * u64::from(brp);
    let quanta = (clock + per_quantum / 2) / per_quantum;
    let l = phase.limits();
    let range = u64::from(1 + l.tseg1.0 + l.tseg2.0)..=u64::from(1 + l.tseg1.1 + l.tseg2.1);
    if !range.contains(&quanta) {
        return None;
    }
    let deviation = (quanta * per_quantum).abs_diff(clock);
    if deviation * 1_000_000 > clock * u64::from(BITRATE_TOLERANCE_PPM) {
        return None;
    }
    Some((quanta as u32, deviation))
}

enum Placed {
    Inside(BitTiming),
    Outside { before: Option<SamplePoint>, after: Option<SamplePoint> },
}

/// Selects the segments of a bit of `quanta`.
fn place_sample_point(phase: Phase, brp: u16, quanta: u32, window: (u32, u32)) -> Placed {
    let l = phase.limits();
    // Quanta up to the sample point, limited by both segments.
    let first = (1 + u32::from(l.tseg1.0)).max(quanta.saturating_sub(u32::from(l.tseg2.1)));
    let last = (1 + u32::from(l.tseg1.1)).min(quanta.saturating_sub(u32::from(l.tseg2.0)));
    let mut inside: Option<(u32, u32)> = None;
    let mut before = None;
    let mut after = None;
    for at in first..=last {
        let point = at * 1000;
        if point < window.0 * quanta {
            before = Some(SamplePoint::of(at, quanta));
        } else if point > window.1 * quanta {
            after = after.or(Some(SamplePoint::of(at, quanta)));
        } else {
            let distance = (2 * point).abs_diff((window.0 + window.1) * quanta);
            if inside.is_none_or(|(least, _)| distance <= least) {
                inside = Some((distance, at));
            }
        }
    }
    match inside {
        Some((_, at)) => {
            let (tseg1, tseg2) = ((at - 1) as u16, (quanta - at) as u16);
            Placed::Inside(BitTiming { brp, tseg1, tseg2, sjw: tseg2.min(tseg1).min(l.sjw_max) })
        }
        None => Placed::Outside { before, after },
    }
}

/// The bit rates on either side of an impossible one.
fn nearest_bitrates(phase: Phase, clock_hz: u32, bitrate: u32) -> BitTimingError {
    let l = phase.limits();
    let least = u32::from(1 + l.tseg1.0 + l.tseg2.0);
    let most = u32::from(1 + l.tseg1.1 + l.tseg2.1);
    let (mut below, mut above) = (None, None);
    for brp in 1..=u32::from(l.brp_max) {
        // Rounded up, the quanta give the bit rate at or below; one less the one above.
        let slower = clock_hz.div_ceil(bitrate).div_ceil(brp);
        if slower <= most {
            let rate = clock_hz / (brp * slower.max(least));
            if rate < bitrate {
                below = below.max(Some(rate));
            }
        }
        let faster = (clock_hz / bitrate / brp).min(most);
        if faster >= least {
            let rate = clock_hz / (brp * faster);
            above = Some(above.map_or(rate, |a: u32| a.min(rate)));
        }
    }
    BitTimingError::Bitrate { clock_hz, bitrate, below: below.filter(|&b| b > 0), above }
}

/// The sample point of the manual's example (5.4.3) and of most CAN nodes, in 0.1 %.
const USUAL: u16 = 875;
/// The smallest other one, in 0.1 %.
const SMALLEST: u16 = 500;

/// Sample point in 0.1 % to configure if that of the other nodes is not known: 87.5 %, or the next
/// smaller one that the controller reaches at this clock (Hz) and bit rate (bit/s).
///
/// Preferred are those that [`vendor_driver_timing`] finds too, in the data phase with a prescaler
/// that allows the transmitter delay compensation. `None` if the bit rate is not possible. Takes up
/// to some milliseconds: not for the cycle.
pub fn usual_sample_point(phase: Phase, is_fd: bool, clock_hz: u32, bitrate: u32) -> Option<u16> {
    solve_bit_timing(phase, clock_hz, bitrate, 0, 1000).ok()?;
    let solved = |permille: u16| {
        let timing = solve_bit_timing(phase, clock_hz, bitrate, permille, permille).ok()?;
        let is_found =
            vendor_driver_timing(phase, is_fd, clock_hz, bitrate, permille, permille).is_some();
        let is_compensable = phase == Phase::Nominal || timing.brp <= TDC_MAX_PRESCALER;
        Some((is_found, is_compensable))
    };
    let mut best = None;
    for permille in (SMALLEST..=USUAL).rev() {
        match solved(permille) {
            Some((true, true)) => return Some(permille),
            Some(rank) if best.is_none_or(|(least, _)| rank > least) => {
                best = Some((rank, permille));
            }
            _ => {}
        }
    }
    best.map(|(_, permille)| permille)
}

/// Lowest and highest sample point that the firmware may choose from a window (0.1 %, bounds
/// included) at a clock (Hz) and a bit rate (bit/s), by any rule.
///
/// # Errors
/// As [`solve_bit_timing`].
pub fn sample_point_range(
    phase: Phase,
    clock_hz: u32,
    bitrate: u32,
    min_permille: u16,
    max_permille: u16,
) -> Result<(SamplePoint, SamplePoint), BitTimingError> {
    let solve = |min, max| solve_bit_timing(phase, clock_hz, bitrate, min, max);
    let any = solve(min_permille, max_permille)?;
    // A narrower window at each end: the first that has a timing.
    let mut from_below = min_permille..=max_permille;
    let mut from_above = (min_permille..=max_permille).rev();
    let lowest = from_below.find_map(|to| solve(min_permille, to).ok()).unwrap_or(any);
    let highest = from_above.find_map(|from| solve(from, max_permille).ok()).unwrap_or(any);
    Ok((lowest.sample_point(), highest.sample_point()))
}

/// Timing that the driver chooses for a clock (Hz), a bit rate (bit/s) and a sample point window
/// (0.1 %, bounds included): the lowest sample point that it finds. `is_fd` is the kind of the
/// channel. `None` if the driver finds none, although another timing may exist.
pub fn vendor_driver_timing(
    phase: Phase,
    is_fd: bool,
    clock_hz: u32,
    bitrate: u32,
    min_permille: u16,
    max_permille: u16,
) -> Option<BitTiming> {
    let limits = match phase {
        Phase::Nominal if is_fd => &FD_NOMINAL,
        Phase::Nominal => &CLASSIC,
        Phase::Data => &DATA,
    };
    let clocks = clock_hz.checked_div(bitrate)?;
    let timing = limits.timing(clocks, u32::from(min_permille), u32::from(max_permille));
    timing.filter(|timing| timing.fits(phase))
}

/// Limits of the driver, in quanta.
struct Limits {
    quanta: u32,
    /// Largest number before the sample point, the sync segment included.
    before: u32,
    /// Smallest and largest number after it.
    after: (u32, u32),
    /// Smallest surplus of the part before the sample point.
    surplus: u32,
    sjw: u32,
}

const CLASSIC: Limits = Limits { quanta: 384, before: 256, after: (2, 128), surplus: 2, sjw: 128 };
const FD_NOMINAL: Limits =
    Limits { quanta: 288, before: 256, after: (1, 32), surplus: 2, sjw: 128 };
const DATA: Limits = Limits { quanta: 46, before: 31, after: (1, 15), surplus: 1, sjw: 15 };

const SHORTEST: u32 = 8;
const PRESCALER_MAX: u32 = 256;

impl Limits {
    /// The smallest prescaler that divides the bit time of `clocks`, with the first sample point in
    /// the window from below. The driver tries the next prescaler if the registers cannot hold that,
    /// but not if the point lies beyond the window.
    fn timing(&self, clocks: u32, min: u32, max: u32) -> Option<BitTiming> {
        let prescalers = (1..=PRESCALER_MAX).filter(|brp| clocks.is_multiple_of(*brp));
        for brp in prescalers.skip_while(|brp| clocks / brp > self.quanta) {
            let quanta = clocks / brp;
            if quanta < SHORTEST {
                break;
            }
            let widest = self.after.1.min((quanta - self.surplus) / 2);
            let before = (quanta - widest).max((min * quanta).div_ceil(1000));
            if before * 1000 / quanta > max {
                break;
            }
            let after = quanta.saturating_sub(before);
            if after >= self.after.0 && before <= self.before {
                return Some(BitTiming {
                    brp: brp as u16,
                    tseg1: (before - 1) as u16,
                    tseg2: after as u16,
                    sjw: after.min(self.sjw) as u16,
                });
            }
        }
        None
    }
}
