//! Bit timing of the MCAN at 80 MHz (manual 13.4, DESIGN "at 80 MHz and 5 Mbit/s").

use ecan_protocol::can::{
    BITRATE_TOLERANCE_PPM, BitTiming, BitTimingError, MCAN_CLOCK_HZ, Phase, SamplePoint,
    solve_bit_timing, tdc_active,
};
use proptest::prelude::*;

const CLOCK: u32 = MCAN_CLOCK_HZ;

fn timing(brp: u16, tseg1: u16, tseg2: u16, sjw: u16) -> BitTiming {
    BitTiming { brp, tseg1, tseg2, sjw }
}

#[test]
fn nominal_timings_match_hand_calculation() {
    // Bit rate, window, expected. 80 quanta at 1 Mbit/s: 65 of them are 81.25 %.
    for (bitrate, min, max, expected) in [
        (1_000_000, 750, 875, timing(1, 64, 15, 15)),
        (1_000_000, 875, 875, timing(1, 69, 10, 10)),
        (500_000, 800, 800, timing(1, 127, 32, 32)),
        (500_000, 875, 875, timing(1, 139, 20, 20)),
        (250_000, 750, 750, timing(1, 239, 80, 80)),
        // 640 periods as 2 * 320: 260 of 320 are 81.25 %, but TSEG1 ends at 257 of 320.
        (125_000, 750, 875, timing(2, 256, 63, 63)),
        // For 87.5 % TSEG1 would need 279 then: the next prescaler.
        (125_000, 875, 875, timing(4, 139, 20, 20)),
        // 8000 periods divide by 25, 32 and 40; 87.5 % of 320 is too long, of 250 no integer.
        (10_000, 750, 875, timing(25, 256, 63, 63)),
        (10_000, 875, 875, timing(40, 174, 25, 25)),
    ] {
        assert_eq!(
            solve_bit_timing(Phase::Nominal, CLOCK, bitrate, min, max),
            Ok(expected),
            "{bitrate}"
        );
        assert_eq!(expected.bitrate(CLOCK), bitrate);
        assert!(expected.fits(Phase::Nominal));
    }
}

#[test]
fn data_timings_match_hand_calculation() {
    for (bitrate, min, max, expected) in [
        (5_000_000, 750, 875, timing(1, 12, 3, 3)),
        (5_000_000, 875, 875, timing(1, 13, 2, 2)),
        (8_000_000, 750, 875, timing(1, 7, 2, 2)),
        // 32 and 33 of 40 have the same distance from 81.25 %: the later one, the last that TSEG1 allows.
        (2_000_000, 750, 875, timing(1, 32, 7, 7)),
        // 87.5 % is not possible with 40, 20 and 10 quanta, but with 8.
        (2_000_000, 875, 875, timing(5, 6, 1, 1)),
        (1_000_000, 800, 800, timing(2, 31, 8, 8)),
    ] {
        let solved = solve_bit_timing(Phase::Data, CLOCK, bitrate, min, max);
        assert_eq!(solved, Ok(expected), "{bitrate}");
        assert!(expected.fits(Phase::Data));
    }
}

#[test]
fn five_megabit_has_three_sample_points_in_the_default_window() {
    let mut found = Vec::new();
    for permille in 750..=875 {
        // Windows of 0.1 %: 81.25 % lies between 81.2 and 81.3.
        if let Ok(timing) = solve_bit_timing(Phase::Data, CLOCK, 5_000_000, permille, permille + 1)
        {
            assert_eq!(timing.quanta(), 16);
            found.push(timing.sample_point());
        }
    }
    found.dedup();
    assert_eq!(found, [SamplePoint(7500), SamplePoint(8125), SamplePoint(8750)]);
}

#[test]
fn impossible_window_names_nearest_sample_points() {
    let error = solve_bit_timing(Phase::Data, CLOCK, 5_000_000, 800, 800).unwrap_err();
    assert_eq!(
        error.to_string(),
        "no sample point between 80 % and 80 % at 5000000 bit/s, nearest are 75 % and 81.25 %"
    );
    // With 10 quanta at 8 Mbit/s and TSEG2 of 1 the last point is 90 %.
    let error = solve_bit_timing(Phase::Data, CLOCK, 8_000_000, 950, 960).unwrap_err();
    assert_eq!(
        error.to_string(),
        "no sample point between 95 % and 96 % at 8000000 bit/s, nearest is 90 %"
    );
}

#[test]
fn impossible_bit_rate_names_nearest() {
    // 80 MHz / 3 Mbit/s is 26.67.
    let error = solve_bit_timing(Phase::Data, CLOCK, 3_000_000, 750, 875).unwrap_err();
    assert_eq!(
        error.to_string(),
        "3000000 bit/s cannot be divided from a clock of 80000000 Hz, \
         nearest are 2962962 bit/s and 3076923 bit/s"
    );
    // Slower than 512 * 385 periods.
    assert_eq!(
        solve_bit_timing(Phase::Nominal, CLOCK, 100, 750, 875),
        Err(BitTimingError::Bitrate {
            clock_hz: CLOCK,
            bitrate: 100,
            below: None,
            above: Some(405)
        })
    );
    assert_eq!(solve_bit_timing(Phase::Nominal, CLOCK, 0, 750, 875), Err(BitTimingError::Zero));
    assert_eq!(solve_bit_timing(Phase::Nominal, 0, 500_000, 750, 875), Err(BitTimingError::Zero));
    assert_eq!(
        solve_bit_timing(Phase::Nominal, CLOCK, 500_000, 875, 750).unwrap_err().to_string(),
        "sample point window 87.5 %..75 % is not a range inside 0..100 %"
    );
}

#[test]
fn odd_bit_rates_are_solved_within_tolerance() {
    // 83.333 kbit/s: 960 periods give 83333.33 bit/s.
    let timing = solve_bit_timing(Phase::Nominal, CLOCK, 83_333, 750, 875).unwrap();
    assert_eq!(timing.clocks_per_bit(), 960);
    assert_eq!(timing.bitrate(CLOCK), 83_333);
}

#[test]
fn delay_compensation_offset() {
    assert!(tdc_active(false, 5_000_000));
    assert!(!tdc_active(false, 4_999_999));
    assert!(tdc_active(true, 1_000_000));
    // The offset is the sample point: 14 of 16 periods, or 2 * 32.
    assert_eq!(timing(1, 13, 2, 2).automatic_tdc_offset(), Some(14));
    assert_eq!(timing(2, 31, 8, 8).automatic_tdc_offset(), Some(64));
    assert_eq!(timing(4, 31, 8, 8).automatic_tdc_offset(), None);
    assert_eq!(timing(0, 31, 8, 8).automatic_tdc_offset(), None);
}

#[test]
fn sample_point_display_is_percent() {
    assert_eq!(SamplePoint(8125).to_string(), "81.25 %");
    assert_eq!(SamplePoint(8750).to_string(), "87.5 %");
    assert_eq!(SamplePoint(8000).to_string(), "80 %");
    assert_eq!(SamplePoint(8005).to_string(), "80.05 %");
}

/// Every timing of a prescaler for a bit rate of a phase, by trying all.
fn all_timings(phase: Phase, clock: u32, bitrate: u32) -> Vec<(u64, BitTiming)> {
    let l = phase.limits();
    let mut found = Vec::new();
    for brp in 1..=l.brp_max {
        for quanta in 1 + l.tseg1.0 + l.tseg2.0..=1 + l.tseg1.1 + l.tseg2.1 {
            let periods = u64::from(brp) * u64::from(quanta) * u64::from(bitrate);
            let off = periods.abs_diff(u64::from(clock));
            if off * 1_000_000 > u64::from(clock) * u64::from(BITRATE_TOLERANCE_PPM) {
                continue;
            }
            for tseg1 in l.tseg1.0..=l.tseg1.1 {
                let tseg2 = (quanta - 1).saturating_sub(tseg1);
                if (l.tseg2.0..=l.tseg2.1).contains(&tseg2) {
                    found.push((off, timing(brp, tseg1, tseg2, 1)));
                }
            }
        }
    }
    found
}

fn inside(timing: &BitTiming, min: u16, max: u16) -> bool {
    let at = 1000 * (1 + u32::from(timing.tseg1));
    (u32::from(min) * timing.quanta()..=u32::from(max) * timing.quanta()).contains(&at)
}

fn distance_to_middle(timing: &BitTiming, min: u16, max: u16) -> f64 {
    let at = f64::from(1 + timing.tseg1) / f64::from(timing.quanta());
    (at - f64::from(min + max) / 2000.0).abs()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn nothing_beats_the_solver(
        data_phase: bool,
        rate in prop_oneof![
            prop::sample::select(vec![10_000u32, 125_000, 250_000, 500_000, 800_000, 1_000_000,
                2_000_000, 4_000_000, 5_000_000, 8_000_000]),
            1_000u32..9_000_000,
        ],
        clock in prop::sample::select(vec![80_000_000u32, 40_000_000, 20_000_000]),
        min in 0u16..=1000,
        width in 0u16..=200,
    ) {
        let max = (min + width).min(1000);
        let (phase, solved) = if data_phase {
            (Phase::Data, solve_bit_timing(Phase::Data, clock, rate, min, max))
        } else {
            (Phase::Nominal, solve_bit_timing(Phase::Nominal, clock, rate, min, max))
        };
        let all = all_timings(phase, clock, rate);
        let good: Vec<_> = all.iter().filter(|(_, t)| inside(t, min, max)).collect();
        match solved {
            Ok(timing) => {
                prop_assert!(timing.fits(phase));
                prop_assert!(inside(&timing, min, max));
                let least = good.iter().map(|(off, t)| (*off, t.brp)).min().unwrap();
                let periods = u64::from(timing.clocks_per_bit()) * u64::from(rate);
                prop_assert_eq!((periods.abs_diff(u64::from(clock)), timing.brp), least);
                let closest = good
                    .iter()
                    .filter(|(off, t)| (*off, t.brp) == least)
                    .map(|(_, t)| distance_to_middle(t, min, max))
                    .fold(f64::INFINITY, f64::min);
                prop_assert!(distance_to_middle(&timing, min, max) <= closest + 1e-12);
            }
            Err(BitTimingError::SamplePoint { below, above, .. }) => {
                prop_assert!(good.is_empty());
                prop_assert!(!all.is_empty());
                let points = || all.iter().map(|(_, t)| (t, t.sample_point()));
                let before = points()
                    .filter(|(t, _)| 1000 * (1 + u32::from(t.tseg1)) < u32::from(min) * t.quanta())
                    .map(|(_, p)| p)
                    .max();
                let behind = points()
                    .filter(|(t, _)| 1000 * (1 + u32::from(t.tseg1)) > u32::from(max) * t.quanta())
                    .map(|(_, p)| p)
                    .min();
                prop_assert_eq!((below, above), (before, behind));
            }
            Err(BitTimingError::Bitrate { below, above, .. }) => {
                prop_assert!(all.is_empty());
                prop_assert!(below.is_none_or(|b| b < rate));
                prop_assert!(above.is_none_or(|a| a > rate));
                prop_assert!(below.is_some() || above.is_some());
            }
            Err(other) => prop_assert!(false, "{other}"),
        }
    }
}
