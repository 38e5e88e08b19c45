//! SM2 and SM3 as single buffers: what is accepted when, and what the master's working counter
//! would see.

mod gateway_support;

use ecan_protocol::device::AlState;
use gateway_support::{Fixture, MS, SERVICE, chunks, standard};

#[test]
fn write_is_refused_until_the_firmware_has_read() {
    let mut bench = Fixture::op(chunks(3), chunks(3));
    let image = vec![0; 384];
    assert!(bench.gateway.write_outputs(bench.now, &image));
    assert!(!bench.gateway.write_outputs(bench.now + SERVICE - 1, &image));
    assert!(bench.gateway.write_outputs(bench.now + SERVICE, &image));
    assert_eq!(bench.gateway.counters().images_written, 2);
    assert_eq!(bench.gateway.counters().writes_rejected, 1);
}

#[test]
fn read_succeeds_once_per_image_and_leaves_the_buffer_alone_when_empty() {
    let mut bench = Fixture::op(chunks(3), chunks(3));
    assert!(!bench.read(), "the first image was taken on entering OP");
    assert!(bench.write());
    bench.input.fill(0xEE);
    assert!(bench.read());
    let first = bench.input.clone();
    assert_ne!(first[0], 0xEE);
    bench.input.fill(0xEE);
    assert!(!bench.read());
    assert!(bench.input.iter().all(|&byte| byte == 0xEE));
}

#[test]
fn image_that_nobody_fetched_stays_and_nothing_is_lost() {
    let mut bench = Fixture::op(chunks(3), chunks(3));
    assert!(bench.write());
    bench.deliver(0, standard(0x10, &[1]));
    assert!(bench.write());
    assert!(bench.read());
    assert_eq!(bench.received(), [], "still the image from before the frame");
    bench.cycle();
    assert_eq!(bench.received(), [(0, standard(0x10, &[1]))]);
}

#[test]
fn length_must_be_exact() {
    let mut bench = Fixture::op(chunks(3), chunks(3));
    for length in [0, 1, 383, 385, 512] {
        assert!(!bench.gateway.write_outputs(bench.now, &vec![0; length]));
        assert!(!bench.gateway.read_inputs(bench.now, &mut vec![0; length]));
    }
}

#[test]
fn nothing_is_exchanged_below_safeop() {
    let mut bench = Fixture::configured(chunks(3), chunks(3));
    assert!(!bench.write());
    assert!(!bench.read());
    bench.gateway.request_al_state(bench.now, AlState::SafeOp);
    assert!(bench.read(), "the first image is there at once");
    bench.gateway.request_al_state(bench.now, AlState::PreOp);
    assert!(!bench.write());
    assert!(!bench.read());
}

#[test]
fn safeop_frees_sm2_without_reading_it_and_refreshes_sm3() {
    let mut bench = Fixture::configured(chunks(3), chunks(3));
    bench.gateway.request_al_state(bench.now, AlState::SafeOp);
    assert!(bench.read());
    bench.push(0, standard(0x10, &[]));
    for _ in 0..5 {
        assert!(bench.write());
        assert!(bench.read());
    }
    assert_eq!(bench.sent(0), []);
    assert!(!bench.read());
    bench.pass(MS);
    assert!(bench.read(), "also without any write");
    assert_eq!(bench.upload(0x8011, 15), 0);
}

#[test]
fn frames_from_before_safeop_are_not_shown() {
    let mut bench = Fixture::configured(chunks(3), chunks(3));
    bench.deliver(0, standard(0x10, &[]));
    bench.start();
    bench.cycle();
    assert_eq!(bench.received(), []);
    assert_eq!(bench.gateway.counters().receive_losses.flushed, 1);
}

#[test]
fn sequence_runs_without_gaps_over_the_wrap() {
    let mut bench = Fixture::op(chunks(1), chunks(1));
    let mut last = bench.input().sequence();
    for _ in 0..0x1_0003 {
        bench.cycle();
        let image = bench.input();
        let wrapped = image.header().flags.contains(ecan_protocol::image::HeaderFlags::SEQ_WRAP);
        assert_eq!(image.sequence(), last.wrapping_add(1));
        assert_eq!(wrapped, image.sequence() == 0);
        last = image.sequence();
    }
}

#[test]
fn stalled_service_leaves_sm2_full() {
    let mut bench = Fixture::op(chunks(3), chunks(3));
    bench.gateway.inject(bench.now, ecan_sim::GatewayFault::ServiceStall { ms: 5 });
    assert!(bench.write());
    assert!(!bench.write_again());
    bench.pass(5 * MS);
    assert!(bench.write_again());
}

#[test]
fn torn_and_corrupted_images_are_what_a_reader_refuses() {
    let mut bench = Fixture::op(chunks(3), chunks(3));
    bench.gateway.inject(bench.now, ecan_sim::GatewayFault::TornTxPdo { images: 1 });
    assert!(bench.write() && bench.read());
    let torn = bench.reader.read(&bench.input).unwrap_err();
    assert_eq!(torn.fault, ecan_protocol::image::ImageFault::Updating);
    bench.gateway.inject(bench.now, ecan_sim::GatewayFault::CrcErrorTxPdo { images: 1 });
    assert!(bench.write() && bench.read());
    let corrupted = bench.reader.read(&bench.input).unwrap_err();
    assert_eq!(corrupted.pdo_error(), Some(ecan_protocol::image::PdoError::BadCrc));
    bench.cycle();
    assert_eq!(bench.received(), []);
}
