//! Rejection, clearing and counting in the writer (manual 5.4.4.1, 6.1, 9.1).

use ecan_protocol::can::*;
use ecan_protocol::image::*;
use ecan_protocol::mapping::*;

fn frame(data: &[u8]) -> FrameRef<'_> {
    FrameRef::classic(CanId::standard(0x100).unwrap(), data).unwrap()
}

fn small() -> PdoProfile {
    PdoProfile { multiplier: 1, channel_mask: 0x03, ..PdoProfile::default() }
}

#[test]
fn full_image_rejects_the_whole_frame() {
    let mut image = [0; 128];
    let mut writer = ImageWriter::new(Direction::RxPdo, small());
    for index in 0..8 {
        let pushed = writer.push(&mut image, 0, 0, frame(&[1; 8]), Timestamp::None);
        assert_eq!(pushed, Ok(index));
    }
    let before = image;
    assert_eq!(
        writer.push(&mut image, 0, 0, frame(&[1; 8]), Timestamp::None),
        Err(PushError::NoRoom { needed: 12, left: 8 })
    );
    assert_eq!(image, before);
    assert_eq!((writer.room(), writer.used(), writer.frames()), (8, 96, 8));
    assert_eq!(writer.push(&mut image, 0, 0, frame(&[1; 4]), Timestamp::None), Ok(8));
    assert_eq!(writer.room(), 0);
}

#[test]
fn header_counts_no_more_than_255_packets() {
    let mut image = [0; 3072];
    let profile = PdoProfile { multiplier: 24, ..PdoProfile::default() };
    let mut writer = ImageWriter::new(Direction::RxPdo, profile);
    for index in 0..255 {
        let pushed = writer.push(&mut image, 3, 0, frame(&[]), Timestamp::None);
        assert_eq!(pushed, Ok(index as u8));
    }
    assert_eq!(
        writer.push(&mut image, 3, 0, frame(&[]), Timestamp::None),
        Err(PushError::TooManyPackets)
    );
}

#[test]
fn invalid_packets_are_rejected() {
    let mut image = [0; 128];
    let mut writer = ImageWriter::new(Direction::RxPdo, small());
    assert_eq!(
        writer.push(&mut image, 2, 0, frame(&[]), Timestamp::None),
        Err(PushError::Channel { channel: 2, mask: 3 })
    );
    assert_eq!(
        writer.push(&mut image, 0, 8, frame(&[]), Timestamp::None),
        Err(PushError::IdAux(8))
    );
    for timestamp in [Timestamp::Delta16(1), Timestamp::Full64(2)] {
        assert_eq!(
            writer.push(&mut image, 0, 0, frame(&[]), timestamp),
            Err(PushError::Timestamp { format: timestamp.format() })
        );
    }
    assert_eq!(
        writer.push(&mut image[..127], 0, 0, frame(&[]), Timestamp::None),
        Err(PushError::Buffer { length: 127, needed: 128 })
    );
    let result = TxResult { channel: 0, sequence: 1, frame_index: 0, code: ResultCode::Ok };
    assert_eq!(writer.push_tx_result(&mut image, &result), Err(PushError::TxResult));
    assert!(writer.is_empty());
    assert_eq!(image, [0; 128]);
}

#[test]
fn stale_bytes_are_cleared_without_the_option() {
    for payload_only in [false, true] {
        let mut image = [0xAA; 128];
        let mut writer =
            ImageWriter::new(Direction::RxPdo, small()).with_payload_only(payload_only);
        let stale = if payload_only { 0xAA } else { 0 };
        writer.commit(&mut image, CommitFields::default());
        assert_eq!(image[24..], [stale; 104]);

        let pushed = writer.push(&mut image, 0, 0, frame(&[0xBB; 8]), Timestamp::None);
        assert_eq!(pushed, Ok(0));
        writer.commit(&mut image, CommitFields::default());
        let pushed = writer.push(&mut image, 0, 0, frame(&[0xCC; 2]), Timestamp::None);
        assert_eq!(pushed, Ok(0));
        writer.commit(&mut image, CommitFields::default());
        let left = if payload_only { 0xBB } else { 0 };
        assert_eq!(image[28..32], [0xCC, 0xCC, left, left]);
        assert_eq!(image[36..], [stale; 92]);
    }
}

#[test]
fn packets_of_a_discarded_image_are_cleared() {
    let mut image = [0; 128];
    let mut writer = ImageWriter::new(Direction::RxPdo, small());
    writer.commit(&mut image, CommitFields::default());
    for _ in 0..3 {
        let pushed = writer.push(&mut image, 0, 0, frame(&[0xBB; 8]), Timestamp::None);
        assert!(pushed.is_ok() && !writer.is_empty());
    }
    writer.begin();
    assert!(writer.is_empty());
    writer.commit(&mut image, CommitFields::default());
    assert_eq!(image[24..], [0; 104]);
}

#[test]
fn padding_is_zero_over_stale_bytes() {
    let profile = PdoProfile { options: OptionFlags::ALIGN4, ..PdoProfile::default() };
    for (id, start) in [(CanId::standard(0x7FF), 4), (CanId::extended(0x1FFF_FFFF), 6)] {
        for length in [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64] {
            let mut image = [0xAA; 1024];
            let mut writer = ImageWriter::new(Direction::RxPdo, profile);
            let data = &[0xBB; 64][..length];
            for data in [&[0xCC; 64][..], data] {
                let frame = FrameRef::fd(id.unwrap(), data, false, false).unwrap();
                writer.push(&mut image, 0, 7, frame, Timestamp::None).unwrap();
                writer.commit(&mut image, CommitFields::default());
            }
            let (packet, padding) =
                image[24..24 + (start + length).next_multiple_of(4)].split_at(start + length);
            assert_eq!(packet[start..], *data);
            assert!(padding.iter().all(|byte| *byte == 0), "{length}: {padding:?}");
        }
    }
}

/// The index of a frame counts frames only (manual 10).
#[test]
fn results_have_no_index() {
    let profile = PdoProfile { options: OptionFlags::TX_RESULT, ..PdoProfile::default() };
    let mut image = [0; 1024];
    let mut writer = ImageWriter::new(Direction::TxPdo, profile);
    let result = TxResult { channel: 0, sequence: 1, frame_index: 0, code: ResultCode::Ok };
    assert_eq!(writer.push(&mut image, 0, 0, frame(&[1]), Timestamp::None), Ok(0));
    assert_eq!(writer.push_tx_result(&mut image, &result), Ok(()));
    assert_eq!(writer.push(&mut image, 0, 0, frame(&[1]), Timestamp::None), Ok(1));
}

/// Writes `count` short frames, then `last` if there is room; returns the end of the packets.
fn fill(writer: &mut ImageWriter, image: &mut [u8], (count, last): (usize, FrameRef<'_>)) -> usize {
    for _ in 0..count {
        writer.push(image, 0, 0, frame(&[0xBB; 3]), Timestamp::None).unwrap();
    }
    let room = writer.room();
    let size = writer.packet_bytes(last, Timestamp::None);
    let pushed = writer.push(image, 1, 7, last, Timestamp::None);
    assert_eq!(pushed.is_ok(), size <= room);
    24 + writer.used()
}

#[test]
fn bytes_after_the_packets_stay_zero() {
    let data = [0xBB; 64];
    let lengths = (0..=64).filter(|&length| Dlc::from_fd_len(length).is_some());
    for (length, count) in lengths.flat_map(|length| (0..=12).map(move |count| (length, count))) {
        for id in [CanId::standard(0x7FF).unwrap(), CanId::extended(0x1FFF_FFFF).unwrap()] {
            for options in [OptionFlags::NONE, OptionFlags::ALIGN4] {
                let last = FrameRef::fd(id, &data[..length], true, false).unwrap();
                let profile = PdoProfile { options, ..small() };
                let mut image = [0xFF; 128];
                let mut writer = ImageWriter::new(Direction::RxPdo, profile);
                writer.commit(&mut image, CommitFields::default());
                let end = fill(&mut writer, &mut image, (count, last));
                writer.commit(&mut image, CommitFields::default());
                assert_eq!(image[end..], [0; 128][end..], "{length} bytes after {count} frames");

                writer.commit(&mut image, CommitFields::default());
                fill(&mut writer, &mut image, (count, last));
                writer.begin();
                writer.commit(&mut image, CommitFields::default());
                assert_eq!(image[24..], [0; 104], "{length} bytes after {count} frames");
            }
        }
    }
}

#[test]
fn sequence_wrap_is_marked_once() {
    let mut image = [0; 128];
    let mut writer = ImageWriter::new(Direction::RxPdo, small());
    let mut flags = |writer: &mut ImageWriter| {
        let sequence = writer.commit(&mut image, CommitFields::default());
        (sequence, image[1])
    };
    assert_eq!(flags(&mut writer), (1, 0));
    writer.set_next_sequence(0xFFFF);
    assert_eq!(flags(&mut writer), (0xFFFF, 0));
    assert_eq!(writer.next_sequence(), 0);
    assert_eq!(flags(&mut writer), (0, HeaderFlags::SEQ_WRAP.bits()));
    assert_eq!(flags(&mut writer), (1, 0));
}

#[test]
fn short_buffer_is_not_committed() {
    let mut image = [0; 127];
    let mut writer = ImageWriter::new(Direction::RxPdo, small());
    writer.commit(&mut image, CommitFields::default());
    assert_eq!(image, [0; 127]);
    assert_eq!(writer.next_sequence(), 1);
}
