//! Errors on a bus: counters, states, bus-off and recovery.

use super::fixture::{
    BIT, CLASSIC, FD, START, bits, bus_of, classic, error_frames, received, run, sent, states,
};
use ecan_protocol::can::{CanFrame, CanId, Phase};
use ecan_sim::{BusError, BusEvent, BusFault, DetectedError, ErrorState, StationConfig};

fn nominal(error: BusError) -> DetectedError {
    DetectedError { error, phase: Phase::Nominal }
}

/// The frame is complete up to the ACK slot; 6 bits of error flag and 8 of delimiter follow.
/// Sixteen failures make the sender error passive; further ones do not count.
#[test]
fn lone_station_becomes_and_stays_error_passive() {
    let (mut bus, s) = bus_of(&[CLASSIC]);
    let frame = classic(0x123, &[1, 2, 3, 4]);
    bus.offer(START, s[0], frame);
    let attempt = (bits(&frame) - 8 + 6 + 8 + 3) * BIT;
    let events = run(&mut bus, START + 15 * attempt);
    assert_eq!(error_frames(&events), 15);
    assert_eq!(bus.error_counters(s[0]), (120, 0));
    assert_eq!(bus.last_error(s[0]), Some(nominal(BusError::Ack)));
    let events = run(&mut bus, START + 16 * attempt);
    assert_eq!(states(&events, s[0]), [ErrorState::Passive]);
    assert_eq!(bus.error_counters(s[0]), (128, 0));
    // An error-passive sender waits for 8 more bits.
    let from = START + 16 * attempt;
    let events = run(&mut bus, from + 1000 * (attempt + 8 * BIT) + 7 * BIT);
    assert_eq!(error_frames(&events), 1000);
    assert_eq!(states(&events, s[0]), []);
    assert_eq!(bus.error_counters(s[0]), (128, 0));
    assert!(bus.is_offering(s[0]));
}

#[test]
fn acknowledging_station_ends_retries() {
    let (mut bus, s) = bus_of(&[CLASSIC]);
    let frame = classic(0x123, &[]);
    bus.offer(START, s[0], frame);
    run(&mut bus, START + 10_000_000);
    assert_eq!(bus.error_state(s[0]), ErrorState::Passive);
    let second = bus.attach();
    bus.configure(START + 10_000_000, second, Some(CLASSIC));
    let events = run(&mut bus, START + 20_000_000);
    assert_eq!(sent(&events).len(), 1);
    assert_eq!(received(&events), [(second, frame)]);
    assert_eq!(bus.error_counters(s[0]), (127, 0));
    assert_eq!(states(&events, s[0]), [ErrorState::Warning]);
}

/// Bit errors: 8 points each, warning at 96, passive at 128, off at 256.
#[test]
fn disturbed_transmissions_cause_bus_off() {
    let (mut bus, s) = bus_of(&[CLASSIC; 2]);
    bus.inject(BusFault::ErrorFrames { station: s[0], count: 32 });
    bus.offer(START, s[0], classic(0x123, &[]));
    let events = run(&mut bus, START + 100_000_000);
    assert_eq!(error_frames(&events), 32);
    assert_eq!(
        states(&events, s[0]),
        [ErrorState::Warning, ErrorState::Passive, ErrorState::BusOff]
    );
    assert_eq!(bus.error_counters(s[0]), (256, 0));
    assert_eq!(bus.error_counters(s[1]), (0, 32), "the receiver saw them all");
    assert_eq!(bus.last_error(s[0]), Some(nominal(BusError::Bit1)));
    assert_eq!(bus.last_error(s[1]), Some(nominal(BusError::Stuff)));
    assert_eq!(bus.station_statistics(s[0]).bus_offs, 1);
    assert_eq!(bus.station_statistics(s[0]).transmit_errors, 32);
    assert_eq!(bus.next_event(), None, "nothing moves any more");
}

#[test]
fn few_disturbances_only_delay_frame() {
    let (mut bus, s) = bus_of(&[CLASSIC; 2]);
    bus.inject(BusFault::ErrorFrames { station: s[0], count: 3 });
    let frame = classic(0x123, &[]);
    bus.offer(START, s[0], frame);
    let events = run(&mut bus, START + 10_000_000);
    assert_eq!(error_frames(&events), 3);
    assert_eq!(received(&events), [(s[1], frame)]);
    // 3 * 8 - 1, and 3 - 1.
    assert_eq!(bus.error_counters(s[0]), (23, 0));
    assert_eq!(bus.error_counters(s[1]), (0, 2));
}

#[test]
fn recovery_on_idle_bus_takes_128_times_11_bits() {
    let (mut bus, s) = bus_of(&[CLASSIC; 2]);
    bus.offer(START, s[1], classic(0x123, &[]));
    bus.inject(BusFault::BusOff(s[1]));
    assert_eq!(bus.next_event(), Some(START));
    let events = run(&mut bus, START + 1_000);
    assert_eq!(
        events,
        [BusEvent::StateChanged { station: s[1], state: ErrorState::BusOff, at_ns: START }]
    );
    let asked = START + 5_000_000;
    run(&mut bus, asked);
    bus.recover(asked, s[1]);
    assert!(bus.is_recovering(s[1]));
    let back = asked + 128 * 11 * BIT;
    assert_eq!(bus.next_event(), Some(back));
    let events = run(&mut bus, back + 1_000_000);
    assert_eq!(
        events[0],
        BusEvent::StateChanged { station: s[1], state: ErrorState::Active, at_ns: back }
    );
    assert_eq!(bus.error_counters(s[1]), (0, 0));
    // The waiting frame is sent at once.
    assert_eq!(sent(&events)[0].2, back);
}

/// On a bus without pauses each frame ends with one sequence of 11 recessive bits (ACK delimiter,
/// EOF, intermission).
#[test]
fn recovery_on_busy_bus_takes_128_frames() {
    let (mut bus, s) = bus_of(&[CLASSIC; 3]);
    bus.inject(BusFault::BusOff(s[2]));
    run(&mut bus, START);
    let frame = classic(0x555, &[0x55; 8]);
    bus.offer(START, s[0], frame);
    bus.recover(START + 1, s[2]);
    let mut events = Vec::new();
    let mut frames = 0;
    while bus.is_recovering(s[2]) {
        events.clear();
        let now = bus.advance(u64::MAX, &mut events);
        if !sent(&events).is_empty() {
            frames += 1;
            bus.offer(now, s[0], frame);
        }
    }
    // The 128th sequence ends with the intermission, when the next frame starts.
    assert_eq!(frames, 128);
    assert_eq!(states(&events, s[2]), [ErrorState::Active]);
}

#[test]
fn bus_off_station_aborts_its_frame() {
    let (mut bus, s) = bus_of(&[CLASSIC; 2]);
    bus.offer(START, s[0], classic(0x123, &[0; 8]));
    run(&mut bus, START + 30 * BIT);
    bus.inject(BusFault::BusOff(s[0]));
    let events = run(&mut bus, START + 1_000_000);
    assert_eq!(states(&events, s[0]), [ErrorState::BusOff]);
    assert_eq!(error_frames(&events), 1);
    assert_eq!(received(&events), []);
    assert_eq!(bus.error_counters(s[1]), (0, 1));
}

/// The station with the wrong bit rate signals an error first and counts 1 + 8 for each frame:
/// error passive after 15 of them. From then on it does not disturb, and the sender has counted
/// 120.
#[test]
fn wrong_bit_rate_disturbs_until_error_passive() {
    let (mut bus, s) = bus_of(&[CLASSIC, CLASSIC, StationConfig::classic(250_000)]);
    let frame = classic(0x123, &[]);
    bus.offer(START, s[0], frame);
    let events = run(&mut bus, START + 100_000_000);
    assert_eq!(error_frames(&events), 15);
    assert_eq!(received(&events), [(s[1], frame)]);
    assert_eq!(states(&events, s[2]), [ErrorState::Warning, ErrorState::Passive]);
    assert_eq!(bus.error_counters(s[0]), (119, 0));
    assert_eq!(bus.error_counters(s[1]), (0, 14));
    assert_eq!(bus.error_counters(s[2]), (0, 136));
}

#[test]
fn wrong_data_bit_rate_matters_only_with_switching() {
    let slow = StationConfig::fd(500_000, 2_000_000);
    let id = CanId::standard(0x123).unwrap();
    let steady = CanFrame::fd(id, &[1; 16], false, false).unwrap();
    let switched = CanFrame::fd(id, &[1; 16], true, false).unwrap();
    for (frame, errors) in [(steady, 0), (switched, 15), (classic(0x123, &[]), 0)] {
        let (mut bus, s) = bus_of(&[FD, FD, slow]);
        bus.offer(START, s[0], frame);
        let events = run(&mut bus, START + 100_000_000);
        assert_eq!(error_frames(&events), errors);
        assert_eq!(sent(&events).len(), 1);
    }
}

#[test]
fn classic_station_destroys_fd_frames() {
    let (mut bus, s) = bus_of(&[FD, FD, CLASSIC]);
    let frame = CanFrame::fd(CanId::standard(1).unwrap(), &[], false, false).unwrap();
    bus.offer(START, s[0], frame);
    let events = run(&mut bus, START + 500_000);
    assert!(error_frames(&events) > 0);
    assert_eq!(received(&events), []);
    assert_eq!(bus.last_error(s[2]), Some(nominal(BusError::Form)));
}

#[test]
fn error_passive_sender_sets_esi() {
    let (mut bus, s) = bus_of(&[FD; 2]);
    bus.inject(BusFault::ErrorFrames { station: s[0], count: 16 });
    let id = CanId::standard(1).unwrap();
    bus.offer(START, s[0], CanFrame::fd(id, &[1], true, false).unwrap());
    let events = run(&mut bus, START + 10_000_000);
    let marked = CanFrame::fd(id, &[1], true, true).unwrap();
    assert_eq!(received(&events), [(s[1], marked)]);
}

#[test]
fn single_shot_frame_is_abandoned_after_failure() {
    let once = StationConfig { auto_retransmit: false, ..CLASSIC };
    let (mut bus, s) = bus_of(&[once]);
    let frame = classic(0x123, &[]);
    bus.offer(START, s[0], frame);
    let events = run(&mut bus, START + 10_000_000);
    assert_eq!(error_frames(&events), 1);
    assert!(matches!(events[1], BusEvent::Abandoned { station, frame: f, .. }
        if station == s[0] && f == frame));
    assert!(!bus.is_offering(s[0]));

    let (mut bus, s) = bus_of(&[once, CLASSIC]);
    bus.offer(START, s[0], frame);
    bus.offer(START, s[1], classic(0x122, &[]));
    let events = run(&mut bus, START + 10_000_000);
    assert_eq!(sent(&events).len(), 1);
    assert!(events.iter().any(|e| matches!(e, BusEvent::Abandoned { station, .. }
        if *station == s[0])));
    assert_eq!(bus.station_statistics(s[0]).arbitrations_lost, 1);
}

#[test]
fn frame_fails_when_last_acknowledging_station_leaves() {
    let (mut bus, s) = bus_of(&[CLASSIC; 2]);
    bus.offer(START, s[0], classic(1, &[]));
    bus.configure(START + 20 * BIT, s[1], None);
    let events = run(&mut bus, START + 60 * BIT);
    assert_eq!(error_frames(&events), 1);
    assert_eq!(received(&events), []);
    assert_eq!(bus.error_counters(s[0]), (8, 0));
}

#[test]
fn reconfigured_sender_aborts_its_frame() {
    let (mut bus, s) = bus_of(&[CLASSIC; 2]);
    bus.offer(START, s[0], classic(1, &[0; 8]));
    bus.configure(START + 30 * BIT, s[0], Some(FD));
    assert!(!bus.is_offering(s[0]));
    let events = run(&mut bus, START + 1_000_000);
    assert_eq!(events, [BusEvent::ErrorFrame { transmitter: s[0], at_ns: START + 50 * BIT }]);
    assert_eq!(bus.error_counters(s[1]), (0, 1));
}
