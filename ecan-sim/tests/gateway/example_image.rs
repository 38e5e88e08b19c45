//! The manual's example (5.4.4.1): these bytes in SM2 put this frame on channel 0.

use super::fixture::{Fixture, chunks, standard};

const EXAMPLE: [u8; 36] = [
    0x16, 0x00, 0x01, 0x00, 0x01, 0x00, 0x0C, 0x00, 0xD3, 0x56, 0xE7, 0x01, 0x0F, 0x01, 0x00, 0x01,
    0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x40, 0x00, 0x23, 0x01, 0x11, 0x22, 0x33, 0x44,
    0x55, 0x66, 0x77, 0x88,
];

#[test]
fn example_image_sends_its_frame_on_channel_0() {
    let mut fixture = Fixture::op(chunks(8), chunks(8));
    fixture.image[..EXAMPLE.len()].copy_from_slice(&EXAMPLE);
    assert!(fixture.write_again());
    let frame = standard(0x123, &[0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88]);
    assert_eq!(fixture.sent(0), [frame]);
    for channel in 1..4 {
        assert_eq!(fixture.sent(channel), []);
    }
    fixture.has(&[(0x8011, 2, 0), (0x8011, 13, 1), (0x8011, 14, 0)]);
}

#[test]
fn received_frame_has_the_same_bytes_in_the_input_image() {
    let mut fixture = Fixture::op(chunks(8), chunks(8));
    fixture.deliver(0, standard(0x123, &[0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88]));
    fixture.cycle();
    // The image on entering SAFEOP was number 1.
    assert_eq!(fixture.input[2..6], [2, 0, 2, 0]);
    assert_eq!(fixture.input[..2], [0x16, 0x08], "channel status changed: a frame was pending");
    assert_eq!(fixture.input[6..16], EXAMPLE[6..16]);
    assert_eq!(fixture.input[24..36], EXAMPLE[24..36]);
    assert!(fixture.input[36..].iter().all(|&byte| byte == 0));
}

#[test]
fn readback_matches_the_manual() {
    let mut fixture = Fixture::op(chunks(8), chunks(8));
    for object in [0x8010, 0x8011] {
        assert_eq!(fixture.upload(object, 2), 0);
        assert_eq!(fixture.upload(object, 9), 1024);
        assert_eq!(fixture.upload(object, 10), 1000);
        assert_eq!(fixture.upload(object, 12), 0x0000_01E7);
    }
}
