//! Error states of a channel: status word, counters, registers, and the ways out of bus-off of
//! 0x8021:14 (manual 7, 13.2.2, 13.5).

mod gateway_support;

use ecan_protocol::config::{BusOffRecovery, DataPathConfig, McanChannelConfig};
use ecan_protocol::image::HeaderFlags;
use ecan_sim::ErrorState;
use gateway_support::{Fixture, chunks, standard};

fn with(bus_off_recovery: BusOffRecovery) -> Fixture {
    let mut bench = Fixture::configured(chunks(3), chunks(3));
    let policy = DataPathConfig { bus_off_recovery, ..DataPathConfig::default() };
    bench.apply_data_path(0, policy);
    bench.start();
    bench
}

fn bus_off(bench: &mut Fixture) {
    bench.gateway.bus_state(bench.now, 0, ErrorState::BusOff, 256, 0);
}

/// Services until the controller wants to recover, `None` when it does not within 20.
fn recovery(bench: &mut Fixture) -> Option<u32> {
    for services in 0..20 {
        if bench.gateway.take_recovery_request(0) {
            return Some(services);
        }
        bench.cycle();
    }
    None
}

#[test]
fn each_policy_has_its_way_out() {
    for (policy, expected) in [
        (BusOffRecovery::Manual, None),
        (BusOffRecovery::Auto, Some(3)),
        (BusOffRecovery::Aggressive, Some(0)),
        (BusOffRecovery::Degraded, None),
    ] {
        let mut bench = with(policy);
        bus_off(&mut bench);
        assert_eq!(recovery(&mut bench), expected, "{policy:?}");
        assert!(!bench.gateway.take_recovery_request(0), "asked once");
        assert_eq!(bench.upload(0x9020, 13), 1);
        assert_eq!(bench.upload(0x9000, 15), 1);
        assert_eq!(bench.upload(0x9020, 14), u32::from(expected.is_some()));
        let degraded = policy == BusOffRecovery::Degraded;
        assert_eq!(bench.upload(0x9020, 15) != 0, degraded);
        bench.gateway.bus_state(bench.now, 0, ErrorState::Active, 0, 0);
        assert_eq!(bench.upload(0x9020, 15), 0);
        bench.push(0, standard(1, &[]));
        bench.cycle();
        assert_eq!(bench.sent(0).len(), 1);
    }
}

#[test]
fn host_recovers_by_applying_the_channel_again() {
    for policy in [BusOffRecovery::Manual, BusOffRecovery::Degraded] {
        let mut bench = with(policy);
        bus_off(&mut bench);
        let generation = bench.gateway.station_generation(0);
        bench.send(McanChannelConfig::apply_write(0));
        assert_ne!(bench.gateway.station_generation(0), generation);
        bench.cycle();
        assert_eq!(bench.input().header().channel_status[0].state().raw(), 2);
        assert_eq!(bench.upload(0x9020, 15), 0);
    }
}

#[test]
fn policy_changed_during_bus_off_takes_effect() {
    let mut bench = with(BusOffRecovery::Manual);
    bus_off(&mut bench);
    assert_eq!(recovery(&mut bench), None);
    bench.apply_data_path(0, DataPathConfig::default());
    assert_eq!(recovery(&mut bench), Some(3));
}

#[test]
fn waiting_frames_are_stale_unless_the_policy_is_aggressive() {
    for (policy, kept) in [(BusOffRecovery::Auto, 1), (BusOffRecovery::Aggressive, 6)] {
        let mut bench = with(policy);
        for id in 0..6 {
            bench.push(0, standard(id, &[]));
        }
        bench.cycle();
        let in_flight = bench.gateway.next_transmit(0).unwrap();
        bus_off(&mut bench);
        assert_eq!(bench.gateway.next_transmit(0), None);
        bench.gateway.bus_state(bench.now, 0, ErrorState::Active, 0, 0);
        bench.gateway.transmitted(bench.now, 0, &in_flight);
        let mut sent = 1;
        for _ in 0..3 {
            sent += bench.sent(0).len();
            bench.cycle();
        }
        assert_eq!(sent, kept, "{policy:?}: the frame in arbitration stays in any case");
        assert_eq!(bench.upload(0x9020, 12), 6 - kept as u32);
    }
}

#[test]
fn status_word_and_header_flags_show_it() {
    let mut bench = with(BusOffRecovery::Manual);
    bench.cycle();
    assert!(!bench.input().header().flags.contains(HeaderFlags::ANY_CHANNEL_ERROR));
    let mut before = bench.input().header().channel_status[0];
    for (state, tec, rec, number, warn) in [
        (ErrorState::Warning, 100, 0, 2, true),
        (ErrorState::Passive, 130, 5, 2, true),
        (ErrorState::BusOff, 256, 0, 3, true),
        (ErrorState::Active, 0, 0, 2, false),
    ] {
        bench.gateway.bus_state(bench.now, 0, state, tec, rec);
        bench.cycle();
        let header = *bench.input().header();
        let status = header.channel_status[0];
        assert_eq!(status.state().raw(), number, "{state:?}");
        assert_eq!(status.warn(), warn);
        assert_eq!(status.bus_off(), state == ErrorState::BusOff);
        assert_eq!(header.flags.contains(HeaderFlags::ANY_CHANNEL_ERROR), warn);
        let changed = header.flags.contains(HeaderFlags::STATUS_CHANGED);
        assert_eq!(changed, status != before, "{state:?}");
        before = status;
        assert_eq!(bench.upload(0x9000, 9), u32::from(status.raw()));
        let ecr = u32::from(tec.min(255)) | u32::from(rec) << 8;
        assert_eq!(bench.upload(0x9000, 1), ecr);
        let psr = bench.upload(0x9000, 2);
        let passive = matches!(state, ErrorState::Passive | ErrorState::BusOff);
        assert_eq!(psr & 1 << 5 != 0, passive);
        assert_eq!(psr & 1 << 6 != 0, warn);
        assert_eq!(psr & 1 << 7 != 0, state == ErrorState::BusOff);
    }
}

#[test]
fn events_are_latched_until_read() {
    let mut bench = with(BusOffRecovery::Manual);
    bench.cycle();
    bench.upload(0x9000, 12);
    let sequence = bench.upload(0x9000, 16);
    bench.cycle();
    assert!(!bench.input().header().channel_status[0].detail_pending());
    bench.gateway.bus_state(bench.now, 0, ErrorState::Warning, 100, 0);
    bench.gateway.bus_state(bench.now, 0, ErrorState::Active, 0, 0);
    bench.cycle();
    assert!(bench.input().header().channel_status[0].detail_pending());
    assert_eq!(bench.upload(0x9000, 16), sequence + 1);
    assert_eq!(bench.upload(0x9000, 12), 1);
    assert_eq!(bench.upload(0x9000, 12), 0);
    bench.cycle();
    assert!(!bench.input().header().channel_status[0].detail_pending());
}

#[test]
fn pending_counts_saturate_at_7() {
    let mut bench = with(BusOffRecovery::Manual);
    for id in 0..20 {
        bench.deliver(0, standard(id, &[]));
        bench.push(0, standard(id, &[]));
    }
    bench.cycle();
    let status = bench.input().header().channel_status[0];
    assert_eq!((status.rx_pending(), status.tx_pending()), (7, 7));
    assert!(status.counter_sat());
    assert_eq!(bench.upload(0x9000, 10), 18);
    assert_eq!(bench.upload(0x9000, 11), 20);
}

#[test]
fn full_receive_fifo_and_half_full_ring_are_pressure() {
    let mut bench = with(BusOffRecovery::Manual);
    for id in 0..44 {
        bench.deliver(0, standard(id, &[]));
    }
    bench.cycle();
    assert!(bench.input().header().channel_status[0].rx_pressure());
    let mut bench = Fixture::op(chunks(3), chunks(24));
    for id in 0..36 {
        bench.push(0, standard(id, &[]));
    }
    bench.cycle();
    assert!(bench.input().header().channel_status[0].tx_pressure());
    bench.cycle();
    assert!(!bench.input().header().channel_status[0].tx_pressure());
}
