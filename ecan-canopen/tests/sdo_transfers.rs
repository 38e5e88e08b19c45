//! SDO transfers that go well, byte by byte against the tables of CiA 301.

use crate::link::{Link, Way, block_settings, settings, value};
use crate::reference::{self, Block, Server};
use ecan_canopen::{Sdo, SdoConfig, SdoStartError};

#[test]
fn expedited_values_of_every_length() {
    for (length, up, down) in [(1, 0x4F, 0x2F), (2, 0x4B, 0x2B), (3, 0x47, 0x27), (4, 0x43, 0x23)] {
        let bytes = [0x11, 0x22, 0x33, 0x44];
        let mut padded = [0; 4];
        padded[..length].copy_from_slice(&bytes[..length]);
        let [a, b, c, d] = padded;
        let mut link =
            Link::new(Server::new(Block::Checked).with(0x6040, 2, &bytes[..length]), settings());
        assert_eq!(link.upload(0x6040, 2), Sdo::Done { len: length });
        assert_eq!(link.client.data(), &bytes[..length]);
        assert_eq!(link.download(0x6041, 3, &bytes[..length]), Sdo::Done { len: length });
        assert_eq!(link.server.value(0x6041, 3), &bytes[..length]);
        assert_eq!(
            link.wire,
            [
                (Way::ToServer, [0x40, 0x40, 0x60, 2, 0, 0, 0, 0]),
                (Way::ToClient, [up, 0x40, 0x60, 2, a, b, c, d]),
                (Way::ToServer, [down, 0x41, 0x60, 3, a, b, c, d]),
                (Way::ToClient, [0x60, 0x41, 0x60, 3, 0, 0, 0, 0]),
            ]
        );
    }
}

#[test]
fn segmented_upload() {
    let mut link =
        Link::new(Server::new(Block::Checked).with(0x1008, 0, b"Servo drive X"), settings());
    assert_eq!(link.upload(0x1008, 0), Sdo::Done { len: 13 });
    assert_eq!(link.client.data(), b"Servo drive X");
    assert_eq!(
        link.wire,
        [
            (Way::ToServer, [0x40, 0x08, 0x10, 0, 0, 0, 0, 0]),
            (Way::ToClient, [0x41, 0x08, 0x10, 0, 13, 0, 0, 0]),
            (Way::ToServer, [0x60, 0, 0, 0, 0, 0, 0, 0]),
            (Way::ToClient, [0x00, b'S', b'e', b'r', b'v', b'o', b' ', b'd']),
            (Way::ToServer, [0x70, 0, 0, 0, 0, 0, 0, 0]),
            (Way::ToClient, [0x13, b'r', b'i', b'v', b'e', b' ', b'X', 0]),
        ]
    );
}

#[test]
fn segmented_download() {
    let mut link = Link::new(Server::new(Block::Checked), settings());
    assert_eq!(link.download(0x2001, 7, b"0123456789"), Sdo::Done { len: 10 });
    assert_eq!(link.server.value(0x2001, 7), b"0123456789");
    assert_eq!(
        link.wire,
        [
            (Way::ToServer, [0x21, 0x01, 0x20, 7, 10, 0, 0, 0]),
            (Way::ToClient, [0x60, 0x01, 0x20, 7, 0, 0, 0, 0]),
            (Way::ToServer, [0x00, b'0', b'1', b'2', b'3', b'4', b'5', b'6']),
            (Way::ToClient, [0x20, 0, 0, 0, 0, 0, 0, 0]),
            (Way::ToServer, [0x19, b'7', b'8', b'9', 0, 0, 0, 0]),
            (Way::ToClient, [0x30, 0, 0, 0, 0, 0, 0, 0]),
        ]
    );
}

#[test]
fn block_upload_with_crc() {
    let text = b"123456789ABCDEFG";
    let [low, high] = reference::crc(text).to_le_bytes();
    let mut link = Link::new(Server::new(Block::Checked).with(0x1009, 0, text), settings());
    link.client.start_block_upload(0x1009, 0).unwrap();
    assert_eq!(link.run(), Sdo::Done { len: 16 });
    assert_eq!(link.client.data(), text);
    assert_eq!(
        link.wire,
        [
            (Way::ToServer, [0xA4, 0x09, 0x10, 0, 16, 14, 0, 0]),
            (Way::ToClient, [0xC6, 0x09, 0x10, 0, 16, 0, 0, 0]),
            (Way::ToServer, [0xA3, 0, 0, 0, 0, 0, 0, 0]),
            (Way::ToClient, [0x01, b'1', b'2', b'3', b'4', b'5', b'6', b'7']),
            (Way::ToClient, [0x02, b'8', b'9', b'A', b'B', b'C', b'D', b'E']),
            (Way::ToClient, [0x83, b'F', b'G', 0, 0, 0, 0, 0]),
            (Way::ToServer, [0xA2, 3, 16, 0, 0, 0, 0, 0]),
            (Way::ToClient, [0xD5, low, high, 0, 0, 0, 0, 0]),
            (Way::ToServer, [0xA1, 0, 0, 0, 0, 0, 0, 0]),
        ]
    );
}

#[test]
fn block_download_with_crc() {
    let mut server = Server::new(Block::Checked);
    server.block_size = 2;
    let mut link = Link::new(server, block_settings());
    assert_eq!(link.download(0x2002, 1, b"123456789ABCDEF"), Sdo::Done { len: 15 });
    assert_eq!(link.server.value(0x2002, 1), b"123456789ABCDEF");
    let [low, high] = reference::crc(b"123456789ABCDEF").to_le_bytes();
    assert_eq!(
        link.wire,
        [
            (Way::ToServer, [0xC6, 0x02, 0x20, 1, 15, 0, 0, 0]),
            (Way::ToClient, [0xA4, 0x02, 0x20, 1, 2, 0, 0, 0]),
            (Way::ToServer, [0x01, b'1', b'2', b'3', b'4', b'5', b'6', b'7']),
            (Way::ToServer, [0x02, b'8', b'9', b'A', b'B', b'C', b'D', b'E']),
            (Way::ToClient, [0xA2, 2, 2, 0, 0, 0, 0, 0]),
            (Way::ToServer, [0x81, b'F', 0, 0, 0, 0, 0, 0]),
            (Way::ToClient, [0xA2, 1, 2, 0, 0, 0, 0, 0]),
            (Way::ToServer, [0xD9, low, high, 0, 0, 0, 0, 0]),
            (Way::ToClient, [0xA1, 0, 0, 0, 0, 0, 0, 0]),
        ]
    );
}

#[test]
fn every_length_goes_both_ways_in_every_manner() {
    for block in [Block::Checked, Block::Unchecked, Block::Segmented] {
        for tells_size in [true, false] {
            for length in (0..40).chain([111, 112, 113, 500, 889, 890, 1024]) {
                let data = value(length);
                for settings in [settings(), block_settings()] {
                    let mut server = Server::new(block).with(0x2000, 0, &data);
                    server.tells_size = tells_size;
                    let mut link = Link::new(server, settings);
                    let done = Sdo::Done { len: length };
                    // Without a size an expedited value counts as four bytes.
                    if tells_size || !(1..4).contains(&length) {
                        assert_eq!(link.upload(0x2000, 0), done, "{block:?} {length}");
                        assert_eq!(link.client.data(), data);
                    }
                    assert_eq!(link.download(0x2003, 1, &data), done, "{block:?} {length}");
                    assert_eq!(link.server.value(0x2003, 1), data);
                    assert!(link.server.aborts.is_empty());
                    assert_eq!(link.client.strays(), 0);
                }
            }
        }
    }
}

#[test]
fn server_without_block_transfer_gets_one_block_request() {
    let data = value(100);
    let server = Server::new(Block::Rejected(0x0504_0001)).with(0x2000, 0, &data);
    let mut link = Link::new(server, block_settings());
    assert_eq!(link.upload(0x2000, 0), Sdo::Done { len: 100 });
    assert_eq!(link.server.commands[..2], [0xA4, 0x40]);
    assert_eq!(link.download(0x2001, 0, &data), Sdo::Done { len: 100 });
    assert_eq!(link.server.value(0x2001, 0), data);
    link.server.commands.clear();
    assert_eq!(link.upload(0x2000, 0), Sdo::Done { len: 100 });
    assert_eq!(link.download(0x2001, 0, &data), Sdo::Done { len: 100 });
    assert!(!link.server.commands.iter().any(|command| command & 0xE0 == 0xC0));
    assert_eq!(link.server.commands[0], 0x40, "known not to support blocks");
    assert_eq!(link.client.data(), data);
}

#[test]
fn ignored_block_request_falls_back_to_segments() {
    let data = value(50);
    let server = Server::new(Block::Ignored).with(0x2000, 0, &data);
    let mut link = Link::new(server, block_settings());
    assert_eq!(link.upload(0x2000, 0), Sdo::Done { len: 50 });
    assert_eq!(link.client.data(), data);
    assert_eq!(link.download(0x2001, 0, &data), Sdo::Done { len: 50 });
    assert_eq!(link.server.value(0x2001, 0), data);
    assert_eq!(link.server.aborts, [0x0504_0000; 2], "each rejected attempt was aborted");
}

#[test]
fn small_object_arrives_in_one_frame_despite_block_request() {
    let server = Server::new(Block::Checked).with(0x1000, 0, &[0x92, 0x01, 0x02, 0x00]);
    let mut link = Link::new(server, block_settings());
    assert_eq!(link.upload(0x1000, 0), Sdo::Done { len: 4 });
    assert_eq!(link.wire.len(), 2);
}

#[test]
fn one_transfer_at_a_time_and_only_what_fits() {
    let small = SdoConfig { buffer_bytes: 10, ..settings() };
    let mut link = Link::new(Server::new(Block::Checked).with(0x2000, 0, &[1]), small);
    assert_eq!(
        link.client.start_download(0x2000, 0, &[0; 11]),
        Err(SdoStartError::TooLong { length: 11, capacity: 10 })
    );
    link.client.start_upload(0x2000, 0).unwrap();
    assert_eq!(link.client.start_upload(0x2000, 0), Err(SdoStartError::Busy));
    assert_eq!(link.client.start_download(0x2000, 0, &[1]), Err(SdoStartError::Busy));
    assert_eq!(link.client.data(), []);
    assert_eq!(link.run(), Sdo::Done { len: 1 });
    assert_eq!(link.download(0x2000, 0, &value(10)), Sdo::Done { len: 10 });
}
