//! Invalid frames are dropped or passed through, never cause a panic, and the line continues to
//! work.

use crate::wire_support::{Datagram, Line, command::*};
use proptest::collection::vec;
use proptest::prelude::*;

/// Addresses with effects.
fn offset() -> impl Strategy<Value = u16> {
    prop_oneof![
        any::<u16>(),
        0x0000_u16..0x0150,
        0x0300_u16..0x0520,
        0x0600_u16..0x0680,
        0x0800_u16..0x0840,
        0x0900_u16..0x09B0,
        Just(0x0910),
        Just(0x0920),
        Just(0x0980),
        Just(0x0990),
        0x0FF0_u16..0x1110,
        0x1CF0_u16..0x1D10,
        0x28F0_u16..0x3010,
    ]
}

/// Data: any bytes, or times at the limits of a clock.
fn data() -> impl Strategy<Value = Vec<u8>> {
    let near = prop_oneof![Just(0), Just(1 << 63), Just(u64::MAX), any::<u64>()];
    let time = (near, 0..4_000_000_000_u64).prop_map(|(near, ns)| near.wrapping_add(ns));
    prop_oneof![
        4 => vec(any::<u8>(), 0..200),
        1 => time.prop_map(|time| time.to_le_bytes().to_vec()),
    ]
}

fn datagram() -> impl Strategy<Value = Datagram> {
    let slave = prop_oneof![Just(0), Just(0x1001), Just(0x1002), any::<u16>()];
    (0_u8..20, slave, offset(), data())
        .prop_map(|(command, slave, offset, data)| Datagram::new(command, slave, offset, &data))
}

/// Checks that the line responds as a line of two gateways.
fn works_on(line: &mut Line) {
    line.pass(1_000_000_000);
    let (_, counter) = line.read(BRD, 0, 0x0000, 1);
    assert_eq!(counter, 2);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn any_bytes_are_survived(frames in vec(vec(any::<u8>(), 0..1600), 1..8)) {
        let mut line = Line::preop(2);
        for mut frame in frames {
            let length = frame.len();
            line.wire.pass(line.now, &mut frame);
            prop_assert_eq!(frame.len(), length);
            // The same, as EtherCAT.
            if length >= 16 {
                frame[12..14].copy_from_slice(&[0x88, 0xA4]);
                frame[15] = frame[15] & 0x07 | 0x10;
                line.wire.pass(line.now, &mut frame);
            }
        }
        works_on(&mut line);
    }

    #[test]
    fn any_datagrams_are_served_or_passed_on(
        frames in vec(vec(datagram(), 1..6), 1..30),
        cut in any::<proptest::sample::Index>(),
        is_in_op in any::<bool>(),
    ) {
        let mut line = Line::preop(2);
        if is_in_op {
            line.configure(0x1001, 3);
            line.map(0x1001, 3, 0);
            line.request(0x1001, 4);
            line.request(0x1001, 8);
        }
        for datagrams in &frames {
            line.pass(100_000);
            let mut frame = crate::wire_support::encode(datagrams);
            let length = frame.len();
            line.wire.pass(line.now, &mut frame);
            prop_assert_eq!(frame.len(), length);
        }
        let mut torn = crate::wire_support::encode(&frames[0]);
        torn.truncate(cut.index(torn.len()));
        line.wire.pass(line.now, &mut torn);
        works_on(&mut line);
    }
}
