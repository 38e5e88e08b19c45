//! The drive's SDO server, with bytes written by hand from CiA 301.

use super::fixture::{Fixture, config};
use ecan_sim::{DriveConfig, DriveQuirks, SdoDirection, SdoEffect, SdoRule};

fn aborted(response: [u8; 8], index: u16, sub: u8) -> u32 {
    let [low, high] = index.to_le_bytes();
    assert_eq!(response[..4], [0x80, low, high, sub], "{response:02X?}");
    u32::from_le_bytes(response[4..].try_into().unwrap())
}

#[test]
fn expedited_transfers_read_and_write_values() {
    let mut fixture = Fixture::booted();
    for (request, response) in [
        // device type, 4 bytes
        ([0x40, 0x00, 0x10, 0, 0, 0, 0, 0], [0x43, 0x00, 0x10, 0, 0x92, 0x01, 0x02, 0x00]),
        // producer heartbeat time, 2 bytes
        ([0x40, 0x17, 0x10, 0, 0, 0, 0, 0], [0x4B, 0x17, 0x10, 0, 0, 0, 0, 0]),
        // error register, 1 byte
        ([0x40, 0x01, 0x10, 0, 0, 0, 0, 0], [0x4F, 0x01, 0x10, 0, 0, 0, 0, 0]),
        // actual position of a drive at 1000
        ([0x40, 0x64, 0x60, 0, 0, 0, 0, 0], [0x43, 0x64, 0x60, 0, 0xE8, 0x03, 0, 0]),
        // profile velocity 123456, with its size
        ([0x23, 0x81, 0x60, 0, 0x40, 0xE2, 0x01, 0x00], [0x60, 0x81, 0x60, 0, 0, 0, 0, 0]),
        // mode of operation 8, without size
        ([0x22, 0x60, 0x60, 0, 8, 0xAA, 0xBB, 0xCC], [0x60, 0x60, 0x60, 0, 0, 0, 0, 0]),
    ] {
        assert_eq!(fixture.sdo(request), response, "{request:02X?}");
    }
    assert_eq!(fixture.drive.object(0x6081, 0), Some(123_456));
    assert_eq!(fixture.drive.object(0x6060, 0), Some(8));
}

#[test]
fn segmented_upload_returns_value() {
    let mut fixture = Fixture::booted();
    // device name "ECAN simulated servo drive", 26 bytes
    assert_eq!(fixture.sdo([0x40, 0x08, 0x10, 0, 0, 0, 0, 0]), [0x41, 0x08, 0x10, 0, 26, 0, 0, 0]);
    assert_eq!(fixture.sdo([0x60, 0, 0, 0, 0, 0, 0, 0]), *b"\x00ECAN si");
    assert_eq!(fixture.sdo([0x70, 0, 0, 0, 0, 0, 0, 0]), *b"\x10mulated");
    assert_eq!(fixture.sdo([0x60, 0, 0, 0, 0, 0, 0, 0]), *b"\x00 servo ");
    // 5 bytes, so 2 unused, and the last
    assert_eq!(fixture.sdo([0x70, 0, 0, 0, 0, 0, 0, 0]), *b"\x15drive\0\0");
}

#[test]
fn segmented_download_writes_value() {
    let mut fixture = Fixture::booted();
    assert_eq!(fixture.sdo([0x21, 0x01, 0x20, 0, 10, 0, 0, 0]), [0x60, 0x01, 0x20, 0, 0, 0, 0, 0]);
    assert_eq!(fixture.sdo(*b"\x00abcdefg"), [0x20, 0, 0, 0, 0, 0, 0, 0]);
    // 3 bytes, the last: 4 unused
    assert_eq!(fixture.sdo(*b"\x19hij\0\0\0\0"), [0x30, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(fixture.sdo([0x40, 0x01, 0x20, 0, 0, 0, 0, 0]), [0x41, 0x01, 0x20, 0, 10, 0, 0, 0]);
    assert_eq!(fixture.sdo([0x60, 0, 0, 0, 0, 0, 0, 0]), *b"\x00abcdefg");
    assert_eq!(fixture.sdo([0x70, 0, 0, 0, 0, 0, 0, 0]), *b"\x19hij\0\0\0\0");
}

#[test]
fn repeated_toggle_bit_is_aborted() {
    let mut fixture = Fixture::booted();
    fixture.sdo([0x40, 0x08, 0x10, 0, 0, 0, 0, 0]);
    fixture.sdo([0x60, 0, 0, 0, 0, 0, 0, 0]);
    let response = fixture.sdo([0x60, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(aborted(response, 0x1008, 0), 0x0503_0000);
    fixture.sdo([0x21, 0x01, 0x20, 0, 20, 0, 0, 0]);
    let response = fixture.sdo(*b"\x10abcdefg");
    assert_eq!(aborted(response, 0x2001, 0), 0x0503_0000);
    // the transfer has ended
    let response = fixture.sdo(*b"\x00abcdefg");
    assert_eq!(aborted(response, 0x2001, 0), 0x0504_0001);
}

/// Sizes that do not match the data.
#[test]
fn wrong_sizes_are_aborted() {
    let mut fixture = Fixture::booted();
    fixture.sdo([0x21, 0x01, 0x20, 0, 3, 0, 0, 0]);
    assert_eq!(aborted(fixture.sdo(*b"\x00abcdefg"), 0x2001, 0), 0x0607_0012);
    fixture.sdo([0x21, 0x01, 0x20, 0, 9, 0, 0, 0]);
    assert_eq!(aborted(fixture.sdo(*b"\x01abcdefg"), 0x2001, 0), 0x0607_0013);
}

#[test]
fn aborts_have_matching_codes() {
    let mut fixture = Fixture::booted();
    let reasons: [([u8; 8], u32); 10] = [
        // unknown object, unknown subindex
        ([0x40, 0x34, 0x12, 0, 0, 0, 0, 0], 0x0602_0000),
        ([0x40, 0x18, 0x10, 9, 0, 0, 0, 0], 0x0609_0011),
        ([0x2B, 0x34, 0x12, 0, 0, 0, 0, 0], 0x0602_0000),
        // statusword is read-only
        ([0x2B, 0x41, 0x60, 0, 0, 0, 0, 0], 0x0601_0002),
        // 4 bytes for 2, 1 byte for 2
        ([0x23, 0x17, 0x10, 0, 0, 0, 0, 0], 0x0607_0012),
        ([0x2F, 0x17, 0x10, 0, 0, 0, 0, 0], 0x0607_0013),
        // halt option code 5 of 1 to 4, and 0
        ([0x2B, 0x5D, 0x60, 0, 5, 0, 0, 0], 0x0609_0031),
        ([0x2B, 0x5D, 0x60, 0, 0, 0, 0, 0], 0x0609_0032),
        // unsupported mode of operation
        ([0x2F, 0x60, 0x60, 0, 5, 0, 0, 0], 0x0609_0030),
        // saving without the signature
        ([0x23, 0x10, 0x10, 1, 1, 2, 3, 4], 0x0800_0020),
    ];
    for (request, code) in reasons {
        let index = u16::from_le_bytes([request[1], request[2]]);
        assert_eq!(aborted(fixture.sdo(request), index, request[3]), code, "{request:02X?}");
    }
    // an unknown command is aborted, a frame of the wrong length is ignored
    assert_eq!(fixture.sdo([0xE0, 0, 0, 0, 0, 0, 0, 0])[0], 0x80);
    assert_eq!(fixture.frame(0x605, &[0x40, 0, 0x10]), []);
    // an abort of the client has no response
    assert_eq!(fixture.frame(0x605, &[0x80, 0, 0x10, 0, 0, 0, 0, 0]), []);
}

/// CRC-16 XMODEM bit by bit, independent of the server's table.
fn crc(data: &[u8]) -> u16 {
    data.iter().fold(0, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte) << 8, |crc: u16, _| {
            if crc & 0x8000 == 0 { crc << 1 } else { crc << 1 ^ 0x1021 }
        })
    })
}

fn block_download(fixture: &mut Fixture, value: &[u8], announce: bool) {
    let size = if announce { value.len() as u32 } else { 0 };
    let [a, b, c, d] = size.to_le_bytes();
    let command = 0xC4 | u8::from(announce) << 1;
    let response = fixture.sdo([command, 0x00, 0x20, 0, a, b, c, d]);
    assert_eq!(response, [0xA4, 0x00, 0x20, 0, 127, 0, 0, 0]);
    let chunks: Vec<_> = if value.is_empty() { vec![&[][..]] } else { value.chunks(7).collect() };
    let mut sequence = 0;
    for (number, chunk) in chunks.iter().enumerate() {
        sequence += 1;
        let last = number + 1 == chunks.len();
        let mut frame = [0; 8];
        frame[0] = sequence | u8::from(last) << 7;
        frame[1..=chunk.len()].copy_from_slice(chunk);
        let responses = fixture.sdo_all(frame);
        if last || sequence == 127 {
            assert_eq!(responses, [[0xA2, sequence, 127, 0, 0, 0, 0, 0]]);
            sequence = 0;
        } else {
            assert!(responses.is_empty());
        }
    }
    let used = chunks.last().unwrap().len();
    let [low, high] = crc(value).to_le_bytes();
    let end = [0xC1 | (7 - used as u8) << 2, low, high, 0, 0, 0, 0, 0];
    assert_eq!(fixture.sdo(end), [0xA1, 0, 0, 0, 0, 0, 0, 0]);
}

pub fn block_upload(fixture: &mut Fixture, block_size: u8) -> Vec<u8> {
    let response = fixture.sdo([0xA4, 0x00, 0x20, 0, block_size, 0, 0, 0]);
    assert_eq!(response[..4], [0xC6, 0x00, 0x20, 0]);
    let size = u32::from_le_bytes(response[4..].try_into().unwrap()) as usize;
    let mut value = Vec::new();
    let mut segments = fixture.sdo_all([0xA3, 0, 0, 0, 0, 0, 0, 0]);
    loop {
        for (number, segment) in segments.iter().enumerate() {
            assert_eq!(usize::from(segment[0] & 0x7F), number + 1);
            value.extend_from_slice(&segment[1..]);
        }
        let last = segments.last().unwrap()[0] & 0x80 != 0;
        let ack = [0xA2, segments.len() as u8, block_size, 0, 0, 0, 0, 0];
        segments = fixture.sdo_all(ack);
        if last {
            break;
        }
        assert!(segments.len() <= usize::from(block_size));
    }
    let end = segments[0];
    assert_eq!(end[0] & 0xE3, 0xC1);
    value.truncate(value.len() - usize::from(end[0] >> 2 & 7));
    assert_eq!(value.len(), size);
    assert_eq!(u16::from_le_bytes([end[1], end[2]]), crc(&value));
    assert!(fixture.sdo_all([0xA1, 0, 0, 0, 0, 0, 0, 0]).is_empty());
    value
}

#[test]
fn block_transfers_work_for_every_length() {
    let mut fixture = Fixture::booted();
    for length in [0, 1, 6, 7, 8, 14, 100, 888, 889, 890, 5000] {
        let value: Vec<u8> = (0..length).map(|number: usize| (number * 7 + 3) as u8).collect();
        block_download(&mut fixture, &value, length % 2 == 0);
        for block_size in [1, 5, 127] {
            assert_eq!(block_upload(&mut fixture, block_size), value, "{length} {block_size}");
        }
    }
}

#[test]
fn download_block_resumes_at_lost_segment() {
    let mut fixture = Fixture::booted();
    fixture.sdo([0xC6, 0x00, 0x20, 0, 14, 0, 0, 0]);
    assert!(fixture.sdo_all(*b"\x01abcdefg").is_empty());
    // segment 2 is lost, 3 and last arrives: the server has 1
    let responses = fixture.sdo_all(*b"\x83xxxxxxx");
    assert_eq!(responses, [[0xA2, 1, 127, 0, 0, 0, 0, 0]]);
    let responses = fixture.sdo_all(*b"\x81hijklmn");
    assert_eq!(responses, [[0xA2, 1, 127, 0, 0, 0, 0, 0]]);
    let [low, high] = crc(b"abcdefghijklmn").to_le_bytes();
    assert_eq!(fixture.sdo([0xC1, low, high, 0, 0, 0, 0, 0]), [0xA1, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(block_upload(&mut fixture, 10), b"abcdefghijklmn");
}

#[test]
fn upload_block_resumes_at_lost_segment() {
    let mut fixture = Fixture::booted();
    let value: Vec<u8> = (0..30).collect();
    block_download(&mut fixture, &value, true);
    fixture.sdo([0xA4, 0x00, 0x20, 0, 4, 0, 0, 0]);
    let segments = fixture.sdo_all([0xA3, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(segments.len(), 4);
    // the client received only the first two
    let segments = fixture.sdo_all([0xA2, 2, 4, 0, 0, 0, 0, 0]);
    assert_eq!(segments[0], [1, 14, 15, 16, 17, 18, 19, 20]);
    assert_eq!(segments[2], [0x83, 28, 29, 0, 0, 0, 0, 0]);
    let end = fixture.sdo([0xA2, 3, 4, 0, 0, 0, 0, 0]);
    assert_eq!(end[0], 0xC1 | 5 << 2);
}

#[test]
fn invalid_block_transfers_are_aborted() {
    let mut fixture = Fixture::booted();
    let code = |response: [u8; 8]| u32::from_le_bytes(response[4..].try_into().unwrap());
    // block sizes
    assert_eq!(code(fixture.sdo([0xA4, 0, 0x20, 0, 0, 0, 0, 0])), 0x0504_0002);
    assert_eq!(code(fixture.sdo([0xA4, 0, 0x20, 0, 128, 0, 0, 0])), 0x0504_0002);
    // CRC
    fixture.sdo([0xC6, 0, 0x20, 0, 7, 0, 0, 0]);
    fixture.sdo(*b"\x81abcdefg");
    assert_eq!(code(fixture.sdo([0xC1, 0x12, 0x34, 0, 0, 0, 0, 0])), 0x0504_0004);
    // an acknowledge of more than was sent
    fixture.sdo([0xA4, 0, 0x20, 0, 4, 0, 0, 0]);
    fixture.sdo_all([0xA3, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(code(fixture.sdo([0xA2, 4, 4, 0, 0, 0, 0, 0])), 0x0504_0003);
    // more than announced
    fixture.sdo([0xC6, 0, 0x20, 0, 3, 0, 0, 0]);
    fixture.sdo_all(*b"\x01abcdefg");
    assert_eq!(code(fixture.sdo(*b"\x02abcdefg")), 0x0607_0012);
    // a read-only object, a number by block
    assert_eq!(code(fixture.sdo([0xC6, 0x00, 0x10, 0, 4, 0, 0, 0])), 0x0601_0002);
    fixture.sdo([0xC6, 0x81, 0x60, 0, 4, 0, 0, 0]);
    fixture.sdo([0x81, 1, 2, 3, 4, 0, 0, 0]);
    let [low, high] = crc(&[1, 2, 3, 4]).to_le_bytes();
    let response = fixture.sdo([0xC1 | 3 << 2, low, high, 0, 0, 0, 0, 0]);
    assert_eq!(response, [0xA1, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(fixture.drive.object(0x6081, 0), Some(0x0403_0201));
}

#[test]
fn short_block_upload_may_be_answered_at_once() {
    let mut fixture = Fixture::booted();
    // the client allows the switch up to 4 bytes
    assert_eq!(
        fixture.sdo([0xA4, 0x00, 0x10, 0, 127, 4, 0, 0]),
        [0x43, 0x00, 0x10, 0, 0x92, 0x01, 0x02, 0x00]
    );
}

#[test]
fn drive_without_block_transfer_aborts() {
    let mut fixture =
        Fixture::with_quirks(DriveQuirks { no_block_transfer: true, ..Default::default() });
    for request in [[0xA4, 0, 0x20, 0, 127, 0, 0, 0], [0xC6, 0, 0x20, 0, 9, 0, 0, 0]] {
        assert_eq!(aborted(fixture.sdo(request), 0x2000, 0), 0x0504_0001);
    }
    let quirks = DriveQuirks { block_upload_falls_back: true, ..Default::default() };
    let mut fixture = Fixture::with_quirks(quirks);
    let response = fixture.sdo([0xA4, 0x08, 0x10, 0, 127, 0, 0, 0]);
    assert_eq!(response, [0x41, 0x08, 0x10, 0, 26, 0, 0, 0]);
    assert_eq!(fixture.sdo([0x60, 0, 0, 0, 0, 0, 0, 0]), *b"\x00ECAN si");
}

#[test]
fn sdo_rules_make_transfers_fail() {
    let rule = |index, direction, effect, times| SdoRule {
        index,
        subindex: None,
        direction,
        effect,
        times,
    };
    let abort = SdoEffect::Abort(ecan_protocol::object::AbortCode(0x0601_0000));
    let mut fixture = Fixture::with_quirks(DriveQuirks {
        sdo_rules: vec![
            rule(0x60C2, SdoDirection::Write, abort, Some(2)),
            rule(0x1018, SdoDirection::Read, SdoEffect::Silence, Some(1)),
        ],
        missing: vec![0x1016],
        ..DriveQuirks::default()
    });
    assert_eq!(fixture.read(0x60C2, 1), Ok(1));
    assert_eq!(fixture.write(0x60C2, 1, 2, 1), Err(0x0601_0000));
    assert_eq!(fixture.write(0x60C2, 2, -3, 1), Err(0x0601_0000));
    assert_eq!(fixture.write(0x60C2, 1, 2, 1), Ok(()));
    assert!(fixture.sdo_all([0x40, 0x18, 0x10, 1, 0, 0, 0, 0]).is_empty());
    assert_eq!(fixture.read(0x1018, 1), Ok(0x5349_4D00));
    assert_eq!(fixture.read(0x1016, 1), Err(0x0602_0000));
}

#[test]
fn responses_are_delayed() {
    let mut fixture = Fixture::with(&DriveConfig { sdo_delay_us: 500, ..config() });
    assert!(fixture.sdo_all([0x40, 0x00, 0x10, 0, 0, 0, 0, 0]).is_empty());
    let asked = fixture.now;
    fixture.pass_ms(1);
    let (at, (id, _)) = fixture.sent[0].clone();
    assert_eq!((at - asked, id), (500_000, 0x585));
}
