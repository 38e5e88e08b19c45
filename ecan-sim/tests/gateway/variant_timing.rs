//! Alternatives for clocks, schedule, timestamps, watchdog and power-on, as the gateway shows them.

use ecan_protocol::device::AlState;
use ecan_protocol::image::{ChannelState, ChannelStatus, EncapsulationProfile};
use ecan_protocol::image::{PdoProfile, Schedule, Timestamp};
use ecan_sim::variant::{
    AssignActivate, ChannelsAtStart, Delta16Unit, GatewayVariant, PhaseUnit, ProcessDataWatchdog,
    ScheduledPulse,
};
use ecan_sim::{GatewayModelConfig, Sync0Window};

use super::fixture::{Fixture, MS, SERVICE, chunks, standard, with_variant};

fn config(variant: GatewayVariant) -> GatewayModelConfig {
    GatewayModelConfig { sync0_window: Sync0Window::OFF, ..with_variant(variant) }
}

/// In PREOP with one chunk per direction.
fn configured(variant: GatewayVariant) -> Fixture {
    Fixture::configured_with(config(variant), chunks(1), chunks(1))
}

/// In OP with pulses at every whole millisecond, 300 us after one of them.
fn with_sync0(variant: GatewayVariant) -> Fixture {
    let mut fixture = configured(variant);
    let start = fixture.start_with_sync0(0);
    let now = start + 4 * MS + 300_000;
    fixture.pass(now - fixture.now);
    fixture
}

#[test]
fn sync0_alone_suffices_or_is_rejected() {
    for (assign_activate, has_sync1, expected) in [
        (AssignActivate::Sync0, false, (AlState::SafeOp, 0)),
        (AssignActivate::Sync0, true, (AlState::SafeOp, 0)),
        (AssignActivate::Sync0AndSync1, false, (AlState::PreOp, 0x30)),
        (AssignActivate::Sync0AndSync1, true, (AlState::SafeOp, 0)),
    ] {
        let mut fixture =
            configured(GatewayVariant { assign_activate, ..GatewayVariant::default() });
        fixture.gateway.set_dc_sync1(has_sync1);
        fixture.start_sync0();
        assert_eq!(
            fixture.request(AlState::SafeOp),
            expected,
            "{assign_activate:?}, Sync1 {has_sync1}"
        );
    }
}

#[test]
fn clock_is_not_needed_without_sync0() {
    let assign_activate = AssignActivate::Sync0AndSync1;
    let mut fixture = configured(GatewayVariant { assign_activate, ..GatewayVariant::default() });
    fixture.start();
}

#[test]
fn watchdog_has_the_configured_time_or_none() {
    for (watchdog, at_20_ms, at_100_ms) in [
        (ProcessDataWatchdog::Configured, AlState::SafeOp, AlState::SafeOp),
        (ProcessDataWatchdog::Fixed, AlState::Op, AlState::SafeOp),
        (ProcessDataWatchdog::Absent, AlState::Op, AlState::Op),
    ] {
        let mut fixture = configured(GatewayVariant { watchdog, ..GatewayVariant::default() });
        fixture.gateway.set_watchdog_ns(20 * MS);
        fixture.start();
        fixture.cycle();
        fixture.pass(20 * MS);
        assert_eq!(fixture.state().0, at_20_ms, "{watchdog:?}");
        fixture.pass(80 * MS);
        assert_eq!(fixture.state().0, at_100_ms, "{watchdog:?}");
    }
}

#[test]
fn channels_start_off_or_with_the_default_configuration() {
    for (channels_at_start, expected) in [
        (ChannelsAtStart::Off, ChannelState::Disabled),
        (ChannelsAtStart::Active, ChannelState::Run),
    ] {
        let variant = GatewayVariant { channels_at_start, ..GatewayVariant::default() };
        let mut fixture = Fixture::preop_with(config(variant));
        for channel in 0..4 {
            let status = ChannelStatus::from_raw(fixture.upload(0x9000 + channel, 9) as u16);
            assert_eq!(status.state(), expected, "{channels_at_start:?}");
        }
    }
}

/// Time from the arrival of an image to its scheduled frame, in us; `None` if it is dropped as late.
fn released_after(scheduled_pulse: ScheduledPulse, offset_ns: u32) -> Option<u64> {
    let mut fixture = with_sync0(GatewayVariant { scheduled_pulse, ..GatewayVariant::default() });
    fixture.push_scheduled(0, standard(1, &[]), Schedule { tag: 0, offset_ns });
    let start = fixture.now;
    assert!(fixture.write());
    for _ in 0..300 {
        if fixture.gateway.next_transmit(0).is_some() {
            return Some((fixture.now - start) / 1_000);
        }
        fixture.pass(10_000);
    }
    assert_eq!(fixture.gateway.counters().transmit_losses.late, 1);
    None
}

#[test]
fn scheduled_frame_refers_to_the_pulse_of_the_variant() {
    for (pulse, early, late) in [
        (ScheduledPulse::Next, Some(800), Some(1_200)),
        (ScheduledPulse::Previous, None, Some(200)),
        (ScheduledPulse::Second, Some(1_800), Some(2_200)),
    ] {
        assert_eq!(released_after(pulse, 100_000), early, "{pulse:?}");
        assert_eq!(released_after(pulse, 500_000), late, "{pulse:?}");
    }
}

#[test]
fn phases_are_in_cpu_cycles_or_nanoseconds() {
    for (phase_unit, expected) in [(PhaseUnit::Cycles, 120_000), (PhaseUnit::Nanoseconds, 300_000)]
    {
        let mut fixture = with_sync0(GatewayVariant { phase_unit, ..GatewayVariant::default() });
        fixture.write_u8(0x9011, 14, 1);
        fixture.cycle();
        assert_eq!(fixture.upload(0x9011, 4), expected, "{phase_unit:?}");
        assert_eq!(fixture.upload(0x9011, 5), expected, "{phase_unit:?}");
    }
}

#[test]
fn delta16_counts_microseconds_or_ticks() {
    for (delta16_unit, expected) in [(Delta16Unit::Microseconds, 100), (Delta16Unit::Ticks, 2_400)]
    {
        let variant = GatewayVariant { delta16_unit, ..GatewayVariant::default() };
        let tx = PdoProfile { profile: EncapsulationProfile::CompactTimestamped, ..chunks(1) };
        let mut fixture = Fixture::configured_with(config(variant), tx, chunks(1));
        fixture.start();
        fixture.deliver(0, standard(1, &[]));
        fixture.pass(100_000);
        fixture.deliver(0, standard(2, &[]));
        fixture.pass(SERVICE);
        fixture.cycle();
        let stamps = fixture.timestamps();
        let [Timestamp::Delta16(first), Timestamp::Delta16(second)] = stamps[..] else {
            panic!("{stamps:?}")
        };
        assert_eq!(second.wrapping_sub(first), expected, "{delta16_unit:?}");
    }
}
