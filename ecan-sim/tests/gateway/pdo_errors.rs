//! Every Last PDO error of 0x8011:14 (manual 13.2): the image that causes it, and the frames that
//! are still sent. The errors of 0x8010 (2, 3 and 12) are in `input_budget`.

use super::fixture::{Fixture, chunks, standard};
use ecan_protocol::image::{
    EncapsulationProfile, Header, HeaderFlags, OptionFlags, PdoProfile, crc16,
};
use ecan_protocol::mapping::HEADER_BYTES;

/// One good packet: channel 0, identifier 0x123, no data.
const GOOD: [u8; 4] = [0x00, 0x00, 0x23, 0x01];

/// An image with this frame area, valid except for `change`.
fn image(
    profile: PdoProfile,
    packets: u8,
    payload: &[u8],
    change: impl FnOnce(&mut Header),
) -> Vec<u8> {
    let mut image = vec![0; profile.pdo_bytes()];
    let mut header = Header {
        ver_ihl: 0x16,
        flags: HeaderFlags::NONE,
        seq_begin: 1,
        seq_end: 1,
        payload_len: payload.len() as u16,
        payload_crc16: crc16(payload),
        layout_id: profile.layout_id(),
        channel_mask: profile.channel_mask,
        frame_count: packets,
        overflow_sat: 0,
        crc_alg: 1,
        channel_status: Default::default(),
    };
    change(&mut header);
    let mut bytes = [0; HEADER_BYTES];
    header.write(&mut bytes);
    image[..HEADER_BYTES].copy_from_slice(&bytes);
    image[HEADER_BYTES..][..payload.len()].copy_from_slice(payload);
    image
}

/// Writes the image and returns error, error counter and the frames sent on channel 0.
fn parse(profile: PdoProfile, image: Vec<u8>) -> (u32, u32, usize) {
    let mut fixture = Fixture::op(chunks(8), profile);
    fixture.image = image;
    assert!(fixture.write_again());
    let sent = fixture.sent(0).len();
    let (error, count) = (fixture.upload(0x8011, 14), fixture.upload(0x8011, 15));
    assert_eq!(fixture.upload(0x8011, 2), if error == 0 { 0 } else { 7 });
    (error, count, sent)
}

fn packets(packets: &[&[u8]]) -> (u32, u32, usize) {
    let payload: Vec<u8> = packets.concat();
    parse(chunks(8), image(chunks(8), packets.len() as u8, &payload, |_| {}))
}

fn header(change: impl FnOnce(&mut Header)) -> (u32, u32, usize) {
    parse(chunks(8), image(chunks(8), 1, &GOOD, change))
}

/// The error, counted once, with the one frame before the fault sent.
fn after_good(error: u32) -> (u32, u32, usize) {
    (error, 1, 1)
}

#[test]
fn faulty_packet_has_its_error() {
    assert_eq!(packets(&[&GOOD]), (0, 0, 1));
    let mut nine = [0; 4 + 12];
    nine[..4].copy_from_slice(&[0x48, 0x00, 0x23, 0x01]);
    for (error, packet, reason) in [
        (4, &[0x00, 0x20, 0, 0, 0, 0][..], "TX_RESULT"),
        (4, &[0x00, 0x40, 0, 0], "STREAM_META"),
        (4, &[0x00, 0x60, 0, 0], "reserved kind"),
        (5, &nine, "DLC 9"),
        (6, &[0x04, 0x00, 0x23, 0x01], "channel 4"),
        (7, &[0x00, 0x08, 0x23, 0x01, 0, 0], "delta16"),
        (7, &[0x00, 0x10, 0x23, 0x01, 0, 0, 0, 0], "delta32"),
        (8, &[0x40, 0x00, 0x23, 0x01, 1, 2, 3], "beyond the payload only"),
        (13, &[0x00, 0x00, 0x23, 0x41], "bit 14"),
        (13, &[0x00, 0x00, 0x23, 0x81], "bit 15"),
        (13, &[0x00, 0x02, 0x23, 0x01], "BRS without FDF"),
    ] {
        assert_eq!(packets(&[&GOOD, packet]), after_good(error), "{reason}");
    }
}

#[test]
fn frame_overrun_2_is_an_unsupported_window() {
    let mut window = vec![0x00, 0x81, 0x23, 0x01];
    window.resize(4 + 64, 0);
    assert_eq!(packets(&[&GOOD, &window]), after_good(2));
    let allowed = PdoProfile { profile: EncapsulationProfile::Window64, ..chunks(8) };
    let payload = [&GOOD[..], &window].concat();
    assert_eq!(parse(allowed, image(allowed, 2, &payload, |_| {})), (0, 0, 2));
}

#[test]
fn packet_overrun_3_reaches_beyond_the_frame_area() {
    // 1000 bytes of frame area: 249 packets of 4 bytes leave 4, the last claims 12.
    let mut payload = GOOD.repeat(249);
    payload.extend([0x40, 0x00, 0x23, 0x01]);
    let (error, count, _) = parse(chunks(8), image(chunks(8), 250, &payload, |_| {}));
    assert_eq!((error, count), (3, 1));
}

#[test]
fn channel_outside_the_mask_has_error_6() {
    let one = PdoProfile { channel_mask: 0x01, ..chunks(8) };
    let payload = [GOOD, [0x01, 0x00, 0x23, 0x01]].concat();
    assert_eq!(parse(one, image(one, 2, &payload, |_| {})), after_good(6));
}

#[test]
fn duplicate_sequence_10_is_another_image_with_the_same_number() {
    let mut fixture = Fixture::op(chunks(8), chunks(8));
    fixture.image = image(chunks(8), 1, &GOOD, |_| {});
    assert!(fixture.write_again());
    let other = [0x00, 0x00, 0x24, 0x01];
    fixture.image = image(chunks(8), 1, &other, |_| {});
    assert!(fixture.write_again());
    assert_eq!(fixture.upload(0x8011, 14), 10);
    assert_eq!(fixture.sent(0), [standard(0x123, &[])]);
}

#[test]
fn faulty_header_has_error_12_14_or_15() {
    assert_eq!(header(|header| header.layout_id ^= 1), (12, 1, 0), "another layout");
    assert_eq!(header(|header| header.payload_crc16 ^= 1), (15, 1, 0));
    assert_eq!(header(|header| header.ver_ihl = 0x26), (14, 1, 0));
    assert_eq!(header(|header| header.ver_ihl = 0x17), (14, 1, 0));
    assert_eq!(header(|header| header.payload_len = 1001), (14, 1, 0));
    assert_eq!(header(|header| header.crc_alg = 2), (14, 1, 0));
    assert_eq!(header(|header| header.seq_end = 2), (14, 1, 0), "half written");
    let no_crc = |header: &mut Header| {
        header.crc_alg = 0;
        header.payload_crc16 = 0;
    };
    assert_eq!(header(no_crc), (14, 1, 0), "the option is off");
    let without = PdoProfile { options: OptionFlags::NO_CRC16, ..chunks(8) };
    assert_eq!(parse(without, image(without, 1, &GOOD, no_crc)), (0, 0, 1));
    assert_eq!(parse(without, vec![0; 1024]), (14, 1, 0), "all zero, even without CRC");
}

#[test]
fn bad_schedule_16() {
    let schedule = |record: [u8; 8]| [&[0x00, 0x18, 0x23, 0x01][..], &record].concat();
    let good = schedule([1, 0, 0, 0, 0xA0, 0x86, 0x01, 0]);
    assert_eq!(packets(&[&GOOD, &good]), after_good(16), "no Sync0 to schedule by");
    for record in [[0, 0, 0, 0, 0, 0, 0, 0], [2, 0, 0, 0, 0, 0, 0, 0], [1, 1, 0, 0, 0, 0, 0, 0]] {
        let mut fixture = Fixture::configured(chunks(8), chunks(8));
        fixture.start_with_sync0(300_000);
        let payload = [&GOOD[..], &schedule(record)].concat();
        fixture.image = image(chunks(8), 2, &payload, |_| {});
        assert!(fixture.write_again());
        assert_eq!(fixture.upload(0x8011, 14), 16, "{record:?}");
        assert_eq!(fixture.sent(0).len(), 1);
    }
}

#[test]
fn errors_9_and_11_come_from_the_profile() {
    for (field, value, error) in [(5, 3, 9), (7, 0x40, 11)] {
        let mut fixture = Fixture::configured(chunks(8), chunks(8));
        fixture.write_u8(0x8011, field, value);
        fixture.write_u8(0x8011, 1, 1);
        assert_eq!(fixture.upload(0x8011, 14), error);
    }
}

#[test]
fn good_image_after_a_faulty_one_is_accepted() {
    let mut fixture = Fixture::op(chunks(8), chunks(8));
    fixture.image = image(chunks(8), 1, &GOOD, |header| header.payload_crc16 ^= 1);
    assert!(fixture.write_again());
    fixture.image = image(chunks(8), 1, &GOOD, |_| {});
    assert!(fixture.write_again());
    assert_eq!(fixture.sent(0).len(), 1, "the faulty image used up no sequence number");
    assert_eq!(fixture.upload(0x8011, 15), 1);
}
