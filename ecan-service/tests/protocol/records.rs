//! Bytes of messages and records, written by hand from docs/SERVICE.md, and arbitrary bytes.

use ecan_protocol::can::{CanFrame, CanId, Dlc};
use ecan_protocol::image::{PdoProfile, ResultCode};
use ecan_protocol::mapping::Direction;
use ecan_service::protocol::*;
use proptest::prelude::*;

fn report(event: FrameEvent, tag: u32, frame: CanFrame) -> FrameReport {
    FrameReport { time_ns: 0x0102_0304_0506_0708, gateway: 0x0203, channel: 1, tag, event, frame }
}

#[test]
fn received_frame_has_the_documented_bytes() {
    let frame = CanFrame::classic(CanId::standard(0x123).unwrap(), &[0x11, 0x22]).unwrap();
    let mut bytes = Vec::new();
    report(FrameEvent::Received, 0, frame).encode(&mut bytes);
    #[rustfmt::skip]
    let expected = [
        8, 7, 6, 5, 4, 3, 2, 1, // time
        0x23, 1, 0, 0, 2, 0, // CAN ID, length, flags
        3, 2, 1, 0, 0, 0, 0, 0, 0, 0, // gateway, channel, kind, code, tag
        0x11, 0x22, 0, 0, 0, 0, 0, 0,
    ];
    assert_eq!(bytes, expected);
}

#[test]
fn failed_fd_frame_has_the_documented_bytes() {
    let frame = CanFrame::fd(CanId::extended(0x1ABC_DEF0).unwrap(), &[7; 12], true, false).unwrap();
    let event = FrameEvent::Failed(ResultCode::BusOff);
    let mut bytes = Vec::new();
    report(event, 0x0A0B_0C0D, frame).encode(&mut bytes);
    #[rustfmt::skip]
    let expected = [
        8, 7, 6, 5, 4, 3, 2, 1,
        0xF0, 0xDE, 0xBC, 0x9A, 12, 5,
        3, 2, 1, 2, 5, 0, 0x0D, 0x0C, 0x0B, 0x0A,
        7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 0, 0, 0, 0,
    ];
    assert_eq!(bytes, expected);
}

#[test]
fn lost_record_has_the_documented_bytes() {
    let mut bytes = Vec::new();
    FrameRecord::Lost { time_ns: 1, frames: 0x0102 }.encode(&mut bytes);
    #[rustfmt::skip]
    let expected = [1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 3, 0, 0, 2, 1, 0, 0];
    assert_eq!(bytes, expected);
}

#[test]
fn remote_frame_to_send_has_the_documented_bytes() {
    let frame = CanFrame::remote(CanId::standard(0x7FF).unwrap(), Dlc::new(8).unwrap()).unwrap();
    let mut bytes = Vec::new();
    TransmitRecord { gateway: 1, channel: 3, tag: 9, max_age_ms: 0x0201, frame }.encode(&mut bytes);
    assert_eq!(bytes, [0xFF, 7, 0, 0x40, 8, 0, 1, 0, 3, 0, 1, 2, 9, 0, 0, 0]);
}

#[test]
fn message_header_has_the_documented_bytes() {
    assert_eq!(header(MessageKind::Frames, 0x0102), [2, 1, 0, 0, 2, 0, 0, 0]);
}

#[test]
fn header_of_other_direction_returns_error() {
    let frames = header(MessageKind::Frames, 0);
    assert_eq!(read_header(frames, Sender::Client), Err(HeaderError::Kind(2)));
    let transmit = header(MessageKind::Transmit, 0);
    assert_eq!(read_header(transmit, Sender::Service), Err(HeaderError::Kind(3)));
    for (kind, max) in
        [(MessageKind::Rpc, MAX_REQUEST_PAYLOAD), (MessageKind::Transmit, MAX_TRANSMIT_PAYLOAD)]
    {
        let too_long = HeaderError::TooLong { bytes: max as u32 + 1, max };
        assert_eq!(read_header(header(kind, max + 1), Sender::Client), Err(too_long));
        assert_eq!(read_header(header(kind, max), Sender::Client), Ok((kind, max)));
    }
}

fn transmit(bytes: &[u8]) -> Result<Vec<TransmitRecord>, RecordError> {
    TransmitRecords::new(bytes).collect()
}

#[test]
fn malformed_transmit_records_return_typed_errors() {
    let good = [0x23, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 5, 0, 0, 0, 0, 0, 0, 0];
    assert_eq!(transmit(&good).unwrap().len(), 1);
    let with = |at: usize, value: u8| {
        let mut bytes = good;
        bytes[at] = value;
        transmit(&bytes).unwrap_err()
    };
    assert_eq!(with(1, 8), RecordError::CanId(0x823));
    assert_eq!(with(3, 0x20), RecordError::CanId(0x2000_0123));
    assert!(matches!(with(4, 9), RecordError::Incomplete(8)));
    assert_eq!(with(5, 1), RecordError::Flags(1));
    assert_eq!(with(5, 8), RecordError::Flags(8));
    assert_eq!(with(8, 4), RecordError::Channel(4));
    assert_eq!(with(9, 1), RecordError::Reserved);
    assert_eq!(with(12, 0), RecordError::Tag);
    assert_eq!(with(23, 1), RecordError::Reserved);
    assert_eq!(transmit(&good[..23]).unwrap_err(), RecordError::Incomplete(7));
    let remote_fd = [0x23, 1, 0, 0x40, 1, 4, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0];
    assert_eq!(transmit(&remote_fd).unwrap_err(), RecordError::RemoteFd);
}

fn any_frame() -> impl Strategy<Value = CanFrame> {
    let id = prop_oneof![
        (0..=CanId::MAX_STANDARD).prop_map(|raw| CanId::new(raw, false).unwrap()),
        (0..=CanId::MAX_EXTENDED).prop_map(|raw| CanId::new(raw, true).unwrap()),
    ];
    let data = prop::collection::vec(any::<u8>(), 64);
    (id, 0_u8..16, data, 0..3, any::<[bool; 2]>()).prop_map(|(id, dlc, data, kind, [brs, esi])| {
        let dlc = Dlc::new(dlc).unwrap();
        match kind {
            0 => CanFrame::classic(id, &data[..dlc.classic_len()]).unwrap(),
            1 => CanFrame::remote(id, Dlc::new(dlc.classic_len() as u8).unwrap()).unwrap(),
            _ => CanFrame::fd(id, &data[..dlc.fd_len()], brs, esi).unwrap(),
        }
    })
}

fn any_event() -> impl Strategy<Value = FrameEvent> {
    prop_oneof![
        Just(FrameEvent::Received),
        Just(FrameEvent::Transmitted),
        Just(FrameEvent::Published),
        Just(FrameEvent::Unknown),
        any::<u8>().prop_map(|code| { FrameEvent::Failed(ResultCode::from_raw(code)) }),
        prop::sample::select(RejectReason::ALL).prop_map(FrameEvent::Rejected),
    ]
}

fn any_record() -> impl Strategy<Value = FrameRecord> {
    let place = (any::<u64>(), any::<u16>(), 0_u8..4, any::<u32>());
    let frame = (place, any_event(), any_frame()).prop_map(|(place, event, frame)| {
        let (time_ns, gateway, channel, tag) = place;
        FrameRecord::Frame(FrameReport { time_ns, gateway, channel, tag, event, frame })
    });
    let lost = any::<(u64, u32)>();
    prop_oneof![
        4 => frame,
        1 => lost.prop_map(|(time_ns, frames)| FrameRecord::Lost { time_ns, frames }),
    ]
}

/// Arbitrary bytes that resemble records: small values are frequent.
fn any_bytes() -> impl Strategy<Value = Vec<u8>> {
    let byte = prop_oneof![3 => 0_u8..9, 1 => any::<u8>()];
    prop::collection::vec(byte, 0..120)
}

proptest! {
    #[test]
    fn frame_batch_round_trip(records in prop::collection::vec(any_record(), 0..20)) {
        let mut bytes = Vec::new();
        for record in &records {
            let before = bytes.len();
            record.encode(&mut bytes);
            prop_assert_eq!(before % 8, 0);
            prop_assert!(bytes.len() - before <= MAX_FRAME_RECORD_BYTES);
        }
        let read: Result<Vec<_>, _> = FrameRecords::new(&bytes).collect();
        prop_assert_eq!(read.unwrap(), records);
    }

    #[test]
    fn transmit_batch_round_trip(
        frames in prop::collection::vec(
            (any::<u16>(), 0_u8..4, 1_u32.., any::<u16>(), any_frame()), 0..20),
    ) {
        let mut bytes = Vec::new();
        let mut records = Vec::new();
        for (gateway, channel, tag, max_age_ms, frame) in frames {
            let record = TransmitRecord { gateway, channel, tag, max_age_ms, frame };
            record.encode(&mut bytes);
            records.push(record);
        }
        prop_assert_eq!(transmit(&bytes).unwrap(), records);
    }

    /// Each byte string has one meaning at most: what is read is written again as it was.
    #[test]
    fn arbitrary_batches_are_read_or_rejected(bytes in any_bytes()) {
        let mut written = Vec::new();
        let mut is_complete = true;
        for record in FrameRecords::new(&bytes) {
            match record {
                Ok(record) => record.encode(&mut written),
                Err(_) => is_complete = false,
            }
        }
        prop_assert!(bytes.starts_with(&written));
        prop_assert_eq!(is_complete, bytes.len() == written.len());
        written.clear();
        for record in TransmitRecords::new(&bytes).flatten() {
            record.encode(&mut written);
        }
        prop_assert!(bytes.starts_with(&written));
        if let Ok(image) = ImageMessage::decode(&bytes) {
            written.clear();
            image.encode(&mut written);
            prop_assert_eq!(&written, &bytes);
        }
    }

    #[test]
    fn image_round_trip(
        numbers in any::<(u64, u64, u32, u16)>(),
        is_rx in any::<bool>(),
        multiplier in 1_u8..=3,
        fill in any::<u8>(),
    ) {
        let (time_ns, cycle, lost, gateway) = numbers;
        let profile = PdoProfile { multiplier, ..PdoProfile::default() };
        let bytes = vec![fill; profile.pdo_bytes()];
        let direction = if is_rx { Direction::RxPdo } else { Direction::TxPdo };
        let image =
            ImageMessage { time_ns, cycle, lost, gateway, direction, profile, image: &bytes };
        let mut written = Vec::new();
        image.encode(&mut written);
        prop_assert_eq!(written.len(), IMAGE_HEAD_BYTES + bytes.len());
        prop_assert_eq!(ImageMessage::decode(&written), Ok(image));
        written.pop();
        prop_assert!(ImageMessage::decode(&written).is_err());
    }

    /// The division of the stream into reads does not matter.
    #[test]
    fn messages_are_cut_independently_of_reads(
        payloads in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..50), 1..8),
        step in 1_usize..40,
        garbage in any_bytes(),
    ) {
        let mut stream = Vec::new();
        for payload in &payloads {
            stream.extend_from_slice(&header(MessageKind::Rpc, payload.len()));
            stream.extend_from_slice(payload);
        }
        let read = |stream: &[u8], step| {
            let mut reader = MessageReader::new(Sender::Client);
            let mut messages = Vec::new();
            for part in stream.chunks(step) {
                reader.push(part);
                loop {
                    match reader.next_message() {
                        Ok(Some((kind, payload))) => messages.push((kind, payload.to_vec())),
                        Ok(None) => break,
                        Err(error) => return (messages, Some(error)),
                    }
                }
            }
            (messages, None)
        };
        let (messages, error) = read(&stream, step);
        let found: Vec<_> = messages.into_iter().map(|(_, payload)| payload).collect();
        prop_assert_eq!(found, payloads);
        prop_assert_eq!(error, None);
        stream.extend_from_slice(&garbage);
        prop_assert_eq!(read(&stream, step), read(&stream, usize::MAX));
    }
}
