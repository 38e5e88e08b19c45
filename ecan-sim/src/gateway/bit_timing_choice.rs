//! Choice of a bit timing from the sample point window (manual 5.4.3, 13.4), which the manual leaves open.

use ecan_protocol::can::{BitTiming, Phase};
use ecan_protocol::config::{BitTimingMode, McanChannelConfig, SamplePointWindow};

use super::variant::BitTimingChoice;

/// Nominal and, for CAN FD, data bit timing of a configuration; `None` if there is none.
pub(super) fn choose(
    config: &McanChannelConfig,
    clock_hz: u32,
    choice: BitTimingChoice,
) -> Option<(BitTiming, Option<BitTiming>)> {
    let (nominal, data) = config.timings(clock_hz).ok()?;
    if config.bit_timing_mode == BitTimingMode::Manual {
        return Some((nominal, data));
    }
    let of = |phase, middle: BitTiming| {
        let (limits, bitrate, window) = match phase {
            Phase::Nominal if config.fd => {
                (&DRIVER_FD_NOMINAL, config.nominal_bitrate, config.nominal_sample_point)
            }
            Phase::Nominal => {
                (&DRIVER_CLASSIC, config.nominal_bitrate, config.nominal_sample_point)
            }
            Phase::Data => (&DRIVER_DATA, config.data_bitrate, config.data_sample_point),
        };
        match choice {
            BitTimingChoice::Middle => Some(middle),
            BitTimingChoice::Lowest => Some(at_bound(phase, middle, window, Bound::Lowest)),
            BitTimingChoice::Highest => Some(at_bound(phase, middle, window, Bound::Highest)),
            BitTimingChoice::Driver => limits.timing(clock_hz.checked_div(bitrate)?, window),
        }
    };
    let data = match data {
        Some(middle) => Some(of(Phase::Data, middle)?),
        None => None,
    };
    Some((of(Phase::Nominal, nominal)?, data))
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Bound {
    Lowest,
    Highest,
}

/// The timing with the same quanta whose sample point is the lowest or highest of the window.
fn at_bound(phase: Phase, middle: BitTiming, window: SamplePointWindow, bound: Bound) -> BitTiming {
    let quanta = middle.quanta();
    let inside = |before: &u32| {
        let permille = u32::from(window.min) * quanta..=u32::from(window.max) * quanta;
        permille.contains(&(before * 1000)) && with_sample_point(middle, *before).fits(phase)
    };
    let mut points = (2..quanta).filter(inside);
    let chosen = match bound {
        Bound::Lowest => points.next(),
        Bound::Highest => points.next_back(),
    };
    chosen.map_or(middle, |before| with_sample_point(middle, before))
}

/// The timing with `before` quanta up to its sample point.
fn with_sample_point(timing: BitTiming, before: u32) -> BitTiming {
    let tseg2 = (timing.quanta() - before) as u16;
    let tseg1 = (before - 1) as u16;
    BitTiming { brp: timing.brp, tseg1, tseg2, sjw: timing.sjw.min(tseg2).max(1) }
}

/// Limits of the public MCAN driver of the controller's vendor (HPMicro SDK), in quanta.
struct DriverLimits {
    quanta: u32,
    /// Largest number before the sample point, the sync segment included.
    before: u32,
    /// Smallest and largest number after it.
    after: (u32, u32),
    /// Smallest surplus of the part before the sample point.
    surplus: u32,
    sjw: u32,
}

const DRIVER_CLASSIC: DriverLimits =
    DriverLimits { quanta: 384, before: 256, after: (2, 128), surplus: 2, sjw: 128 };
const DRIVER_FD_NOMINAL: DriverLimits =
    DriverLimits { quanta: 288, before: 256, after: (1, 32), surplus: 2, sjw: 128 };
const DRIVER_DATA: DriverLimits =
    DriverLimits { quanta: 46, before: 31, after: (1, 15), surplus: 1, sjw: 15 };

impl DriverLimits {
    const SHORTEST: u32 = 8;
    const PRESCALER_MAX: u32 = 256;

    /// As the driver: the smallest prescaler that divides the bit time of `clocks`, with the first sample
    /// point in the window from below. It tries the next prescaler if the registers cannot hold that, but
    /// not if the point lies beyond the window.
    fn timing(&self, clocks: u32, window: SamplePointWindow) -> Option<BitTiming> {
        let (min, max) = (u32::from(window.min), u32::from(window.max));
        let prescalers = (1..=Self::PRESCALER_MAX).filter(|brp| clocks.is_multiple_of(*brp));
        for brp in prescalers.skip_while(|brp| clocks / brp > self.quanta) {
            let quanta = clocks / brp;
            if quanta < Self::SHORTEST {
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
