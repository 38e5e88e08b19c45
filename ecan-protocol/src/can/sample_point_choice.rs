//! Sample points that a bit rate allows (manual 5.4.3, 13.4).

use super::bit_timing::{BitTimingError, Phase, SamplePoint, TDC_MAX_PRESCALER, solve_bit_timing};
use super::vendor_driver::vendor_driver_timing;

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
