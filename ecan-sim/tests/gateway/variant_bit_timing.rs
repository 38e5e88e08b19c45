//! Alternatives for the bit timing that the firmware chooses, as NBTP and DBTP show it.

use ecan_protocol::config::{McanChannelConfig, SamplePointWindow};
use ecan_sim::variant::{BitTimingChoice, GatewayVariant};

use super::fixture::{Fixture, preop};

const BUILD_FAIL: u32 = 3;

/// Applies a configuration in PREOP; returns the apply status.
fn apply(bit_timing: BitTimingChoice, config: McanChannelConfig) -> (Fixture, u32) {
    let mut fixture = preop(GatewayVariant { bit_timing, ..Default::default() });
    let status = fixture.try_apply_channel(0, config);
    (fixture, status)
}

/// Quanta before the sample point and quanta of a bit.
type Point = (u32, u32);

fn points(fixture: &mut Fixture) -> (Point, Point) {
    const READ: u8 = 1;
    let [(0, nbtp), (0, dbtp)] = [0x1C, 0x0C].map(|offset| fixture.register(offset, READ)) else {
        panic!("the registers are not readable")
    };
    let point = |tseg1: u32, tseg2: u32| (tseg1 + 2, tseg1 + tseg2 + 3);
    (point(nbtp >> 8 & 0xFF, nbtp & 0x7F), point(dbtp >> 8 & 0x1F, dbtp >> 4 & 0x0F))
}

#[test]
fn sample_point_in_a_window_follows_the_choice() {
    let window = SamplePointWindow { min: 750, max: 875 };
    for (choice, nominal, data) in [
        (BitTimingChoice::Middle, 130, 33),
        (BitTimingChoice::Lowest, 120, 30),
        (BitTimingChoice::Highest, 140, 33),
        // at most 32 quanta after the nominal sample point
        (BitTimingChoice::Driver, 128, 30),
    ] {
        let config = McanChannelConfig {
            nominal_sample_point: window,
            data_sample_point: window,
            ..McanChannelConfig::fd(500_000, 2_000_000)
        };
        let (mut fixture, status) = apply(choice, config);
        assert_eq!(status, 0, "{choice:?}");
        assert_eq!(points(&mut fixture), ((nominal, 160), (data, 40)), "{choice:?}");
    }
}

#[test]
fn equal_bounds_leave_no_choice() {
    let config = McanChannelConfig::fd(1_000_000, 5_000_000).sample_point(875, 875);
    for choice in [
        BitTimingChoice::Middle,
        BitTimingChoice::Lowest,
        BitTimingChoice::Highest,
        BitTimingChoice::Driver,
    ] {
        let (mut fixture, status) = apply(choice, config);
        assert_eq!(status, 0, "{choice:?}");
        assert_eq!(points(&mut fixture), ((70, 80), (14, 16)), "{choice:?}");
    }
}

/// 87.5 % at 500 kbit/s and 2 Mbit/s needs a data prescaler of 5, with which the core has no TDC.
#[test]
fn driver_has_no_timing_for_some_windows() {
    let rates = McanChannelConfig::fd(500_000, 2_000_000);
    let config = McanChannelConfig { tdc: false, ..rates.sample_point(875, 875) };
    let (mut fixture, status) = apply(BitTimingChoice::Middle, config);
    assert_eq!(status, 0);
    assert_eq!(points(&mut fixture).1, (7, 8));
    assert_eq!(apply(BitTimingChoice::Driver, config).1, BUILD_FAIL);
}
