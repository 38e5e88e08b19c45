//! SDO servers that announce wrong sizes, CRCs and segments: a transfer ends with the whole value or a typed error.

use crate::link::{MS, block_settings, settings, value};
use crate::reference::{Block, Frame, Server};
use ecan_canopen::{Sdo, SdoClient, SdoConfig, SdoFault};
use ecan_protocol::object::AbortCode;
use proptest::prelude::*;

const LENGTH: SdoFault = SdoFault::Violated(AbortCode::LENGTH);
const SEQUENCE: SdoFault = SdoFault::Violated(AbortCode(0x0504_0003));
const CRC: SdoFault = SdoFault::Violated(AbortCode(0x0504_0004));
const BLOCK_SIZE: SdoFault = SdoFault::Violated(AbortCode(0x0504_0002));

/// Object of all transfers.
const KEY: (u16, u8) = (0x2000, 0);

fn once(settings: SdoConfig) -> SdoConfig {
    SdoConfig { retries: 0, buffer_bytes: 500, ..settings }
}

/// Runs a transfer with a server whose responses `change` falsifies; it gets the number of the response, from 0.
fn run(
    client: &mut SdoClient,
    server: &mut Server,
    mut change: impl FnMut(usize, &mut Frame),
) -> Sdo {
    let mut responses = 0;
    for ms in 0..5_000 {
        if let Some(frame) = client.frame() {
            client.sent(ms * MS);
            for mut response in server.request(frame) {
                change(responses, &mut response);
                responses += 1;
                client.receive(&response, ms * MS);
            }
        }
        client.tick(ms * MS);
        if client.state() != Sdo::Busy && client.frame().is_none() {
            return client.state();
        }
    }
    panic!("the transfer does not end");
}

fn upload(
    settings: SdoConfig,
    server: Server,
    length: usize,
    change: impl FnMut(usize, &mut Frame),
) -> (Sdo, Vec<u8>) {
    let mut server = server.with(KEY.0, KEY.1, &value(length));
    let mut client = SdoClient::new(settings);
    client.start_upload(KEY.0, KEY.1).unwrap();
    let state = run(&mut client, &mut server, change);
    (state, client.data().to_vec())
}

fn announce(frame: &mut Frame, size: u32) {
    frame[4..].copy_from_slice(&size.to_le_bytes());
}

#[test]
fn announced_size_must_be_that_of_the_value() {
    for settings in [once(settings()), once(block_settings())] {
        for length in [100, 98, 105, 490] {
            for announced in [0, 1, length - 7, length - 1, length + 1, length + 7, 500] {
                let (state, data) =
                    upload(settings, Server::new(Block::Checked), length, |nth, frame| {
                        if nth == 0 {
                            announce(frame, announced as u32);
                        }
                    });
                assert_eq!(state, Sdo::Failed(LENGTH), "{length} bytes, announced: {announced}");
                assert!(data.is_empty());
            }
        }
        let (state, _) = upload(settings, Server::new(Block::Checked), 100, |nth, frame| {
            if nth == 0 {
                announce(frame, u32::MAX);
            }
        });
        assert_eq!(state, Sdo::Failed(SdoFault::TooLong { capacity: 500 }));
    }
}

#[test]
fn early_end_of_the_value_is_a_violation() {
    let (state, data) = upload(once(settings()), Server::new(Block::Checked), 100, |nth, frame| {
        frame[0] |= u8::from(nth == 5);
    });
    assert_eq!((state, data.len()), (Sdo::Failed(LENGTH), 0));
    // The fifth segment of a block is marked as the last one of the value; the server continues.
    let (state, data) =
        upload(once(block_settings()), Server::new(Block::Checked), 100, |nth, frame| {
            frame[0] |= if nth == 5 { 0x80 } else { 0 };
        });
    assert!(matches!(state, Sdo::Failed(_)), "{state}");
    assert!(data.is_empty());
}

#[test]
fn wrong_number_of_unused_bytes_is_a_violation() {
    let mut without_size = Server::new(Block::Checked);
    without_size.tells_size = false;
    // The size reveals it, and without a size the CRC.
    for (server, fault) in [(Server::new(Block::Checked), LENGTH), (without_size, CRC)] {
        let (state, data) = upload(once(block_settings()), server, 100, |_, frame| {
            if frame[0] & 0xE3 == 0xC1 {
                frame[0] ^= 0b100;
            }
        });
        assert_eq!((state, data.len()), (Sdo::Failed(fault), 0));
    }
}

#[test]
fn wrong_crc_is_a_violation() {
    let (state, data) =
        upload(once(block_settings()), Server::new(Block::Checked), 100, |_, frame| {
            if frame[0] & 0xE3 == 0xC1 {
                frame[1] ^= 1;
            }
        });
    assert_eq!((state, data.len()), (Sdo::Failed(CRC), 0));
}

#[test]
fn more_segments_than_the_block_has_are_a_violation() {
    // The client asks for blocks of 4; the server sends 6, then continues with the next one.
    for (surplus, retries) in [(1, 0), (2, 0), (6, 0), (2, 2)] {
        let mut block = block_settings();
        block.block.segments = 4;
        let settings = SdoConfig { retries, ..block };
        let data = value(70);
        let mut client = SdoClient::new(settings);
        client.start_block_upload(KEY.0, KEY.1).unwrap();
        let mut at = 0;
        let mut aborts = 0;
        for ms in 0..1_000 {
            let Some(frame) = client.frame() else {
                client.tick(ms * MS);
                continue;
            };
            client.sent(ms * MS);
            match frame[0] {
                0xA4 => {
                    at = 0;
                    // Neither size nor CRC
                    client.receive(&[0xC0, 0x00, 0x20, 0, 0, 0, 0, 0], ms * MS);
                }
                0xA3 | 0xA2 => {
                    for sequence in 1..=4 + surplus {
                        let mut segment = [sequence, 0, 0, 0, 0, 0, 0, 0];
                        let end = data.len().min(at + 7);
                        segment[1..=end - at].copy_from_slice(&data[at..end]);
                        at = end;
                        segment[0] |= if at == data.len() { 0x80 } else { 0 };
                        client.receive(&segment, ms * MS);
                        if at == data.len() {
                            break;
                        }
                    }
                }
                0x80 => aborts += 1,
                other => panic!("{other:02X}"),
            }
        }
        assert_eq!(client.state(), Sdo::Failed(SEQUENCE), "{surplus} too many");
        assert_eq!(aborts, u32::from(retries) + 1);
        assert!(client.data().is_empty());
    }
}

#[test]
fn block_size_and_acknowledgement_of_a_download_are_checked() {
    let falsify = |change: fn(usize, &mut Frame)| {
        let mut server = Server::new(Block::Checked);
        server.block_size = 10;
        let mut client = SdoClient::new(once(block_settings()));
        client.start_download(KEY.0, KEY.1, &value(100)).unwrap();
        let state = run(&mut client, &mut server, change);
        assert!(server.value(KEY.0, KEY.1).is_empty(), "nothing was stored");
        state
    };
    for invalid in
        [|_: usize, frame: &mut Frame| frame[4] = 0, |_: usize, frame: &mut Frame| frame[4] = 128]
    {
        assert_eq!(falsify(invalid), Sdo::Failed(BLOCK_SIZE), "block size of the first block");
    }
    let state = falsify(|nth, frame| {
        if nth == 1 {
            frame[2] = 0;
        }
    });
    assert_eq!(state, Sdo::Failed(BLOCK_SIZE), "of the next block");
    let state = falsify(|nth, frame| {
        if nth == 1 {
            frame[1] = 11;
        }
    });
    assert_eq!(state, Sdo::Failed(SEQUENCE), "more segments acknowledged than sent");
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// A changed size, sequence number, toggle bit, length or checksum in any response delays or ends a transfer.
    /// The value is never a wrong one.
    #[test]
    fn falsified_response_never_gives_a_wrong_value(
        length in 15..300usize,
        by_block: bool,
        nth in 0..60usize,
        bits in 1..=255u8,
        retries in 0..3u8,
    ) {
        let settings = if by_block { block_settings() } else { settings() };
        let settings = SdoConfig { retries, buffer_bytes: 500, ..settings };
        let (state, data) = upload(settings, Server::new(Block::Checked), length, |response, frame| {
            if response == nth {
                match response {
                    // The size; the command would be a valid one of another transfer type.
                    0 => frame[4] ^= bits,
                    _ => frame[0] ^= bits,
                }
            }
        });
        match state {
            Sdo::Done { len } => {
                prop_assert_eq!(len, length);
                prop_assert_eq!(data, value(length));
            }
            Sdo::Failed(_) => prop_assert!(data.is_empty()),
            other => prop_assert!(false, "{}", other),
        }
    }
}
