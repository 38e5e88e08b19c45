//! Behaviour of the nodes.

use crate::ecrt_support::frame;
use ecan_protocol::can::{CanFrame, CanId, Dlc};
use ecan_sim::{
    EchoNode, FaultyConfig, FaultyNode, Node, NodeOutput, ReplayNode, ReplayRecord, SilentNode,
};

fn drain(out: &mut NodeOutput) -> Vec<CanFrame> {
    std::iter::from_fn(|| out.pop()).collect()
}

/// Runs a node by its own times; returns each frame with its time.
fn play(node: &mut dyn Node, until: u64) -> Vec<(u64, CanFrame)> {
    let mut out = NodeOutput::new();
    let mut played = Vec::new();
    while let Some(due) = node.next_event().filter(|&due| due <= until) {
        node.advance(due, &mut out);
        played.extend(drain(&mut out).into_iter().map(|frame| (due, frame)));
    }
    played
}

#[test]
fn echo_node_answers_in_kind_and_order() {
    let id = CanId::extended(0x1234_5678).unwrap();
    let frames = [
        frame(0x123, &[1, 2, 3]),
        CanFrame::remote(id, Dlc::new(4).unwrap()).unwrap(),
        CanFrame::fd(id, &[9; 48], true, false).unwrap(),
    ];
    let mut node = EchoNode::new();
    let mut out = NodeOutput::new();
    for (now, frame) in frames.iter().enumerate() {
        node.received(now as u64, frame, &mut out);
    }
    assert_eq!(out.len(), 3);
    assert_eq!(out.front(), Some(&frames[0]));
    assert_eq!(drain(&mut out), frames);
    assert_eq!(node.echoed(), 3);
    // It does not answer its own frames.
    node.transmitted(9, &frames[0], &mut out);
    assert!(out.is_empty());
    assert_eq!(node.next_event(), None);
}

#[test]
fn silent_node_sends_nothing() {
    let mut out = NodeOutput::new();
    let mut node = SilentNode;
    node.started(0, &mut out);
    node.received(1, &frame(1, &[]), &mut out);
    assert!(out.is_empty());
    assert_eq!(node.next_event(), None);
}

const LOG: &str = "\
# recorded by hand
(100.000000) can0 101#01
(100.000500) can1 201#
(100.001000) can0 102#02

(100.000900) can0 103#03
(100.002000) can0 104#04
";

#[test]
fn replay_keeps_recorded_intervals() {
    let mut node = ReplayNode::from_log(LOG, Some("can0")).unwrap().with_start_delay(7);
    assert_eq!(node.next_event(), None, "not before it is started");
    node.started(1_000, &mut NodeOutput::new());
    let played = play(&mut node, u64::MAX);
    let times: Vec<_> = played.iter().map(|(at, frame)| (*at, frame.id().raw())).collect();
    // 103 is older than 102 in the log: both are sent together, and 104 is sent 1.1 ms after 103.
    assert_eq!(times, [(1_007, 0x101), (1_001_007, 0x102), (1_001_007, 0x103), (2_101_007, 0x104)]);
    assert_eq!(node.sent(), 4);
    assert_eq!(node.next_event(), None);
    // After a restart, as after a power cycle, it begins again.
    node.started(5_000_000, &mut NodeOutput::new());
    assert_eq!(node.next_event(), Some(5_000_007));
}

#[test]
fn replay_of_all_interfaces_contains_every_record() {
    assert_eq!(ReplayNode::from_log(LOG, None).unwrap().records().len(), 5);
}

#[test]
fn replay_skips_error_messages() {
    let log = "(1.000000) can0 20000080#0000000000000000\n(2.000000) can0 123#1122334455667788_B\n";
    let node = ReplayNode::from_log(log, None).unwrap();
    let records: Vec<_> = node.records().iter().map(|record| record.frame.data().len()).collect();
    assert_eq!(records, [8]);
}

#[test]
fn replay_recognizes_other_formats() {
    let texts = [
        "  can0  123   [1]  11\n  can0  124   [0] \n",
        "base hex timestamps absolute\n1.5 1 123 Rx d 1 11\n1.5 2 124 Rx d 0\n",
        ";$FILEVERSION=1.1\n 1) 1.0 Rx 0123 1 11\n 2) 1.0 Rx 0124 0\n",
    ];
    for text in texts {
        let node = ReplayNode::from_log(text, None).unwrap();
        let frames: Vec<_> = node.records().iter().map(|record| record.frame).collect();
        assert_eq!(frames, [frame(0x123, &[0x11]), frame(0x124, &[])], "{text}");
    }
}

#[test]
fn replay_can_repeat() {
    let records = vec![
        ReplayRecord { time_ns: 50, frame: frame(1, &[]) },
        ReplayRecord { time_ns: 60, frame: frame(2, &[]) },
    ];
    let mut node = ReplayNode::new(records).with_repeat(100);
    node.started(0, &mut NodeOutput::new());
    let times: Vec<_> = play(&mut node, 230).iter().map(|(at, _)| *at).collect();
    assert_eq!(times, [0, 10, 110, 120, 220, 230]);
}

#[test]
fn invalid_log_is_rejected_with_line() {
    let error = ReplayNode::from_log("# ok\n(1.000000) can0 12#\n", None).unwrap_err();
    assert_eq!(error.line, 2);
    assert_eq!(
        error.to_string(),
        "line 2, column 19: expected a CAN ID of 3 or 8 hex digits, then `#`"
    );
}

fn responses(config: FaultyConfig, count: usize) -> (FaultyNode, Vec<Vec<CanFrame>>) {
    let mut node = FaultyNode::new(config, 7);
    let mut out = NodeOutput::new();
    let responses = (0..count)
        .map(|now| {
            node.received(now as u64, &frame(0x123, &[0xA5; 8]), &mut out);
            drain(&mut out)
        })
        .collect();
    (node, responses)
}

#[test]
fn faulty_node_without_faults_echoes() {
    let (_, responses) = responses(FaultyConfig::default(), 100);
    assert!(responses.iter().all(|a| a == &[frame(0x123, &[0xA5; 8])]));
}

#[test]
fn faulty_node_drops_configured_rate() {
    let config = |drop_permille| FaultyConfig { drop_permille, ..FaultyConfig::default() };
    let (node, none) = responses(config(1000), 50);
    assert!(none.iter().all(Vec::is_empty));
    assert_eq!(node.dropped(), 50);
    let (node, some) = responses(config(250), 10_000);
    let dropped = some.iter().filter(|a| a.is_empty()).count();
    assert_eq!(node.dropped(), dropped as u64);
    assert!((2_300..2_700).contains(&dropped), "{dropped} of 10000");
}

#[test]
fn corrupted_response_differs_in_one_bit() {
    let (node, responses) =
        responses(FaultyConfig { corrupt_permille: 1000, ..FaultyConfig::default() }, 200);
    assert_eq!(node.corrupted(), 200);
    let mut hit = [false; 64];
    for response in responses {
        let [response] = response.as_slice() else {
            panic!("one response each");
        };
        let differing: Vec<usize> =
            (0..64).filter(|bit| (response.data()[bit / 8] ^ 0xA5) >> (bit % 8) & 1 == 1).collect();
        assert_eq!(differing.len(), 1);
        hit[differing[0]] = true;
    }
    assert!(hit.iter().filter(|h| **h).count() > 32, "any bit may be hit");
}

#[test]
fn frame_without_data_is_not_corrupted() {
    let config =
        FaultyConfig { corrupt_permille: 1000, repeat_permille: 1000, ..FaultyConfig::default() };
    let mut node = FaultyNode::new(config, 0);
    let mut out = NodeOutput::new();
    let remote = CanFrame::remote(CanId::standard(5).unwrap(), Dlc::new(8).unwrap()).unwrap();
    node.received(0, &remote, &mut out);
    assert_eq!(drain(&mut out), [remote, remote]);
    assert_eq!(node.corrupted(), 0);
}

#[test]
fn babbling_node_keeps_interval_without_backlog() {
    let babble = frame(0, &[0xBB; 8]);
    let config = FaultyConfig { babble_us: 1, ..FaultyConfig::default() };
    let mut node = FaultyNode::new(config, 0);
    let mut out = NodeOutput::new();
    node.started(10_000, &mut out);
    let played = play(&mut node, 13_000);
    let expected: Vec<_> = [10_000, 11_000, 12_000, 13_000].map(|at| (at, babble)).into();
    assert_eq!(played, expected);
    // The bus was too slow for the last frame.
    node.advance(14_000, &mut out);
    node.advance(19_500, &mut out);
    assert_eq!(out.len(), 1);
    assert_eq!(node.next_event(), Some(20_000));
}
