//! Choice of a bit timing from the sample point window (manual 5.4.3, 13.4), which the manual leaves open.

use ecan_protocol::can::{BitTiming, Phase, vendor_driver_timing};
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
        let (bitrate, window) = config.bit_rate_and_window(phase);
        match choice {
            BitTimingChoice::Middle => Some(middle),
            BitTimingChoice::Lowest => Some(at_bound(phase, middle, window, Bound::Lowest)),
            BitTimingChoice::Highest => Some(at_bound(phase, middle, window, Bound::Highest)),
            BitTimingChoice::Driver => {
                vendor_driver_timing(phase, config.fd, clock_hz, bitrate, window.min, window.max)
            }
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
