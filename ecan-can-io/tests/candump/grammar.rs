//! Valid and invalid lines of candump logs.

use std::path::Path;

use ecan_can_io::candump::{DirectionMark, ParseErrorKind, Record, parse_line};
use ecan_protocol::can::{CanFrame, CanId, Dlc, FrameKind};
use proptest::prelude::*;

fn std_id(id: u16) -> CanId {
    CanId::standard(id).unwrap()
}

fn ext_id(id: u32) -> CanId {
    CanId::extended(id).unwrap()
}

fn read(line: &str) -> Record<'_> {
    parse_line(line).unwrap().expect("a record")
}

fn frame(text: &str) -> CanFrame {
    read(&format!("(0000000001.000000) can0 {text}")).frame
}

#[test]
fn classic_frames() {
    assert_eq!(frame("123#"), CanFrame::classic(std_id(0x123), &[]).unwrap());
    assert_eq!(
        frame("7FF#1122334455667788"),
        CanFrame::classic(std_id(0x7FF), &[0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88])
            .unwrap()
    );
    assert_eq!(frame("1FFFFFFF#aB"), CanFrame::classic(ext_id(0x1FFF_FFFF), &[0xAB]).unwrap());
    // The number of digits selects the format, not the value.
    assert_eq!(frame("00000123#"), CanFrame::classic(ext_id(0x123), &[]).unwrap());
}

#[test]
fn remote_frames() {
    let remote = |dlc| CanFrame::remote(std_id(0x123), Dlc::new(dlc).unwrap()).unwrap();
    assert_eq!(frame("123#R"), remote(0));
    assert_eq!(frame("123#R0"), remote(0));
    assert_eq!(frame("123#R4"), remote(4));
    assert_eq!(frame("123#R8"), remote(8));
}

#[test]
fn fd_frames() {
    let kinds = [
        ("0", false, false),
        ("1", true, false),
        ("2", false, true),
        ("3", true, true),
        ("4", false, false),
        ("5", true, false),
        ("7", true, true),
    ];
    for (flags, brs, esi) in kinds {
        assert_eq!(frame(&format!("123##{flags}")).kind(), FrameKind::Fd { brs, esi });
    }
    let data = "00112233445566778899AABB";
    assert_eq!(frame(&format!("12345678##1{data}")).data().len(), 12);
    assert_eq!(frame(&format!("123##1{}", "5A".repeat(64))).data(), [0x5A; 64]);
}

#[test]
fn time_stamps() {
    assert_eq!(read("(1398128223.803317) c 1FF#").time_ns, 1_398_128_223_803_317_000);
    assert_eq!(read("(1398128223.803317001) c 1FF#").time_ns, 1_398_128_223_803_317_001);
    assert_eq!(read("(0.000001) c 1FF#").time_ns, 1_000);
    assert_eq!(read("(18446744073.709551615) c 1FF#").time_ns, u64::MAX);
}

#[test]
fn interfaces_and_directions() {
    assert_eq!(read("(1.000000) vcan0.1-x 1FF#").interface, "vcan0.1-x");
    assert_eq!(read("(1.000000) käfer 1FF#").interface, "käfer");
    assert_eq!(read("(1.000000) can0 1FF#").direction, None);
    assert_eq!(read("(1.000000) can0 1FF#00 R").direction, Some(DirectionMark::Received));
    assert_eq!(read("(1.000000) can0 1FF#R T \r\n").direction, Some(DirectionMark::Transmitted));
    assert_eq!(read(" (1.000000)\tcan0  1FF#00  T").frame, frame("1FF#00"));
}

#[test]
fn raw_dlc_is_parsed_and_dropped() {
    assert_eq!(read("(1.000000) can0 123#1122334455667788_B").frame, frame("123#1122334455667788"));
    assert_eq!(read("(1.000000) can0 123#1122334455667788_f T").frame.data().len(), 8);
    assert_eq!(read("(1.000000) can0 123#R8_9").frame, frame("123#R8"));
}

#[test]
fn lines_without_a_record() {
    for line in ["", "  \t", "\r\n", "# 123#00", "   #"] {
        assert_eq!(parse_line(line), Ok(None), "{line:?}");
    }
}

#[test]
fn syntax_error_names_its_column() {
    use ParseErrorKind as Kind;
    let long = format!("(1.000000) can0 123##0{}", "00".repeat(65));
    let cases: &[(&str, Kind, usize)] = &[
        ("can0 123#00", Kind::TimeStart, 1),
        ("  x", Kind::TimeStart, 3),
        ("(", Kind::Seconds, 2),
        ("(.000000) can0 123#", Kind::Seconds, 2),
        ("(-1.000000) can0 123#", Kind::Seconds, 2),
        ("(12 can0 123#", Kind::Seconds, 4),
        ("(1.) can0 123#", Kind::Fraction, 4),
        ("(1.00000) can0 123#", Kind::Fraction, 9),
        ("(1.0000000) can0 123#", Kind::Fraction, 11),
        ("(1.0000000000) can0 123#", Kind::Fraction, 13),
        ("(1.000000 can0 123#", Kind::Fraction, 10),
        ("(18446744073.709551616) can0 123#", Kind::TimeRange, 1),
        ("(99999999999999999999.000000) can0 123#", Kind::TimeRange, 1),
        ("(1.000000)can0 123#", Kind::Blank, 11),
        ("(1.000000)", Kind::Blank, 11),
        ("(1.000000) ", Kind::Interface, 12),
        ("(1.000000) can0", Kind::Blank, 16),
        ("(1.000000) can0 ", Kind::Identifier, 17),
        ("(1.000000) can0 12#", Kind::Identifier, 19),
        ("(1.000000) can0 1234#", Kind::Identifier, 21),
        ("(1.000000) can0 123456789#", Kind::Identifier, 25),
        ("(1.000000) can0 xyz#", Kind::Identifier, 17),
        ("(1.000000) can0 123", Kind::Identifier, 20),
        ("(1.000000) käfer 12#", Kind::Identifier, 20),
        ("(1.000000) can0 800#", Kind::IdentifierRange(0x800), 17),
        ("(1.000000) can0 40000000#", Kind::IdentifierRange(0x4000_0000), 17),
        ("(1.000000) can0 20000004#0000000000000000", Kind::ErrorMessage, 17),
        ("(1.000000) can0 123#1", Kind::Data, 22),
        ("(1.000000) can0 123#11x2", Kind::Data, 23),
        ("(1.000000) can0 123#1ä", Kind::Data, 22),
        ("(1.000000) can0 123#112233445566778899", Kind::DataTooLong(8), 37),
        ("(1.000000) can0 123#1122334455667788_8", Kind::RawDlc, 38),
        ("(1.000000) can0 123#1122334455667788_", Kind::RawDlc, 38),
        ("(1.000000) can0 123#1122334455667788_G", Kind::RawDlc, 38),
        ("(1.000000) can0 123#1122334455667788_99", Kind::Trailing, 39),
        ("(1.000000) can0 123#11_9", Kind::Data, 23),
        ("(1.000000) can0 123#R8_8", Kind::RawDlc, 24),
        ("(1.000000) can0 123#R7_9", Kind::Trailing, 23),
        ("(1.000000) can0 123##11122334455667788_9", Kind::Data, 39),
        ("(1.000000) can0 123#R9", Kind::RemoteDlc, 22),
        ("(1.000000) can0 123#Rx", Kind::RemoteDlc, 22),
        ("(1.000000) can0 123#R44", Kind::Trailing, 23),
        ("(1.000000) can0 123##", Kind::Flags, 22),
        ("(1.000000) can0 123##g", Kind::Flags, 22),
        ("(1.000000) can0 123##8", Kind::UnknownFlags(8), 22),
        ("(1.000000) can0 123##1112233445566778899", Kind::DataLength(9), 23),
        (&long, Kind::DataTooLong(64), 151),
        ("(1.000000) can0 123#00 X", Kind::Trailing, 24),
        ("(1.000000) can0 123#00 RT", Kind::Trailing, 24),
        ("(1.000000) can0 123#00 R 7", Kind::Trailing, 26),
    ];
    for (line, kind, column) in cases {
        let error = parse_line(line).expect_err(line);
        assert_eq!((error.kind, error.column), (*kind, *column), "{line}");
    }
}

#[test]
fn syntax_error_has_readable_text() {
    let error = parse_line("(1.000000) can0 123##1112233445566778899").unwrap_err();
    assert_eq!(
        error.to_string(),
        "column 23: 9 data bytes have no CAN FD DLC; allowed: 0 to 8, 12, 16, 20, 24, 32, 48, 64"
    );
}

#[test]
fn record_display_matches_candump() {
    for line in [
        "(1398128223.803317) can0 166#D0320009",
        "(0000000001.000000) can0 123#R",
        "(0000000001.000000) can0 123#R8",
        "(0000000001.000000001) can0 01234567##3AB",
        "(0000000001.000000) can0 7FF##0",
        "(0000000001.000000) can0 000# T",
        "(0000000001.000000) can0 00000000#00 R",
    ] {
        assert_eq!(read(line).to_string(), line);
    }
}

fn any_id() -> impl Strategy<Value = CanId> {
    prop_oneof![(0..=0x7FFu16).prop_map(std_id), (0..=0x1FFF_FFFFu32).prop_map(ext_id)]
}

fn any_frame() -> impl Strategy<Value = CanFrame> {
    let lengths = vec![0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64usize];
    let bytes = || prop::collection::vec(any::<u8>(), 64);
    prop_oneof![
        (any_id(), bytes(), 0..=8usize)
            .prop_map(|(id, data, n)| CanFrame::classic(id, &data[..n]).unwrap()),
        (any_id(), 0..=8u8)
            .prop_map(|(id, dlc)| CanFrame::remote(id, Dlc::new(dlc).unwrap()).unwrap()),
        (any_id(), bytes(), prop::sample::select(lengths), any::<bool>(), any::<bool>())
            .prop_map(|(id, data, n, brs, esi)| CanFrame::fd(id, &data[..n], brs, esi).unwrap()),
    ]
}

proptest! {
    #[test]
    fn displayed_record_parses_to_itself(
        micros in any::<bool>(),
        time in any::<u64>(),
        interface in "[!-~]{1,15}",
        frame in any_frame(),
        direction in prop_oneof![
            Just(None),
            Just(Some(DirectionMark::Received)),
            Just(Some(DirectionMark::Transmitted))
        ],
    ) {
        let time_ns = if micros { time / 1000 * 1000 } else { time };
        let record = Record { time_ns, interface: &interface, frame, direction };
        let line = record.to_string();
        prop_assert_eq!(parse_line(&line), Ok(Some(record)));
    }

    #[test]
    fn any_text_parses_or_fails_within_the_line(line in ".*") {
        if let Err(error) = parse_line(&line) {
            prop_assert!(error.column >= 1 && error.column <= line.chars().count() + 1);
        }
    }

    /// One character of a valid line is replaced, inserted or removed.
    #[test]
    fn damaged_line_parses_or_fails(
        frame in any_frame(),
        at in any::<prop::sample::Index>(),
        other in prop::option::of(any::<char>()),
        replace in any::<bool>(),
    ) {
        let record = Record { time_ns: 1_000, interface: "can0", frame, direction: None };
        let mut characters: Vec<char> = record.to_string().chars().collect();
        let at = at.index(characters.len());
        if replace || other.is_none() {
            characters.remove(at);
        }
        if let Some(other) = other {
            characters.insert(at, other);
        }
        let line: String = characters.into_iter().collect();
        match parse_line(&line) {
            Ok(Some(record)) => {
                // Still a record: its Display must round-trip.
                let written = record.to_string();
                prop_assert_eq!(parse_line(&written), Ok(Some(record)));
            }
            Ok(None) => {}
            Err(error) => prop_assert!(error.column <= line.chars().count() + 1),
        }
    }
}

#[test]
fn vehicle_recording_round_trips() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/vehicle-can.log");
    let Ok(log) = std::fs::read_to_string(&path) else {
        println!("skipped: no recording at ../shared/data/vehicle-can.log");
        return;
    };
    let mut records = 0;
    let mut last = 0;
    for line in log.lines() {
        let record = read(line);
        assert_eq!(record.to_string(), line);
        assert_eq!(record.interface, "can0");
        assert_eq!(record.frame.kind(), FrameKind::Data);
        assert!(!record.frame.id().is_extended());
        assert!((2..=8).contains(&record.frame.data().len()));
        assert!(record.time_ns >= last);
        last = record.time_ns;
        records += 1;
    }
    assert_eq!(records, 6_158);
}
