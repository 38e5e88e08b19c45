//! Screen format and filters, compared with candump.

use ecan_can_io::candump::{
    DirectionMark, Filter, FilterError, FrameText, ParseErrorKind, ScreenFrame, ScreenRecord,
    ScreenTime, parse_frame, parse_screen_line,
};
use ecan_protocol::can::FrameKind;
use proptest::prelude::*;

fn shown(text: &str) -> String {
    ScreenFrame::new(&parse_frame(text).unwrap()).to_string()
}

#[test]
fn columns_match_candump() {
    // Left: frame for cansend; right: output of candump.
    let table = [
        ("123#", "123   [0] "),
        ("123#DEADBEEF", "123   [4]  DE AD BE EF"),
        ("7FF#1122334455667788", "7FF   [8]  11 22 33 44 55 66 77 88"),
        ("12345678#AA", "12345678   [1]  AA"),
        ("123#R", "123   [0]  remote request"),
        ("12345678#R5", "12345678   [5]  remote request"),
        ("123##1AABB", "123  [02]  AA BB"),
        ("123##0112233445566778899AABBCC", "123  [12]  11 22 33 44 55 66 77 88 99 AA BB CC"),
    ];
    for (given, expected) in table {
        assert_eq!(shown(given), expected, "{given}");
    }
}

#[test]
fn indent_and_ascii_match_candump() {
    let frame = parse_frame("123#414243007F7E").unwrap();
    let indented = ScreenFrame { is_indented: true, ..ScreenFrame::new(&frame) };
    assert_eq!(indented.to_string(), "     123   [6]  41 42 43 00 7F 7E");
    let ascii = ScreenFrame { has_ascii: true, ..ScreenFrame::new(&frame) };
    assert_eq!(ascii.to_string(), "123   [6]  41 42 43 00 7F 7E         'ABC..~'");
    let full = parse_frame("123#4142434445464748").unwrap();
    let ascii = ScreenFrame { has_ascii: true, ..ScreenFrame::new(&full) };
    assert_eq!(ascii.to_string(), "123   [8]  41 42 43 44 45 46 47 48   'ABCDEFGH'");
    // candump prints no characters for more than 8 bytes.
    let long = parse_frame("123##04142434445464748494A4B4C").unwrap();
    let ascii = ScreenFrame { has_ascii: true, ..ScreenFrame::new(&long) };
    assert_eq!(ascii.to_string(), "123  [12]  41 42 43 44 45 46 47 48 49 4A 4B 4C");
}

fn screen(line: &str) -> ScreenRecord<'_> {
    parse_screen_line(line).unwrap().expect("a record")
}

#[test]
fn screen_lines_of_candump_parse() {
    // Left: output of candump; right: the frame for cansend.
    let table = [
        ("  can0  123   [0] ", "123#"),
        ("  vcan0  123   [4]  DE AD BE EF", "123#DEADBEEF"),
        ("  can0       123   [2]  41 42                     'AB'", "123#4142"),
        ("  can0  12345678   [1]  AA", "12345678#AA"),
        ("  can0  123   [4]  remote request", "123#R4"),
        ("  can0  123  [02]  AA BB", "123##0AABB"),
        ("  can0  RX B -  123  [01]  aa", "123##1AA"),
        ("  can0  TX - E  123  [01]  AA\r\n", "123##2AA"),
        (" (1398128223.803317)  can0  123   [1]  11  +4711", "123#11"),
        ("can0 123 [1] 11", "123#11"),
    ];
    for (line, expected) in table {
        let record = screen(line);
        assert_eq!(record.frame, parse_frame(expected).unwrap(), "{line}");
        assert!(record.interface == "can0" || record.interface == "vcan0", "{line}");
    }
    assert_eq!(screen(table[6].0).direction, Some(DirectionMark::Received));
    assert_eq!(screen(table[7].0).direction, Some(DirectionMark::Transmitted));
    assert_eq!(screen(table[9].0).direction, None);
    for line in ["", "# comment", "\tcontroller-problem{}", "          Speed  100.00 km/h"] {
        assert_eq!(parse_screen_line(line), Ok(None), "{line:?}");
    }
}

#[test]
fn screen_time_stamps_parse() {
    let stamps = [
        ("000.020000", ScreenTime::Nanoseconds(20_000_000)),
        ("1398128223.803317001", ScreenTime::Nanoseconds(1_398_128_223_803_317_001)),
        ("2014-04-22 00:57:03.803317", ScreenTime::Date("2014-04-22 00:57:03.803317")),
    ];
    for (text, time) in stamps {
        let line = format!(" ({text})  can0  123   [0] ");
        assert_eq!(screen(&line).time, Some(time));
    }
    assert_eq!(screen("  can0  123   [0] ").time, None);
}

#[test]
fn screen_error_names_its_column() {
    use ParseErrorKind as Kind;
    let cases = [
        ("  can0", Kind::Blank, 7),
        ("  can0  12   [1]  11", Kind::ScreenIdentifier, 11),
        ("  can0  123#11", Kind::ScreenIdentifier, 12),
        ("  can0  800   [1]  11", Kind::IdentifierRange(0x800), 9),
        ("  can0  20000080   [8]  00 00 00 00 00 00 00 00   ERRORFRAME", Kind::ErrorMessage, 9),
        ("  can0  123   (1)  11", Kind::ScreenLength, 15),
        ("  can0  123   [9]  11", Kind::ScreenLength, 15),
        ("  can0  123  [65]  11", Kind::ScreenLength, 14),
        ("  can0  123   [2]  11", Kind::ScreenData(2), 22),
        ("  can0  123   [1]  11 22", Kind::ScreenData(1), 22),
        ("  can0  123   [1]  1", Kind::ScreenData(1), 21),
        ("  can0  123   [1]  11'.'", Kind::ScreenData(1), 22),
        ("  can0  123   [1]  00010001", Kind::ScreenData(1), 22),
        ("  can0  123  [09]  1 ", Kind::ScreenData(9), 21),
        ("  can0  RX x -  123   [0] ", Kind::Flags, 12),
        (" (1.0)  can0  123   [0] ", Kind::Fraction, 6),
        (" (2014-04-22  can0  123   [0] ", Kind::Fraction, 2),
    ];
    for (line, kind, column) in cases {
        let error = parse_screen_line(line).expect_err(line);
        assert_eq!((error.kind, error.column), (kind, column), "{line}");
    }
    let bytes = "11 ".repeat(9);
    let error = parse_screen_line(&format!("  can0  123  [09]  {bytes}")).unwrap_err();
    assert_eq!(error.kind, Kind::DataLength(9));
}

#[test]
fn frame_text_round_trips() {
    for text in ["123#", "1FFFFFFF#0011", "7FF#R8", "000##3AABB", "123##0"] {
        assert_eq!(FrameText(&parse_frame(text).unwrap()).to_string(), text);
    }
    let table = [
        ("12#", "column 3"),
        ("800#", "column 1"),
        ("123#1", "column 6"),
        ("123#112233445566778899", "column 21"),
        ("123#R9", "column 6"),
        ("123# ", "column 5"),
        ("123##0112233445566778899", "column 7"),
        ("", "column 1"),
    ];
    for (text, words) in table {
        let message = parse_frame(text).unwrap_err().to_string();
        assert!(message.starts_with(words), "{text}: {message}");
    }
}

#[test]
fn filters_match_candump() {
    // Filter, frame, whether it passes.
    let table = [
        ("123:7FF", "123#", true),
        ("123:7FF", "124#", false),
        ("123:7FF", "123#R", true),
        ("123:7FF", "00000123#", true),
        ("123:7FF", "10000123#", true),
        ("123:C00007FF", "123#11", true),
        ("123:C00007FF", "123#R", false),
        ("123:C00007FF", "00000123#", false),
        ("400:700", "4FF#", true),
        ("400:700", "500#", false),
        ("400~7F0", "40F#", false),
        ("400~7F0", "410#", true),
        ("12345678:DFFFFFFF", "12345678#AA", true),
        ("12345678:DFFFFFFF", "12345679#AA", false),
        ("12345678:DFFFFFFF", "678#", false),
        ("00000123:DFFFFFFF", "123#", false),
        ("0:0", "7FF#", true),
        ("0~0", "7FF#", false),
        ("123:7ff", "123##1AA", true),
    ];
    for (filter, frame, passes) in table {
        let filter_read: Filter = filter.parse().unwrap();
        assert_eq!(filter_read.passes(&parse_frame(frame).unwrap()), passes, "{filter} {frame}");
    }
    for wrong in ["", "123", "123:", ":7FF", "12G:7FF", "123:7FF:1", "123456789:0", "+1:7FF"] {
        assert_eq!(wrong.parse::<Filter>(), Err(FilterError), "{wrong}");
    }
}

proptest! {
    /// Any text given as a frame or a filter is read or rejected, and what is read as a frame is
    /// written back so that it reads the same.
    #[test]
    fn any_filter_text_parses_or_fails(text in "[0-9A-Fa-f#R:~x é]{0,24}|\\PC{0,24}") {
        let _ = text.parse::<Filter>();
        if let Ok(frame) = parse_frame(&text) {
            prop_assert_eq!(parse_frame(&FrameText(&frame).to_string()), Ok(frame));
        }
    }

    /// What the screen shows is read as the same frame, but for the bits that it does not show.
    #[test]
    fn shown_frame_parses_to_itself(
        id in 0..0x1000_u32,
        is_extended: bool,
        data in prop::collection::vec(any::<u8>(), 0..9),
        is_fd: bool,
        is_indented: bool,
        has_ascii: bool,
    ) {
        let digits = if is_extended { format!("{id:08X}") } else { format!("{:03X}", id & 0x7FF) };
        let bytes: String = data.iter().map(|byte| format!("{byte:02X}")).collect();
        let mark = if is_fd { "##0" } else { "#" };
        let frame = parse_frame(&format!("{digits}{mark}{bytes}")).unwrap();
        let line = format!("  can0  {}", ScreenFrame { frame: &frame, is_indented, has_ascii });
        let read = screen(&line);
        prop_assert_eq!(read.frame, frame);
        prop_assert_eq!(matches!(frame.kind(), FrameKind::Fd { .. }), is_fd);
    }

    #[test]
    fn any_screen_line_parses_or_fails(line in "[ (a-z0-9.)]{0,12} [0-9A-F]{2,9} [\\[0-9\\] A-F']{0,24}|\\PC{0,40}") {
        if let Err(error) = parse_screen_line(&line) {
            prop_assert!(error.column >= 1 && error.column <= line.chars().count() + 1);
        }
    }

    /// A filter passes exactly the frames that its inverse does not.
    #[test]
    fn inverted_filter_passes_the_others(id: u32, mask: u32, frame in 0..0x800_u32, remote: bool) {
        let frame = parse_frame(&format!("{frame:03X}#{}", if remote { "R" } else { "" })).unwrap();
        let passes = |mark| format!("{id:X}{mark}{mask:X}").parse::<Filter>().unwrap().passes(&frame);
        prop_assert_ne!(passes(':'), passes('~'));
    }
}
