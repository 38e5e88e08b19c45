//! Every status of 0x8010:2 and 0x8011:2 (manual 13.2), and the profile that stays active.

use super::fixture::{Fixture, chunks};
use ecan_protocol::config::assignment_writes;
use ecan_protocol::device::AlState;
use ecan_protocol::image::PdoProfile;
use ecan_protocol::mapping::Direction;

const MULTIPLIER: u8 = 3;
const MASK: u8 = 4;
const PROFILE: u8 = 5;
const BUDGET: u8 = 6;
const OPTIONS: u8 = 7;

fn apply(fixture: &mut Fixture, object: u16, field: u8, value: u8) -> u32 {
    fixture.write_u8(object, field, value);
    fixture.write_u8(object, 1, 1);
    fixture.upload(object, 2)
}

#[test]
fn rejected_field_has_its_status_and_keeps_the_profile() {
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
            let mut fixture = Fixture::configured(chunks(8), chunks(8));
            let crc = fixture.upload(object, 11);
            assert_eq!(
                apply(&mut fixture, object, field, value),
                status,
                "field {field} = {value}"
            );
            assert_eq!(fixture.upload(object, 14), last_error);
            assert_eq!(fixture.upload(object, 15), 0, "no packet was wrong");
            fixture.has(&[(object, 9, 1024), (object, 11, crc), (object, 12, 0x1E7)]);
        }
    }
}

#[test]
fn written_but_not_applied_is_pending() {
    let mut fixture = Fixture::configured(chunks(8), chunks(8));
    fixture.write_u8(0x8010, MASK, 0x01);
    assert_eq!(fixture.upload(0x8010, 2), 9);
    fixture.write_u8(0x8010, MASK, 0x0F);
    assert_eq!(fixture.upload(0x8010, 2), 0, "written back");
    assert_eq!(apply(&mut fixture, 0x8010, MASK, 0x03), 0);
    assert_eq!(fixture.upload(0x8010, 12), 7 | 0x03 << 5);
}

#[test]
fn layout_cannot_change_in_op() {
    let mut fixture = Fixture::op(chunks(8), chunks(8));
    for (field, value) in [(MULTIPLIER, 4), (MASK, 1), (PROFILE, 1), (BUDGET, 1), (OPTIONS, 2)] {
        let before = fixture.upload(0x8011, field) as u8;
        assert_eq!(apply(&mut fixture, 0x8011, field, value), 1);
        assert_eq!(fixture.upload(0x8011, 12), 0x1E7);
        fixture.write_u8(0x8011, field, before);
    }
    fixture.write_u8(0x8011, 1, 1);
    assert_eq!(fixture.upload(0x8011, 2), 0, "what is active already changes no layout");
    fixture.request(AlState::SafeOp);
    assert_eq!(apply(&mut fixture, 0x8011, OPTIONS, 2), 0);
    assert_eq!(fixture.upload(0x8011, 12), 0x0040_01E7);
}

#[test]
fn assignment_must_be_the_first_chunks_in_order() {
    let mut fixture = Fixture::preop();
    fixture.write_u8(0x1C12, 0, 0);
    for (subindex, map) in [(1u8, 0x1601u16), (2, 0x1600)] {
        fixture.download(0x1C12, subindex, &map.to_le_bytes()).unwrap();
    }
    fixture.write_u8(0x1C12, 0, 2);
    assert_eq!(apply(&mut fixture, 0x8011, MULTIPLIER, 2), 5);
    fixture.send(assignment_writes(Direction::RxPdo, 2));
    assert_eq!(apply(&mut fixture, 0x8011, MULTIPLIER, 2), 0);
}

#[test]
fn assignment_changed_under_an_active_profile_needs_a_reload() {
    let mut fixture = Fixture::configured(chunks(8), chunks(8));
    fixture.send(assignment_writes(Direction::TxPdo, 3));
    fixture.send([PdoProfile::apply_write(Direction::TxPdo)]);
    fixture.has(&[(0x8010, 2, 5), (0x8010, 9, 1024)]);
}

#[test]
fn layout_crc_is_stable_and_distinguishes_layouts() {
    let mut seen = Vec::new();
    for multiplier in [1, 3, 8] {
        let mut fixture = Fixture::configured(chunks(multiplier), chunks(multiplier));
        seen.push(fixture.upload(0x8010, 11));
        seen.push(fixture.upload(0x8011, 11));
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
    let mut fixture = Fixture::op(chunks(8), chunks(8));
    assert!(fixture.write_again(), "all zero");
    fixture.has(&[(0x8011, 2, 7), (0x8011, 14, 14), (0x8011, 15, 1)]);
    fixture.write_u8(0x8011, 8, 0x02);
    for cleared in [2, 14, 15, 16] {
        assert_eq!(fixture.upload(0x8011, cleared), 0);
    }
}

#[test]
fn reset_session_clears_all_but_the_counters() {
    let mut fixture = Fixture::op(chunks(8), chunks(8));
    assert!(fixture.write_again());
    fixture.cycle();
    fixture.has(&[(0x8011, 13, 1), (0x8010, 13, 2)]);
    fixture.write_u8(0x8011, 8, 0x01);
    fixture.write_u8(0x8010, 8, 0x01);
    fixture.has(&[(0x8011, 13, 0), (0x8011, 14, 0), (0x8011, 15, 1)]);
    fixture.cycle();
    assert_eq!(fixture.input().sequence(), 1);
}
