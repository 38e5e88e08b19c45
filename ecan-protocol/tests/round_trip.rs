//! The reader reads what the writer writes, and returns an error for any other bytes.

use ecan_protocol::can::*;
use ecan_protocol::image::*;
use ecan_protocol::mapping::*;
use proptest::prelude::*;

fn can_id() -> impl Strategy<Value = CanId> {
    prop_oneof![
        (0..=0x7FF_u16).prop_map(|id| CanId::standard(id).unwrap()),
        (0..=0x1FFF_FFFF_u32).prop_map(|id| CanId::extended(id).unwrap()),
    ]
}

fn can_frame() -> impl Strategy<Value = CanFrame> {
    let data = prop::array::uniform32(any::<u16>());
    (can_id(), 0..=15_u8, 0..3_u8, any::<(bool, bool)>(), data).prop_map(
        |(id, dlc, kind, (brs, esi), words)| {
            let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
            let fd = Dlc::new(dlc).unwrap();
            let classic = Dlc::new(dlc.min(8)).unwrap();
            match kind {
                0 => CanFrame::classic(id, &bytes[..classic.classic_len()]),
                1 => CanFrame::remote(id, classic),
                _ => CanFrame::fd(id, &bytes[..fd.fd_len()], brs, esi),
            }
            .unwrap()
        },
    )
}

/// A packet as the application pushes it.
#[derive(Clone, Debug)]
enum Item {
    Frame { channel: u8, id_aux: u8, frame: CanFrame, timestamp: Timestamp },
    Result(TxResult),
}

fn timestamp(direction: Direction, profile: EncapsulationProfile) -> BoxedStrategy<Timestamp> {
    match direction {
        Direction::RxPdo => prop_oneof![
            Just(Timestamp::None),
            any::<(u16, u32)>()
                .prop_map(|(tag, offset_ns)| { Schedule { tag, offset_ns }.to_timestamp() }),
        ]
        .boxed(),
        Direction::TxPdo if profile.allows_delta16() => prop_oneof![
            Just(Timestamp::None),
            any::<u16>().prop_map(Timestamp::Delta16),
            any::<u32>().prop_map(Timestamp::Delta32),
            any::<u64>().prop_map(Timestamp::Full64),
        ]
        .boxed(),
        Direction::TxPdo => Just(Timestamp::None).boxed(),
    }
}

fn item(direction: Direction, profile: PdoProfile) -> BoxedStrategy<Item> {
    let channels: Vec<u8> = (0..4).filter(|&c| profile.has_channel(c)).collect();
    let frame = (
        prop::sample::select(channels),
        0..8_u8,
        can_frame(),
        timestamp(direction, profile.profile),
    )
        .prop_map(|(channel, id_aux, frame, timestamp)| Item::Frame {
            channel,
            id_aux,
            frame,
            timestamp,
        });
    let results = direction == Direction::TxPdo && profile.options.contains(OptionFlags::TX_RESULT);
    if !results {
        return frame.boxed();
    }
    let result =
        (0..8_u8, any::<(u16, u8, u8)>()).prop_map(|(channel, (sequence, index, code))| {
            Item::Result(TxResult {
                channel,
                sequence,
                frame_index: index,
                code: ResultCode::from_raw(code),
            })
        });
    prop_oneof![3 => frame, 1 => result].boxed()
}

fn pdo_profile() -> impl Strategy<Value = (Direction, PdoProfile)> {
    (
        prop::sample::select(&Direction::ALL[..]),
        1..=24_u8,
        1..=15_u8,
        prop::sample::select(EncapsulationProfile::ALL),
        0..3_u8,
        0..=0x1F_u8,
    )
        .prop_map(|(direction, multiplier, channel_mask, profile, budget, options)| {
            let profile = PdoProfile {
                multiplier,
                channel_mask,
                profile,
                budget: BudgetPolicy::from_raw(budget).unwrap(),
                options: OptionFlags::from_bits(options).unwrap(),
            };
            (direction, profile)
        })
}

/// A direction, a profile, the use of windows, and the packets of several consecutive images.
fn stream() -> impl Strategy<Value = (Direction, PdoProfile, bool, Vec<Vec<Item>>)> {
    pdo_profile().prop_flat_map(|(direction, profile)| {
        let image = prop::collection::vec(item(direction, profile), 0..60);
        let images = prop::collection::vec(image, 1..4);
        (Just(direction), Just(profile), any::<bool>(), images)
    })
}

/// Pushes one packet.
fn push(writer: &mut ImageWriter, image: &mut [u8], item: &Item) -> Result<(), PushError> {
    match item {
        Item::Frame { channel, id_aux, frame, timestamp } => {
            writer.push(image, *channel, *id_aux, frame.as_ref(), *timestamp).map(|_| ())
        }
        Item::Result(result) => writer.push_tx_result(image, result),
    }
}

/// Pushes what fits and returns it.
fn fill<'i>(writer: &mut ImageWriter, image: &mut [u8], items: &'i [Item]) -> Vec<&'i Item> {
    items
        .iter()
        .filter(|item| match push(writer, image, item) {
            Ok(()) => true,
            Err(PushError::NoRoom { needed, left }) => {
                assert!(needed > left);
                assert_eq!(usize::from(left), writer.room());
                false
            }
            Err(other) => panic!("{other}"),
        })
        .collect()
}

fn assert_same(read: &[Packet<'_>], written: &[&Item]) {
    assert_eq!(read.len(), written.len());
    let mut next_index = 0;
    let mut last_offset = 0;
    for (read, written) in read.iter().zip(written) {
        match (read, written) {
            (Packet::Frame(packet), Item::Frame { channel, id_aux, frame, timestamp }) => {
                assert_eq!(packet.channel, *channel);
                assert_eq!(packet.id_aux, *id_aux);
                assert_eq!(packet.frame.to_owned(), *frame);
                assert_eq!(packet.timestamp, *timestamp);
                assert_eq!(packet.index, next_index);
                assert!(packet.offset > last_offset);
                last_offset = packet.offset;
                next_index += 1;
            }
            (Packet::TxResult(read), Item::Result(written)) => assert_eq!(read, written),
            _ => panic!("{read:?} for {written:?}"),
        }
    }
}

proptest! {
    #[test]
    fn what_is_written_is_read(
        (direction, profile, d64, images) in stream(),
        start in any::<u16>(),
        garbage in any::<u8>(),
    ) {
        let bytes = profile.pdo_bytes();
        let mut image = vec![garbage; bytes + 8];
        let mut writer = ImageWriter::new(direction, profile);
        writer.use_d64(d64);
        writer.set_next_sequence(start);
        let reader = ImageReader::new(direction, profile);
        for (number, items) in images.iter().enumerate() {
            let written = fill(&mut writer, &mut image, items);
            let used = writer.used();
            let sequence = writer.commit(&mut image, CommitFields::default());
            prop_assert_eq!(sequence, start.wrapping_add(number as u16));

            let received = reader.read(&image).unwrap();
            prop_assert_eq!(received.sequence(), sequence);
            prop_assert!(!received.layout_changed());
            prop_assert_eq!(received.payload().len(), used);
            let flags = received.header().flags;
            let results = written.iter().any(|item| matches!(item, Item::Result(_)));
            prop_assert_eq!(flags.contains(HeaderFlags::TX_RESULT_PRESENT), results);
            let wrapped = number > 0 && sequence == 0;
            prop_assert_eq!(flags.contains(HeaderFlags::SEQ_WRAP), wrapped);
            if profile.options.contains(OptionFlags::ALIGN4) {
                prop_assert_eq!(used % 4, 0);
            }
            if !profile.options.contains(OptionFlags::PAYLOAD_ONLY) {
                prop_assert!(image[24 + used..bytes].iter().all(|&byte| byte == 0));
            }
            // The bytes after the image belong to others.
            prop_assert!(image[bytes..].iter().all(|&byte| byte == garbage));
            let read: Vec<_> = reader.read(&image).unwrap().packets().map(Result::unwrap).collect();
            assert_same(&read, &written);
        }
    }

    #[test]
    fn cursor_goes_on_where_it_was_taken((direction, profile, d64, images) in stream()) {
        let mut image = vec![0; profile.pdo_bytes()];
        let mut writer = ImageWriter::new(direction, profile);
        writer.use_d64(d64);
        fill(&mut writer, &mut image, &images[0]);
        writer.commit(&mut image, CommitFields::default());
        let reader = ImageReader::new(direction, profile);
        let received = reader.read(&image).unwrap();
        let at_once: Vec<_> = received.packets().collect();

        let header = *received.header();
        let mut cursor = PacketCursor::default();
        let mut one_by_one = Vec::new();
        loop {
            let mut packets = reader.resume(&image, &header, cursor);
            let Some(packet) = packets.next() else { break };
            one_by_one.push(packet);
            cursor = packets.cursor();
        }
        prop_assert_eq!(one_by_one, at_once);
    }

    #[test]
    fn cursor_in_a_foreign_image_does_no_harm(
        (direction, profile, _, images) in stream(),
        steps in 0..20_usize,
        foreign in prop::collection::vec(any::<u8>(), 0..3200),
    ) {
        let mut image = vec![0; profile.pdo_bytes()];
        let mut writer = ImageWriter::new(direction, profile);
        fill(&mut writer, &mut image, &images[0]);
        writer.commit(&mut image, CommitFields::default());
        let reader = ImageReader::new(direction, profile);
        let received = reader.read(&image).unwrap();
        let mut packets = received.packets();
        for _ in packets.by_ref().take(steps) {}
        let cursor = packets.cursor();

        prop_assert!(reader.resume(&foreign, received.header(), cursor).count() <= 256);
        if let Some(Ok(head)) = foreign.get(..24).map(<&[u8; 24]>::try_from) {
            prop_assert!(reader.resume(&foreign, &Header::parse(head), cursor).count() <= 256);
        }
    }

    #[test]
    fn any_bytes_are_packets_or_an_error(
        (direction, profile) in pdo_profile(),
        crc in any::<bool>(),
        mut image in prop::collection::vec(any::<u8>(), 0..3200),
        settled in any::<bool>(),
    ) {
        if settled && image.len() >= 24 {
            image[0] = VER_IHL;
            image.copy_within(2..4, 4);
            let payload_len = (image.len() as u16 - 24).min(300);
            image[6..8].copy_from_slice(&payload_len.to_le_bytes());
            image[8..10].fill(0);
            image[15] = 0;
        }
        let reader = ImageReader::new(direction, profile).with_crc(crc);
        walk(&reader, &image);
    }

    #[test]
    fn mutated_images_are_packets_or_an_error(
        (direction, profile, d64, images) in stream(),
        mutations in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let mut image = vec![0; profile.pdo_bytes()];
        let mut writer = ImageWriter::new(direction, profile);
        writer.use_d64(d64);
        fill(&mut writer, &mut image, &images[0]);
        let used = writer.used();
        writer.commit(&mut image, CommitFields::default());
        let reader = ImageReader::new(direction, profile);
        for (at, value) in mutations {
            let at = at.index(24 + used);
            image[at] = value;
            walk(&reader, &image);
            // The same with a CRC that matches, so that the packets are reached.
            let payload_len = usize::from(u16::from_le_bytes([image[6], image[7]]));
            if let (1, Some(payload)) = (image[15], image[24..].get(..payload_len)) {
                let crc = crc16_portable(payload);
                image[8..10].copy_from_slice(&crc.to_le_bytes());
            }
            walk(&reader, &image);
        }
    }

    #[test]
    fn single_flipped_bit_of_the_payload_is_found(
        (direction, profile, d64, images) in stream(),
        at in any::<prop::sample::Index>(),
        bit in 0..8_u8,
    ) {
        let profile = PdoProfile {
            options: profile.options.without(OptionFlags::NO_CRC16),
            ..profile
        };
        let mut image = vec![0; profile.pdo_bytes()];
        let mut writer = ImageWriter::new(direction, profile);
        writer.use_d64(d64);
        fill(&mut writer, &mut image, &images[0]);
        prop_assume!(writer.used() > 0);
        let at = 24 + at.index(writer.used());
        writer.commit(&mut image, CommitFields::default());
        image[at] ^= 1 << bit;
        let diagnosis = ImageReader::new(direction, profile).read(&image).unwrap_err();
        prop_assert_eq!(diagnosis.pdo_error(), Some(PdoError::BadCrc));
    }
}

/// Reads to the end and checks the properties of every image.
fn walk(reader: &ImageReader, image: &[u8]) {
    let received = match reader.read(image) {
        Ok(received) => received,
        Err(diagnosis) => {
            assert_eq!(diagnosis.offset, 0);
            assert!(!diagnosis.to_string().is_empty());
            return;
        }
    };
    let mut packets = received.packets();
    let mut count = 0;
    for packet in packets.by_ref() {
        match packet {
            Ok(Packet::Frame(packet)) => {
                assert!(reader.profile().has_channel(packet.channel));
                let frame = packet.frame;
                // A frame that is read can be created: it satisfies every rule of CAN.
                let again = match frame.kind() {
                    FrameKind::Data => FrameRef::classic(frame.id(), frame.data()),
                    FrameKind::Remote => FrameRef::remote(frame.id(), frame.dlc()),
                    FrameKind::Fd { brs, esi } => FrameRef::fd(frame.id(), frame.data(), brs, esi),
                };
                assert_eq!(again, Ok(frame));
                count += 1;
            }
            Ok(Packet::TxResult(result)) => {
                assert_eq!(reader.direction(), Direction::TxPdo);
                assert!(result.channel < 8);
                count += 1;
            }
            Err(diagnosis) => {
                assert!(diagnosis.pdo_error().is_some());
                assert!(usize::from(diagnosis.offset) >= HEADER_BYTES);
                assert!(!diagnosis.to_string().is_empty());
                assert!(packets.next().is_none());
                return;
            }
        }
    }
    assert_eq!(count, received.header().frame_count);
}
