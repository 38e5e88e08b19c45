//! Choice and range of sample points, and the driver of the controller's vendor (manual 5.4.3, 13.4).

use ecan_protocol::can::{
    MCAN_CLOCK_HZ, Phase, SamplePoint, sample_point_range, solve_bit_timing, usual_sample_point,
    vendor_driver_timing,
};
use ecan_protocol::config::{BitTimingMode, ChannelWarning, McanChannelConfig, SamplePointWindow};
use proptest::prelude::*;

const CLOCK: u32 = MCAN_CLOCK_HZ;

#[test]
fn usual_sample_point_is_87_5_percent_where_possible() {
    for (phase, is_fd, bitrate, expected) in [
        (Phase::Nominal, false, 1_000_000, 875),
        (Phase::Nominal, false, 500_000, 875),
        (Phase::Nominal, false, 250_000, 875),
        (Phase::Nominal, false, 125_000, 875),
        (Phase::Nominal, true, 1_000_000, 875),
        (Phase::Nominal, true, 500_000, 875),
        (Phase::Data, true, 5_000_000, 875),
        // 87 of 100 quanta.
        (Phase::Nominal, false, 800_000, 870),
        // 87.5 % needs a prescaler of 5, with which nothing compensates the delay; 17 of 20.
        (Phase::Data, true, 2_000_000, 850),
        (Phase::Data, true, 4_000_000, 850),
        // 8 of 10.
        (Phase::Data, true, 8_000_000, 800),
    ] {
        assert_eq!(
            usual_sample_point(phase, is_fd, CLOCK, bitrate),
            Some(expected),
            "{phase} {bitrate}"
        );
    }
    assert_eq!(usual_sample_point(Phase::Nominal, false, CLOCK, 3), None);
}

#[test]
fn constructors_request_one_sample_point() {
    let fd = McanChannelConfig::fd(500_000, 2_000_000);
    assert_eq!(fd.nominal_sample_point, SamplePointWindow::exactly(875));
    assert_eq!(fd.data_sample_point, SamplePointWindow::exactly(850));
    assert!(fd.tdc);
    let classic = McanChannelConfig::classic(250_000);
    assert_eq!(classic.nominal_sample_point, SamplePointWindow::exactly(875));
    // An impossible bit rate is reported as such.
    assert_eq!(McanChannelConfig::classic(3).nominal_sample_point, SamplePointWindow::DEFAULT);
}

#[test]
fn range_holds_every_sample_point_of_the_window() {
    let range = |min, max| sample_point_range(Phase::Nominal, CLOCK, 1_000_000, min, max).unwrap();
    assert_eq!(range(750, 875), (SamplePoint(7_500), SamplePoint(8_750)));
    // 61 to 69 of 80.
    assert_eq!(range(751, 874), (SamplePoint(7_625), SamplePoint(8_625)));
    assert_eq!(range(875, 875), (SamplePoint(8_750), SamplePoint(8_750)));
    assert!(sample_point_range(Phase::Nominal, CLOCK, 1_000_000, 876, 880).is_err());
}

/// Computed by hand from the driver's description: first point from below, limits of its registers.
#[test]
fn vendor_driver_takes_the_lowest_sample_point() {
    let driver = |phase, is_fd, bitrate, min, max| {
        vendor_driver_timing(phase, is_fd, CLOCK, bitrate, min, max)
            .map(|timing| (timing.brp, timing.sample_point()))
    };
    let nominal = |bitrate, min, max| driver(Phase::Nominal, false, bitrate, min, max);
    assert_eq!(nominal(1_000_000, 750, 875), Some((1, SamplePoint(7_500))));
    assert_eq!(nominal(1_000_000, 875, 875), Some((1, SamplePoint(8_750))));
    let data = |bitrate, min, max| driver(Phase::Data, true, bitrate, min, max);
    assert_eq!(data(2_000_000, 875, 875), None, "35 of 40 does not fit, 17.5 of 20 does not exist");
    assert_eq!(data(2_000_000, 850, 850), Some((2, SamplePoint(8_500))));
    assert_eq!(data(0, 750, 875), None);
    // 15 quanta need a prescaler of 79; the register ends at 32.
    assert_eq!(data(67_454, 500, 533), None);
}

fn warnings(config: &McanChannelConfig) -> Vec<ChannelWarning> {
    let mut warnings = Vec::new();
    config.warnings(&mut |warning| warnings.push(warning));
    warnings
}

#[test]
fn constructors_cause_no_warning() {
    for nominal in [125_000, 250_000, 500_000, 800_000, 1_000_000] {
        assert_eq!(warnings(&McanChannelConfig::classic(nominal)), []);
        for data in [1_000_000, 2_000_000, 4_000_000, 5_000_000, 8_000_000] {
            assert_eq!(warnings(&McanChannelConfig::fd(nominal, data)), [], "{nominal}/{data}");
        }
    }
}

#[test]
fn settings_that_may_not_match_the_bus_cause_warnings() {
    let fd = McanChannelConfig::fd(500_000, 2_000_000);
    let wide = McanChannelConfig { data_sample_point: SamplePointWindow::DEFAULT, ..fd };
    let phase = Phase::Data;
    let expected = ChannelWarning::WideWindow { phase, min_permille: 750, max_permille: 875 };
    assert_eq!(warnings(&wide), [expected]);
    let classic = McanChannelConfig {
        nominal_sample_point: SamplePointWindow::DEFAULT,
        ..McanChannelConfig::classic(500_000)
    };
    assert_eq!(warnings(&classic), []);
    let unsolved = fd.sample_point(875, 875);
    assert_eq!(warnings(&unsolved), [ChannelWarning::NoDriverTiming { phase }]);
    let bit_timing_mode = BitTimingMode::Manual;
    let by_hand = McanChannelConfig { bit_timing_mode, ..McanChannelConfig::classic(500_000) };
    assert_eq!(warnings(&by_hand), [ChannelWarning::ManualTiming]);
    let unpaired = McanChannelConfig { tdc_offset: 30, ..fd };
    assert_eq!(warnings(&unpaired), [ChannelWarning::UnpairedTdc { offset: 30, filter: 0 }]);
    let pair = McanChannelConfig { tdc_filter: 32, ..unpaired };
    assert_eq!(warnings(&pair), []);
}

proptest! {
    #[test]
    fn choices_lie_in_their_window(
        bitrate in 10_000..8_000_000_u32,
        min in 500..950_u16,
        width in 0..400_u16,
        is_data: bool,
    ) {
        let (phase, max) = (if is_data { Phase::Data } else { Phase::Nominal }, (min + width).min(1000));
        let inside = |point: SamplePoint| {
            u32::from(point.0) + 1 >= u32::from(min) * 10 && u32::from(point.0) <= u32::from(max) * 10 + 1
        };
        if let Some(timing) = vendor_driver_timing(phase, is_data, CLOCK, bitrate, min, max) {
            prop_assert!(timing.sample_point().0 + 10 >= min * 10, "{timing:?}");
            prop_assert!(timing.fits(phase), "{timing:?}");
        }
        if let Ok((lowest, highest)) = sample_point_range(phase, CLOCK, bitrate, min, max) {
            prop_assert!(lowest <= highest && inside(lowest) && inside(highest));
            let middle = solve_bit_timing(phase, CLOCK, bitrate, min, max).unwrap().sample_point();
            prop_assert!(lowest <= middle && middle <= highest, "{lowest} {middle} {highest}");
        }
        if let Some(permille) = usual_sample_point(phase, is_data, CLOCK, bitrate) {
            prop_assert!(permille <= 875);
            prop_assert!(solve_bit_timing(phase, CLOCK, bitrate, permille, permille).is_ok());
        }
    }
}
