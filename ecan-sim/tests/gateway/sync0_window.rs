//! Outputs that arrive around a Sync0 pulse are missed (manual 15.6.1, 16.1).

use super::fixture::{Fixture, MS, SERVICE, chunks, standard};
use ecan_protocol::device::{AlState, AlStatusCode};
use ecan_sim::{GatewayModelConfig, Sync0Window};

/// In OP with pulses at every whole millisecond; returns the time of one of them.
fn synchronous(window: Sync0Window) -> (Fixture, u64) {
    let config = GatewayModelConfig { sync0_window: window, ..GatewayModelConfig::default() };
    let mut fixture = Fixture::configured_with(config, chunks(3), chunks(3));
    let start = fixture.start_with_sync0(0);
    (fixture, start + 4 * MS)
}

/// Cycles from `first` on, each with a frame while the previous one was accepted; returns which
/// writes were accepted. Every input image must be there.
fn cycles(fixture: &mut Fixture, first: u64, count: usize) -> Vec<bool> {
    let mut was_written = true;
    (0..count as u64)
        .map(|cycle| {
            fixture.now = first + cycle * MS;
            if was_written {
                fixture.push(0, standard(cycle as u16 + 1, &[]));
                was_written = fixture.write();
            } else {
                was_written = fixture.write_again();
            }
            assert!(fixture.read(), "SM3 is empty in cycle {cycle}");
            was_written
        })
        .collect()
}

#[test]
fn outputs_outside_the_window_are_taken() {
    for distance in [20_000, 500_000, MS - 50_001] {
        let (mut fixture, pulse) = synchronous(Sync0Window::default());
        assert_eq!(cycles(&mut fixture, pulse + distance, 30), [true; 30], "{distance}");
        assert_eq!(fixture.sent(0).len(), 30);
        assert_eq!(fixture.gateway.counters().outputs_missed, 0);
        assert_eq!(fixture.state(), (AlState::Op, 0));
    }
}

#[test]
fn every_second_write_is_rejected_within_the_window() {
    let window = Sync0Window { missed_limit: 0, ..Sync0Window::default() };
    for distance in [0, 19_999, MS - 50_000, MS - 1] {
        let (mut fixture, pulse) = synchronous(window);
        let accepted = cycles(&mut fixture, pulse + distance, 20);
        assert_eq!(accepted, [true, false].repeat(10), "{distance}");
        let counters = *fixture.gateway.counters();
        assert_eq!((counters.outputs_missed, counters.writes_rejected), (10, 10));
        let ids = Fixture::identifiers(&fixture.sent(0));
        assert_eq!(ids, [1, 2, 4, 6, 8, 10, 12, 14, 16, 18], "each frame once");
        assert_eq!(fixture.state(), (AlState::Op, 0));
    }
}

#[test]
fn missed_image_is_read_after_the_rejected_write() {
    let (mut fixture, pulse) = synchronous(Sync0Window::default());
    fixture.now = pulse;
    fixture.push(0, standard(1, &[]));
    assert!(fixture.write());
    fixture.pass(MS - SERVICE);
    assert_eq!(fixture.sent(0), []);
    assert!(!fixture.write_again());
    assert_eq!(Fixture::identifiers(&fixture.sent(0)), [1]);
    fixture.pass(MS);
    assert!(fixture.write_again(), "SM2 is empty again");
}

#[test]
fn row_of_missed_outputs_ends_op_with_the_configured_code() {
    for code in [AlStatusCode::SYNC_ERROR, AlStatusCode::FATAL_SYNC] {
        let window = Sync0Window { missed_limit: 6, al_status: code, ..Sync0Window::default() };
        let (mut fixture, pulse) = synchronous(window);
        cycles(&mut fixture, pulse, 5);
        assert_eq!(fixture.state(), (AlState::Op, 0));
        // An image in time ends the row.
        fixture.now = pulse + 5 * MS + 300_000;
        assert!(!fixture.write_again(), "holds the missed image");
        fixture.now += MS;
        assert!(fixture.write_again());
        cycles(&mut fixture, pulse + 10 * MS, 5);
        assert_eq!(fixture.state(), (AlState::Op, 0));
        fixture.now = pulse + 15 * MS;
        fixture.write();
        assert_eq!(fixture.state(), (AlState::SafeOp, code.0));
        assert_eq!(fixture.gateway.counters().al_errors, 1);
    }
}

#[test]
fn window_that_is_off_misses_nothing() {
    let (mut fixture, pulse) = synchronous(Sync0Window::OFF);
    assert_eq!(cycles(&mut fixture, pulse, 30), [true; 30]);
    assert_eq!(fixture.sent(0).len(), 30);
}
