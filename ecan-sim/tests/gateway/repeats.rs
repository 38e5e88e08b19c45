//! Repeated images are no-ops: no frame, no TX_RESULT, no error (manual 13.2, 13.8).

use super::fixture::{Fixture, chunks, standard};
use ecan_protocol::image::{OptionFlags, PdoProfile};

fn with_results() -> PdoProfile {
    PdoProfile { options: OptionFlags::TX_RESULT, ..chunks(8) }
}

#[test]
fn exact_repeat_is_a_no_op() {
    let mut fixture = Fixture::op(with_results(), chunks(8));
    fixture.push(0, standard(0x10, &[1]));
    fixture.cycle();
    assert_eq!(fixture.sent(0).len(), 1);
    assert_eq!(fixture.results().len(), 1);
    for _ in 0..3 {
        assert!(fixture.write_again());
        assert!(fixture.read());
        assert_eq!(fixture.results(), []);
        assert_eq!(fixture.sent(0), []);
    }
    fixture.has(&[(0x8011, 14, 0), (0x8011, 15, 0)]);
    assert_eq!(fixture.gateway.counters().images_repeated, 3);
}

#[test]
fn rejected_image_is_counted_once_until_another_one_arrives() {
    let mut fixture = Fixture::op(chunks(8), chunks(8));
    for counted in 1..=2 {
        fixture.image.fill(0);
        for _ in 0..3 {
            assert!(fixture.write_again());
            fixture.has(&[(0x8011, 14, 14), (0x8011, 15, counted)]);
        }
        fixture.push(0, standard(0x10, &[1]));
        fixture.cycle();
        assert_eq!(fixture.sent(0).len(), 1);
    }
    assert_eq!(fixture.gateway.counters().images_repeated, 4);
}

#[test]
fn next_sequence_executes_the_same_frames_again() {
    let mut fixture = Fixture::op(with_results(), chunks(8));
    for sequence in 1..4 {
        fixture.push(0, standard(0x10, &[1]));
        fixture.cycle();
        assert_eq!(fixture.sent(0).len(), 1);
        assert_eq!(fixture.results()[0].sequence, sequence);
    }
}

#[test]
fn sequence_0_is_a_number_like_any_other() {
    let mut fixture = Fixture::op(chunks(8), chunks(8));
    fixture.writer.set_next_sequence(0);
    fixture.push(0, standard(0x10, &[]));
    fixture.cycle();
    assert_eq!(fixture.sent(0).len(), 1);
    assert!(fixture.write_again());
    assert_eq!(fixture.sent(0), []);
}

#[test]
fn reset_session_makes_the_old_image_new_again() {
    let mut fixture = Fixture::op(chunks(8), chunks(8));
    fixture.push(0, standard(0x10, &[]));
    fixture.cycle();
    assert_eq!(fixture.sent(0).len(), 1);
    fixture.write_u8(0x8011, 8, 1);
    assert!(fixture.write_again());
    assert_eq!(fixture.sent(0).len(), 1);
}

#[test]
fn power_cycle_makes_the_old_image_new_again() {
    let mut fixture = Fixture::op(chunks(8), chunks(8));
    fixture.push(0, standard(0x10, &[]));
    fixture.cycle();
    assert_eq!(fixture.sent(0).len(), 1);
    let old = fixture.image.clone();
    fixture.power_cycle();
    fixture.apply_profiles(chunks(8), chunks(8));
    fixture.apply_channel(0, ecan_protocol::config::McanChannelConfig::default());
    fixture.start();
    fixture.image = old;
    assert!(fixture.write_again());
    assert_eq!(fixture.sent(0).len(), 1, "which is why a host resets the session first");
}

#[test]
fn packets_before_a_bad_packet_are_sent_once() {
    let mut fixture = Fixture::op(chunks(8), chunks(8));
    fixture.push(0, standard(0x10, &[]));
    fixture.push(0, standard(0x11, &[]));
    fixture.writer.commit(&mut fixture.image, Default::default());
    // the second packet's kind becomes 3
    fixture.image[29] |= 0x60;
    let crc = ecan_protocol::image::crc16(&fixture.image[24..32]);
    fixture.image[8..10].copy_from_slice(&crc.to_le_bytes());
    for _ in 0..3 {
        fixture.write_again();
    }
    assert_eq!(Fixture::identifiers(&fixture.sent(0)), [0x10]);
    assert_eq!(fixture.upload(0x8011, 14), 4);
}
