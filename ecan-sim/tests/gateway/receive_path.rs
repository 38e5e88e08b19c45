//! From the bus to the TxPDO: drain budgets, cache depth and overflow policies of
//! 0x8021..0x8024, with their counters of 0x9020..0x9023 (manual 13.2.2, 13.2.5).

use super::fixture::{Fixture, MS, chunks, extended, standard};
use ecan_protocol::config::{CacheDepth, CriticalFrames, DataPathConfig, RxBudget, RxOverflow};
use ecan_protocol::image::PdoProfile;

const TOTAL: u8 = 5;
const OLD: u8 = 6;
const NEW: u8 = 7;
const CRITICAL: u8 = 8;
const DEGRADED: u8 = 15;

/// In OP with this policy on channel 0 and a TxPDO large enough for the whole cache.
fn with(policy: DataPathConfig) -> Fixture {
    let mut fixture = Fixture::configured(chunks(16), chunks(3));
    fixture.apply_data_path(0, policy);
    fixture.start();
    fixture
}

/// Delivers frames without fetching the input image, so that the cache fills up.
fn overflow(fixture: &mut Fixture, ids: &[u16]) -> Vec<u32> {
    assert!(fixture.write(), "fills SM3");
    for &id in ids {
        fixture.deliver(0, standard(id, &[]));
        assert!(fixture.write());
    }
    assert!(fixture.read());
    fixture.cycle();
    fixture.received_ids()
}

fn policy() -> DataPathConfig {
    DataPathConfig { rx_cache_depth: CacheDepth::D8, rx_drain_max: 8, ..DataPathConfig::default() }
}

#[test]
fn default_policy_drains_two_frames_per_service() {
    let mut fixture = with(DataPathConfig::default());
    fixture.deliver_ids(0, 0..7);
    let mut per_cycle = Vec::new();
    let mut ids = Vec::new();
    for _ in 0..5 {
        fixture.cycle();
        per_cycle.push(fixture.received().len());
        ids.extend(fixture.received().iter().map(|(_, frame)| frame.id().raw()));
    }
    assert_eq!(per_cycle, [2, 2, 2, 1, 0]);
    assert_eq!(ids, [0, 1, 2, 3, 4, 5, 6]);
    fixture.has(&[(0x9020, 4, 2), (0x9020, 10, 2), (0x9020, TOTAL, 0)]);
}

#[test]
fn budget_policies_divide_the_frame_area() {
    for (rx_budget, rx_drain_max, drained) in [
        (RxBudget::Balanced, 8, 2),
        (RxBudget::Balanced, 1, 1),
        (RxBudget::Limited, 5, 5),
        (RxBudget::Performance, 5, 5),
        (RxBudget::Adaptive, 6, 6),
        (RxBudget::Limited, 0, 0),
    ] {
        let mut fixture = with(DataPathConfig { rx_budget, rx_drain_max, ..policy() });
        fixture.deliver_ids(0, 0..10);
        fixture.cycle();
        assert_eq!(fixture.received().len(), drained, "{rx_budget:?} {rx_drain_max}");
        assert_eq!(fixture.upload(0x9020, 3), drained as u32);
    }
}

#[test]
fn adaptive_falls_back_to_the_minimum_under_pressure() {
    let mut fixture = with(DataPathConfig {
        rx_budget: RxBudget::Adaptive,
        rx_drain_min: 1,
        rx_drain_max: 6,
        ..policy()
    });
    assert!(fixture.write(), "SM3 is full from here on");
    fixture.deliver_ids(0, 0..20);
    let mut drained = Vec::new();
    for _ in 0..3 {
        assert!(fixture.write());
        drained.push(fixture.upload(0x9020, 3));
    }
    assert_eq!(drained, [6, 1, 1]);
}

#[test]
fn full_cache_drops_the_newest_or_the_oldest_frame() {
    for (rx_overflow, expected, dropped) in [
        (RxOverflow::DropNewest, 0x100..0x108, (0, 2)),
        (RxOverflow::DropOldest, 0x102..0x10A, (2, 0)),
    ] {
        let mut fixture = with(DataPathConfig { rx_overflow, ..policy() });
        let kept = overflow(&mut fixture, &(0x100..0x10A).collect::<Vec<_>>());
        assert_eq!(kept, expected.collect::<Vec<_>>(), "{rx_overflow:?}");
        let counts = (fixture.upload(0x9020, OLD), fixture.upload(0x9020, NEW));
        assert_eq!(counts, dropped, "{rx_overflow:?}");
        for (index, subindex) in [(0x9020, TOTAL), (0x9000, 13), (0x8010, 16)] {
            assert_eq!(fixture.upload(index, subindex), 2, "{rx_overflow:?} {index:04X}");
        }
        assert_eq!(fixture.upload(0x9020, 2), 8, "{rx_overflow:?}: high watermark");
    }
}

#[test]
fn preserve_critical_drops_uncritical_frames() {
    // CANopen of node 5: TPDO1, EMCY, heartbeat; SDO response; SYNC
    let feedback = 0x185;
    let ids = [feedback, feedback, 0x085, feedback, 0x705, 0x585, 0x080, feedback];
    for (critical_frames, late, expected) in [
        // an uncritical new frame is dropped
        (CriticalFrames::CanopenSafety, 0x186, ids.to_vec()),
        // a critical one replaces the oldest uncritical one
        (CriticalFrames::CanopenSafety, 0x086, [&ids[1..], &[0x086]].concat()),
        (CriticalFrames::CanopenSafety, 0x000, [&ids[1..], &[0x000]].concat()),
        (CriticalFrames::CanopenSafety, 0x77F, [&ids[1..], &[0x77F]].concat()),
        // SDO, SYNC and TIME count only in the conservative class
        (CriticalFrames::CanopenSafety, 0x586, ids.to_vec()),
        (CriticalFrames::CanopenAll, 0x586, [&ids[1..], &[0x586]].concat()),
        (CriticalFrames::CanopenAll, 0x100, [&ids[1..], &[0x100]].concat()),
        (CriticalFrames::None, 0x086, ids.to_vec()),
    ] {
        let rx_overflow = RxOverflow::PreserveCritical;
        let mut fixture = with(DataPathConfig { rx_overflow, critical_frames, ..policy() });
        let kept = overflow(&mut fixture, &[&ids[..], &[late]].concat());
        let expected: Vec<u32> = expected.iter().map(|&id| u32::from(id)).collect();
        assert_eq!(kept, expected, "{critical_frames:?} {late:#x}");
        let saved = u32::from(expected.last() == Some(&u32::from(late)) && late != feedback);
        assert_eq!(fixture.upload(0x9020, CRITICAL), saved);
    }
}

#[test]
fn oldest_critical_frame_is_dropped() {
    let rx_overflow = RxOverflow::PreserveCritical;
    let mut fixture = with(DataPathConfig { rx_overflow, ..policy() });
    let kept = overflow(&mut fixture, &(0x701..0x70A).collect::<Vec<_>>());
    assert_eq!(kept, (0x702..0x70A).collect::<Vec<_>>());
}

#[test]
fn extended_frames_are_never_critical() {
    let rx_overflow = RxOverflow::PreserveCritical;
    let mut fixture = with(DataPathConfig { rx_overflow, ..policy() });
    assert!(fixture.write());
    for id in 0..9 {
        fixture.deliver(0, extended(0x85 + id));
        assert!(fixture.write());
    }
    assert_eq!((fixture.upload(0x9020, NEW), fixture.upload(0x9020, CRITICAL)), (1, 0));
}

#[test]
fn degraded_state_follows_threshold_and_pressure() {
    let rx_overflow = RxOverflow::Degraded;
    let mut fixture = with(DataPathConfig { rx_overflow, degraded_threshold: 3, ..policy() });
    assert!(fixture.write());
    for id in 0..10 {
        fixture.deliver(0, standard(id, &[]));
        assert!(fixture.write());
    }
    assert_eq!(fixture.upload(0x9020, DEGRADED), 0);
    fixture.deliver(0, standard(10, &[]));
    assert!(fixture.write());
    assert_ne!(fixture.upload(0x9020, DEGRADED), 0);
    assert!(fixture.read());
    fixture.cycle();
    assert!(fixture.input().header().channel_status[0].warn(), "built before the cache was empty");
    fixture.cycle();
    assert_eq!(fixture.upload(0x9020, DEGRADED), 0);
}

#[test]
fn rx_cache_depths_match_their_numbers() {
    for (written, depth) in
        [(0, 32), (1, 8), (2, 16), (3, 24), (8, 8), (16, 16), (24, 24), (32, 32)]
    {
        let mut fixture = with(DataPathConfig { rx_drain_max: 8, ..DataPathConfig::default() });
        fixture.write_u8(0x8021, 7, written);
        fixture.send([DataPathConfig::apply_write(0)]);
        assert_eq!(fixture.upload(0x8021, 3), 0);
        assert!(fixture.write());
        for id in 0..40 {
            fixture.deliver(0, standard(id, &[]));
            assert!(fixture.write());
        }
        assert_eq!(fixture.upload(0x9020, 1), depth, "{written}");
    }
}

#[test]
fn rejected_policies_leave_the_old_one() {
    for (subindex, value) in [
        (1, 2),
        (4, 9),
        // The minimum is above the maximum.
        (4, 3),
        (5, 9),
        (6, 4),
        (7, 4),
        (7, 33),
        (8, 4),
        (11, 9),
        (12, 9),
        (13, 4),
        (14, 4),
    ] {
        let mut fixture = Fixture::preop();
        fixture.write_u8(0x8021, subindex, value);
        fixture.write_u8(0x8021, 2, 1);
        assert_eq!(fixture.upload(0x8021, 3), 1, "{subindex} = {value}");
        assert_eq!(fixture.upload(0x8021, 20), 0x5405_9201);
    }
}

#[test]
fn applied_policy_is_read_back_packed() {
    let mut fixture = Fixture::preop();
    let policy = DataPathConfig::for_traffic(6, 7);
    fixture.apply_data_path(2, policy);
    fixture.has(&[(0x8023, 20, policy.active_word()), (0x8022, 20, 0x5405_9201)]);
}

#[test]
fn disabled_policy_runs_with_the_factory_values() {
    let mut fixture = with(DataPathConfig { enable: false, ..policy() });
    assert_eq!(fixture.upload(0x8021, 20) & 1, 0);
    fixture.deliver_ids(0, 0..5);
    fixture.cycle();
    assert_eq!(fixture.received().len(), 2);
}

#[test]
fn service_budget_limits_all_channels_together() {
    let mut fixture = Fixture::configured(chunks(16), chunks(3));
    for channel in 0..4 {
        fixture.apply_data_path(channel, DataPathConfig { rx_drain_min: 1, ..policy() });
    }
    // two microseconds a frame
    fixture.download(0x8020, 7, &12u16.to_le_bytes()).unwrap();
    fixture.write_u8(0x8020, 2, 1);
    assert_eq!(fixture.upload(0x8020, 3), 0);
    fixture.start();
    for channel in 0..4 {
        fixture.deliver_ids(channel, 0..8);
    }
    fixture.cycle();
    let drained: Vec<_> = (0..4).map(|channel| fixture.upload(0x9020 + channel, 3)).collect();
    assert_eq!(drained, [6, 1, 1, 1]);
}

#[test]
fn global_control_rejects_unknown_options() {
    let mut fixture = Fixture::preop();
    for (subindex, data) in [(5, &[1, 0, 0, 0][..]), (6, &[1, 0, 0, 0]), (7, &[0xE9, 0x03])] {
        let before = fixture.try_upload(0x8020, subindex).unwrap();
        fixture.download(0x8020, subindex, data).unwrap();
        fixture.write_u8(0x8020, 2, 1);
        assert_eq!(fixture.upload(0x8020, 3), 1);
        fixture.download(0x8020, subindex, &before).unwrap();
    }
    fixture.write_u8(0x8020, 2, 1);
    assert_eq!(fixture.upload(0x8020, 3), 0);
}

#[test]
fn channel_outside_the_mask_is_drained_and_dropped() {
    let tx = PdoProfile { channel_mask: 0x01, ..chunks(3) };
    let mut fixture = Fixture::op(tx, chunks(3));
    for _ in 0..100 {
        fixture.deliver(1, standard(1, &[]));
        fixture.cycle();
        assert_eq!(fixture.received(), []);
    }
    assert_eq!(fixture.gateway.counters().receive_losses.masked, 100);
    assert_eq!(fixture.upload(0x9021, TOTAL), 0, "nothing went wrong");
}

#[test]
fn full_controller_fifo_of_48_loses_new_frames() {
    let mut fixture = with(DataPathConfig::default());
    fixture.deliver_ids(0, 0..50);
    assert_eq!(fixture.gateway.counters().receive_losses.controller_full, 2);
    fixture.cycle();
    assert_eq!(fixture.upload(0x9020, NEW), 2);
    assert!(fixture.input().header().overflow_sat >= 2);
    fixture.pass(MS);
    assert_eq!(fixture.upload(0x9000, 10), 46);
}

#[test]
fn image_misses_no_frame_of_a_channel_outside_the_mask() {
    let tx = PdoProfile { channel_mask: 0x01, ..chunks(3) };
    let mut fixture = Fixture::op(tx, chunks(3));
    fixture.deliver_ids(1, 0..50);
    assert_eq!(fixture.gateway.counters().receive_losses.controller_full, 2);
    for _ in 0..3 {
        fixture.cycle();
        assert_eq!(fixture.input().header().overflow_sat, 0);
    }
}
