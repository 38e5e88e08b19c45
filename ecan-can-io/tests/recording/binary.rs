//! BLF, pcapng and pcap.

use std::io::Cursor;

use ecan_can_io::candump::{FrameText, parse_frame};
use ecan_can_io::capture::{Capture, ErrorFrame, Traffic};
use ecan_can_io::recording::{BlfWriter, Format, ReadOptions, Recording};
use ecan_protocol::can::CanFrame;
use proptest::prelude::*;

const START_NS: u64 = 1_700_000_000_123_456_789;
const FRAMES: [&str; 6] = [
    "123#1122",
    "1ABCDEFF#",
    "7FF#R4",
    "124##30102030405060708090A0B0C",
    "00000001##0",
    "125#0102030405060708",
];

fn read(bytes: &[u8]) -> Recording {
    Recording::read(bytes, &ReadOptions::default()).unwrap()
}

fn shown(recording: &Recording) -> Vec<(u64, String, String)> {
    let line = |frame: &ecan_can_io::recording::LoggedFrame| {
        (frame.time_ns, frame.interface.clone(), FrameText(&frame.frame).to_string())
    };
    recording.frames.iter().map(line).collect()
}

fn frames() -> impl Iterator<Item = (u64, usize, CanFrame)> {
    FRAMES
        .iter()
        .enumerate()
        .map(|(nth, text)| (START_NS + nth as u64 * 1_000_001, nth % 4, parse_frame(text).unwrap()))
}

fn blf(frames: impl Iterator<Item = (u64, usize, CanFrame)>) -> Vec<u8> {
    let mut writer = BlfWriter::new(Cursor::new(Vec::new())).unwrap();
    for (nth, (time_ns, port, frame)) in frames.enumerate() {
        writer.write(time_ns, port as u16, &frame, nth % 2 == 1).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

#[test]
fn blf_file_is_read_as_written() {
    let bytes = blf(frames());
    let recording = read(&bytes);
    assert_eq!((recording.format, recording.skipped.len()), (Format::Blf, 0));
    let expected: Vec<_> = FRAMES
        .iter()
        .enumerate()
        .map(|(nth, text)| (nth as u64 * 1_000_001, format!("can{}", nth % 4), (*text).to_owned()))
        .collect();
    assert_eq!(shown(&recording), expected);
    assert_eq!(&bytes[..8], b"LOGG\x90\0\0\0");
    assert_eq!(u64::from_le_bytes(bytes[16..24].try_into().unwrap()), bytes.len() as u64);
    // The start in UTC: 2023-11-14, a Tuesday, 22:13:20.123.
    let start: Vec<_> =
        bytes[40..56].chunks(2).map(|half| u16::from_le_bytes([half[0], half[1]])).collect();
    assert_eq!(start, [2023, 11, 2, 14, 22, 13, 20, 123]);
}

#[test]
fn comments_of_a_blf_file_are_no_frames() {
    let mut writer = BlfWriter::new(Cursor::new(Vec::new())).unwrap();
    for (nth, (time_ns, port, frame)) in frames().enumerate() {
        writer.comment(time_ns, &"gap"[..nth % 4]).unwrap();
        writer.write(time_ns, port as u16, &frame, false).unwrap();
    }
    let recording = read(&writer.finish().unwrap().into_inner());
    assert_eq!((recording.frames.len(), recording.skipped.len()), (FRAMES.len(), 0));
}

/// Several containers, whose borders are inside objects.
#[test]
fn long_blf_file_is_whole() {
    let frame = parse_frame("123##1".to_owned().as_str()).unwrap();
    let many = (0..20_000_u64).map(|nth| (START_NS + nth * 1000, 0, frame));
    let bytes = blf(many);
    let recording = read(&bytes);
    assert_eq!((recording.frames.len(), recording.skipped.len()), (20_000, 0));
    assert_eq!(recording.frames[19_999].time_ns, 19_999_000);
    let cut = read(&bytes[..bytes.len() - 1000]);
    assert!(cut.frames.len() > 10_000 && cut.frames.len() < 20_000);
}

#[test]
fn damaged_blf_container_is_reported_and_the_others_are_read() {
    let frame = parse_frame("123#1122").unwrap();
    let mut bytes = blf((0..6_000_u64).map(|nth| (START_NS + nth, 0, frame)));
    for byte in &mut bytes[200..220] {
        *byte ^= 0x5A;
    }
    let recording = read(&bytes);
    assert!(recording.skipped[0].to_string().contains("a container is damaged"));
    assert!(!recording.frames.is_empty());
}

#[test]
fn own_capture_is_read_again() {
    let mut capture = Capture::new(Vec::new(), "test").unwrap();
    for (time_ns, port, frame) in frames() {
        capture.frame(time_ns, port, Traffic::Received, &frame).unwrap();
    }
    capture.error(START_NS, 0, &ErrorFrame::new(0x40, [0; 8])).unwrap();
    let recording = read(&capture.finish().unwrap());
    assert_eq!((recording.format, recording.error_frames), (Format::Pcap, 1));
    assert_eq!(recording.skipped, []);
    let texts: Vec<_> = shown(&recording).into_iter().map(|(_, _, text)| text).collect();
    assert_eq!(texts, FRAMES);
    assert_eq!(recording.frames[1].time_ns - recording.frames[0].time_ns, 1_000_001);
}

/// A pcap file of microseconds and one of nanoseconds, in both byte orders.
#[test]
fn pcap_is_read_in_both_byte_orders() {
    for (magic, unit) in [(0xA1B2_C3D4_u32, 1_000), (0xA1B2_3C4D, 1)] {
        for is_big in [false, true] {
            let number =
                |value: u32| if is_big { value.to_be_bytes() } else { value.to_le_bytes() };
            let version = if is_big { [0, 2, 0, 4] } else { [2, 0, 4, 0] };
            let mut bytes = number(magic).to_vec();
            bytes.extend(version);
            bytes.extend([number(0), number(0), number(65_535), number(227)].concat());
            for (seconds, fraction) in [(5, 7), (6, 0)] {
                bytes.extend([number(seconds), number(fraction), number(10), number(10)].concat());
                bytes.extend([0x80, 0, 1, 0x23, 2, 0, 0, 0, 0xAB, 0xCD]);
            }
            bytes.extend(number(9));
            let recording = read(&bytes);
            let expected = [
                (5_000_000_000 + 7 * unit, "can0".to_owned(), "00000123#ABCD".to_owned()),
                (6_000_000_000, "can0".to_owned(), "00000123#ABCD".to_owned()),
            ];
            assert_eq!(shown(&recording), expected);
            assert!(recording.skipped[0].to_string().contains("damaged or not complete"));
        }
    }
}

proptest! {
    #[test]
    fn damaged_files_do_not_panic(
        is_blf in any::<bool>(),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        cut in any::<prop::sample::Index>(),
    ) {
        let mut bytes = match is_blf {
            true => blf(frames()),
            false => {
                let mut capture = Capture::new(Vec::new(), "test").unwrap();
                for (time_ns, port, frame) in frames() {
                    capture.frame(time_ns, port, Traffic::Sent, &frame).unwrap();
                }
                capture.finish().unwrap()
            }
        };
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        bytes.truncate(cut.index(bytes.len()) + 1);
        if let Ok(recording) = Recording::read(&bytes, &ReadOptions::default()) {
            prop_assert!(recording.frames.len() <= FRAMES.len());
        }
    }
}
