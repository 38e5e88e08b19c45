//! Every status of 0x8010:2 and 0x8011:2 (manual 13.2), and what stays active meanwhile.

mod gateway_support;

use ecan_protocol::config::assignment_writes;
use ecan_protocol::device::AlState;
use ecan_protocol::image::PdoProfile;
use ecan_protocol::mapping::Direction;
use gateway_support::{Fixture, chunks};

const MULTIPLIER: u8 = 3;
const MASK: u8 = 4;
const PROFILE: u8 = 5;
const BUDGET: u8 = 6;
const OPTIONS: u8 = 7;

fn apply(bench: &mut Fixture, object: u16, field: u8, value: u8) -> u32 {
    bench.write_u8(object, field, value);
    bench.write_u8(object, 1, 1);
    bench.upload(object, 2)
}

#[test]
fn nothing_is_active_before_the_first_apply() {
    let mut bench = Fixture::preop();
    for object in [0x8010, 0x8011] {
        for active in [2, 9, 10, 11, 12] {
            assert_eq!(bench.upload(object, active), 0);
        }
    }
}

#[test]
fn every_refused_field_has_its_status_and_leaves_the_old_profile() {
    for object in [0x8010, 0x8011] {
        for (field, value, status, last_error) in [
            (MULTIPLIER, 0, 2, 0),
            (MULTIPLIER, 25, 2, 0),
            (MASK, 0, 3, 0),
            (MASK, 0x1F, 3, 0),
            (PROFILE, 2, 4, 9),
            (PROFILE, 6, 4, 9),
            (MULTIPLIER, 9, 5, 12),
            (BUDGET, 3, 10, 11),
            (OPTIONS, 0x20, 10, 11),
            (OPTIONS, 0x80, 10, 11),
        ] {
            let mut bench = Fixture::configured(chunks(8), chunks(8));
            let crc = bench.upload(object, 11);
            assert_eq!(apply(&mut bench, object, field, value), status, "field {field} = {value}");
            assert_eq!(bench.upload(object, 14), last_error);
            assert_eq!(bench.upload(object, 15), 0, "no packet was wrong");
            assert_eq!(bench.upload(object, 9), 1024);
            assert_eq!(bench.upload(object, 11), crc);
            assert_eq!(bench.upload(object, 12), 0x1E7);
        }
    }
}

#[test]
fn written_but_not_applied_is_pending() {
    let mut bench = Fixture::configured(chunks(8), chunks(8));
    bench.write_u8(0x8010, MASK, 0x01);
    assert_eq!(bench.upload(0x8010, 2), 9);
    bench.write_u8(0x8010, MASK, 0x0F);
    assert_eq!(bench.upload(0x8010, 2), 0, "written back");
    assert_eq!(apply(&mut bench, 0x8010, MASK, 0x03), 0);
    assert_eq!(bench.upload(0x8010, 12), 7 | 0x03 << 5);
}

#[test]
fn layout_cannot_change_in_op() {
    let mut bench = Fixture::op(chunks(8), chunks(8));
    for (field, value) in [(MULTIPLIER, 4), (MASK, 1), (PROFILE, 1), (BUDGET, 1), (OPTIONS, 2)] {
        let before = bench.upload(0x8011, field) as u8;
        assert_eq!(apply(&mut bench, 0x8011, field, value), 1);
        assert_eq!(bench.upload(0x8011, 12), 0x1E7);
        bench.write_u8(0x8011, field, before);
    }
    bench.write_u8(0x8011, 1, 1);
    assert_eq!(bench.upload(0x8011, 2), 0, "what is active already changes no layout");
    bench.gateway.request_al_state(bench.now, AlState::SafeOp);
    assert_eq!(apply(&mut bench, 0x8011, OPTIONS, 2), 0);
    assert_eq!(bench.upload(0x8011, 12), 0x0040_01E7);
}

#[test]
fn assignment_must_be_the_first_chunks_in_order() {
    let mut bench = Fixture::preop();
    bench.write_u8(0x1C12, 0, 0);
    for (subindex, map) in [(1u8, 0x1601u16), (2, 0x1600)] {
        bench.download(0x1C12, subindex, &map.to_le_bytes()).unwrap();
    }
    bench.write_u8(0x1C12, 0, 2);
    assert_eq!(apply(&mut bench, 0x8011, MULTIPLIER, 2), 5);
    for write in assignment_writes(Direction::RxPdo, 2) {
        bench.send(write);
    }
    assert_eq!(apply(&mut bench, 0x8011, MULTIPLIER, 2), 0);
}

#[test]
fn assignment_changed_under_an_active_profile_needs_a_reload() {
    let mut bench = Fixture::configured(chunks(8), chunks(8));
    for write in assignment_writes(Direction::TxPdo, 3) {
        bench.send(write);
    }
    bench.send(PdoProfile::apply_write(Direction::TxPdo));
    assert_eq!(bench.upload(0x8010, 2), 5);
    assert_eq!(bench.upload(0x8010, 9), 1024);
}

#[test]
fn layout_crc_tells_layouts_apart_and_repeats() {
    let mut seen = Vec::new();
    for multiplier in [1, 3, 8] {
        let mut bench = Fixture::configured(chunks(multiplier), chunks(multiplier));
        seen.push(bench.upload(0x8010, 11));
        seen.push(bench.upload(0x8011, 11));
        let mut again = Fixture::configured(chunks(multiplier), chunks(multiplier));
        assert_eq!(again.upload(0x8010, 11), seen[seen.len() - 2]);
    }
    let all = seen.len();
    seen.sort_unstable();
    seen.dedup();
    assert_eq!(seen.len(), all);
    assert!(!seen.contains(&0));
}

#[test]
fn parser_faults_and_overflow_show_until_cleared() {
    let mut bench = Fixture::op(chunks(8), chunks(8));
    assert!(bench.write_again(), "all zero");
    assert_eq!(bench.upload(0x8011, 2), 7);
    assert_eq!(bench.upload(0x8011, 14), 14);
    assert_eq!(bench.upload(0x8011, 15), 1);
    bench.write_u8(0x8011, 8, 0x02);
    for cleared in [2, 14, 15, 16] {
        assert_eq!(bench.upload(0x8011, cleared), 0);
    }
}

#[test]
fn reset_session_forgets_sequence_and_last_error_but_not_the_counters() {
    let mut bench = Fixture::op(chunks(8), chunks(8));
    assert!(bench.write_again());
    bench.cycle();
    assert_eq!(bench.upload(0x8011, 13), 1);
    assert_eq!(bench.upload(0x8010, 13), 2);
    bench.write_u8(0x8011, 8, 0x01);
    bench.write_u8(0x8010, 8, 0x01);
    assert_eq!(bench.upload(0x8011, 13), 0);
    assert_eq!(bench.upload(0x8011, 14), 0);
    assert_eq!(bench.upload(0x8011, 15), 1);
    bench.cycle();
    assert_eq!(bench.input().sequence(), 1);
}
