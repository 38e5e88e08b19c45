//! Dissection of captures by tshark. Skipped without tshark.

use ecan_can_io::capture::{Capture, ErrorFrame, ImageOrigin, Traffic};
use ecan_protocol::can::{CanFrame, CanId, Dlc, FrameRef};
use ecan_protocol::image::{
    ChannelState, ChannelStatus, CommitFields, EncapsulationProfile, ImageWriter, OptionFlags,
    PdoProfile, ResultCode, Schedule, Timestamp, TxResult,
};
use ecan_protocol::mapping::Direction;
use ecan_test_support::fields_of;

const DISSECTOR: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../packaging/wireshark/ecan_pdo.lua");
const TIME_NS: u64 = 1_700_000_000_123_456_789;

/// Manual 5.4.4.1: one classic frame, 0x123 on channel 0, N = 8, sequence 1.
const MANUALS_IMAGE: [u8; 36] = [
    0x16, 0x00, 0x01, 0x00, 0x01, 0x00, 0x0c, 0x00, 0xd3, 0x56, 0xe7, 0x01, 0x0f, 0x01, 0x00, 0x01,
    0, 0, 0, 0, 0, 0, 0, 0, //
    0x40, 0x00, 0x23, 0x01, 0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88,
];

/// The fields of each packet of a capture, with `|` between and commas between those of one name;
/// `None` without tshark. The names have blanks between them.
fn fields(names: &str, fill: impl FnOnce(&mut Capture<Vec<u8>>)) -> Option<Vec<String>> {
    let mut capture = Capture::new(Vec::new(), "test").unwrap();
    fill(&mut capture);
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("capture.pcapng");
    std::fs::write(&path, capture.finish().unwrap()).unwrap();
    fields_of(&path, DISSECTOR, "frame", &names.split(' ').collect::<Vec<_>>())
}

fn image_fields(
    names: &str,
    direction: Direction,
    profile: PdoProfile,
    image: &[u8],
) -> Option<String> {
    fields_of_images(names, direction, profile, &[image.to_vec()])?.pop()
}

/// The fields of each image. A run of tshark takes a second.
fn fields_of_images(
    names: &str,
    direction: Direction,
    profile: PdoProfile,
    images: &[Vec<u8>],
) -> Option<Vec<String>> {
    let origin = ImageOrigin { slave: 3, direction, profile };
    let lines = fields(names, |capture| {
        images.iter().for_each(|image| capture.image(TIME_NS, &origin, image).unwrap());
    })?;
    assert_eq!(lines.len(), images.len(), "{lines:?}");
    Some(lines)
}

fn manuals_image() -> Vec<u8> {
    let mut image = MANUALS_IMAGE.to_vec();
    image.resize(1024, 0);
    image
}

fn standard(id: u16) -> CanId {
    CanId::standard(id).unwrap()
}

#[test]
fn image_of_the_manual_is_dissected() {
    let names = "_ws.col.Protocol _ws.col.Info frame.time_epoch frame.interface_name \
                 ecan_pdo.direction ecan_pdo.slave ecan_pdo.profile.n ecan_pdo.version \
                 ecan_pdo.ihl ecan_pdo.flags ecan_pdo.seq_begin ecan_pdo.seq_end \
                 ecan_pdo.payload_len ecan_pdo.payload_crc16 ecan_pdo.layout_id \
                 ecan_pdo.channel_mask ecan_pdo.frame_count ecan_pdo.crc_alg ecan_pdo.ctrl \
                 ecan_pdo.channel ecan_pdo.dlc ecan_pdo.id ecan_pdo.data _ws.expert";
    let profile = PdoProfile::default();
    let Some(line) = image_fields(names, Direction::RxPdo, profile, &manuals_image()) else {
        return;
    };
    let expected = "ECAN-PDO|RxPDO slave 3, sequence 1  0:123#1122334455667788|\
                    1700000000.123456789|ecan3|0|3|7|1|6|0x00|1|1|12|0x56d3|0x01e7|0x0f|1|1|\
                    0x0040|0|8|0x00000123|1122334455667788|";
    assert_eq!(line, expected);
}

#[test]
fn all_packet_forms_are_dissected() {
    let profile = PdoProfile {
        profile: EncapsulationProfile::Window64Timestamped,
        options: OptionFlags::TX_RESULT.with(OptionFlags::ALIGN4),
        ..PdoProfile::default()
    };
    let mut image = vec![0; profile.pdo_bytes()];
    let mut writer = ImageWriter::new(Direction::TxPdo, profile);
    let extended = CanId::extended(0x1234_5678).unwrap();
    let frames = [
        (FrameRef::classic(extended, &[1, 2, 3]).unwrap(), 0, Timestamp::Delta16(0x1234)),
        (FrameRef::remote(standard(0x7FF), Dlc::new(4).unwrap()).unwrap(), 1, Timestamp::None),
        (FrameRef::fd(standard(1), &[9; 12], true, true).unwrap(), 2, Timestamp::None),
    ];
    for (frame, channel, timestamp) in frames {
        writer.push(&mut image, channel, 0, frame, timestamp).unwrap();
    }
    writer.use_d64(true);
    let frame = FrameRef::fd(standard(2), &[8; 16], false, false).unwrap();
    writer.push(&mut image, 3, 0, frame, Timestamp::None).unwrap();
    let result =
        TxResult { channel: 3, sequence: 777, frame_index: 5, code: ResultCode::TxFifoFull };
    writer.push_tx_result(&mut image, &result).unwrap();
    let mut commit = CommitFields::default();
    commit.channel_status[1] = ChannelStatus::default()
        .with_state(ChannelState::BusOff)
        .with_bus_off(true)
        .with_tx_pending(6);
    writer.commit(&mut image, commit);

    let names = "ecan_pdo.channel ecan_pdo.kind ecan_pdo.id ecan_pdo.dlc ecan_pdo.d64 \
                 ecan_pdo.data ecan_pdo.time.delta16 ecan_pdo.result.sequence \
                 ecan_pdo.result.frame ecan_pdo.result.code ecan_pdo.status.state \
                 ecan_pdo.status.tx_pending _ws.expert.message";
    let Some(line) = image_fields(names, Direction::TxPdo, profile, &image) else { return };
    let columns: Vec<_> = line.split('|').collect();
    let data = ["010203", &"09".repeat(12), &"08".repeat(16)].join(",");
    let expected = [
        "0,1,2,3,3",
        "0,0,0,0,1",
        "0x12345678,0x000007ff,0x00000001,0x00000002",
        "3,4,9,10",
        "0,0,0,1",
        &data,
        "4660",
        "777",
        "5",
        "4",
        "0,3,0,0",
        "0,6,0,0",
        "The channel is bus-off,The gateway has rejected the frame",
    ];
    assert_eq!(columns, expected);
}

#[test]
fn scheduled_frames_show_their_phase() {
    let profile = PdoProfile::default();
    let mut image = vec![0; profile.pdo_bytes()];
    let mut writer = ImageWriter::new(Direction::RxPdo, profile);
    let frame = FrameRef::classic(standard(0x321), &[1, 2]).unwrap();
    let schedule = Schedule { tag: 77, offset_ns: 250_000 };
    writer.push_scheduled(&mut image, 1, 1, frame, schedule).unwrap();
    writer.commit(&mut image, CommitFields::default());
    let names = "ecan_pdo.schedule.format ecan_pdo.schedule.tag ecan_pdo.schedule.offset_ns \
                 ecan_pdo.id ecan_pdo.id_aux_tx ecan_pdo.data _ws.expert";
    let Some(line) = image_fields(names, Direction::RxPdo, profile, &image) else { return };
    assert_eq!(line, "1|77|250000|0x00000321|1|0102|");
}

#[test]
fn damaged_images_are_marked() {
    let damages: [(&str, &[(usize, u8)]); 8] = [
        ("Not a fixed header of version 1 with 24 bytes", &[(0, 0x26)]),
        ("The sequences differ: torn image, not valid", &[(4, 2)]),
        ("The payload is longer than the frame area", &[(7, 4)]),
        ("The CRC of the payload is wrong", &[(28, 0)]),
        ("The CRC algorithm does not match the profile", &[(15, 0)]),
        ("The layout does not match the profile", &[(10, 0)]),
        ("The number of packets does not match the header", &[(13, 2)]),
        ("The data of this cycle are incomplete", &[(14, 1)]),
    ];
    let images = damages.map(|(_, bytes)| {
        let mut image = manuals_image();
        bytes.iter().for_each(|(place, byte)| image[*place] = *byte);
        image
    });
    let (names, profile) = ("_ws.expert.message", PdoProfile::default());
    let Some(lines) = fields_of_images(names, Direction::TxPdo, profile, &images) else { return };
    assert_eq!(lines, damages.map(|(message, _)| message));
    // Shorter than it says, by and by down to nothing: never an error of the script.
    let image = manuals_image();
    let profile = PdoProfile::default();
    let origin = ImageOrigin { slave: 0, direction: Direction::RxPdo, profile };
    let lengths = [0, 1, 23, 24, 25, 35];
    let Some(lines) = fields("_ws.expert.message _ws.lua.text", |capture| {
        for length in lengths {
            capture.image(TIME_NS, &origin, &image[..length]).unwrap();
        }
    }) else {
        return;
    };
    assert_eq!(lines, ["The image is truncated|"; 6]);
}

#[test]
fn unreadable_packets_are_marked() {
    // Without a CRC the content can be anything: a reserved kind, a frame without its end.
    let profile = PdoProfile { options: OptionFlags::NO_CRC16, ..PdoProfile::default() };
    let controls = [
        (0x6000_u16, "Unknown packet kind"),
        (0x4000, "Unknown packet kind"),
        (0x0178, "The packet exceeds the payload"),
    ];
    let images = controls.map(|(control, _)| {
        let mut image = manuals_image();
        image[8..12].copy_from_slice(&[0, 0, 0, 0]);
        image[10..12].copy_from_slice(&profile.layout_id().to_le_bytes());
        image[13] = 0;
        image[15] = 0;
        image[24..26].copy_from_slice(&control.to_le_bytes());
        image
    });
    let names = "_ws.expert.message ecan_pdo.data";
    let Some(lines) = fields_of_images(names, Direction::TxPdo, profile, &images) else { return };
    assert_eq!(lines, controls.map(|(_, message)| format!("{message}|")));
}

#[test]
fn can_frames_are_dissected() {
    let extended = CanId::extended(0x1234_5678).unwrap();
    let names = "frame.interface_name frame.packet_flags_direction _ws.col.Protocol can.id \
                 can.flags.xtd can.flags.rtr can.flags.err can.len canfd.flags.brs \
                 canfd.flags.esi data.data can.err.busoff";
    let Some(lines) = fields(names, |capture| {
        let frames = [
            CanFrame::classic(standard(0x123), &[0xAA, 0xBB]).unwrap(),
            CanFrame::remote(extended, Dlc::new(4).unwrap()).unwrap(),
            CanFrame::fd(standard(1), &[7; 12], true, false).unwrap(),
        ];
        for frame in &frames {
            capture.frame(TIME_NS, 2, Traffic::Received, frame).unwrap();
        }
        capture.frame(TIME_NS, 1, Traffic::Sent, &frames[0]).unwrap();
        capture.error(TIME_NS, 0, &ErrorFrame::new(0x40, [0; 8])).unwrap();
    }) else {
        return;
    };
    let expected = [
        "can2|0x00000001|CAN|291|0|0|0|2|||aabb|",
        "can2|0x00000001|CAN|305419896|1|1|0|4||||",
        "can2|0x00000001|CANFD|1|0|||12|1|0|070707070707070707070707|",
        "can1|0x00000002|CAN|291|0|0|0|2|||aabb|",
        "can0|0x00000001|CAN||||1|8||||1",
    ];
    assert_eq!(lines, expected);
}
