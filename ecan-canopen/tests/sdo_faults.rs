//! SDO transfers on a wire that loses, delays and damages frames, with servers that reject.

use std::time::Duration;

use crate::link::{Link, MS, TIMEOUT_MS, block_settings, settings, value};
use crate::reference::{self, Block, Server, abort};
use ecan_canopen::{Sdo, SdoConfig, SdoFault};
use ecan_protocol::object::AbortCode;
use proptest::prelude::*;

#[test]
fn abort_by_the_server_is_final_and_explained() {
    let mut server = Server::new(Block::Checked).with(0x6060, 0, &[1]);
    server.rejected.insert((0x6060, 0), 0x0609_0030);
    let mut link = Link::new(server, settings());
    let fault = SdoFault::Aborted(AbortCode(0x0609_0030));
    assert_eq!(link.download(0x6060, 0, &[200]), Sdo::Failed(fault));
    assert_eq!(fault.to_string(), "aborted by the node: 0x06090030 value range exceeded");
    assert_eq!(link.wire.len(), 2, "asked once, and no abort against an abort");
    assert_eq!(link.upload(0x7777, 1), Sdo::Failed(SdoFault::Aborted(AbortCode::NO_OBJECT)));
    for length in [5, 200] {
        assert_eq!(link.download(0x6060, 0, &value(length)), Sdo::Failed(fault), "{length}");
    }
}

#[test]
fn silence_is_aborted_and_tried_again_then_reported() {
    let mut link = Link::new(Server::new(Block::Checked).with(0x1000, 0, &[7]), settings());
    link.lost = (0..100).collect();
    assert_eq!(
        link.upload(0x1000, 0),
        Sdo::Failed(SdoFault::TimedOut { attempts: 3, stray: None })
    );
    let request = [0x40, 0x00, 0x10, 0, 0, 0, 0, 0];
    let timeout = [0x80, 0x00, 0x10, 0, 0x00, 0x00, 0x04, 0x05];
    assert_eq!(link.sent(), [request, timeout, request, timeout, request, timeout]);
    let elapsed_ms = link.now_ns / MS;
    assert!((60..=70).contains(&elapsed_ms), "three times {TIMEOUT_MS} ms, not {elapsed_ms}");
    link.lost.clear();
    assert_eq!(link.upload(0x1000, 0), Sdo::Done { len: 1 }, "and the client goes on");
}

#[test]
fn zero_retries_fail_on_one_lost_frame() {
    let once = SdoConfig { retries: 0, ..settings() };
    let mut link = Link::new(Server::new(Block::Checked).with(0x1000, 0, &[7]), once);
    link.lost = vec![1];
    let fault = SdoFault::TimedOut { attempts: 1, stray: None };
    assert_eq!(link.upload(0x1000, 0), Sdo::Failed(fault));
    assert_eq!(fault.to_string(), "no answer after 1 attempt");
}

#[test]
fn answers_that_do_not_count_are_named_after_the_timeout() {
    let cases: [(&[u8], &str); 4] = [
        (&[0x43, 0x00, 0x10, 0], "; the node sent an answer of 4 bytes, 8 are needed"),
        (&[0x4B, 0x00, 0x10, 0, 7], "; the node sent an answer of 5 bytes, 8 are needed"),
        (&[0x4F, 0x01, 0x10, 2, 7, 0, 0, 0], "; the node answered for 0x1001:02"),
        (&[0x60, 0x00, 0x10, 0, 0, 0, 0], "; the node sent an answer of 7 bytes, 8 are needed"),
    ];
    for (answer, text) in cases {
        let mut link =
            Link::new(Server::new(Block::Checked), SdoConfig { retries: 0, ..settings() });
        link.lost = (0..100).collect();
        link.client.start_upload(0x1000, 0).unwrap();
        link.client.sent(0);
        link.client.receive(answer, 0);
        let Sdo::Failed(fault) = link.run() else { panic!("{text}") };
        assert_eq!(fault.to_string(), format!("no answer after 1 attempt{text}"));
        assert_eq!(link.client.strays(), 1);
    }
}

#[test]
fn short_answer_with_its_whole_content_counts() {
    let mut link = Link::new(Server::new(Block::Checked), settings());
    for (answer, expected) in [
        (&[0x4B, 0x00, 0x10, 0, 7, 9][..], &[7, 9][..]),
        (&[0x47, 0x00, 0x10, 0, 1, 2, 3], &[1, 2, 3]),
    ] {
        link.client.start_upload(0x1000, 0).unwrap();
        link.client.sent(0);
        link.client.receive(answer, 0);
        assert_eq!(link.client.data(), expected);
    }
    link.client.start_download(0x1000, 0, &[1]).unwrap();
    link.client.sent(0);
    link.client.receive(&[0x60, 0x00, 0x10, 0], 0);
    assert_eq!(link.client.state(), Sdo::Done { len: 1 });
}

#[test]
fn server_that_sends_empty_segments_for_ever_is_aborted() {
    let mut link = Link::new(Server::new(Block::Checked), settings());
    link.client.start_upload(0x1008, 0).unwrap();
    link.client.sent(0);
    link.client.receive(&[0x40, 0x08, 0x10, 0, 0, 0, 0, 0], 0);
    let mut toggle = 0x00;
    for segment in 0..10 {
        if link.client.state() != Sdo::Busy {
            break;
        }
        link.client.sent(0);
        // Three bytes, then none.
        let unused = if segment == 0 { 4 } else { 7 };
        link.client.receive(&[toggle | unused << 1, 1, 2, 3, 0, 0, 0, 0], 0);
        toggle ^= 0x10;
    }
    let Sdo::Failed(fault) = link.client.state() else { panic!("{:?}", link.client.state()) };
    assert_eq!(fault, SdoFault::Endless { bytes: 3 });
    let abort = link.client.frame().unwrap();
    assert_eq!((abort[0], &abort[4..]), (0x80, &0x0800_0000_u32.to_le_bytes()[..]));
}

#[test]
fn answer_timeout_starts_when_the_frame_is_sent() {
    let mut link = Link::new(Server::new(Block::Checked).with(0x1000, 0, &[7]), settings());
    link.client.start_upload(0x1000, 0).unwrap();
    let frame = link.client.frame();
    // A bus without room for ten timeouts.
    for ms in 0..200 {
        link.client.tick(ms * MS);
        assert_eq!((link.client.frame(), link.client.state()), (frame, Sdo::Busy));
    }
    link.now_ns = 200 * MS;
    assert_eq!(link.run(), Sdo::Done { len: 1 });
    assert_eq!(link.wire.len(), 2);
}

#[test]
fn answer_to_storing_parameters_may_be_slow() {
    let server = || Server::new(Block::Checked).with(0x1010, 1, &[1, 0, 0, 0]);
    let storage_timeout = Duration::from_millis(2_000);
    let mut link = Link::new(server(), SdoConfig { storage_timeout, ..settings() });
    link.delays = vec![0, 1_900];
    assert_eq!(link.download(0x1010, 1, b"save"), Sdo::Done { len: 4 });
    assert_eq!(link.wire.len(), 2, "no repetition");
    // Reading the capability is as fast as any other object.
    let mut link = Link::new(server(), SdoConfig { storage_timeout, retries: 0, ..settings() });
    link.delays = vec![0, 1_900];
    assert_eq!(
        link.upload(0x1010, 1),
        Sdo::Failed(SdoFault::TimedOut { attempts: 1, stray: None })
    );
}

#[test]
fn wrong_toggle_bit_is_aborted() {
    for (answer, upload) in
        [([0x10, 1, 2, 3, 4, 5, 6, 7], true), ([0x30, 0, 0, 0, 0, 0, 0, 0], false)]
    {
        let once = SdoConfig { retries: 0, ..settings() };
        let server = Server::new(Block::Checked).with(0x1008, 0, &value(20));
        let mut link = Link::new(server, once);
        if upload {
            link.client.start_upload(0x1008, 0).unwrap();
        } else {
            link.client.start_download(0x1008, 0, &value(20)).unwrap();
        }
        link.step();
        assert!(link.client.frame().is_some(), "the first segment is due");
        link.client.sent(link.now_ns);
        link.client.receive(&answer, link.now_ns);
        let fault = SdoFault::Violated(AbortCode::TOGGLE);
        assert_eq!(link.run(), Sdo::Failed(fault));
        assert_eq!(fault.to_string(), "aborted by the host: 0x05030000 toggle bit not alternated");
        assert_eq!(link.server.aborts, [0x0503_0000]);
    }
}

#[test]
fn any_single_lost_frame_is_made_good() {
    for block in [Block::Checked, Block::Unchecked] {
        for settings in [settings(), block_settings()] {
            for patience_ms in [None, Some(5)] {
                for lost in 0..60 {
                    let data = value(150);
                    let mut server = Server::new(block).with(0x2000, 0, &data);
                    server.block_size = 7;
                    let mut link = Link::new(server, settings);
                    link.patience_ms = patience_ms;
                    link.lost = vec![lost];
                    assert_eq!(link.upload(0x2000, 0), Sdo::Done { len: 150 }, "frame {lost}");
                    assert_eq!(link.client.data(), data);
                    link.lost = vec![link.wire.len() + lost];
                    assert_eq!(link.download(0x2001, 0, &data), Sdo::Done { len: 150 });
                    assert_eq!(link.server.value(0x2001, 0), data, "frame {lost}");
                }
            }
        }
    }
}

#[test]
fn lost_segment_repeats_only_the_rest_of_its_block() {
    let data = value(100);
    let server = Server::new(Block::Checked).with(0x2000, 0, &data);
    let mut link = Link::new(server, block_settings());
    // Request, answer, start, segments 1 and 2; the third is lost.
    link.lost = vec![5];
    assert_eq!(link.upload(0x2000, 0), Sdo::Done { len: 100 });
    assert_eq!(link.client.data(), data);
    let sent = link.sent();
    assert_eq!(sent[2][..3], [0xA2, 2, 16], "two segments are here");
    assert_eq!(sent[3][..3], [0xA2, 13, 16], "and the other thirteen");
    assert!(link.server.aborts.is_empty());

    let mut server = Server::new(Block::Checked);
    server.block_size = 10;
    let mut link = Link::new(server, block_settings());
    link.lost = vec![5];
    assert_eq!(link.download(0x2001, 0, &data), Sdo::Done { len: 100 });
    assert_eq!(link.server.value(0x2001, 0), data);
    assert!(link.server.aborts.is_empty());
    // 15 segments of the value, 7 of the first block again, request and closing frame.
    assert_eq!(link.sent().len(), 15 + 7 + 2);
}

#[test]
fn lost_end_of_a_block_is_requested_again() {
    let data = value(100);
    let server = Server::new(Block::Checked).with(0x2000, 0, &data);
    let mut link = Link::new(server, block_settings());
    // The last two of fifteen segments.
    link.lost = vec![16, 17];
    assert_eq!(link.upload(0x2000, 0), Sdo::Done { len: 100 });
    assert_eq!(link.client.data(), data);
    assert_eq!(link.sent()[2][..3], [0xA2, 13, 16]);
    assert!(link.server.aborts.is_empty(), "no need to start over");
}

#[test]
fn damaged_block_is_rejected_by_its_crc() {
    let once = SdoConfig { retries: 0, ..block_settings() };
    let server = Server::new(Block::Checked).with(0x2000, 0, &value(21));
    let mut link = Link::new(server, once);
    link.client.start_upload(0x2000, 0).unwrap();
    link.step();
    // The server's block, with one bit changed.
    link.client.sent(link.now_ns);
    let data = value(21);
    for number in 1..=3u8 {
        let mut segment = [number | if number == 3 { 0x80 } else { 0 }, 0, 0, 0, 0, 0, 0, 0];
        segment[1..].copy_from_slice(&data[usize::from(number - 1) * 7..][..7]);
        segment[4] ^= u8::from(number == 2);
        link.client.receive(&segment, link.now_ns);
    }
    link.client.sent(link.now_ns);
    let [low, high] = reference::crc(&data).to_le_bytes();
    link.client.receive(&[0xC1, low, high, 0, 0, 0, 0, 0], link.now_ns);
    let fault = SdoFault::Violated(AbortCode(0x0504_0004));
    assert_eq!(link.run(), Sdo::Failed(fault));
    assert_eq!(fault.to_string(), "aborted by the host: 0x05040004 CRC error");
}

#[test]
fn block_rejected_by_the_server_is_sent_again() {
    let server = Server::new(Block::Checked);
    let mut link = Link::new(server, block_settings());
    link.client.start_download(0x2001, 0, &value(40)).unwrap();
    link.step();
    link.client.receive(&abort((0x2001, 0), 0x0504_0004), link.now_ns);
    assert_eq!(link.run(), Sdo::Done { len: 40 });
    assert_eq!(link.server.value(0x2001, 0), value(40));
}

#[test]
fn too_long_value_is_rejected_with_and_without_size() {
    let small = SdoConfig { buffer_bytes: 50, ..settings() };
    let small_block = SdoConfig { buffer_bytes: 50, ..block_settings() };
    for tells_size in [true, false] {
        for settings in [small, small_block] {
            let mut server = Server::new(Block::Checked).with(0x2000, 0, &value(51));
            server.tells_size = tells_size;
            let mut link = Link::new(server, settings);
            let fault = SdoFault::TooLong { capacity: 50 };
            assert_eq!(link.upload(0x2000, 0), Sdo::Failed(fault));
            assert_eq!(link.server.aborts, [0x0504_0005]);
            link.server.objects.insert((0x2000, 0), value(50));
            assert_eq!(link.upload(0x2000, 0), Sdo::Done { len: 50 });
        }
    }
}

#[test]
fn answers_about_other_objects_are_ignored() {
    let mut link = Link::new(Server::new(Block::Checked).with(0x1000, 0, &[7]), settings());
    link.client.start_upload(0x1000, 0).unwrap();
    link.client.sent(0);
    link.client.receive(&[0x4F, 0x00, 0x20, 0, 99, 0, 0, 0], 1);
    link.client.receive(&[0x4F, 0x00, 0x10, 1, 99, 0, 0, 0], 1);
    link.client.receive(&abort((0x2000, 0), 0x0602_0000), 1);
    link.client.receive(&[0xFF; 8], 1);
    assert_eq!((link.client.state(), link.client.strays()), (Sdo::Busy, 4));
    link.client.receive(&[0x4F, 0x00, 0x10, 0, 7, 0, 0, 0], 1);
    assert_eq!(link.client.data(), [7]);
    link.client.receive(&[0x4F, 0x00, 0x10, 0, 8, 0, 0, 0], 1);
    assert_eq!(link.client.data(), [7], "nothing was asked");
}

#[test]
fn wrong_service_for_the_object_is_a_violation() {
    let once = SdoConfig { retries: 0, ..settings() };
    let mut link = Link::new(Server::new(Block::Checked).with(0x1000, 0, &[7]), once);
    link.client.start_upload(0x1000, 0).unwrap();
    link.client.sent(0);
    link.client.receive(&[0x60, 0x00, 0x10, 0, 0, 0, 0, 0], 1);
    assert_eq!(link.run(), Sdo::Failed(SdoFault::Violated(AbortCode::COMMAND)));
    assert_eq!(link.server.aborts, [0x0504_0001]);
}

#[test]
fn cancel_aborts_only_a_transfer_known_to_the_server() {
    let mut link = Link::new(Server::new(Block::Checked).with(0x1000, 0, &value(9)), settings());
    link.client.start_upload(0x1000, 0).unwrap();
    link.client.cancel();
    assert_eq!(link.client.state(), Sdo::Failed(SdoFault::Cancelled));
    assert_eq!(link.client.frame(), None);
    link.client.start_upload(0x1000, 0).unwrap();
    link.step();
    link.client.cancel();
    link.client.start_upload(0x1000, 0).unwrap();
    assert_eq!(link.run(), Sdo::Done { len: 9 });
    assert_eq!(link.server.aborts, [0x0800_0000]);
    link.client.start_upload(0x1000, 0).unwrap();
    link.step();
    link.client.drop_transfer(SdoFault::GatewayLost);
    assert_eq!(link.client.frame(), None, "the server is out of reach");
    assert_eq!(link.client.state(), Sdo::Failed(SdoFault::GatewayLost));
}

#[test]
fn acknowledging_nothing_forever_does_not_keep_the_client_busy() {
    let once = SdoConfig { retries: 1, ..block_settings() };
    let mut link = Link::new(Server::new(Block::Checked), once);
    link.client.start_download(0x2000, 0, &value(60)).unwrap();
    for ms in 0..10_000 {
        if let Some(frame) = link.client.frame() {
            link.client.sent(ms * MS);
            let answer = match frame[0] {
                0xC6 => [0xA4, 0x00, 0x20, 0, 4, 0, 0, 0],
                0x80 => continue,
                number if number & 0x7F == 4 => [0xA2, 0, 4, 0, 0, 0, 0, 0],
                _ => continue,
            };
            link.client.receive(&answer, ms * MS);
        }
        link.client.tick(ms * MS);
        if link.client.state() != Sdo::Busy {
            break;
        }
    }
    assert_eq!(link.client.state(), Sdo::Failed(SdoFault::Violated(AbortCode(0x0504_0003))));
}

#[test]
fn answer_resembling_a_segment_is_not_one() {
    let data = value(100);
    let server = Server::new(Block::Checked).with(0x2000, 0, &data);
    let mut settings = block_settings();
    settings.block.segments = 100;
    let mut link = Link::new(server, settings);
    link.client.start_upload(0x2000, 0).unwrap();
    link.step();
    link.client.sent(link.now_ns);
    // The request was sent twice, because the first answer was late: here is the second.
    link.client.receive(&[0xC6, 0x00, 0x20, 0, 100, 0, 0, 0], link.now_ns);
    assert_eq!((link.client.strays(), link.client.frame()), (1, None));
    for frame in link.server.request([0xA3, 0, 0, 0, 0, 0, 0, 0]) {
        link.client.receive(&frame, link.now_ns);
    }
    assert_eq!(link.run(), Sdo::Done { len: 100 });
    assert_eq!(link.client.data(), data);
}

#[test]
fn block_without_size_and_crc_restarts() {
    let data = value(100);
    let mut server = Server::new(Block::Unchecked).with(0x2000, 0, &data);
    server.tells_size = false;
    let mut link = Link::new(server, block_settings());
    link.lost = vec![16, 17];
    assert_eq!(link.upload(0x2000, 0), Sdo::Done { len: 100 });
    assert_eq!(link.client.data(), data);
    assert_eq!(link.server.aborts, [0x0504_0000]);
}

#[test]
fn wrong_size_is_a_violation() {
    let once = SdoConfig { retries: 0, ..settings() };
    for (told, code) in [(8, 0x0607_0010), (9, 0x0607_0010), (6, 0x0607_0010)] {
        let mut link = Link::new(Server::new(Block::Checked), once);
        link.client.start_upload(0x2000, 0).unwrap();
        link.client.sent(0);
        link.client.receive(&[0x41, 0x00, 0x20, 0, told, 0, 0, 0], 0);
        link.client.sent(0);
        link.client.receive(&[0x01, 1, 2, 3, 4, 5, 6, 7], 0);
        let fault = SdoFault::Violated(AbortCode(code));
        assert_eq!(link.run(), Sdo::Failed(fault), "seven bytes came, {told} were told");
        assert_eq!(link.server.aborts, [code]);
    }
}

#[test]
fn late_abort_or_answer_does_not_end_an_unsent_attempt() {
    let mut link = Link::new(Server::new(Block::Checked).with(0x1000, 0, &[7]), settings());
    link.client.start_upload(0x1000, 0).unwrap();
    link.client.sent(0);
    link.now_ns = 100 * MS;
    link.client.tick(link.now_ns);
    link.client.sent(link.now_ns);
    assert_eq!(link.client.frame(), Some([0x40, 0x00, 0x10, 0, 0, 0, 0, 0]), "asking again");
    link.client.receive(&abort((0x1000, 0), 0x0504_0000), link.now_ns);
    assert_eq!((link.client.strays(), link.client.state()), (1, Sdo::Busy));
    // Nor does a late answer.
    link.client.receive(&[0x4F, 0x00, 0x10, 0, 9, 0, 0, 0], link.now_ns);
    assert_eq!((link.client.strays(), link.client.state()), (2, Sdo::Busy));
    assert_eq!(link.run(), Sdo::Done { len: 1 });
    assert_eq!((link.client.data(), link.wire.len()), (&[7][..], 2));
}

fn server_kind() -> impl Strategy<Value = Block> {
    prop_oneof![
        Just(Block::Checked),
        Just(Block::Unchecked),
        Just(Block::Segmented),
        Just(Block::Rejected(0x0504_0001)),
        Just(Block::Rejected(0x0800_0000)),
    ]
}

/// An up- or download of random bytes, and how the server takes it.
#[derive(Debug, Clone)]
struct Case {
    data: Vec<u8>,
    block: Block,
    block_size: u8,
    segments: u8,
    uses_block: bool,
    is_upload: bool,
    tells_size: bool,
    patience_ms: Option<u64>,
}

fn case() -> impl Strategy<Value = Case> {
    (
        proptest::collection::vec(any::<u8>(), 0..300),
        server_kind(),
        1..=127u8,
        1..=127u8,
        any::<[bool; 3]>(),
        proptest::option::of(3..19u64),
    )
        .prop_map(|(data, block, block_size, segments, flags, patience_ms)| Case {
            // Without a size, an expedited value has four bytes.
            tells_size: flags[2] || (1..4).contains(&data.len()),
            data,
            block,
            block_size,
            segments,
            uses_block: flags[0],
            is_upload: flags[1],
            patience_ms,
        })
}

impl Case {
    fn link(&self) -> Link {
        let mut server = Server::new(self.block).with(0x2000, 0, &self.data);
        server.block_size = self.block_size;
        server.tells_size = self.tells_size;
        let mut settings = if self.uses_block { block_settings() } else { settings() };
        settings.block.segments = self.segments;
        let mut link = Link::new(server, settings);
        link.patience_ms = self.patience_ms;
        link
    }

    fn transfer(&self, link: &mut Link) -> Sdo {
        if self.is_upload {
            link.upload(0x2000, 0)
        } else {
            link.server.objects.remove(&(0x2001, 0));
            link.download(0x2001, 0, &self.data)
        }
    }

    /// What the transfer brought to its destination.
    fn result<'a>(&self, link: &'a Link) -> &'a [u8] {
        if self.is_upload { link.client.data() } else { link.server.value(0x2001, 0) }
    }
}

proptest! {
    #![proptest_config(ProptestConfig {
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn lost_frames_up_to_the_retries_are_tolerated(
        case in case(),
        lost in proptest::collection::vec(0..150usize, 0..=2),
    ) {
        let mut link = case.link();
        link.lost = lost;
        prop_assert_eq!(case.transfer(&mut link), Sdo::Done { len: case.data.len() });
        prop_assert_eq!(case.result(&link), &case.data[..]);
    }

    #[test]
    fn success_is_never_reported_for_other_bytes_whatever_is_lost(
        case in case(),
        lost in proptest::collection::vec(any::<bool>(), 0..400),
        share in 1..30usize,
    ) {
        let mut link = case.link();
        link.lost = lost.iter().enumerate()
            .filter(|(at, lost)| **lost && at * 7 % 30 < share)
            .map(|(at, _)| at)
            .collect();
        match case.transfer(&mut link) {
            Sdo::Done { len } => {
                prop_assert_eq!(len, case.data.len());
                prop_assert_eq!(case.result(&link), &case.data[..]);
            }
            Sdo::Failed(fault) => {
                prop_assert!(matches!(fault, SdoFault::TimedOut { attempts: 3, .. }
                    | SdoFault::Violated(_) | SdoFault::Aborted(_)), "{}", fault);
            }
            state => prop_assert!(false, "{}", state),
        }
        // And when the bus is well again, the next transfer succeeds.
        link.lost.clear();
        prop_assert_eq!(case.transfer(&mut link), Sdo::Done { len: case.data.len() });
        prop_assert_eq!(case.result(&link), &case.data[..]);
    }

    #[test]
    fn late_answers_are_not_mistaken_for_others(
        mut case in case(),
        delays in proptest::collection::vec(prop_oneof![4 => Just(0), 1 => 0..60u64], 0..200),
    ) {
        // Whoever sends blocks twice because of a delay needs the CRC to reveal it.
        if case.block == Block::Unchecked {
            case.block = Block::Checked;
        }
        let mut link = case.link();
        link.delays = delays;
        if let Sdo::Done { len } = case.transfer(&mut link) {
            prop_assert_eq!(len, case.data.len());
            let result = case.result(&link).to_vec();
            prop_assert_eq!(&result, &case.data);
        }
        link.settle();
        link.delays.clear();
        prop_assert_eq!(case.transfer(&mut link), Sdo::Done { len: case.data.len() });
        prop_assert_eq!(case.result(&link), &case.data[..]);
    }

    #[test]
    fn any_bytes_from_the_server_leave_the_client_well(
        case in case(),
        frames in proptest::collection::vec((any::<[u8; 8]>(), 0..4u8), 0..200),
    ) {
        let mut link = case.link();
        if case.is_upload {
            link.client.start_upload(0x2000, 0).unwrap();
        } else {
            link.client.start_download(0x2000, 0, &case.data).unwrap();
        }
        for (mut frame, kind) in frames {
            link.now_ns += MS;
            if link.client.frame().is_some() {
                link.client.sent(link.now_ns);
            }
            if kind > 0 {
                // About the right object, and with a plausible command.
                frame[1..4].copy_from_slice(&[0x00, 0x20, 0x00]);
            }
            if kind > 1 {
                frame[0] &= 0xE7;
            }
            if frame[0] != 0x80 {
                link.client.receive(&frame, link.now_ns);
            }
            link.client.tick(link.now_ns);
            prop_assert!(link.client.data().len() <= link.client.capacity());
        }
        link.client.cancel();
        // The first request still finds the server as the rubbish has left it.
        link.run();
        prop_assert_eq!(case.transfer(&mut link), Sdo::Done { len: case.data.len() });
        prop_assert_eq!(case.result(&link), &case.data[..]);
    }
}
