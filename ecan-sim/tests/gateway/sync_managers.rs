//! SM2 and SM3 as single buffers: accepted accesses and working counters.

use super::fixture::{Fixture, MS, SERVICE, chunks, standard};
use ecan_protocol::device::AlState;
use ecan_sim::GatewayModelConfig;

#[test]
fn write_is_rejected_until_the_firmware_has_read() {
    let mut fixture = Fixture::op(chunks(3), chunks(3));
    let image = vec![0; 384];
    assert!(fixture.gateway.write_outputs(fixture.now, &image));
    assert!(!fixture.gateway.write_outputs(fixture.now + SERVICE - 1, &image));
    assert!(fixture.gateway.write_outputs(fixture.now + SERVICE, &image));
    assert_eq!(fixture.gateway.counters().images_written, 2);
    assert_eq!(fixture.gateway.counters().writes_rejected, 1);
}

#[test]
fn each_image_is_read_once() {
    let mut fixture = Fixture::op(chunks(3), chunks(3));
    assert!(!fixture.read(), "the first image was taken on entering OP");
    assert!(fixture.write());
    fixture.input.fill(0xEE);
    assert!(fixture.read());
    let first = fixture.input.clone();
    assert_ne!(first[0], 0xEE);
    fixture.input.fill(0xEE);
    assert!(!fixture.read());
    assert!(fixture.input.iter().all(|&byte| byte == 0xEE));
}

/// Reads that find no image, in cycles of 1 ms with a varying distance from the write to the read.
fn rejected_reads(publishes_after_read: bool) -> u64 {
    let config = GatewayModelConfig { publishes_after_read, ..GatewayModelConfig::default() };
    let mut fixture = Fixture::configured_with(config, chunks(8), chunks(8));
    fixture.start();
    let mut cycle = |distance| {
        assert!(fixture.gateway.write_outputs(fixture.now, &[0; 1024]));
        fixture.pass(distance);
        let is_empty = !fixture.gateway.read_inputs(fixture.now, &mut [0; 1024]);
        fixture.pass(MS - distance);
        u64::from(is_empty)
    };
    cycle(0);
    [2 * SERVICE, 0, 2 * SERVICE, 2 * SERVICE, 0, 0].map(cycle).iter().sum()
}

#[test]
fn read_after_the_service_leaves_an_image_for_the_next_cycle() {
    assert_eq!(rejected_reads(true), 0);
    assert_eq!(rejected_reads(false), 2, "after each change from late to early");
}

#[test]
fn unread_image_stays_without_loss() {
    let mut fixture = Fixture::op(chunks(3), chunks(3));
    assert!(fixture.write());
    fixture.deliver(0, standard(0x10, &[1]));
    assert!(fixture.write());
    assert!(fixture.read());
    assert_eq!(fixture.received(), [], "still the image from before the frame");
    fixture.cycle();
    assert_eq!(fixture.received(), [(0, standard(0x10, &[1]))]);
}

#[test]
fn length_must_be_exact() {
    let mut fixture = Fixture::op(chunks(3), chunks(3));
    for length in [0, 1, 383, 385, 512] {
        assert!(!fixture.gateway.write_outputs(fixture.now, &vec![0; length]));
        assert!(!fixture.gateway.read_inputs(fixture.now, &mut vec![0; length]));
    }
}

#[test]
fn nothing_is_exchanged_below_safeop() {
    let mut fixture = Fixture::configured(chunks(3), chunks(3));
    assert!(!fixture.write());
    assert!(!fixture.read());
    fixture.request(AlState::SafeOp);
    assert!(fixture.read(), "the first image is there at once");
    fixture.request(AlState::PreOp);
    assert!(!fixture.write());
    assert!(!fixture.read());
}

#[test]
fn safeop_empties_sm2_unread_and_refreshes_sm3() {
    let mut fixture = Fixture::configured(chunks(3), chunks(3));
    fixture.request(AlState::SafeOp);
    assert!(fixture.read());
    fixture.push(0, standard(0x10, &[]));
    for _ in 0..5 {
        assert!(fixture.write());
        assert!(fixture.read());
    }
    assert_eq!(fixture.sent(0), []);
    assert!(!fixture.read());
    fixture.pass(MS);
    assert!(fixture.read(), "also without any write");
    assert_eq!(fixture.upload(0x8011, 15), 0);
}

#[test]
fn frames_received_before_safeop_are_dropped() {
    let mut fixture = Fixture::configured(chunks(3), chunks(3));
    fixture.deliver(0, standard(0x10, &[]));
    fixture.start();
    fixture.cycle();
    assert_eq!(fixture.received(), []);
    assert_eq!(fixture.gateway.counters().receive_losses.flushed, 1);
}

#[test]
fn sequence_runs_without_gaps_over_the_wrap() {
    let mut fixture = Fixture::op(chunks(1), chunks(1));
    let mut last = fixture.input().sequence();
    for _ in 0..0x1_0003 {
        fixture.cycle();
        let image = fixture.input();
        let wrapped = image.header().flags.contains(ecan_protocol::image::HeaderFlags::SEQ_WRAP);
        assert_eq!(image.sequence(), last.wrapping_add(1));
        assert_eq!(wrapped, image.sequence() == 0);
        last = image.sequence();
    }
}

#[test]
fn stalled_service_leaves_sm2_full() {
    let mut fixture = Fixture::op(chunks(3), chunks(3));
    fixture.gateway.inject(fixture.now, ecan_sim::GatewayFault::ServiceStall { ms: 5 });
    assert!(fixture.write());
    assert!(!fixture.write_again());
    fixture.pass(5 * MS);
    assert!(fixture.write_again());
}

#[test]
fn torn_and_corrupted_images_are_rejected_by_a_reader() {
    let mut fixture = Fixture::op(chunks(3), chunks(3));
    fixture.gateway.inject(fixture.now, ecan_sim::GatewayFault::TornTxPdo { images: 1 });
    assert!(fixture.write() && fixture.read());
    let torn = fixture.reader.read(&fixture.input).unwrap_err();
    assert_eq!(torn.fault, ecan_protocol::image::ImageFault::Updating);
    fixture.gateway.inject(fixture.now, ecan_sim::GatewayFault::CrcErrorTxPdo { images: 1 });
    assert!(fixture.write() && fixture.read());
    let corrupted = fixture.reader.read(&fixture.input).unwrap_err();
    assert_eq!(corrupted.pdo_error(), Some(ecan_protocol::image::PdoError::BadCrc));
    fixture.cycle();
    assert_eq!(fixture.received(), []);
}
