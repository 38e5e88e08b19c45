//! Faults that the reader rejects, and their diagnoses (manual 6.1, 13.2, 16.2).

use ecan_protocol::image::*;
use ecan_protocol::mapping::*;

const BYTES: usize = 256;

fn profile(encapsulation: EncapsulationProfile, options: OptionFlags) -> PdoProfile {
    PdoProfile {
        multiplier: 2,
        channel_mask: 0x07,
        profile: encapsulation,
        budget: BudgetPolicy::Balanced,
        options,
    }
}

fn compact() -> PdoProfile {
    profile(EncapsulationProfile::Compact, OptionFlags::NONE)
}

/// An image with a payload made by hand.
fn image(profile: PdoProfile, frame_count: u8, payload: &[u8]) -> [u8; BYTES] {
    let mut image = [0; BYTES];
    image[24..24 + payload.len()].copy_from_slice(payload);
    let mut head = [0; 24];
    Header {
        ver_ihl: VER_IHL,
        flags: HeaderFlags::NONE,
        seq_begin: 77,
        seq_end: 77,
        payload_len: payload.len() as u16,
        payload_crc16: crc16_portable(payload),
        layout_id: profile.layout_id(),
        channel_mask: profile.channel_mask,
        frame_count,
        overflow_sat: 0,
        crc_alg: CRC_ALG_CCITT_FALSE,
        channel_status: [ChannelStatus::default(); 4],
    }
    .write(&mut head);
    image[..24].copy_from_slice(&head);
    image
}

/// One valid frame: channel 0, standard 0x001, two bytes.
const GOOD: [u8; 6] = [0x10, 0x00, 0x01, 0x00, 0xAA, 0xBB];

fn rejected(profile: PdoProfile, image: &[u8; BYTES]) -> ParseDiagnosis {
    let reader = ImageReader::new(Direction::TxPdo, profile);
    reader.read(image).expect_err("the image was accepted")
}

/// The error after [`GOOD`] if a faulty packet follows.
fn packet_error(direction: Direction, profile: PdoProfile, faulty: &[u8]) -> ParseDiagnosis {
    let mut payload = GOOD.to_vec();
    payload.extend_from_slice(faulty);
    let image = image(profile, 2, &payload);
    let reader = ImageReader::new(direction, profile);
    let received = reader.read(&image).expect("the image itself is intact");
    let mut packets = received.packets();
    assert!(matches!(packets.next(), Some(Ok(Packet::Frame(_)))));
    let diagnosis = packets.next().expect("a packet").expect_err("an error");
    assert_eq!(packets.next(), None, "nothing follows an error");
    assert_eq!(diagnosis.offset, 30);
    assert_eq!(diagnosis.sequence, 77);
    assert_eq!(usize::from(diagnosis.payload_len), payload.len());
    assert_eq!(diagnosis.layout_id, profile.layout_id());
    diagnosis
}

fn pdo_error(profile: PdoProfile, faulty: &[u8]) -> PdoError {
    packet_error(Direction::TxPdo, profile, faulty).pdo_error().unwrap()
}

#[test]
fn image_being_updated_is_skipped() {
    let mut image = image(compact(), 1, &GOOD);
    image[4] ^= 1;
    let diagnosis = rejected(compact(), &image);
    assert_eq!(diagnosis.fault, ImageFault::Updating);
    assert_eq!(diagnosis.pdo_error(), None);
}

#[test]
fn sequence_numbers_are_checked_first() {
    let mut image = image(compact(), 1, &GOOD);
    image[0] = 0;
    image[4] ^= 1;
    image[15] = 9;
    assert_eq!(rejected(compact(), &image).fault, ImageFault::Updating);
}

#[test]
fn headers_that_are_not_version_1() {
    for (at, value) in [(0, 0x26), (0, 0x15), (0, 0x00), (15, 0), (15, 2)] {
        let mut image = image(compact(), 1, &GOOD);
        image[at] = value;
        let diagnosis = rejected(compact(), &image);
        assert_eq!(diagnosis.pdo_error(), Some(PdoError::BadHeader));
    }
}

#[test]
fn all_zero_image_returns_bad_header() {
    for options in [OptionFlags::NONE, OptionFlags::NO_CRC16] {
        let profile = profile(EncapsulationProfile::Compact, options);
        let diagnosis = rejected(profile, &[0; BYTES]);
        assert_eq!(diagnosis.pdo_error(), Some(PdoError::BadHeader));
    }
}

#[test]
fn payload_longer_than_frame_area() {
    let mut image = image(compact(), 1, &GOOD);
    image[6] = 233;
    let diagnosis = rejected(compact(), &image);
    assert_eq!(diagnosis.pdo_error(), Some(PdoError::BadHeader));
    assert_eq!(diagnosis.payload_len, 233);
}

#[test]
fn crc_error_has_both_values() {
    let mut image = image(compact(), 1, &GOOD);
    image[28] ^= 0x40;
    let diagnosis = rejected(compact(), &image);
    assert_eq!(diagnosis.pdo_error(), Some(PdoError::BadCrc));
    assert_eq!(diagnosis.payload_crc16, crc16_portable(&GOOD));
    assert_eq!(diagnosis.computed_crc16, crc16_portable(&image[24..30]));
    assert!(diagnosis.to_string().starts_with("bad CRC in image 77: 0x"));
}

#[test]
fn image_without_crc_needs_option_or_force() {
    let mut image = image(compact(), 1, &GOOD);
    image[8..10].fill(0);
    image[15] = 0;
    let without = ImageReader::new(Direction::TxPdo, compact()).with_crc(false);
    assert!(without.read(&image).is_ok());
    let no_crc = profile(EncapsulationProfile::Compact, OptionFlags::NO_CRC16);
    let reader = ImageReader::new(Direction::TxPdo, no_crc);
    assert!(reader.read(&image).is_ok());
    assert!(reader.with_crc(true).read(&image).is_err());
    assert!(ImageReader::new(Direction::TxPdo, compact()).read(&image).is_err());
    // Without an algorithm the field is 0.
    image[8] = 1;
    let diagnosis = without.read(&image).unwrap_err();
    assert_eq!(diagnosis.pdo_error(), Some(PdoError::BadHeader));
}

#[test]
fn crc_is_checked_even_if_not_required() {
    let no_crc = profile(EncapsulationProfile::Compact, OptionFlags::NO_CRC16);
    let mut image = image(no_crc, 1, &GOOD);
    let reader = ImageReader::new(Direction::TxPdo, no_crc);
    assert!(reader.read(&image).is_ok());
    image[28] ^= 1;
    let diagnosis = reader.read(&image).unwrap_err();
    assert_eq!(diagnosis.pdo_error(), Some(PdoError::BadCrc));
}

#[test]
fn reserved_flags_and_stale_bytes_are_ignored() {
    let mut image = image(compact(), 1, &GOOD);
    image[1] = 0xC0;
    image[30..].fill(0xEE);
    let reader = ImageReader::new(Direction::TxPdo, compact());
    let received = reader.read(&image).unwrap();
    assert_eq!(received.packets().filter(Result::is_ok).count(), 1);
}

#[test]
fn other_layout_is_accepted_and_marked() {
    let mut image = image(compact(), 1, &GOOD);
    image[10] ^= 1;
    let reader = ImageReader::new(Direction::TxPdo, compact());
    let received = reader.read(&image).unwrap();
    assert!(received.layout_changed());
    assert_eq!(received.packets().filter(Result::is_ok).count(), 1);
}

#[test]
fn unknown_kind_ends_the_stream() {
    for ctrl in [0x4000_u16, 0x6000] {
        let mut packet = ctrl.to_le_bytes().to_vec();
        packet.extend([0; 6]);
        assert_eq!(pdo_error(compact(), &packet), PdoError::UnknownKind);
    }
}

#[test]
fn tx_result_in_rxpdo_returns_error() {
    let diagnosis = packet_error(Direction::RxPdo, compact(), &[0, 0x20, 1, 0, 0, 0]);
    assert_eq!(diagnosis.pdo_error(), Some(PdoError::UnknownKind));
    assert_eq!(diagnosis.kind, 1);
}

#[test]
fn tx_result_channel_ignores_the_mask() {
    let payload = [0x03, 0x20, 1, 0, 0, 3];
    let image = image(compact(), 1, &payload);
    let reader = ImageReader::new(Direction::TxPdo, compact());
    let packets: Vec<_> = reader.read(&image).unwrap().packets().collect();
    let result =
        TxResult { channel: 3, sequence: 1, frame_index: 0, code: ResultCode::InvalidChannel };
    assert_eq!(packets, [Ok(Packet::TxResult(result))]);
}

#[test]
fn channel_outside_mask_returns_error() {
    for channel in 3..8 {
        let diagnosis = packet_error(Direction::TxPdo, compact(), &[channel, 0, 1, 0]);
        assert_eq!(diagnosis.pdo_error(), Some(PdoError::InvalidChannel));
        assert_eq!(diagnosis.channel, channel);
        assert_eq!((diagnosis.packet_end, diagnosis.ctrl), (34, channel.into()));
    }
}

#[test]
fn classic_frame_rules() {
    let window = profile(EncapsulationProfile::Window64, OptionFlags::NONE);
    let frame = |ctrl: u16| {
        let mut packet = ctrl.to_le_bytes().to_vec();
        packet.extend([0; 66]);
        packet
    };
    for dlc in 9..16 {
        assert_eq!(pdo_error(compact(), &frame(dlc << 3)), PdoError::InvalidDlc);
        // A remote frame too.
        let remote = dlc << 3 | 0x0400;
        assert_eq!(pdo_error(compact(), &frame(remote)), PdoError::InvalidDlc);
    }
    assert_eq!(pdo_error(compact(), &frame(0x0200)), PdoError::ReservedBit);
    // No window, with or without data.
    assert_eq!(pdo_error(window, &frame(0x8000)), PdoError::InvalidDlc);
    assert_eq!(pdo_error(window, &frame(0x8400)), PdoError::InvalidDlc);
}

#[test]
fn window_without_profile_returns_error() {
    let mut packet = vec![0x08, 0x81, 1, 0];
    packet.extend([0; 64]);
    assert_eq!(pdo_error(compact(), &packet), PdoError::FrameOverrun);
}

#[test]
fn remote_frame_with_window_ends_without_data() {
    let window = profile(EncapsulationProfile::Window64, OptionFlags::NONE);
    let payload = [0x20, 0x84, 0x05, 0x00, 0x10, 0x00, 0x01, 0x00, 0xAA, 0xBB];
    let image = image(window, 2, &payload);
    let reader = ImageReader::new(Direction::TxPdo, window);
    let packets: Vec<_> = reader.read(&image).unwrap().packets().collect();
    let [Err(diagnosis)] = packets[..] else { panic!("{packets:?}") };
    assert_eq!(diagnosis.pdo_error(), Some(PdoError::InvalidDlc));
    assert_eq!((diagnosis.offset, diagnosis.packet_end), (24, 28));
}

#[test]
fn timestamp_needs_profile_and_direction() {
    let timestamped = profile(EncapsulationProfile::CompactTimestamped, OptionFlags::NONE);
    for format in 1..4_u16 {
        let mut packet = (format << 11).to_le_bytes().to_vec();
        packet.extend([0; 10]);
        assert_eq!(pdo_error(compact(), &packet), PdoError::InvalidTsf);
        if format != 3 {
            let diagnosis = packet_error(Direction::RxPdo, timestamped, &packet);
            assert_eq!(diagnosis.pdo_error(), Some(PdoError::InvalidTsf));
            assert_eq!(u16::from(diagnosis.tsf), format);
        }
    }
}

#[test]
fn bad_schedule_keeps_the_next_packet() {
    let mut payload = vec![0x00, 0x18, 0x01, 0x00, 2, 0, 0, 0, 0, 0, 0, 0];
    payload.extend(GOOD);
    let image = image(compact(), 2, &payload);
    let reader = ImageReader::new(Direction::RxPdo, compact());
    let schedules: Vec<_> = reader
        .read(&image)
        .unwrap()
        .packets()
        .map(|packet| match packet {
            Ok(Packet::Frame(packet)) => packet.schedule(),
            other => panic!("{other:?}"),
        })
        .collect();
    assert_eq!(schedules, [Some(Err(PdoError::BadSchedule)), None]);
}

#[test]
fn reserved_id_bits_return_error() {
    for high in [0x40, 0x80, 0xC0] {
        let packet = [0x00, 0x00, 0x01, high];
        assert_eq!(pdo_error(compact(), &packet), PdoError::ReservedBit);
        // Eight bytes: the most frequent size has a path of its own.
        let packet = [0x40, 0x00, 0x00, high, 1, 2, 3, 4, 5, 6, 7, 8];
        assert_eq!(pdo_error(compact(), &packet), PdoError::ReservedBit);
    }
}

#[test]
fn packet_truncated_at_every_byte() {
    let whole = [0xC8, 0x01, 0x01, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12];
    for length in 1..whole.len() {
        let diagnosis = packet_error(Direction::TxPdo, compact(), &whole[..length]);
        assert_eq!(diagnosis.pdo_error(), Some(PdoError::Truncated), "{length}");
    }
    for length in 2..6 {
        let result = [0x00, 0x20, 1, 0, 0, 0];
        assert_eq!(pdo_error(compact(), &result[..length]), PdoError::Truncated);
    }
}

#[test]
fn alignment_pads_the_last_packet() {
    let aligned = profile(EncapsulationProfile::Compact, OptionFlags::ALIGN4);
    let image = image(aligned, 1, &GOOD);
    let reader = ImageReader::new(Direction::TxPdo, aligned);
    let diagnosis = reader.read(&image).unwrap().packets().next().unwrap();
    let diagnosis = diagnosis.unwrap_err();
    assert_eq!(diagnosis.pdo_error(), Some(PdoError::Truncated));
    assert_eq!((diagnosis.offset, diagnosis.packet_end), (24, 32));
}

#[test]
fn packet_count_mismatch_returns_error() {
    for (frame_count, readable) in [(0, 0), (1, 1), (3, 2), (255, 2)] {
        let payload = [GOOD, GOOD].concat();
        let image = image(compact(), frame_count, &payload);
        let reader = ImageReader::new(Direction::TxPdo, compact());
        let packets: Vec<_> = reader.read(&image).unwrap().packets().collect();
        assert_eq!(packets.len(), readable + 1);
        let diagnosis = packets.last().unwrap().unwrap_err();
        assert_eq!(diagnosis.pdo_error(), Some(PdoError::BadHeader));
        assert_eq!(usize::from(diagnosis.offset), 24 + readable * GOOD.len());
    }
}

#[test]
fn diagnosis_has_location_and_fault() {
    let diagnosis = packet_error(Direction::TxPdo, compact(), &[0x17, 0, 1, 0, 1, 2]);
    assert_eq!(
        diagnosis.to_string(),
        "invalid channel in image 77 at offset 30 to 36: control word 0x0017, kind 0, channel 7, \
         DLC 2, TSF 0 (payload of 12 bytes, layout 0x00e1)"
    );
}
