//! Golden lines, and properties of all lines.

use ecan_protocol::can::{CanFrame, CanId, Dlc};
use proptest::prelude::*;

use super::{MAX_LINE, NamedRate, SlcanCommand, UnknownCommand, encode, parse};
use crate::bridge::test_frames::any_frame;

fn standard(id: u16) -> CanId {
    CanId::standard(id).unwrap()
}

fn extended(id: u32) -> CanId {
    CanId::extended(id).unwrap()
}

fn text(frame: &CanFrame, time_ns: Option<u64>) -> String {
    let mut text = Vec::new();
    encode(frame, time_ns, &mut text);
    String::from_utf8(text).unwrap()
}

/// Lines as python-can 4.6 writes them, and their frames.
fn golden_frames() -> Vec<(&'static str, CanFrame)> {
    let bytes: Vec<u8> = (0x10..0x1C).collect();
    vec![
        ("t12381122334455667788", {
            CanFrame::classic(standard(0x123), &[0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88])
                .unwrap()
        }),
        ("t7FF0", CanFrame::classic(standard(0x7FF), &[]).unwrap()),
        ("T1FFFFFFF2ABCD", CanFrame::classic(extended(0x1FFF_FFFF), &[0xAB, 0xCD]).unwrap()),
        ("T000001231FF", CanFrame::classic(extended(0x123), &[0xFF]).unwrap()),
        ("r6018", CanFrame::remote(standard(0x601), Dlc::new(8).unwrap()).unwrap()),
        ("R123456780", CanFrame::remote(extended(0x1234_5678), Dlc::new(0).unwrap()).unwrap()),
        ("d0013010203", CanFrame::fd(standard(1), &[1, 2, 3], false, false).unwrap()),
        ("D000000100", CanFrame::fd(extended(0x10), &[], false, false).unwrap()),
        (
            "b7019101112131415161718191A1B",
            CanFrame::fd(standard(0x701), &bytes, true, false).unwrap(),
        ),
        ("B1234567880102030405060708", {
            let data = [1, 2, 3, 4, 5, 6, 7, 8];
            CanFrame::fd(extended(0x1234_5678), &data, true, false).unwrap()
        }),
    ]
}

#[test]
fn frames_match_python_can_format() {
    for (line, frame) in golden_frames() {
        assert_eq!(parse(line.as_bytes()), Ok(SlcanCommand::Transmit(frame)), "{line}");
        assert_eq!(text(&frame, None), format!("{line}\r"));
        let lower = line[..1].to_owned() + &line[1..].to_lowercase();
        assert_eq!(parse(lower.as_bytes()), Ok(SlcanCommand::Transmit(frame)), "{lower}");
    }
}

/// SavvyCAN sets bit 31 of extended identifiers.
#[test]
fn flag_in_extended_identifier_is_ignored() {
    let id = extended(0x123);
    let data = [1u8];
    let table = [
        ("T80000123101", CanFrame::classic(id, &data).unwrap()),
        ("R800001231", CanFrame::remote(id, Dlc::new(1).unwrap()).unwrap()),
        ("D80000123101", CanFrame::fd(id, &data, false, false).unwrap()),
        ("B80000123101", CanFrame::fd(id, &data, true, false).unwrap()),
    ];
    for (line, frame) in table {
        assert_eq!(parse(line.as_bytes()), Ok(SlcanCommand::Transmit(frame)), "{line}");
    }
}

/// SavvyCAN writes length codes in decimal digits.
#[test]
fn length_code_may_have_two_decimal_digits() {
    for (code, length) in [(10, 16), (13, 32), (15, 64)] {
        let line = format!("b123{code}{}", "5A".repeat(length));
        let frame = CanFrame::fd(standard(0x123), &[0x5A; 64][..length], true, false).unwrap();
        assert_eq!(parse(line.as_bytes()), Ok(SlcanCommand::Transmit(frame)), "{line}");
    }
    // One byte that begins with 0, no length code of 10.
    let one = CanFrame::classic(standard(0x123), &[0x05]).unwrap();
    assert_eq!(parse(b"t123105"), Ok(SlcanCommand::Transmit(one)));
    for line in ["t12310", "b1231005", "b123155A", "b12316"] {
        assert_eq!(parse(line.as_bytes()), Err(UnknownCommand), "{line}");
    }
}

#[test]
fn longest_frame_is_longest_line() {
    let frame = CanFrame::fd(extended(1), &[0xA5; 64], true, false).unwrap();
    // The program writes a length code of one digit, and a carriage return.
    assert_eq!(text(&frame, None).len(), MAX_LINE);
    assert!(text(&frame, None).starts_with("B00000001FA5"));
}

#[test]
fn timestamp_counts_milliseconds_of_minute() {
    let frame = CanFrame::classic(standard(0x123), &[7]).unwrap();
    let stamped = |ms: u64| text(&frame, Some(ms * 1_000_000 + 999_999));
    assert_eq!(stamped(0), "t1231070000\r");
    assert_eq!(stamped(59_999), "t123107EA5F\r");
    assert_eq!(stamped(60_001), "t1231070001\r");
}

#[test]
fn commands_are_parsed() {
    use SlcanCommand as Command;
    let table = [
        ("", Command::Nothing),
        ("S0", Command::Bitrate(NamedRate::exactly(10_000))),
        ("S6", Command::Bitrate(NamedRate::exactly(500_000))),
        ("S8", Command::Bitrate(NamedRate::exactly(1_000_000))),
        ("S9", Command::Bitrate(NamedRate::exactly(83_300))),
        ("s031C", Command::Bitrate(NamedRate::exactly(125_000))),
        ("s0014", Command::Bitrate(NamedRate::exactly(1_000_000))),
        ("Y2", Command::DataBitrate(NamedRate::exactly(2_000_000))),
        ("Y5", Command::DataBitrate(NamedRate::exactly(5_000_000))),
        ("O", Command::Open),
        ("L", Command::OpenListening),
        ("C", Command::Close),
        ("F", Command::Flags),
        ("V", Command::Version),
        ("v", Command::Version),
        ("N", Command::SerialNumber),
        ("Z0", Command::Timestamps(false)),
        ("Z1", Command::Timestamps(true)),
        ("X1", Command::AutoPoll),
        ("M00000000", Command::AcceptAll),
        ("mFFFFFFFF", Command::AcceptAll),
    ];
    for (line, command) in table {
        assert_eq!(parse(line.as_bytes()), Ok(command), "{line:?}");
    }
}

#[test]
fn invalid_commands_are_rejected() {
    let lines = [
        "t",
        "t12",
        "t123",
        "t8000",
        "t123911",
        "t12",
        "t1232AA",
        "t1231AAB",
        "t1231AABB",
        "t1231GG",
        "t 231AA",
        "T0000000",
        "r12391",
        "r123111",
        "rF00",
        "r1239",
        "d123911",
        "b123F",
        "dFFF0",
        "tFFF0",
        "S",
        "S:",
        "S66",
        "s0",
        "sXXXX",
        "Y0",
        "Y3",
        "Z2",
        "X0",
        "m00000000",
        "M1",
        "OO",
        "O ",
        "C1",
        "A",
        "P",
        "U1",
        "Q1",
        "W0",
        "x",
        "\x07",
        "é",
    ];
    for line in lines {
        assert_eq!(parse(line.as_bytes()), Err(UnknownCommand), "{line:?}");
    }
}

/// A frame line in capitals, without flags in its identifier, with its end.
fn canonical(line: &[u8]) -> String {
    let line = str::from_utf8(line).unwrap();
    let (letter, rest) = line.split_at(1);
    if letter == letter.to_lowercase() {
        return line.to_uppercase() + "\r";
    }
    let (id, rest) = rest.split_at(8);
    let id = u32::from_str_radix(id, 16).unwrap() & 0x1FFF_FFFF;
    format!("{letter}{id:08X}{}\r", rest.to_uppercase())
}

proptest! {
    #[test]
    fn written_frames_can_be_parsed(frame in any_frame(false)) {
        let line = text(&frame, None);
        let line = line.strip_suffix('\r').unwrap();
        prop_assert_eq!(parse(line.as_bytes()), Ok(SlcanCommand::Transmit(frame)));
    }

    #[test]
    fn any_line_is_parsed_or_rejected(line in prop::collection::vec(any::<u8>(), 0..200)) {
        if let Ok(SlcanCommand::Transmit(frame)) = parse(&line) {
            prop_assert_eq!(text(&frame, None).to_uppercase(), canonical(&line));
        }
    }

    #[test]
    fn frame_like_lines_are_parsed_or_rejected(line in "[tTrRdDbB][0-9A-Fa-f]{0,24}") {
        if let Ok(command) = parse(line.as_bytes()) {
            let SlcanCommand::Transmit(frame) = command else { panic!("{line} is {command:?}") };
            prop_assert_eq!(text(&frame, None).to_uppercase(), canonical(line.as_bytes()));
        }
    }
}
