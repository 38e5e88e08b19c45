//! From the RxPDO to the controller: TX budget, ring of 64, overflow policies, and the order in
//! which a FIFO and a queue send (manual 13.2.2, 13.4).

use super::fixture::{Fixture, chunks, extended, fd, standard};
use ecan_protocol::can::{CanFrame, CanId, Dlc};
use ecan_protocol::config::{
    DataPathConfig, McanChannelConfig, MessageRamLayout, TxMode, TxOverflow,
};
use ecan_sim::GatewayModelConfig;

const FIFO_FULL: u8 = 11;
const STALE: u8 = 12;
const DEGRADED: u8 = 15;

/// In OP with this policy on channel 0 and this number of transmit elements.
fn with(policy: DataPathConfig, tx_fifo_size: u8) -> Fixture {
    with_pressure(GatewayModelConfig::default().tx_pressure_percent, policy, tx_fifo_size)
}

/// A gateway as that of [`with`], with this threshold of `tx_pressure`.
fn with_pressure(tx_pressure_percent: u8, policy: DataPathConfig, tx_fifo_size: u8) -> Fixture {
    let config = GatewayModelConfig { tx_pressure_percent, ..GatewayModelConfig::default() };
    let mut fixture = Fixture::configured_with(config, chunks(3), chunks(24));
    let ram = MessageRamLayout { tx_fifo_size, ..MessageRamLayout::fd() };
    fixture.apply_channel(0, McanChannelConfig { ram, ..McanChannelConfig::default() });
    fixture.apply_data_path(0, policy);
    fixture.start();
    fixture
}

#[test]
fn default_budget_hands_four_frames_over_per_service() {
    let mut fixture = with(DataPathConfig::default(), 32);
    fixture.push_ids(0, 0..10);
    let mut per_cycle = Vec::new();
    for _ in 0..4 {
        fixture.cycle();
        per_cycle.push(fixture.sent(0).len());
    }
    assert_eq!(per_cycle, [4, 4, 2, 0]);
}

#[test]
fn budget_follows_the_policy() {
    for max in [0, 1, 8] {
        let mut fixture =
            with(DataPathConfig { tx_budget_max: max, ..DataPathConfig::default() }, 32);
        fixture.push_ids(0, 0..10);
        fixture.cycle();
        assert_eq!(fixture.sent(0).len(), usize::from(max));
    }
}

#[test]
fn drop_newest_and_drop_oldest_at_a_full_ring() {
    for (tx_overflow, first, last) in
        [(TxOverflow::DropNewest, 0, 63), (TxOverflow::DropOldest, 6, 69)]
    {
        let policy = DataPathConfig { tx_overflow, tx_budget_max: 8, ..DataPathConfig::default() };
        let mut fixture = with(policy, 32);
        fixture.push_ids(0, 0..70);
        let mut sent = Vec::new();
        for _ in 0..10 {
            fixture.cycle();
            sent.extend(fixture.sent(0));
        }
        let ids = Fixture::identifiers(&sent);
        assert_eq!(ids, (first..=last).collect::<Vec<_>>());
        fixture.has(&[(0x8011, 16, 6), (0x8011, 2, 8), (0xB000, 6, 1 << 4)]);
        let stale = if tx_overflow == TxOverflow::DropOldest { 6 } else { 0 };
        assert_eq!(fixture.upload(0x9020, STALE), stale);
    }
}

#[test]
fn full_fifo_is_counted_and_the_frames_wait_in_the_ring() {
    let mut fixture = with(DataPathConfig::default(), 2);
    fixture.push_ids(0, 0..6);
    fixture.cycle();
    fixture.has(&[(0x9020, FIFO_FULL, 1), (0x9000, 11, 6), (0xB000, 6, 1 << 5)]);
    assert!(fixture.upload(0x9000, 9) & 1 << 7 != 0, "tx_pressure");
    let mut ids = Fixture::identifiers(&fixture.sent(0));
    for _ in 0..3 {
        fixture.cycle();
        ids.extend(Fixture::identifiers(&fixture.sent(0)));
    }
    assert_eq!(ids, [0, 1, 2, 3, 4, 5]);
}

#[test]
fn backoff_doubles_the_skipped_services() {
    let policy = DataPathConfig {
        tx_overflow: TxOverflow::Backoff,
        backoff_base_cycles: 2,
        ..DataPathConfig::default()
    };
    let mut fixture = with(policy, 1);
    fixture.push_ids(0, 0..20);
    let mut attempts = Vec::new();
    let mut last = 0;
    for cycle in 0..20 {
        fixture.cycle();
        let full = fixture.upload(0x9020, FIFO_FULL);
        if full != last {
            attempts.push(cycle);
            last = full;
        }
    }
    assert_eq!(attempts, [0, 3, 8, 17]);
    assert_eq!(fixture.sent(0).len(), 1);
}

#[test]
fn backoff_ends_with_a_sent_frame_and_keeps_the_minimum() {
    let policy = DataPathConfig {
        tx_overflow: TxOverflow::Backoff,
        backoff_base_cycles: 100,
        tx_budget_min: 1,
        ..DataPathConfig::default()
    };
    let mut fixture = with(policy, 1);
    fixture.push_ids(0, 0..4);
    let mut ids = Vec::new();
    for _ in 0..5 {
        fixture.cycle();
        ids.extend(Fixture::identifiers(&fixture.sent(0)));
    }
    assert_eq!(ids, [0, 1, 2, 3], "one frame a service in spite of the backoff");
}

#[test]
fn degraded_channel_rejects_frames_until_empty() {
    let policy = DataPathConfig {
        tx_overflow: TxOverflow::Degraded,
        degraded_threshold: 3,
        tx_budget_max: 8,
        ..DataPathConfig::default()
    };
    let mut fixture = with(policy, 1);
    fixture.push_ids(0, 0..3);
    for _ in 0..2 {
        fixture.cycle();
        assert_eq!(fixture.upload(0x9020, DEGRADED), 0);
    }
    fixture.cycle();
    assert_ne!(fixture.upload(0x9020, DEGRADED), 0);
    fixture.push(0, standard(0x100, &[]));
    fixture.cycle();
    assert_eq!(fixture.gateway.counters().transmit_losses.ring_full, 1);
    let mut ids = Vec::new();
    for _ in 0..4 {
        ids.extend(Fixture::identifiers(&fixture.sent(0)));
        fixture.cycle();
    }
    assert_eq!(ids, [0, 1, 2]);
    assert_eq!(fixture.upload(0x9020, DEGRADED), 0);
    fixture.push(0, standard(0x101, &[]));
    fixture.cycle();
    assert_eq!(Fixture::identifiers(&fixture.sent(0)), [0x101]);
}

#[test]
fn queue_mode_sends_by_priority_and_fifo_in_order() {
    let remote = |id| CanFrame::remote(CanId::standard(id).unwrap(), Dlc::new(0).unwrap()).unwrap();
    let frames = [
        standard(0x300, &[]),
        extended(0x100 << 18),
        remote(0x100),
        standard(0x100, &[1]),
        standard(0x100, &[2]),
        standard(0x080, &[]),
    ];
    for (tx_mode, order) in
        [(TxMode::Fifo, [0, 1, 2, 3, 4, 5]), (TxMode::Queue, [5, 3, 4, 2, 1, 0])]
    {
        let mut fixture = Fixture::configured(chunks(3), chunks(3));
        let ram = MessageRamLayout { tx_mode, ..MessageRamLayout::fd() };
        fixture.apply_channel(0, McanChannelConfig { ram, ..McanChannelConfig::default() });
        let policy = DataPathConfig { tx_budget_max: 8, ..DataPathConfig::default() };
        fixture.apply_data_path(0, policy);
        fixture.start();
        for frame in frames {
            fixture.push(0, frame);
        }
        fixture.cycle();
        assert_eq!(fixture.sent(0), order.map(|at| frames[at]), "{tx_mode:?}");
    }
}

#[test]
fn one_frame_is_in_arbitration_at_a_time() {
    let mut fixture = with(DataPathConfig::default(), 32);
    fixture.push_ids(0, 0..3);
    fixture.cycle();
    let first = fixture.gateway.next_transmit(0).unwrap();
    assert_eq!(fixture.gateway.next_transmit(0), None);
    fixture.gateway.transmitted(fixture.now, 0, &first);
    let second = fixture.gateway.next_transmit(0).unwrap();
    fixture.gateway.abandoned(fixture.now, 0, &second);
    assert_eq!(fixture.gateway.next_transmit(0).unwrap().id().raw(), 2);
    assert_eq!(fixture.gateway.counters().frames_on_bus, 1);
    assert_eq!(fixture.gateway.counters().transmit_losses.not_retransmitted, 1);
}

#[test]
fn element_too_small_for_the_data_sends_filler() {
    let mut fixture = Fixture::configured(chunks(3), chunks(3));
    let ram = MessageRamLayout {
        tx_data_size: ecan_protocol::config::DataSize::B16,
        ..MessageRamLayout::fd()
    };
    fixture.apply_channel(0, McanChannelConfig { ram, ..McanChannelConfig::default() });
    fixture.start();
    fixture.push(0, fd(1, &[0x11; 24]));
    fixture.cycle();
    let mut data = [0xCC; 24];
    data[..16].fill(0x11);
    assert_eq!(fixture.sent(0), [fd(1, &data)]);
}

#[test]
fn channels_have_rings_of_their_own() {
    let mut fixture = Fixture::op(chunks(3), chunks(24));
    fixture.push_ids(0, 0..64);
    fixture.push(3, standard(0x300, &[]));
    fixture.cycle();
    assert_eq!(Fixture::identifiers(&fixture.sent(3)), [0x300]);
}

#[test]
fn tx_pressure_threshold_is_configurable() {
    let still = DataPathConfig { tx_budget_max: 0, ..DataPathConfig::default() };
    for (percent, frames) in [(1, 1), (25, 16), (50, 32), (99, 64), (100, 64)] {
        let mut fixture = with_pressure(percent, still, 32);
        fixture.push_ids(0, 0..frames - 1);
        fixture.cycle();
        assert!(!fixture.input().header().channel_status[0].tx_pressure(), "{percent} %");
        fixture.push_ids(0, 0..1);
        fixture.cycle();
        assert!(fixture.input().header().channel_status[0].tx_pressure(), "{percent} %");
    }
    // a full transmit FIFO of the controller is pressure, except with 100 percent
    for (percent, shown) in [(99, true), (100, false)] {
        let mut fixture = with_pressure(percent, DataPathConfig::default(), 2);
        fixture.push_ids(0, 0..6);
        fixture.cycle();
        assert_eq!(fixture.input().header().channel_status[0].tx_pressure(), shown, "{percent} %");
    }
}
