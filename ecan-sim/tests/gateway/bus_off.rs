//! Error states of a channel: status word, counters, registers, and the recovery policies of
//! 0x8021:14 (manual 7, 13.2.2, 13.5).

use super::fixture::{Fixture, chunks, standard};
use ecan_protocol::config::{BusOffRecovery, DataPathConfig, McanChannelConfig};
use ecan_protocol::image::HeaderFlags;
use ecan_sim::ErrorState;

fn with(bus_off_recovery: BusOffRecovery) -> Fixture {
    let mut fixture = Fixture::configured(chunks(3), chunks(3));
    let policy = DataPathConfig { bus_off_recovery, ..DataPathConfig::default() };
    fixture.apply_data_path(0, policy);
    fixture.start();
    fixture
}

fn bus_off(fixture: &mut Fixture) {
    fixture.gateway.bus_state(fixture.now, 0, ErrorState::BusOff, 256, 0);
}

/// Services until the controller requests recovery, `None` if it does not within 20.
fn recovery(fixture: &mut Fixture) -> Option<u32> {
    for services in 0..20 {
        if fixture.gateway.take_recovery_request(0) {
            return Some(services);
        }
        fixture.cycle();
    }
    None
}

#[test]
fn each_policy_recovers_in_its_way() {
    for (policy, expected) in [
        (BusOffRecovery::Manual, None),
        (BusOffRecovery::Auto, Some(3)),
        (BusOffRecovery::Aggressive, Some(0)),
        (BusOffRecovery::Degraded, None),
    ] {
        let mut fixture = with(policy);
        bus_off(&mut fixture);
        assert_eq!(recovery(&mut fixture), expected, "{policy:?}");
        assert!(!fixture.gateway.take_recovery_request(0), "asked once");
        assert_eq!(fixture.upload(0x9020, 13), 1);
        assert_eq!(fixture.upload(0x9000, 15), 1);
        assert_eq!(fixture.upload(0x9020, 14), u32::from(expected.is_some()));
        let degraded = policy == BusOffRecovery::Degraded;
        assert_eq!(fixture.upload(0x9020, 15) != 0, degraded);
        fixture.gateway.bus_state(fixture.now, 0, ErrorState::Active, 0, 0);
        assert_eq!(fixture.upload(0x9020, 15), 0);
        fixture.push(0, standard(1, &[]));
        fixture.cycle();
        assert_eq!(fixture.sent(0).len(), 1);
    }
}

#[test]
fn host_recovers_by_applying_the_channel_again() {
    for policy in [BusOffRecovery::Manual, BusOffRecovery::Degraded] {
        let mut fixture = with(policy);
        bus_off(&mut fixture);
        let generation = fixture.gateway.station_generation(0);
        fixture.send([McanChannelConfig::apply_write(0)]);
        assert_ne!(fixture.gateway.station_generation(0), generation);
        fixture.cycle();
        assert_eq!(fixture.input().header().channel_status[0].state().raw(), 2);
        assert_eq!(fixture.upload(0x9020, 15), 0);
    }
}

#[test]
fn policy_changed_during_bus_off_takes_effect() {
    let mut fixture = with(BusOffRecovery::Manual);
    bus_off(&mut fixture);
    assert_eq!(recovery(&mut fixture), None);
    fixture.apply_data_path(0, DataPathConfig::default());
    assert_eq!(recovery(&mut fixture), Some(3));
}

#[test]
fn waiting_frames_are_stale_except_with_aggressive() {
    for (policy, kept) in [(BusOffRecovery::Auto, 1), (BusOffRecovery::Aggressive, 6)] {
        let mut fixture = with(policy);
        fixture.push_ids(0, 0..6);
        fixture.cycle();
        let in_flight = fixture.gateway.next_transmit(0).unwrap();
        bus_off(&mut fixture);
        assert_eq!(fixture.gateway.next_transmit(0), None);
        fixture.gateway.bus_state(fixture.now, 0, ErrorState::Active, 0, 0);
        fixture.gateway.transmitted(fixture.now, 0, &in_flight);
        let mut sent = 1;
        for _ in 0..3 {
            sent += fixture.sent(0).len();
            fixture.cycle();
        }
        assert_eq!(sent, kept, "{policy:?}: the frame in arbitration stays in any case");
        assert_eq!(fixture.upload(0x9020, 12), 6 - kept as u32);
    }
}

#[test]
fn status_word_and_header_flags_show_it() {
    let mut fixture = with(BusOffRecovery::Manual);
    fixture.cycle();
    assert!(!fixture.input().header().flags.contains(HeaderFlags::ANY_CHANNEL_ERROR));
    let mut before = fixture.input().header().channel_status[0];
    for (state, tec, rec, number, warn) in [
        (ErrorState::Warning, 100, 0, 2, true),
        (ErrorState::Passive, 130, 5, 2, true),
        (ErrorState::BusOff, 256, 0, 3, true),
        (ErrorState::Active, 0, 0, 2, false),
    ] {
        fixture.gateway.bus_state(fixture.now, 0, state, tec, rec);
        fixture.cycle();
        let header = *fixture.input().header();
        let status = header.channel_status[0];
        assert_eq!(status.state().raw(), number, "{state:?}");
        assert_eq!(status.warn(), warn);
        assert_eq!(status.bus_off(), state == ErrorState::BusOff);
        assert_eq!(header.flags.contains(HeaderFlags::ANY_CHANNEL_ERROR), warn);
        let changed = header.flags.contains(HeaderFlags::STATUS_CHANGED);
        assert_eq!(changed, status != before, "{state:?}");
        before = status;
        assert_eq!(fixture.upload(0x9000, 9), u32::from(status.raw()));
        let ecr = u32::from(tec.min(255)) | u32::from(rec) << 8;
        assert_eq!(fixture.upload(0x9000, 1), ecr);
        let psr = fixture.upload(0x9000, 2);
        let passive = matches!(state, ErrorState::Passive | ErrorState::BusOff);
        assert_eq!(psr & 1 << 5 != 0, passive);
        assert_eq!(psr & 1 << 6 != 0, warn);
        assert_eq!(psr & 1 << 7 != 0, state == ErrorState::BusOff);
    }
}

#[test]
fn events_are_latched_until_read() {
    let mut fixture = with(BusOffRecovery::Manual);
    fixture.cycle();
    fixture.upload(0x9000, 12);
    let sequence = fixture.upload(0x9000, 16);
    fixture.cycle();
    assert!(!fixture.input().header().channel_status[0].detail_pending());
    fixture.gateway.bus_state(fixture.now, 0, ErrorState::Warning, 100, 0);
    fixture.gateway.bus_state(fixture.now, 0, ErrorState::Active, 0, 0);
    fixture.cycle();
    assert!(fixture.input().header().channel_status[0].detail_pending());
    fixture.has(&[(0x9000, 16, sequence + 1), (0x9000, 12, 1), (0x9000, 12, 0)]);
    fixture.cycle();
    assert!(!fixture.input().header().channel_status[0].detail_pending());
}

#[test]
fn pending_counts_saturate_at_7() {
    let mut fixture = with(BusOffRecovery::Manual);
    fixture.deliver_ids(0, 0..20);
    fixture.push_ids(0, 0..20);
    fixture.cycle();
    let status = fixture.input().header().channel_status[0];
    assert_eq!((status.rx_pending(), status.tx_pending()), (7, 7));
    assert!(status.counter_sat());
    fixture.has(&[(0x9000, 10, 18), (0x9000, 11, 20)]);
}

#[test]
fn full_receive_fifo_and_half_full_ring_are_pressure() {
    let mut fixture = with(BusOffRecovery::Manual);
    fixture.deliver_ids(0, 0..44);
    fixture.cycle();
    assert!(fixture.input().header().channel_status[0].rx_pressure());
    let mut fixture = Fixture::op(chunks(3), chunks(24));
    fixture.push_ids(0, 0..36);
    fixture.cycle();
    assert!(fixture.input().header().channel_status[0].tx_pressure());
    fixture.cycle();
    assert!(!fixture.input().header().channel_status[0].tx_pressure());
}
