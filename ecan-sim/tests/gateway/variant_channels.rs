//! Alternatives for the configuration of the channels, as the gateway shows them.

use ecan_protocol::can::BitTiming;
use ecan_protocol::config::{BitTimingMode, DataPathConfig, McanChannelConfig};
use ecan_sim::ErrorState;
use ecan_sim::variant::{
    BitRates, BusOffWait, ChannelApplyInOp, GatewayVariant, ManualTiming, Number,
    ProtectedRegister, RotationDirection, RotationEffect, TdcPrescaler,
};

use super::fixture::{configured, preop};

const OK: u32 = 0;
const FAIL: u32 = 1;
const BUILD_FAIL: u32 = 3;
const RUNTIME_FAIL: u32 = 4;

#[test]
fn manual_timing_is_physical_or_in_register_values() {
    let manual = McanChannelConfig {
        bit_timing_mode: BitTimingMode::Manual,
        manual_nominal: BitTiming { brp: 9, tseg1: 11, tseg2: 2, sjw: 1 },
        ..McanChannelConfig::classic(500_000)
    };
    for (manual_timing, bitrate) in [
        (ManualTiming::Physical, 80_000_000 / (9 * 14)),
        (ManualTiming::RegisterValues, 80_000_000 / (10 * 16)),
    ] {
        let mut fixture = preop(GatewayVariant { manual_timing, ..Default::default() });
        assert_eq!(fixture.try_apply_channel(0, manual), OK, "{manual_timing:?}");
        let station = fixture.gateway.station_config(0).unwrap();
        assert_eq!(station.nominal_bitrate, bitrate, "{manual_timing:?}");
    }
}

#[test]
fn delay_compensation_works_with_two_or_all_prescalers() {
    let slow = McanChannelConfig { tdc: true, ..McanChannelConfig::fd(125_000, 500_000) };
    for (tdc_prescaler, expected) in [(TdcPrescaler::OneOrTwo, BUILD_FAIL), (TdcPrescaler::Any, OK)]
    {
        let mut fixture = preop(GatewayVariant { tdc_prescaler, ..Default::default() });
        assert_eq!(fixture.try_apply_channel(0, slow), expected, "{tdc_prescaler:?}");
    }
}

#[test]
fn channel_is_applied_in_op_or_rejected() {
    for (channel_apply_in_op, expected, bitrate) in
        [(ChannelApplyInOp::Executed, OK, 250_000), (ChannelApplyInOp::Rejected, FAIL, 1_000_000)]
    {
        let mut fixture = configured(GatewayVariant { channel_apply_in_op, ..Default::default() });
        fixture.start();
        let other = McanChannelConfig::classic(250_000);
        assert_eq!(fixture.try_apply_channel(0, other), expected, "{channel_apply_in_op:?}");
        let station = fixture.gateway.station_config(0).unwrap();
        assert_eq!(station.nominal_bitrate, bitrate, "{channel_apply_in_op:?}");
    }
}

#[test]
fn message_ram_limits_the_layout() {
    let default = McanChannelConfig::fd(500_000, 2_000_000);
    let small = McanChannelConfig::classic(500_000);
    let mut large = default;
    large.ram.rx_fifo0.size = 64;
    for (bytes, expected) in [
        (8192, [OK, OK, RUNTIME_FAIL]),
        (4096, [OK, RUNTIME_FAIL, RUNTIME_FAIL]),
        (16384, [OK, OK, OK]),
    ] {
        let message_ram_bytes = Number::nearest(bytes);
        let mut fixture = preop(GatewayVariant { message_ram_bytes, ..Default::default() });
        let statuses = [small, default, large].map(|config| fixture.try_apply_channel(0, config));
        assert_eq!(statuses, expected, "{bytes} bytes");
    }
}

#[test]
fn protected_register_is_ignored_or_rejected_in_operation() {
    const NBTP: u32 = 0x1C;
    const WRITE: u8 = 2;
    const ENGINEERING: u8 = 1;
    for (protected_register, expected) in
        [(ProtectedRegister::Ignored, 0), (ProtectedRegister::Rejected, 2)]
    {
        let mut fixture = configured(GatewayVariant { protected_register, ..Default::default() });
        fixture.write_u8(0xB000, 1, ENGINEERING);
        fixture.download(0xA000, 4, &[0; 4]).unwrap();
        assert_eq!(fixture.register(NBTP, WRITE).0, expected, "{protected_register:?}");
    }
}

#[test]
fn rotation_moves_the_channels_up_or_down() {
    for (rotation_direction, channel_0_at) in
        [(RotationDirection::Up, 1), (RotationDirection::Down, 3)]
    {
        let mut fixture = preop(GatewayVariant { rotation_direction, ..Default::default() });
        fixture.write_u8(0x8000, 12, 1);
        fixture.apply_channel(0, McanChannelConfig::classic(250_000));
        for connector in 0..4 {
            let is_used = fixture.gateway.station_config(connector).is_some();
            assert_eq!(is_used, connector == channel_0_at, "{rotation_direction:?} {connector}");
        }
    }
}

#[test]
fn rotation_takes_effect_at_its_time() {
    use RotationEffect::{ChannelApply, Start, Write};
    for (rotation_effect, active) in [(Write, [1, 1]), (ChannelApply, [0, 1]), (Start, [0, 0])] {
        let mut fixture = preop(GatewayVariant { rotation_effect, ..Default::default() });
        fixture.write_u8(0x8000, 12, 1);
        let mut read = [fixture.upload(0x8000, 13), 0];
        fixture.apply_channel(0, McanChannelConfig::classic(250_000));
        read[1] = fixture.upload(0x8000, 13);
        assert_eq!((read, fixture.upload(0x8000, 15)), (active, 0), "{rotation_effect:?}");
    }
}

#[test]
fn bit_rates_beyond_the_usual_are_accepted_or_rejected() {
    use BitRates::{Any, NominalLimited, Rejected};
    for (bit_rates, expected) in [(NominalLimited, [3, 0]), (Any, [0, 0]), (Rejected, [3, 3])] {
        let mut fixture = preop(GatewayVariant { bit_rates, ..Default::default() });
        let slow = McanChannelConfig { tdc: false, ..McanChannelConfig::fd(1_000_000, 500_000) };
        let statuses = [McanChannelConfig::classic(2_000_000), slow]
            .map(|config| fixture.try_apply_channel(0, config));
        assert_eq!(statuses, expected, "{bit_rates:?}");
    }
}

#[test]
fn recovery_from_bus_off_waits_or_not() {
    for (bus_off_wait, waits) in [(BusOffWait::BackoffBase, true), (BusOffWait::Nothing, false)] {
        let mut fixture = configured(GatewayVariant { bus_off_wait, ..Default::default() });
        let policy = DataPathConfig { backoff_base_cycles: 3, ..DataPathConfig::default() };
        fixture.apply_data_path(0, policy);
        fixture.start();
        fixture.gateway.bus_state(fixture.now, 0, ErrorState::BusOff, 256, 0);
        fixture.cycle();
        assert_eq!(fixture.gateway.take_recovery_request(0), !waits, "{bus_off_wait:?}");
        for _ in 0..3 {
            fixture.cycle();
        }
        assert_eq!(fixture.gateway.take_recovery_request(0), waits, "{bus_off_wait:?}");
    }
}
