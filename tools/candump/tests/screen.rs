//! Screen format and filters, compared with candump.
#![allow(missing_docs)]

use ecan_candump::{Filter, FilterError, FrameText, ScreenFrame, parse_frame};
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

    /// A filter passes exactly the frames that its inverse does not.
    #[test]
    fn inverted_filter_passes_the_others(id: u32, mask: u32, frame in 0..0x800_u32, remote: bool) {
        let frame = parse_frame(&format!("{frame:03X}#{}", if remote { "R" } else { "" })).unwrap();
        let passes = |mark| format!("{id:X}{mark}{mask:X}").parse::<Filter>().unwrap().passes(&frame);
        prop_assert_ne!(passes(':'), passes('~'));
    }
}
