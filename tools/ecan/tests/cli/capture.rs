//! `--capture` of the commands that carry frames: what other programs read in the file.

use std::path::Path;

use ecan_test_support::fields_of;

use crate::support::client::Client;
use crate::support::{Running, Scenario, assert_has, fails};

const DISSECTOR: &str =
    concat!(env!("CARGO_MANIFEST_DIR"), "/../../packaging/wireshark/ecan_pdo.lua");

/// Milliseconds, frame.
const FRAMES: [(u64, &str); 4] = [
    (0, "123#DEADBEEF"),
    (500, "12345678#R4"),
    (600, "7FF#1122334455667788"),
    (700, "111##1AABBCCDDEEFF001122334455"),
];

fn bus() -> Scenario {
    Scenario::replaying(&FRAMES, "")
}

/// The blocks of a capture: type, and what is between the two lengths.
fn blocks(mut file: &[u8]) -> Vec<(u32, Vec<u8>)> {
    let number = |bytes: &[u8]| u32::from_le_bytes(bytes[..4].try_into().unwrap());
    let mut blocks = Vec::new();
    while !file.is_empty() {
        let length = number(&file[4..]) as usize;
        assert_eq!(number(&file[length - 4..]) as usize, length);
        blocks.push((number(file), file[8..length - 4].to_vec()));
        file = &file[length..];
    }
    blocks
}

/// The CAN frames of a capture in their order: whether they were sent, identifier, data.
fn frames(path: &str) -> Vec<(bool, u32, Vec<u8>)> {
    let packets = blocks(&std::fs::read(path).unwrap()).into_iter().filter(|(kind, _)| *kind == 6);
    let frame = |(_, block): (u32, Vec<u8>)| {
        let number = |at: usize| u32::from_le_bytes(block[at..at + 4].try_into().unwrap());
        let length = number(12) as usize;
        let packet = &block[20..20 + length];
        // The option behind the packet: flags, four bytes, of which two bits are the direction.
        let option = 20 + length.next_multiple_of(4);
        assert_eq!(block[option..option + 4], [2, 0, 4, 0]);
        let is_sent = match number(option + 4) {
            1 => false,
            2 => true,
            flags => panic!("{flags}"),
        };
        let id = u32::from_be_bytes(packet[..4].try_into().unwrap());
        (is_sent, id, packet[8..].to_vec())
    };
    packets.map(frame).collect()
}

/// Fields of the packets that a display filter passes; `None` without tshark.
fn tshark(bus: &Scenario, filter: &str, names: &[&str]) -> Option<Vec<String>> {
    fields_of(Path::new(&bus.path("out.pcapng")), DISSECTOR, filter, names)
}

#[test]
fn capture_has_received_frames() {
    let bus = bus();
    let path = bus.path("out.pcapng");
    let fd = ["--data-bitrate", "2000000"];
    let shown = bus.good(&[&["dump", "-n", "4", "--capture", &path][..], &fd].concat());
    assert_eq!(shown, "");
    let blocks = blocks(&std::fs::read(&path).unwrap());
    let types: Vec<_> = blocks.iter().map(|(block_type, _)| *block_type).collect();
    assert_eq!(types, [0x0A0D_0D0A, 1, 6, 6, 6, 6]);
    // Interface, time, both lengths, then the frame.
    let frame: &[u8] = &[0, 0, 1, 0x23, 4, 0, 0, 0, 0xDE, 0xAD, 0xBE, 0xEF];
    assert_eq!(&blocks[2].1[20..32], frame);
    assert_eq!(&blocks[3].1[20..28], [0xD2, 0x34, 0x56, 0x78, 4, 0, 0, 0]);

    let names = ["frame.interface_name", "frame.time_relative", "can.id", "data.data"];
    let Some(lines) = tshark(&bus, "can || canfd", &names) else { return };
    let expected = [
        "can0|0.000000000|291|deadbeef",
        "can0|0.500000000|305419896|",
        "can0|0.600000000|2047|1122334455667788",
        "can0|0.700000000|273|aabbccddeeff001122334455",
    ];
    assert_eq!(lines, expected);
}

#[test]
fn capture_uses_filters_and_screen_of_dump() {
    let bus = bus();
    let path = bus.path("out.pcapng");
    let log = bus.path("out.log");
    let shown =
        bus.good(&["dump", "-n", "1", "--capture", &path, "-l", &log, "--screen", "7FF:7FF"]);
    assert_eq!(shown, "  can0  7FF   [8]  11 22 33 44 55 66 77 88\n");
    assert!(bus.read("out.log").ends_with("can0 7FF#1122334455667788\n"));
    assert_eq!(blocks(&std::fs::read(&path).unwrap()).len(), 3);
}

#[test]
fn capture_has_images_of_both_directions() {
    let bus = bus();
    let path = bus.path("out.pcapng");
    bus.good(&["dump", "-n", "1", "--pdo-n", "2", "--capture", &path, "--images"]);
    // Each image is there once: 16 bytes of the capture, 256 of the gateway, which begin so.
    let file = std::fs::read(&path).unwrap();
    let images: Vec<_> = blocks(&file)
        .into_iter()
        .filter(|(block_type, block)| *block_type == 6 && block[12..16] == 272_u32.to_le_bytes())
        .map(|(_, block)| block[20..][..272].to_vec())
        .collect();
    for direction in [0, 1] {
        let headers: Vec<_> = images
            .iter()
            .filter(|image| image[6] == direction)
            .map(|image| image[16..40].to_vec())
            .collect();
        assert!(headers.len() > 1000, "{}", headers.len());
        assert!(headers.windows(2).all(|pair| pair[0] != pair[1]));
        assert!(headers.iter().all(|header| header[0] == 0x16));
    }

    let names = ["ecan_pdo.direction", "ecan_pdo.profile.n", "ecan_pdo.id", "ecan_pdo.data"];
    let Some(lines) = tshark(&bus, "ecan_pdo.frame_count > 0", &names) else { return };
    assert_eq!(lines, ["1|1|0x00000123|deadbeef"]);
    // Header, CRC and layout of every image are right.
    let wrong = tshark(&bus, "ecan_pdo && _ws.expert", &["_ws.expert.message"]).unwrap();
    assert_eq!(wrong, Vec::<String>::new());
}

#[test]
fn bus_off_is_captured_as_error_frame() {
    let fault = "[[fault]]\nat_ms = 7000\nkind = \"bus_off\"\ngateway = 0\nchannel = 0\n";
    let bus = Scenario::replaying(&FRAMES, fault);
    let path = bus.path("out.pcapng");
    let output = bus.run(&["dump", "--channel", "0", "-T", "9000", "--capture", &path]);
    assert!(String::from_utf8(output.stderr).unwrap().contains(") can0: bus-off"));
    let is_bus_off = |block: &[u8]| block[20..28] == [0x20, 0, 0, 0x40, 8, 0, 0, 0];
    let blocks = blocks(&std::fs::read(&path).unwrap());
    assert!(blocks.iter().any(|(block_type, block)| *block_type == 6 && is_bus_off(block)));
}

#[test]
fn capture_has_sent_and_received_frames() {
    let bus = Scenario::new("[[node]]\nkind = \"echo\"\nbus = \"0.0\"\n");
    let path = bus.path("out.pcapng");
    bus.good(&["send", "123#DEADBEEF", "12345678#R2", "--capture", &path, "--images"]);
    let can = "can && !ecan_pdo";
    let names = ["frame.interface_name", "frame.packet_flags_direction", "can.id", "data.data"];
    if let Some(lines) = tshark(&bus, can, &names) {
        // Some releases write the flags as hexadecimal numbers.
        let lines: Vec<_> = lines.iter().map(|line| line.replace("0x0000000", "")).collect();
        let sent = ["can0|2|291|deadbeef", "can0|2|305419896|"];
        assert_eq!(lines, [sent, ["can0|1|291|deadbeef", "can0|1|305419896|"]].concat());
        // The gateway got them in an image.
        let names = ["ecan_pdo.direction", "ecan_pdo.id"];
        let images = tshark(&bus, "ecan_pdo.direction == 0 && ecan_pdo.id", &names).unwrap();
        assert_eq!(images, ["0|0x00000123,0x12345678"]);
    }

    bus.good(&[
        "gen",
        "-n",
        "50",
        "-g",
        "1",
        "-I",
        "i",
        "-L",
        "8",
        "-D",
        "i",
        "--capture",
        &path,
        "--force",
    ]);
    let (sent, came): (Vec<_>, Vec<_>) =
        frames(&path).into_iter().partition(|(is_sent, ..)| *is_sent);
    let expected: Vec<_> =
        (0..50_u64).map(|number| (true, number as u32, number.to_le_bytes().to_vec())).collect();
    assert_eq!(sent, expected);
    let echo: Vec<_> = expected.into_iter().map(|(_, id, data)| (false, id, data)).collect();
    // The last ones may still be on their way.
    assert!(came.len() > 40 && echo.starts_with(&came), "{came:?}");
}

#[test]
fn capture_has_replayed_frames_and_echo() {
    let bus = Scenario::new("[[node]]\nkind = \"echo\"\nbus = \"0.2\"\n");
    let log = bus.write(
        "drive.log",
        "(1.000000) can2 123#01\n(1.100000) can2 124#02\n(2.000000) can2 125#\n",
    );
    let path = bus.path("out.pcapng");
    bus.good(&["replay", &log, "--channel", "2", "--capture", &path]);
    let frame = |is_sent, id, data: &[u8]| (is_sent, id, data.to_vec());
    let expected = [(0x123, &[1][..]), (0x124, &[2]), (0x125, &[])]
        .map(|(id, data)| [frame(true, id, data), frame(false, id, data)]);
    let frames = frames(&path);
    assert!(expected.concat().starts_with(&frames) && frames.len() >= 5, "{frames:?}");
    // An interface is described with its first packet: there is only the one of the channel.
    let interfaces = blocks(&std::fs::read(&path).unwrap());
    let interfaces: Vec<_> = interfaces.into_iter().filter(|(kind, _)| *kind == 1).collect();
    assert_eq!((interfaces.len(), &interfaces[0].1[12..16]), (1, &b"can2"[..]));
}

#[test]
fn rejected_frame_is_not_captured() {
    // Nobody acknowledges: the gateway takes what its channel holds, and no more.
    let alone = Scenario::new("");
    let path = alone.path("out.pcapng");
    let arguments =
        ["gen", "--seed", "1", "-n", "1000", "-g", "0", "--timeout", "300", "--capture", &path];
    let output = alone.run(&[&arguments[..], &["--json"]].concat());
    assert_eq!(output.status.code(), Some(1));
    let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let tried = summary["frames"].as_u64().unwrap();
    let taken = frames(&path).iter().filter(|(is_sent, ..)| *is_sent).count() as u64;
    assert!(taken > 0 && taken <= tried && tried < 1000, "{taken} of {tried}");
}

#[test]
fn bridge_captures_both_directions() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("out.pcapng").display().to_string();
    let mut bridge = Running::start(&["--ecrt", "sim", "bridge", "--capture", &path]);
    let line = bridge.line();
    let mut client = Client::connect(line.split(' ').nth(3).unwrap());
    client.say("S6\rO\rt1232AABB\r");
    // Its own frame is echoed by the node.
    client.expect("\r\rz\rt1232AABB\r");
    bridge.end();
    let expected = [true, false].map(|is_sent| (is_sent, 0x123, vec![0xAA, 0xBB]));
    assert_eq!(frames(&path), expected);
}

#[test]
fn invalid_use_is_reported() {
    assert_has(&fails(2, &["--ecrt", "sim", "dump", "--images"]), "--capture <FILE>");
    let message = fails(2, &["--ecrt", "sim", "dump", "--screen"]);
    assert!(
        message.contains("--record <FILE>") && message.contains("--capture <FILE>"),
        "{message}"
    );
    let message = fails(2, &["--ecrt", "sim", "dump", "--record", "x", "--capture", "x"]);
    assert_eq!(message, "ecan: --record and --capture name the same file");
    let bus = bus();
    let log = bus.write("drive.log", "(1.000000) can0 123#01\n");
    let message = bus.fails(2, &["replay", &log, "--capture", &log]);
    assert!(message.contains("--capture would overwrite the recording"), "{message}");
    let message = bus.fails(2, &["replay", &log, "--record", "x", "--capture", "x"]);
    assert_eq!(message, "ecan: --record and --capture name the same file");
    let commands: [&[&str]; 3] = [&["send", "123#"], &["gen", "-n", "9"], &["replay", &log]];
    for command in commands {
        let message = bus.fails(6, &[command, &["--capture", "/dev/full"]].concat());
        assert_eq!(message, "ecan: cannot write /dev/full: No space left on device (os error 28)");
    }
    let path = bus.path("none/out.pcapng");
    let message = bus.fails(6, &["dump", "-n", "1", "--capture", &path]);
    assert_eq!(
        message,
        format!("ecan: cannot write {path}: No such file or directory (os error 2)")
    );
    let message = bus.fails(6, &["dump", "-T", "9000", "--capture", "/dev/full", "--images"]);
    assert_eq!(message, "ecan: cannot write /dev/full: No space left on device (os error 28)");
}
