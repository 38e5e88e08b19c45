//! Scheduled transmission (manual 8.4, 13.8): frames are sent at their offset after the next Sync0
//! pulse, or dropped.

use super::fixture::{Fixture, MS, chunks, standard};
use ecan_protocol::config::{McanChannelConfig, MessageRamLayout};
use ecan_protocol::image::Schedule;
use ecan_sim::{GatewayModelConfig, Sync0Window};

const LATE_DROP: u32 = 1 << 6;
const QUEUE_FULL: u32 = 1 << 7;
const TX_FAIL: u32 = 1 << 8;
const TIMER_MISS: u32 = 1 << 9;

/// In OP between two of the pulses at every whole millisecond; returns the time of the first one. The
/// firmware misses no outputs: tests write close to a pulse to meet or miss a phase.
fn synchronous() -> (Fixture, u64) {
    let config = GatewayModelConfig { sync0_window: Sync0Window::OFF, ..Default::default() };
    let mut fixture = Fixture::configured_with(config, chunks(24), chunks(24));
    let start = fixture.start_with_sync0(300_000);
    (fixture, start)
}

fn schedule(fixture: &mut Fixture, channel: u8, id: u16, offset_ns: u32) {
    fixture.push_scheduled(channel, standard(id, &[]), Schedule { tag: 7, offset_ns });
}

fn diag_flags(fixture: &mut Fixture) -> u32 {
    fixture.upload(0xB000, 6)
}

#[test]
fn frame_leaves_at_its_phase_of_the_next_cycle() {
    let (mut fixture, start) = synchronous();
    fixture.now = start + 4 * MS + 300_000;
    schedule(&mut fixture, 0, 0x10, 100_000);
    assert!(fixture.write());
    assert_eq!(fixture.sent(0), []);
    let due = start + 5 * MS + 100_000;
    assert_eq!(fixture.gateway.next_event(), Some(due));
    fixture.gateway.advance(due - 1);
    assert_eq!(fixture.sent(0), []);
    fixture.gateway.advance(due);
    assert_eq!(Fixture::identifiers(&fixture.sent(0)), [0x10]);
    assert_eq!(fixture.gateway.counters().frames_released, 1);
    assert_eq!(diag_flags(&mut fixture), 0);
}

#[test]
fn equal_phases_keep_the_order_of_the_image_and_earlier_ones_go_first() {
    let (mut fixture, start) = synchronous();
    fixture.now = start + 4 * MS + 300_000;
    for (id, offset) in [(0x30, 200_000), (0x20, 100_000), (0x31, 200_000), (0x10, 200_000)] {
        schedule(&mut fixture, 0, id, offset);
    }
    schedule(&mut fixture, 1, 0x40, 100_000);
    assert!(fixture.write());
    fixture.pass(MS);
    assert_eq!(Fixture::identifiers(&fixture.sent(0)), [0x20, 0x30, 0x31, 0x10]);
    assert_eq!(Fixture::identifiers(&fixture.sent(1)), [0x40]);
}

#[test]
fn immediate_frames_do_not_wait() {
    let (mut fixture, start) = synchronous();
    fixture.now = start + 4 * MS + 300_000;
    schedule(&mut fixture, 0, 0x10, 100_000);
    fixture.push(0, standard(0x20, &[]));
    assert!(fixture.write());
    assert_eq!(Fixture::identifiers(&fixture.sent(0)), [0x20]);
}

#[test]
fn missed_phase_is_dropped_not_moved_to_another_cycle() {
    let (mut fixture, start) = synchronous();
    // arrives 10 us before a pulse, is parsed 20 us after it
    fixture.now = start + 5 * MS - 10_000;
    schedule(&mut fixture, 0, 0x10, 15_000);
    schedule(&mut fixture, 0, 0x11, 25_000);
    assert!(fixture.write());
    fixture.pass(3 * MS);
    assert_eq!(Fixture::identifiers(&fixture.sent(0)), [0x11]);
    assert_eq!(fixture.gateway.counters().transmit_losses.late, 1);
    assert_eq!(diag_flags(&mut fixture), LATE_DROP);
    fixture.has(&[(0x8011, 16, 1), (0x8011, 2, 8)]);
}

#[test]
fn offset_beyond_the_cycle_is_invalid() {
    let (mut fixture, _) = synchronous();
    schedule(&mut fixture, 0, 0x10, 999_999);
    assert!(fixture.write());
    assert_eq!(fixture.upload(0x8011, 14), 0);
    schedule(&mut fixture, 0, 0x10, 1_000_000);
    assert!(fixture.write());
    assert_eq!(fixture.upload(0x8011, 14), 16);
}

#[test]
fn queue_holds_64_frames() {
    let (mut fixture, _) = synchronous();
    for id in 0..70 {
        schedule(&mut fixture, (id % 4) as u8, id, 500_000);
    }
    assert!(fixture.write());
    assert_eq!(fixture.gateway.counters().frames_scheduled, 64);
    assert_eq!(fixture.gateway.counters().transmit_losses.schedule_full, 6);
    assert_eq!(diag_flags(&mut fixture), QUEUE_FULL);
}

#[test]
fn full_controller_at_the_phase_loses_the_frame() {
    let mut fixture = Fixture::configured(chunks(24), chunks(24));
    let ram = MessageRamLayout { tx_fifo_size: 2, ..MessageRamLayout::fd() };
    fixture.apply_channel(0, McanChannelConfig { ram, ..McanChannelConfig::default() });
    fixture.start_with_sync0(300_000);
    for id in 0..3 {
        schedule(&mut fixture, 0, id, 100_000);
    }
    assert!(fixture.write());
    fixture.pass(2 * MS);
    assert_eq!(Fixture::identifiers(&fixture.sent(0)), [0, 1]);
    assert_eq!(diag_flags(&mut fixture), TX_FAIL | 1 << 5);
    assert_eq!(fixture.gateway.counters().transmit_losses.schedule_failed, 1);
}

#[test]
fn frames_scheduled_for_a_stopped_sync0_are_dropped() {
    let (mut fixture, _) = synchronous();
    schedule(&mut fixture, 0, 0x10, 100_000);
    assert!(fixture.write());
    fixture.gateway.set_dc_sync0(None);
    fixture.pass(3 * MS);
    assert_eq!(fixture.sent(0), []);
    assert_eq!(diag_flags(&mut fixture), TIMER_MISS);
    assert_eq!(fixture.state(), (ecan_protocol::device::AlState::SafeOp, 0x2C));
}

#[test]
fn clear_diagnostics_clears_the_flags() {
    let (mut fixture, start) = synchronous();
    fixture.now = start + 5 * MS - 10_000;
    schedule(&mut fixture, 0, 0x10, 0);
    assert!(fixture.write());
    assert_eq!(diag_flags(&mut fixture), LATE_DROP);
    fixture.write_u8(0xB000, 4, 0x20);
    assert_eq!(diag_flags(&mut fixture), 0);
    assert_eq!((fixture.upload(0xB000, 5), fixture.upload(0xB000, 12)), (0, 1));
}

#[test]
fn pulses_follow_start_and_shift() {
    let mut fixture = Fixture::configured(chunks(3), chunks(3));
    let start_ns = fixture.now + MS;
    fixture.gateway.set_dc_sync0(Some(ecan_sim::Sync0 {
        start_ns,
        cycle_ns: 2 * MS as u32,
        shift_ns: 250_000,
    }));
    fixture.pass(2 * MS);
    fixture.start();
    schedule(&mut fixture, 0, 0x10, 1_000);
    assert!(fixture.write());
    assert_eq!(fixture.gateway.next_event(), Some(start_ns + 2 * MS + 250_000 + 1_000));
}

#[test]
fn release_jitter_delays_and_keeps_the_order() {
    let config = GatewayModelConfig { release_jitter_ns: 13_000, ..GatewayModelConfig::default() };
    let mut fixture = Fixture::configured_with(config, chunks(24), chunks(24));
    let start = fixture.start_with_sync0(0);
    let mut delays = Vec::new();
    for cycle in 4..54 {
        fixture.now = start + cycle * MS + 300_000;
        schedule(&mut fixture, 0, 0x20, 100_000);
        schedule(&mut fixture, 0, 0x10, 100_000);
        assert!(fixture.write());
        let due = start + (cycle + 1) * MS + 100_000;
        let released = fixture.gateway.next_event().unwrap();
        delays.push(released - due);
        fixture.gateway.advance(released - 1);
        assert_eq!(fixture.sent(0), []);
        fixture.gateway.advance(released);
        assert_eq!(Fixture::identifiers(&fixture.sent(0)), [0x20, 0x10]);
    }
    let (least, most) = (delays.iter().min().unwrap(), delays.iter().max().unwrap());
    assert!(*most <= 13_000 && most - least > 6_000, "{delays:?}");
}
