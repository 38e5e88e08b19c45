//! Bit timing that the public MCAN driver of the controller's vendor (HPMicro SDK) chooses from a
//! sample point window.
//!
//! The manual does not state how the firmware chooses (13.4); it names this driver for the
//! delay compensation only. The result is a hint, not a fact about the device.

use super::bit_timing::{BitTiming, Phase};

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
