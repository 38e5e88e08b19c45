//! Bytes from the manual, or calculated by hand from its tables.

use ecan_protocol::can::*;
use ecan_protocol::image::*;
use ecan_protocol::mapping::*;

fn standard(id: u16) -> CanId {
    CanId::standard(id).unwrap()
}

fn extended(id: u32) -> CanId {
    CanId::extended(id).unwrap()
}

/// Writes one image and returns its bytes.
fn image_of(
    direction: Direction,
    profile: PdoProfile,
    fill: impl FnOnce(&mut ImageWriter, &mut [u8]),
) -> Vec<u8> {
    let mut image = vec![0; profile.pdo_bytes()];
    let mut writer = ImageWriter::new(direction, profile);
    fill(&mut writer, &mut image);
    writer.commit(&mut image, CommitFields::default());
    image
}

fn with_options(options: OptionFlags) -> PdoProfile {
    PdoProfile { options, ..PdoProfile::default() }
}

fn timestamped(options: OptionFlags) -> PdoProfile {
    PdoProfile {
        profile: EncapsulationProfile::CompactTimestamped,
        options,
        ..PdoProfile::default()
    }
}

/// Manual 5.4.4.1: one classic frame, 0x123 on channel 0, N = 8, sequence 1.
const FIRST_IMAGE: [u8; 36] = [
    0x16, 0x00, 0x01, 0x00, 0x01, 0x00, 0x0c, 0x00, 0xd3, 0x56, 0xe7, 0x01, 0x0f, 0x01, 0x00, 0x01,
    0, 0, 0, 0, 0, 0, 0, 0, //
    0x40, 0x00, 0x23, 0x01, 0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88,
];
const FIRST_DATA: [u8; 8] = [0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88];

#[test]
fn example_image_of_the_manual_is_written() {
    let image = image_of(Direction::RxPdo, PdoProfile::default(), |writer, image| {
        let frame = FrameRef::classic(standard(0x123), &FIRST_DATA).unwrap();
        assert_eq!(writer.push(image, 0, 0, frame, Timestamp::None), Ok(0));
    });
    assert_eq!(image[..36], FIRST_IMAGE);
    assert_eq!(image[36..], [0; 1024 - 36]);
}

#[test]
fn example_image_of_the_manual_is_read() {
    let mut image = [0; 1024];
    image[..36].copy_from_slice(&FIRST_IMAGE);
    for direction in Direction::ALL {
        let reader = ImageReader::new(direction, PdoProfile::default());
        let received = reader.read(&image).unwrap();
        assert_eq!(received.sequence(), 1);
        assert!(!received.is_incomplete() && !received.layout_changed());
        assert_eq!(received.header().payload_len, 12);
        assert_eq!(received.header().payload_crc16, 0x56D3);
        let packets: Vec<_> = received.packets().map(Result::unwrap).collect();
        assert_eq!(
            packets,
            [Packet::Frame(FramePacket {
                direction,
                channel: 0,
                id_aux: 0,
                frame: FrameRef::classic(standard(0x123), &FIRST_DATA).unwrap(),
                timestamp: Timestamp::None,
                index: 0,
                offset: 24,
            })]
        );
    }
}

/// Manual 5.4.3 and 5.4.4.1.
#[test]
fn profile_words_and_layout_ids() {
    let default = PdoProfile::default();
    assert_eq!((default.word(), default.layout_id()), (0x0000_01E7, 0x01E7));
    let aligned = with_options(OptionFlags::ALIGN4);
    assert_eq!((aligned.word(), aligned.layout_id()), (0x0040_01E7, 0x01A7));
    assert_eq!((default.pdo_bytes(), default.frame_area_bytes()), (1024, 1000));
}

/// Manual 5.2.
#[test]
fn sizes_by_multiplier() {
    for (multiplier, bytes, area) in [
        (1, 128, 104),
        (2, 256, 232),
        (3, 384, 360),
        (6, 768, 744),
        (12, 1536, 1512),
        (24, 3072, 3048),
    ] {
        let profile = PdoProfile { multiplier, ..PdoProfile::default() };
        assert_eq!(profile.pdo_bytes(), bytes);
        assert_eq!(profile.frame_area_bytes(), area);
    }
}

/// Manual 8.3.1, the table of lengths.
#[test]
fn packet_lengths_with_and_without_alignment() {
    let data = [0x5A; 64];
    let rows = [
        (FrameRef::classic(standard(1), &data[..8]).unwrap(), Timestamp::None, 12, 12),
        (FrameRef::classic(extended(1), &data[..8]).unwrap(), Timestamp::None, 14, 16),
        (FrameRef::fd(standard(1), &data, false, false).unwrap(), Timestamp::None, 68, 68),
        (FrameRef::fd(extended(1), &data, false, false).unwrap(), Timestamp::Delta16(7), 72, 72),
    ];
    for (frame, timestamp, raw, aligned) in rows {
        for (options, length) in [(OptionFlags::NONE, raw), (OptionFlags::ALIGN4, aligned)] {
            let image = image_of(Direction::TxPdo, timestamped(options), |writer, image| {
                assert_eq!(writer.packet_bytes(frame, timestamp), length);
                assert_eq!(writer.push(image, 0, 0, frame, timestamp), Ok(0));
            });
            assert_eq!(usize::from(image[6]) | usize::from(image[7]) << 8, length);
            assert_eq!(image[24 + raw..], vec![0; 1000 - raw]);
        }
    }
}

/// Manual 8 and 8.1, one frame with every field of its control word in use.
#[test]
fn frame_with_every_field() {
    let data = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12];
    let frame = FrameRef::fd(extended(0x1ABC_DEF0), &data, true, true).unwrap();
    let image = image_of(Direction::TxPdo, timestamped(OptionFlags::ALIGN4), |writer, image| {
        let pushed = writer.push(image, 3, 2, frame, Timestamp::Delta16(0xBEEF));
        assert_eq!(pushed, Ok(0));
    });
    assert_eq!(
        image[24..44],
        [
            // channel 3, DLC 9, extended; CAN FD, BRS, ESI, delta16
            0xCB, 0x0F, //
            0xF0, 0xDE, 0xBC, 0x5A, // ID_AUX 2 above the 29 bits
            0xEF, 0xBE, //
            1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12,
        ]
    );
    let reader = ImageReader::new(Direction::TxPdo, timestamped(OptionFlags::ALIGN4));
    let Some(Ok(Packet::Frame(packet))) = reader.read(&image).unwrap().packets().next() else {
        panic!("no frame");
    };
    assert_eq!((packet.channel, packet.id_aux), (3, 2));
    assert_eq!(packet.timestamp, Timestamp::Delta16(0xBEEF));
    assert_eq!(packet.frame, frame);
}

#[test]
fn id_aux_is_above_a_standard_id() {
    let image = image_of(Direction::RxPdo, PdoProfile::default(), |writer, image| {
        let frame = FrameRef::classic(standard(0x7FF), &[]).unwrap();
        assert_eq!(writer.push(image, 1, 3, frame, Timestamp::None), Ok(0));
    });
    assert_eq!(image[24..28], [0x01, 0x00, 0xFF, 0x1F]);
}

/// Manual 8.2: a remote frame has a DLC and no data.
#[test]
fn remote_frame_packet() {
    let image = image_of(Direction::RxPdo, PdoProfile::default(), |writer, image| {
        let frame = FrameRef::remote(standard(0x321), Dlc::new(8).unwrap()).unwrap();
        assert_eq!(writer.push(image, 0, 0, frame, Timestamp::None), Ok(0));
    });
    assert_eq!(image[6], 4);
    assert_eq!(image[24..28], [0x40, 0x04, 0x21, 0x03]);
}

/// Manual 8.3: with D64 the data has 64 bytes for every DLC.
#[test]
fn window_of_64_bytes() {
    let profile = PdoProfile { profile: EncapsulationProfile::Window64, ..PdoProfile::default() };
    let frame = FrameRef::fd(standard(0x10), &[0xAB; 12], false, false).unwrap();
    let classic = FrameRef::classic(standard(0x11), &[0xCD]).unwrap();
    let image = image_of(Direction::RxPdo, profile, |writer, image| {
        writer.use_d64(true);
        assert_eq!(writer.push(image, 0, 0, frame, Timestamp::None), Ok(0));
        assert_eq!(writer.push(image, 0, 0, classic, Timestamp::None), Ok(1));
    });
    assert_eq!(image[6], 68 + 5);
    assert_eq!(image[24..28], [0x48, 0x81, 0x10, 0x00]);
    assert_eq!(image[28..40], [0xAB; 12]);
    assert_eq!(image[40..92], [0; 52]);
    assert_eq!(image[92..97], [0x08, 0x00, 0x11, 0x00, 0xCD]);
    let reader = ImageReader::new(Direction::RxPdo, profile);
    let frames: Vec<_> = reader
        .read(&image)
        .unwrap()
        .packets()
        .map(|packet| match packet {
            Ok(Packet::Frame(packet)) => packet.frame,
            other => panic!("{other:?}"),
        })
        .collect();
    assert_eq!(frames, [frame, classic]);
}

/// Manual 8.4 and 13.8: the schedule record instead of a full64 timestamp.
#[test]
fn scheduled_frame_packet() {
    let schedule = Schedule { tag: 0x0102, offset_ns: 100_000 };
    let image = image_of(Direction::RxPdo, PdoProfile::default(), |writer, image| {
        let frame = FrameRef::classic(standard(0x80), &[0x55]).unwrap();
        let pushed = writer.push_scheduled(image, 0, 0, frame, schedule);
        assert_eq!(pushed, Ok(0));
    });
    assert_eq!(
        image[24..37],
        [0x08, 0x18, 0x80, 0x00, 0x01, 0x00, 0x02, 0x01, 0xA0, 0x86, 0x01, 0x00, 0x55]
    );
    let reader = ImageReader::new(Direction::RxPdo, PdoProfile::default());
    let Some(Ok(Packet::Frame(packet))) = reader.read(&image).unwrap().packets().next() else {
        panic!("no frame");
    };
    assert_eq!(packet.schedule(), Some(Ok(schedule)));
}

/// Manual 10; padded to 8 bytes with ALIGN4.
#[test]
fn tx_result_packet() {
    let result =
        TxResult { channel: 2, sequence: 0x1234, frame_index: 7, code: ResultCode::TxFifoFull };
    let raw = [0x02, 0x20, 0x34, 0x12, 0x07, 0x04];
    for (options, length) in
        [(OptionFlags::TX_RESULT, 6), (OptionFlags::TX_RESULT.with(OptionFlags::ALIGN4), 8)]
    {
        let image = image_of(Direction::TxPdo, with_options(options), |writer, image| {
            assert_eq!(writer.push_tx_result(image, &result), Ok(()));
        });
        assert_eq!(image[1], HeaderFlags::TX_RESULT_PRESENT.bits());
        assert_eq!((image[6], image[13]), (length, 1));
        assert_eq!(image[24..30], raw);
        assert_eq!(image[30..34], [0; 4]);
        let reader = ImageReader::new(Direction::TxPdo, with_options(options));
        let packets: Vec<_> = reader.read(&image).unwrap().packets().collect();
        assert_eq!(packets, [Ok(Packet::TxResult(result))]);
    }
}

/// Manual 9.1, bit 2.
#[test]
fn image_without_crc() {
    let image = image_of(Direction::RxPdo, with_options(OptionFlags::NO_CRC16), |writer, image| {
        let frame = FrameRef::classic(standard(0x123), &FIRST_DATA).unwrap();
        assert_eq!(writer.push(image, 0, 0, frame, Timestamp::None), Ok(0));
    });
    // layout word 0x0080_01E7
    let header = [0x16, 0, 1, 0, 1, 0, 12, 0, 0, 0, 0x67, 0x01, 0x0F, 1, 0, 0];
    assert_eq!(image[..16], header);
}

#[test]
fn header_fields_of_the_gateway() {
    let mut image = vec![0; 1024];
    let mut writer = ImageWriter::new(Direction::TxPdo, PdoProfile::default());
    let status = ChannelStatus::default()
        .with_state(ChannelState::Run)
        .with_fd_enabled(true)
        .with_rx_pending(1);
    let fields = CommitFields {
        flags: HeaderFlags::STREAM_TRUNCATED.with(HeaderFlags::STATUS_CHANGED),
        overflow: 9,
        channel_status: [status; 4],
    };
    assert_eq!(writer.commit(&mut image, fields), 1);
    let header = [
        0x16, 0x29, 1, 0, 1, 0, 0, 0, 0xFF, 0xFF, 0xE7, 0x01, 0x0F, 0, 9, 1, //
        0x0A, 0x04, 0x0A, 0x04, 0x0A, 0x04, 0x0A, 0x04,
    ];
    assert_eq!(image[..24], header);
    let reader = ImageReader::new(Direction::TxPdo, PdoProfile::default());
    let received = reader.read(&image).unwrap();
    assert!(received.is_incomplete());
    assert_eq!(received.header().channel_status, [status; 4]);
    assert_eq!(received.packets().count(), 0);
}
