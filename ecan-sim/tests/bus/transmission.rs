//! Frame times, arbitration and station modes of a bus.

use super::fixture::{
    BIT, CLASSIC, FD, START, bits, bus_of, classic, error_frames, received, run, sent,
};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_sim::{BusEvent, CanBus, ErrorState, StationConfig, StationMode};
use proptest::prelude::*;

#[test]
fn every_other_station_receives_frame_at_its_end() {
    let (mut bus, s) = bus_of(&[CLASSIC; 3]);
    let frame = classic(0x123, &[1, 2, 3]);
    assert!(bus.offer(START, s[1], frame));
    assert!(!bus.offer(START, s[1], frame), "one frame at a time");
    let end = START + bits(&frame) * BIT;
    assert_eq!(bus.next_event(), Some(end));
    let event = |station| BusEvent::Received { station, frame, start_ns: START, at_ns: end };
    assert_eq!(
        run(&mut bus, START + 1_000_000),
        [
            BusEvent::Transmitted { station: s[1], frame, start_ns: START, at_ns: end },
            event(s[0]),
            event(s[2]),
        ]
    );
    assert!(!bus.is_offering(s[1]));
}

#[test]
fn next_frame_starts_after_three_bits() {
    let (mut bus, s) = bus_of(&[CLASSIC; 2]);
    let (one, two) = (classic(0x10, &[7; 8]), classic(0x20, &[]));
    bus.offer(START, s[0], one);
    bus.offer(START, s[1], two);
    let sent = sent(&run(&mut bus, START + 1_000_000));
    assert_eq!(sent[0].2, START);
    assert_eq!(sent[1].2, sent[0].3 + 3 * BIT);
    assert_eq!(sent[1].3, sent[1].2 + bits(&two) * BIT);
}

#[test]
fn switching_shortens_only_data_phase() {
    let (mut bus, s) = bus_of(&[FD; 2]);
    // 26 nominal and 550 data bits, see the frame timing tests.
    let frame = CanFrame::fd(CanId::standard(0x555).unwrap(), &[0x55; 64], true, false).unwrap();
    bus.offer(START, s[0], frame);
    let sent = sent(&run(&mut bus, START + 1_000_000));
    assert_eq!(sent[0].3 - sent[0].2, 26 * 2_000 + 550 * 200);
}

/// Frames offered up to the start of the next frame take part in arbitration.
#[test]
fn offer_at_start_of_next_frame_takes_part() {
    let (mut bus, s) = bus_of(&[CLASSIC; 3]);
    let first = classic(0x100, &[]);
    bus.offer(START, s[0], first);
    bus.offer(START + 1, s[1], classic(0x200, &[]));
    let mut events = Vec::new();
    bus.advance(START + 1_000_000, &mut events);
    let next_start = START + bits(&first) * BIT + 3 * BIT;
    bus.offer(next_start, s[2], classic(0x1FF, &[]));
    // Too late: the bus is busy.
    bus.offer(next_start + 1, s[0], classic(0x000, &[]));
    let order: Vec<_> = sent(&run(&mut bus, START + 1_000_000))
        .iter()
        .map(|(_, frame, ..)| frame.id().raw())
        .collect();
    assert_eq!(order, [0x1FF, 0x000, 0x200]);
}

#[test]
fn data_beats_remote_and_standard_beats_extended() {
    let (mut bus, s) = bus_of(&[CLASSIC; 4]);
    let standard = CanId::standard(0x123).unwrap();
    let extended = CanId::extended(0x123 << 18).unwrap();
    let dlc = ecan_protocol::can::Dlc::new(0).unwrap();
    let frames = [
        CanFrame::remote(extended, dlc).unwrap(),
        CanFrame::classic(extended, &[]).unwrap(),
        CanFrame::remote(standard, dlc).unwrap(),
        CanFrame::classic(standard, &[]).unwrap(),
    ];
    for (station, frame) in s.iter().zip(frames) {
        bus.offer(START, *station, frame);
    }
    let order: Vec<_> =
        sent(&run(&mut bus, START + 10_000_000)).iter().map(|(_, frame, ..)| *frame).collect();
    let expected: Vec<_> = frames.into_iter().rev().collect();
    assert_eq!(order, expected);
}

#[test]
fn equal_identifiers_use_station_order_and_are_counted() {
    let (mut bus, s) = bus_of(&[CLASSIC; 3]);
    bus.offer(START, s[2], classic(0x77, &[2]));
    bus.offer(START, s[1], classic(0x77, &[1]));
    let order: Vec<_> =
        sent(&run(&mut bus, START + 1_000_000)).iter().map(|(station, ..)| *station).collect();
    assert_eq!(order, [s[1], s[2]]);
    assert_eq!(bus.statistics().identifier_collisions, 1);
}

fn any_classic() -> impl Strategy<Value = CanFrame> {
    let id = prop_oneof![
        (0..=0x7FFu16).prop_map(|id| CanId::standard(id).unwrap()),
        // Neighbouring identifiers, of both formats.
        (0x120..=0x123u16).prop_map(|id| CanId::standard(id).unwrap()),
        (0x120..=0x123u32, 0..4u32).prop_map(|(a, b)| CanId::extended(a << 18 | b).unwrap()),
        (0..=0x1FFF_FFFFu32).prop_map(|id| CanId::extended(id).unwrap()),
    ];
    (id, prop::collection::vec(any::<u8>(), 0..=8), any::<bool>()).prop_map(|(id, data, remote)| {
        if remote {
            let dlc = ecan_protocol::can::Dlc::new(data.len() as u8).unwrap();
            CanFrame::remote(id, dlc).unwrap()
        } else {
            CanFrame::classic(id, &data).unwrap()
        }
    })
}

proptest! {
    /// Pending frames are sent in the order of their bits on the wire, without gaps, and every
    /// station except the sender receives them.
    #[test]
    fn pending_frames_are_sent_by_priority(frames in prop::collection::vec(any_classic(), 1..12)) {
        let mut expected: Vec<CanFrame> = Vec::new();
        for frame in frames {
            let bits = super::naive::arbitration_bits(&frame);
            if expected.iter().all(|other| super::naive::arbitration_bits(other) != bits) {
                expected.push(frame);
            }
        }
        let configs = vec![CLASSIC; expected.len() + 1];
        let (mut bus, s) = bus_of(&configs);
        for (frame, station) in expected.iter().zip(&s) {
            bus.offer(START, *station, *frame);
        }
        expected.sort_by_key(super::naive::arbitration_bits);
        let events = run(&mut bus, START + 1_000_000_000);
        let out = sent(&events);
        let order: Vec<_> = out.iter().map(|(_, frame, ..)| *frame).collect();
        prop_assert_eq!(&order, &expected);
        let mut start = START;
        for (_, frame, began, ended) in out {
            prop_assert_eq!(began, start);
            prop_assert_eq!(ended, start + super::naive::encode(&frame).bits.len() as u64 * BIT);
            start = ended + 3 * BIT;
        }
        prop_assert_eq!(received(&events).len(), expected.len() * (s.len() - 1));
        prop_assert_eq!(error_frames(&events), 0);
    }
}

#[test]
fn station_joins_after_eleven_bits() {
    let mut bus = CanBus::new("test");
    let (a, b) = (bus.attach(), bus.attach());
    bus.configure(0, a, Some(CLASSIC));
    bus.configure(0, b, Some(CLASSIC));
    let frame = classic(1, &[]);
    bus.offer(0, a, frame);
    assert_eq!(sent(&run(&mut bus, 1_000_000))[0].2, 11 * BIT);
    // A third station, configured during a frame, does not receive that frame.
    let c = bus.attach();
    bus.offer(1_000_000, a, frame);
    bus.configure(1_000_000 + 20 * BIT, c, Some(CLASSIC));
    bus.offer(1_000_000 + 20 * BIT, b, classic(2, &[]));
    let events = run(&mut bus, 2_000_000);
    let seen: Vec<_> = received(&events)
        .into_iter()
        .filter(|(station, _)| *station == c)
        .map(|(_, frame)| frame.id().raw())
        .collect();
    assert_eq!(seen, [2]);
}

#[test]
fn listeners_receive_but_do_not_acknowledge() {
    let listen = StationConfig { mode: StationMode::Listen, ..CLASSIC };
    let (mut bus, s) = bus_of(&[CLASSIC, listen]);
    let frame = classic(0x123, &[]);
    bus.offer(START, s[1], classic(0x1, &[]));
    bus.offer(START, s[0], frame);
    let mut events = Vec::new();
    while bus.error_state(s[0]) != ErrorState::Passive {
        bus.advance(START + 100_000_000, &mut events);
    }
    // The sender's active error flags destroyed the frame for the listener too.
    assert_eq!(error_frames(&events), 16);
    assert_eq!(received(&events), []);
    // An error-passive sender's flags are recessive: the listener receives the frame.
    events.clear();
    bus.advance(START + 100_000_000, &mut events);
    assert_eq!(error_frames(&events), 1);
    assert_eq!(received(&events), [(s[1], frame)]);
    assert_eq!(bus.error_counters(s[1]), (0, 0));
    assert!(bus.is_offering(s[1]), "a listener's frame waits");

    let (mut bus, s) = bus_of(&[CLASSIC, listen, CLASSIC]);
    bus.offer(START, s[0], frame);
    let events = run(&mut bus, START + 1_000_000);
    assert_eq!(received(&events), [(s[1], frame), (s[2], frame)]);
}

#[test]
fn internal_loopback_does_not_use_bus() {
    let looped = StationConfig { mode: StationMode::InternalLoopback, ..CLASSIC };
    let (mut bus, s) = bus_of(&[looped, CLASSIC, CLASSIC]);
    let (own, other) = (classic(0x1, &[5; 8]), classic(0x2, &[]));
    assert!(bus.offer(START, s[0], own));
    assert!(bus.is_offering(s[0]));
    bus.offer(START, s[1], other);
    let events = run(&mut bus, START + 1_000_000);
    // Both at the same time, each with its own length.
    let out = sent(&events);
    assert_eq!(out[0].0, s[1]);
    assert_eq!(out[0].3, START + bits(&other) * BIT);
    assert_eq!(out[1].0, s[0]);
    assert_eq!(out[1].3, START + bits(&own) * BIT);
    assert_eq!(received(&events), [(s[2], other), (s[0], own)]);
    assert_eq!(bus.statistics().frames, 1);
}

#[test]
fn external_loopback_needs_no_acknowledgement() {
    let looped = StationConfig { mode: StationMode::ExternalLoopback, ..CLASSIC };
    let (mut bus, s) = bus_of(&[looped]);
    let frame = classic(0x1, &[]);
    bus.offer(START, s[0], frame);
    let events = run(&mut bus, START + 1_000_000);
    assert_eq!(sent(&events).len(), 1);
    assert_eq!(received(&events), [(s[0], frame)]);

    let (mut bus, s) = bus_of(&[looped, CLASSIC]);
    bus.offer(START, s[0], frame);
    let events = run(&mut bus, START + 1_000_000);
    assert_eq!(received(&events), [(s[0], frame), (s[1], frame)]);
    // It neither receives nor acknowledges frames of others.
    bus.offer(START + 1_000_000, s[1], classic(2, &[]));
    let events = run(&mut bus, START + 1_200_000);
    assert_eq!(received(&events), []);
    assert!(error_frames(&events) > 0);
}

#[test]
fn classic_station_sends_fd_frames_in_classic_format() {
    let (mut bus, s) = bus_of(&[CLASSIC; 2]);
    let id = CanId::standard(1).unwrap();
    let frame = CanFrame::fd(id, &[9; 12], true, false).unwrap();
    bus.offer(START, s[0], frame);
    let events = run(&mut bus, START + 1_000_000);
    assert_eq!(received(&events), [(s[1], classic(1, &[9; 8]))]);
}

#[test]
fn withdrawn_frame_is_not_sent() {
    let (mut bus, s) = bus_of(&[CLASSIC; 2]);
    bus.offer(START, s[0], classic(1, &[]));
    bus.offer(START, s[1], classic(2, &[]));
    bus.withdraw(s[1]);
    assert!(!bus.is_offering(s[1]));
    run(&mut bus, START + BIT);
    // In transmission: it is completed.
    bus.withdraw(s[0]);
    assert!(bus.is_offering(s[0]));
    let events = run(&mut bus, START + 1_000_000);
    assert_eq!(sent(&events).len(), 1);
}

#[test]
fn station_off_the_bus_cannot_send() {
    let mut bus = CanBus::new("test");
    let station = bus.attach();
    assert!(!bus.offer(0, station, classic(1, &[])));
    assert!(!bus.is_offering(station));
    assert_eq!(bus.next_event(), None);
}

#[test]
fn bus_without_pauses_has_load_one() {
    let (mut bus, s) = bus_of(&[CLASSIC; 2]);
    let before = bus.statistics();
    assert_eq!(before.at_ns, START);
    let frame = classic(0x123, &[3; 8]);
    let slot = (bits(&frame) + 3) * BIT;
    let mut events = Vec::new();
    let mut now = START;
    for _ in 0..10 {
        bus.offer(now, s[0], frame);
        events.clear();
        now = bus.advance(u64::MAX, &mut events);
    }
    run(&mut bus, START + 10 * slot);
    let full = bus.statistics();
    assert_eq!(full.frames, 10);
    assert_eq!(full.busy_ns, 10 * slot);
    assert!((full.load_since(&before) - 1.0).abs() < 1e-12);
    run(&mut bus, START + 20 * slot);
    assert!((bus.statistics().load_since(&before) - 0.5).abs() < 1e-12);
    assert!(bus.statistics().load_since(&full).abs() < 1e-12);
}

/// A snapshot during a frame counts the elapsed part.
#[test]
fn load_counts_frame_in_transmission() {
    let (mut bus, s) = bus_of(&[CLASSIC; 2]);
    let before = bus.statistics();
    bus.offer(START, s[0], classic(0x123, &[3; 8]));
    run(&mut bus, START + 40 * BIT);
    assert_eq!(bus.statistics().busy_ns - before.busy_ns, 40 * BIT);
}
