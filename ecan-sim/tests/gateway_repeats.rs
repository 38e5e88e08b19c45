//! Repeated images are no-ops: no frame, no TX_RESULT, no error (manual 13.2, 13.8).

mod gateway_support;

use ecan_protocol::image::{OptionFlags, PdoProfile};
use gateway_support::{Fixture, chunks, standard};

fn with_results() -> PdoProfile {
    PdoProfile { options: OptionFlags::TX_RESULT, ..chunks(8) }
}

#[test]
fn exact_repeat_sends_nothing_and_reports_nothing() {
    let mut bench = Fixture::op(with_results(), chunks(8));
    bench.push(0, standard(0x10, &[1]));
    bench.cycle();
    assert_eq!(bench.sent(0).len(), 1);
    assert_eq!(bench.results().len(), 1);
    for _ in 0..3 {
        assert!(bench.write_again());
        assert!(bench.read());
        assert_eq!(bench.results(), []);
        assert_eq!(bench.sent(0), []);
    }
    assert_eq!(bench.upload(0x8011, 14), 0);
    assert_eq!(bench.upload(0x8011, 15), 0);
    assert_eq!(bench.gateway.counters().images_repeated, 3);
}

#[test]
fn next_sequence_executes_the_same_frames_again() {
    let mut bench = Fixture::op(with_results(), chunks(8));
    for sequence in 1..4 {
        bench.push(0, standard(0x10, &[1]));
        bench.cycle();
        assert_eq!(bench.sent(0).len(), 1);
        assert_eq!(bench.results()[0].sequence, sequence);
    }
}

#[test]
fn sequence_0_is_a_number_like_any_other() {
    let mut bench = Fixture::op(chunks(8), chunks(8));
    bench.writer.set_next_sequence(0);
    bench.push(0, standard(0x10, &[]));
    bench.cycle();
    assert_eq!(bench.sent(0).len(), 1);
    assert!(bench.write_again());
    assert_eq!(bench.sent(0), []);
}

#[test]
fn reset_session_makes_the_old_image_new_again() {
    let mut bench = Fixture::op(chunks(8), chunks(8));
    bench.push(0, standard(0x10, &[]));
    bench.cycle();
    assert_eq!(bench.sent(0).len(), 1);
    bench.write_u8(0x8011, 8, 1);
    assert!(bench.write_again());
    assert_eq!(bench.sent(0).len(), 1);
}

#[test]
fn power_cycle_makes_the_old_image_new_again() {
    let mut bench = Fixture::op(chunks(8), chunks(8));
    bench.push(0, standard(0x10, &[]));
    bench.cycle();
    assert_eq!(bench.sent(0).len(), 1);
    let old = bench.image.clone();
    bench.gateway.power(bench.now, false);
    bench.gateway.power(bench.now, true);
    bench.pass(1_000 * gateway_support::MS);
    bench.set_up_mailboxes();
    bench.gateway.request_al_state(bench.now, ecan_protocol::device::AlState::PreOp);
    bench.apply_profiles(chunks(8), chunks(8));
    bench.apply_channel(0, ecan_protocol::config::McanChannelConfig::default());
    bench.start();
    bench.image = old;
    assert!(bench.write_again());
    assert_eq!(bench.sent(0).len(), 1, "which is why a host resets the session first");
}

#[test]
fn image_with_a_bad_packet_behind_good_ones_is_executed_once() {
    let mut bench = Fixture::op(chunks(8), chunks(8));
    bench.push(0, standard(0x10, &[]));
    bench.push(0, standard(0x11, &[]));
    bench.writer.commit(&mut bench.image, Default::default());
    // the second packet's kind becomes 3
    bench.image[29] |= 0x60;
    let crc = ecan_protocol::image::crc16(&bench.image[24..32]);
    bench.image[8..10].copy_from_slice(&crc.to_le_bytes());
    for _ in 0..3 {
        bench.write_again();
    }
    assert_eq!(Fixture::identifiers(&bench.sent(0)), [0x10]);
    assert_eq!(bench.upload(0x8011, 14), 4);
}
