//! A copy of a line continues as its original does, and neither affects the other.

use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::image::{CommitFields, ImageWriter, PdoProfile, Timestamp};
use ecan_protocol::mapping::Direction;
use ecan_sim::{BridgeProtocol, BridgeSpec, GatewayCounters, Node, NodeKind, Wire, echo};

use crate::wire_support::{Datagram, Line, MS, command::*};

const BYTES: usize = 384;

/// The answers of 20 cycles with one frame each to the echo node of channel 1.
fn cycles(line: &mut Line, writer: &mut ImageWriter) -> Vec<Vec<Datagram>> {
    let frame = CanFrame::classic(CanId::standard(0x123).unwrap(), &[1, 2, 3]).unwrap();
    let mut outputs = vec![0; 2 * BYTES];
    let mut answers = Vec::new();
    for _ in 0..20 {
        line.pass(MS);
        writer.push(&mut outputs[..BYTES], 0, 0, frame.as_ref(), Timestamp::None).unwrap();
        writer.commit(&mut outputs[..BYTES], CommitFields::default());
        let sent =
            [Datagram::logical(LRW, 0, &outputs), Datagram::new(FPRD, 0x1001, 0x0130, &[0; 6])];
        answers.push(line.exchange(&sent).unwrap());
    }
    answers
}

fn counters(line: &Line) -> GatewayCounters {
    line.wire.world().counters(0).unwrap()
}

#[test]
fn copy_continues_as_its_original() {
    let mut line = Line::op();
    let word = line.upload(0x1001, (0x8011, 12));
    let mut writer = ImageWriter::new(Direction::RxPdo, PdoProfile::from_word(word).unwrap());
    cycles(&mut line, &mut writer);
    let before = counters(&line);
    assert!(before.frames_to_master > 0, "{before:?}");

    let mut copy = line.try_clone().unwrap();
    let mut writer_of_copy = writer.clone();
    let answers = cycles(&mut line, &mut writer);
    assert_eq!(counters(&copy), before, "the original does not affect the copy");
    assert!(counters(&line).frames_to_master > before.frames_to_master);
    assert_eq!(cycles(&mut copy, &mut writer_of_copy), answers);
    assert_eq!(counters(&copy), counters(&line));
}

#[test]
fn node_that_cannot_be_copied_prevents_a_copy() {
    struct Connected;
    impl Node for Connected {}
    let mut scenario = echo(1);
    scenario.nodes[0].kind =
        NodeKind::Bridge(BridgeSpec { protocol: BridgeProtocol::Slcan, ..BridgeSpec::default() });
    let wire = Wire::with_bridges(&scenario, 0, Some(|_| Ok(Box::new(Connected)))).unwrap();
    assert!(wire.try_clone().is_none());
}
