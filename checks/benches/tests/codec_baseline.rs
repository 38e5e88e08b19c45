//! The baseline of the benchmarks does the same work as this codec: it writes the same bytes and
//! reads the same packets.

#[path = "../benches/codec/pair.rs"]
mod pair;

use ecan_bench::baseline;
use ecan_protocol::image::*;
use ecan_protocol::mapping::*;
use pair::Random;

const STREAMS: u64 = 1500;

fn any_profile(random: &mut Random) -> (Direction, PdoProfile) {
    let direction = Direction::ALL[random.below(2) as usize];
    let profile = PdoProfile {
        multiplier: random.below(24) as u8 + 1,
        channel_mask: random.below(15) as u8 + 1,
        profile: EncapsulationProfile::ALL[random.below(4) as usize],
        // The baseline always clears everything.
        options: OptionFlags::from_bits(random.below(16) as u8).unwrap(),
        ..PdoProfile::default()
    };
    (direction, profile)
}

/// The timestamp in the type of this codec.
fn timestamp(frame: &baseline::Frame<'_>) -> Timestamp {
    match frame.timestamp_format() {
        0 => Timestamp::None,
        1 => Timestamp::Delta16(frame.timestamp as u16),
        2 => Timestamp::Delta32(frame.timestamp as u32),
        _ => Timestamp::Full64(frame.timestamp),
    }
}

/// Pushes a frame to both; false if it does not fit.
fn push(
    (rust, image): (&mut ImageWriter, &mut [u8]),
    (c, c_image): (&mut baseline::Writer, &mut [u8]),
    frame: &baseline::Frame<'_>,
) -> bool {
    let pushed =
        rust.push(image, frame.channel, frame.id_aux, pair::frame(frame), timestamp(frame));
    let c_pushed = c.push(c_image, frame);
    match pushed {
        Ok(index) => assert_eq!(c_pushed, i32::from(index)),
        Err(PushError::NoRoom { .. }) => assert_eq!(c_pushed, -1),
        Err(PushError::TooManyPackets) => assert_eq!(c_pushed, -2),
        Err(PushError::Channel { .. }) => assert_eq!(c_pushed, -3),
        Err(PushError::Timestamp { .. }) => assert_eq!(c_pushed, -5),
        Err(other) => panic!("{other}"),
    }
    !matches!(pushed, Err(PushError::NoRoom { .. } | PushError::TooManyPackets))
}

/// Both read the same packets, up to the same fault if there is one.
fn assert_same_reading(reader: &ImageReader, c: &mut baseline::Reader, image: &[u8]) -> usize {
    let (Ok(received), Some((c_packets, c_whole))) = (reader.read(image), c.read(image)) else {
        assert_eq!(reader.read(image).is_err(), c.read(image).is_none());
        assert_eq!(c.decode(image), 0);
        return 0;
    };
    let packets: Vec<_> = received.packets().map_while(Result::ok).collect();
    assert_eq!(received.packets().all(|packet| packet.is_ok()), c_whole);
    assert_eq!(packets.len(), c_packets.len());
    let mut sum = 0;
    for (packet, c_packet) in packets.iter().zip(&c_packets) {
        match (packet, c_packet) {
            (Packet::Frame(packet), baseline::Packet::Frame(frame, index)) => {
                assert_eq!(packet.frame, pair::frame(frame));
                assert_eq!(packet.timestamp, timestamp(frame));
                assert_eq!((packet.channel, packet.id_aux), (frame.channel, frame.id_aux));
                assert_eq!(packet.index, *index);
                let data = packet.frame.data();
                sum += u64::from(packet.channel)
                    + u64::from(packet.frame.id().raw())
                    + data.len() as u64
                    + u64::from(data.first().copied().unwrap_or(0));
            }
            (Packet::TxResult(result), baseline::Packet::TxResult(c_result)) => {
                let TxResult { channel, sequence, frame_index, code } = *result;
                let same =
                    baseline::TxResult { channel, sequence, index: frame_index, code: code.raw() };
                assert_eq!(*c_result, same);
            }
            _ => panic!("{packet:?}, {c_packet:?}"),
        }
    }
    assert_eq!(c.decode(image), sum);
    packets.len()
}

#[test]
fn both_codecs_write_and_read_the_same() {
    let mut read = 0;
    for seed in 0..STREAMS {
        let mut random = Random(seed);
        let (direction, profile) = any_profile(&mut random);
        let c_profile = pair::profile(direction, &profile);
        let results =
            direction == Direction::TxPdo && profile.options.contains(OptionFlags::TX_RESULT);
        let windows = c_profile.windows && random.chance(2);
        let (mut image, mut c_image) = ([0xA5; 3072], [0xA5; 3072]);
        let start = 0xFFFE_u16.wrapping_add(random.below(3) as u16);
        let mut writer = ImageWriter::new(direction, profile);
        writer.set_next_sequence(start);
        writer.use_d64(windows);
        let mut c_writer = baseline::Writer::new(&c_profile, start);
        let reader = ImageReader::new(direction, profile);
        let mut c_reader = baseline::Reader::new(&c_profile);

        for _ in 0..4 {
            c_writer.begin(&mut c_image);
            for _ in 0..random.below(300) {
                if results && random.chance(4) {
                    let code = ResultCode::from_raw(random.below(8) as u8);
                    let result = TxResult {
                        channel: random.below(8) as u8,
                        sequence: random.bits() as u16,
                        frame_index: random.bits() as u8,
                        code,
                    };
                    let c_result = baseline::TxResult {
                        channel: result.channel,
                        sequence: result.sequence,
                        index: result.frame_index,
                        code: code.raw(),
                    };
                    let pushed = writer.push_tx_result(&mut image, &result);
                    let c_pushed = c_writer.push_tx_result(&mut c_image, &c_result);
                    assert_eq!(pushed.is_ok(), c_pushed == 0);
                    continue;
                }
                let mut data = [0; 64];
                data.fill_with(|| random.bits() as u8);
                let mut frame = random.frame(&data);
                if windows && frame.flags() & baseline::FD != 0 {
                    let (id, flags) = (frame.id, frame.flags() | baseline::WINDOW);
                    let place = (frame.channel, frame.id_aux);
                    frame = baseline::Frame::new(id, flags, frame.dlc(), &data);
                    (frame.channel, frame.id_aux) = place;
                }
                if random.chance(4) {
                    let value = match random.below(4) {
                        1 => random.bits() & 0xFFFF,
                        2 => random.bits() & 0xFFFF_FFFF,
                        _ => random.bits() & !0xFFFF | 1,
                    };
                    let format = match value {
                        0..=0xFFFF => 1,
                        0x1_0000..=0xFFFF_FFFF => 2,
                        _ => 3,
                    };
                    frame = frame.with_timestamp(format, value);
                }
                let both = ((&mut writer, &mut image[..]), (&mut c_writer, &mut c_image[..]));
                if !push(both.0, both.1, &frame) {
                    break;
                }
            }
            let sequence = writer.commit(&mut image, CommitFields::default());
            assert_eq!(c_writer.commit(&mut c_image), sequence);
            let bytes = profile.pdo_bytes();
            assert_eq!(image[..bytes], c_image[..bytes], "seed {seed}");
            read += assert_same_reading(&reader, &mut c_reader, &image);

            // A wrong byte; then one in a payload whose CRC matches, so that packets are reached.
            let at = random.below(bytes as u64) as usize;
            let mut wrong = image;
            wrong[at] ^= 1 << random.below(8);
            assert_same_reading(&reader, &mut c_reader, &wrong);
            let payload_len = usize::from(u16::from_le_bytes([wrong[6], wrong[7]]));
            if let (1, Some(payload)) = (wrong[15], wrong[24..].get(..payload_len)) {
                let crc = crc16(payload).to_le_bytes();
                wrong[8..10].copy_from_slice(&crc);
                assert_same_reading(&reader, &mut c_reader, &wrong);
            }
        }
    }
    // Most packets are read again: the mix is not rejected as a whole.
    assert!(read > 100_000, "{read}");
}

#[test]
fn crc_is_equal_for_every_length() {
    let mut random = Random(1);
    let data: Vec<u8> = (0..3048).map(|_| random.bits() as u8).collect();
    for length in (0..300).chain([512, 1511, 1512, 1513, 3047, 3048]) {
        assert_eq!(baseline::crc16(&data[..length]), crc16(&data[..length]), "{length}");
        assert_eq!(baseline::crc16(&data[..length]), crc16_portable(&data[..length]), "{length}");
    }
}
