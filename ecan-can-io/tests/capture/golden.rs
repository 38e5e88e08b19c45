//! The bytes of the file, written out by hand from the descriptions of the formats.

use ecan_can_io::capture::{Capture, ErrorFrame, ImageOrigin, Traffic};
use ecan_protocol::can::{CanFrame, CanId, Dlc};
use ecan_protocol::image::{OptionFlags, PdoProfile};
use ecan_protocol::mapping::Direction;

const TIME_NS: u64 = 0x0123_4567_89AB_CDEF;

/// Section header with the application `test`.
const SECTION: [u8; 40] = [
    0x0a, 0x0d, 0x0d, 0x0a, 40, 0, 0, 0, 0x4d, 0x3c, 0x2b, 0x1a, 1, 0, 0, 0, //
    0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, //
    4, 0, 4, 0, b't', b'e', b's', b't', 0, 0, 0, 0, 40, 0, 0, 0,
];

/// Interface of a link type with a name of four letters at most: name, nanoseconds, end.
fn interface(link_type: u8, name: &str) -> Vec<u8> {
    let mut bytes = vec![1, 0, 0, 0, 40, 0, 0, 0, link_type, 0, 0, 0, 0, 0, 0, 0];
    bytes.extend([2, 0, name.len() as u8, 0]);
    bytes.extend(name.bytes().chain(std::iter::repeat(0)).take(4));
    bytes.extend([9, 0, 1, 0, 9, 0, 0, 0, 0, 0, 0, 0, 40, 0, 0, 0]);
    bytes
}

fn packet(interface: u8, flags: u8, content: &[u8]) -> Vec<u8> {
    let padded = content.len().next_multiple_of(4);
    let total = (32 + padded + 12) as u32;
    let length = content.len() as u32;
    let mut bytes = [6, total].map(u32::to_le_bytes).concat();
    bytes.extend([interface, 0, 0, 0, 0x67, 0x45, 0x23, 0x01, 0xef, 0xcd, 0xab, 0x89]);
    bytes.extend([length, length].map(u32::to_le_bytes).concat());
    bytes.extend(content);
    bytes.resize(28 + padded, 0);
    bytes.extend([2, 0, 4, 0, flags, 0, 0, 0, 0, 0, 0, 0]);
    bytes.extend(total.to_le_bytes());
    bytes
}

/// The file behind the section header.
fn written(fill: impl FnOnce(&mut Capture<Vec<u8>>)) -> Vec<u8> {
    let mut capture = Capture::new(Vec::new(), "test").unwrap();
    fill(&mut capture);
    let bytes = capture.finish().unwrap();
    assert_eq!(bytes[..40], SECTION);
    bytes[40..].to_vec()
}

fn standard(id: u16) -> CanId {
    CanId::standard(id).unwrap()
}

#[test]
fn empty_capture_has_section_header() {
    assert!(written(|_| {}).is_empty());
}

#[test]
fn can_frames_match_socketcan() {
    let extended = CanId::extended(0x1234_5678).unwrap();
    let frames: [(CanFrame, &[u8]); 6] = [
        (
            CanFrame::classic(standard(0x123), &[0x11, 0x22, 0x33]).unwrap(),
            &[0, 0, 1, 0x23, 3, 0, 0, 0, 0x11, 0x22, 0x33],
        ),
        (CanFrame::classic(extended, &[]).unwrap(), &[0x92, 0x34, 0x56, 0x78, 0, 0, 0, 0]),
        (
            CanFrame::remote(standard(0x7FF), Dlc::new(4).unwrap()).unwrap(),
            &[0x40, 0, 7, 0xff, 4, 0, 0, 0],
        ),
        (
            CanFrame::remote(extended, Dlc::new(0).unwrap()).unwrap(),
            &[0xd2, 0x34, 0x56, 0x78, 0, 0, 0, 0],
        ),
        (
            CanFrame::fd(standard(1), &[7; 12], true, false).unwrap(),
            &[0, 0, 0, 1, 12, 5, 0, 0, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7],
        ),
        (CanFrame::fd(extended, &[], false, true).unwrap(), &[0x92, 0x34, 0x56, 0x78, 0, 6, 0, 0]),
    ];
    for (frame, content) in frames {
        let bytes = written(|capture| {
            capture.frame(TIME_NS, 2, Traffic::Received, &frame).unwrap();
            capture.frame(TIME_NS, 2, Traffic::Sent, &frame).unwrap();
        });
        let expected =
            [interface(227, "can2"), packet(0, 1, content), packet(0, 2, content)].concat();
        assert_eq!(bytes, expected, "{frame:?}");
    }
}

#[test]
fn error_frames_match_socketcan() {
    let error = ErrorFrame::new(0x44, [0, 0x0c, 0, 0, 0, 0, 0, 0]);
    let bytes = written(|capture| capture.error(TIME_NS, 0, &error).unwrap());
    let content = [0x20, 0, 0, 0x44, 8, 0, 0, 0, 0, 0x0c, 0, 0, 0, 0, 0, 0];
    assert_eq!(bytes, [interface(227, "can0"), packet(0, 1, &content)].concat());
}

#[test]
fn images_start_with_their_origin() {
    // N = 8, channels 0x0F, profile 0, balanced, ALIGN_4: 7 | 0x0F << 5 | 2 << 21.
    let profile = PdoProfile { options: OptionFlags::ALIGN4, ..PdoProfile::default() };
    let image = [0xA5; 1024];
    let origin = |direction| ImageOrigin { slave: 0x0102, direction, profile };
    let bytes = written(|capture| {
        capture.image(TIME_NS, &origin(Direction::RxPdo), &image).unwrap();
        capture.image(TIME_NS, &origin(Direction::TxPdo), &image).unwrap();
    });
    // The name is longer than four letters: 44 bytes.
    assert_eq!(&bytes[16..28], b"\x02\x00\x07\x00ecan258\x00");
    let header = |direction| {
        [b'E', b'C', b'A', b'N', 1, 16, direction, 0, 0x02, 0x01, 0, 0, 0xe7, 0x01, 0x40, 0]
    };
    let content = |direction| [&header(direction)[..], &image].concat();
    let expected = [packet(0, 2, &content(0)), packet(0, 1, &content(1))].concat();
    assert_eq!(bytes[44..], expected);
}

#[test]
fn interfaces_are_described_before_packets() {
    let frame = CanFrame::classic(standard(5), &[]).unwrap();
    let content = [0, 0, 0, 5, 0, 0, 0, 0];
    let bytes = written(|capture| {
        for port in [1, 0, 1] {
            capture.frame(TIME_NS, port, Traffic::Received, &frame).unwrap();
        }
    });
    let expected = [
        interface(227, "can1"),
        packet(0, 1, &content),
        interface(227, "can0"),
        packet(1, 1, &content),
        packet(0, 1, &content),
    ];
    assert_eq!(bytes, expected.concat());
}

#[test]
fn gaps_are_the_comment_of_the_next_packet() {
    let frame = CanFrame::classic(standard(5), &[]).unwrap();
    let bytes = written(|capture| {
        capture.gap("1 image");
        capture.gap("of two");
        for _ in 0..2 {
            capture.frame(TIME_NS, 0, Traffic::Received, &frame).unwrap();
        }
    });
    // opt_comment: code 1, length, text, padded to four bytes.
    let comment = b"\x01\0\x19\0gap: 1 image; gap: of two\0\0\0";
    let bare = packet(0, 1, &[0, 0, 0, 5, 0, 0, 0, 0]);
    let total = (bare.len() + comment.len()) as u32;
    let mut commented = [&bare[..36], comment, &bare[36..]].concat();
    commented[4..8].copy_from_slice(&total.to_le_bytes());
    let end = commented.len() - 4;
    commented[end..].copy_from_slice(&total.to_le_bytes());
    assert_eq!(bytes, [interface(227, "can0"), commented, bare].concat());
}
