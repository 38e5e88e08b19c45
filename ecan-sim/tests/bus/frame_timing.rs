//! Frame lengths on the wire: counted by hand, compared with an independent encoder and with a
//! recording of a real bus.

use std::collections::BTreeMap;
use std::path::Path;

use ecan_protocol::can::{CanFrame, CanId, Dlc, FrameBits, FrameKind};
use ecan_sim::{FrameTiming, INTERMISSION_BITS, WireFrame};
use proptest::prelude::*;

fn std_id(id: u16) -> CanId {
    CanId::standard(id).unwrap()
}

fn ext_id(id: u32) -> CanId {
    CanId::extended(id).unwrap()
}

fn timing(frame: CanFrame) -> (u16, u16, u16) {
    let t = FrameTiming::of(&frame);
    (t.nominal_bits, t.data_bits, t.stuff_bits)
}

#[test]
fn frames_have_known_lengths() {
    let classic = |id, data: &[u8]| CanFrame::classic(id, data).unwrap();
    let fd = |id, data: &[u8], esi| CanFrame::fd(id, data, true, esi).unwrap();
    let example = [0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88];
    for (frame, expected) in [
        // 44 bits of frame; the 34 zeros from SOF to the CRC (which is 0) need a stuff bit after every
        // fifth one: 6.
        (classic(std_id(0), &[]), (50, 0, 6)),
        // 1 + 11 + 1 + 1 + 1 + 4 + 15 + 1 + 1 + 1 + 7 = 44, and 8 per byte. Identifier 0x555 and bytes
        // 0x55 alternate; the only stuff bit is in the CRC 001101100000100, after five zeros.
        (classic(std_id(0x555), &[0x55; 8]), (44 + 64 + 1, 0, 1)),
        // The example frame of manual 5.4.4.1.
        (classic(std_id(0x123), &example), (44 + 64 + 1, 0, 1)),
        // 17 bits up to BRS, then ESI, DLC, 512 data bits, 32 bits of CRC field and the CRC delimiter,
        // then 9 nominal bits. No stuff bits.
        (fd(std_id(0x555), &[0x55; 64], false), (17 + 9, 1 + 4 + 512 + 32 + 1, 0)),
        // SOF to IDE are 14 zeros, so 2 stuff bits before the switch; 512 zeros of data take 102.
        (fd(std_id(0), &[0; 64], false), (17 + 2 + 9, 550 + 102, 104)),
        // 31 ones up to the last identifier bit take 6 stuff bits, 518 ones from BRS on take 103.
        (fd(ext_id(0x1FFF_FFFF), &[0xFF; 64], true), (36 + 6 + 9, 550 + 103, 109)),
        // 160 zeros are 32 runs of five; after the last one comes the fixed stuff bit of the CRC field
        // instead of a dynamic one.
        (fd(std_id(0x555), &[0; 20], false), (26, 1 + 4 + 160 + 31 + 32 + 1, 31)),
    ] {
        assert_eq!(timing(frame), expected, "{frame:?}");
    }
    let alternating = classic(std_id(0x555), &[0x55; 8]);
    assert_eq!(WireFrame::new(&alternating).crc(), 0b001_1011_0000_0100);
}

/// A remote frame has no data for any DLC: 64 bits extended, 44 standard.
#[test]
fn remote_frames_carry_no_data() {
    for dlc in 0..=8 {
        let dlc = Dlc::new(dlc).unwrap();
        let short = FrameTiming::of(&CanFrame::remote(std_id(0x2AA), dlc).unwrap());
        let long = FrameTiming::of(&CanFrame::remote(ext_id(0x0AAA_AAAA), dlc).unwrap());
        assert_eq!(short.nominal_bits - short.stuff_bits, 44);
        assert_eq!(long.nominal_bits - long.stuff_bits, 64);
    }
}

/// Up to 16 bytes the CRC field has 4 + 17 + 6 bits, from 20 on 4 + 21 + 7.
#[test]
fn crc_field_grows_between_16_and_20_bytes() {
    let length = |n: usize| {
        let t =
            FrameTiming::of(&CanFrame::fd(std_id(0x555), &[0xAA; 64][..n], true, false).unwrap());
        t.data_bits - t.stuff_bits
    };
    assert_eq!(length(16), 5 + 128 + 27 + 1);
    assert_eq!(length(20), 5 + 160 + 32 + 1);
}

/// Without BRS all bits are nominal, with the same total.
#[test]
fn without_switching_every_bit_is_nominal() {
    let switched = FrameTiming::of(&CanFrame::fd(std_id(0x555), &[7; 32], true, false).unwrap());
    let steady = FrameTiming::of(&CanFrame::fd(std_id(0x555), &[7; 32], false, false).unwrap());
    assert_eq!(steady.data_bits, 0);
    // BRS itself differs, but is not part of a run of five.
    assert_eq!(steady.total_bits(), switched.total_bits());
}

/// 26 bits at 500 kbit/s and 550 at 5 Mbit/s: 52 us + 110 us.
#[test]
fn duration_adds_both_phases() {
    let t = FrameTiming::of(&CanFrame::fd(std_id(0x555), &[0x55; 64], true, false).unwrap());
    assert_eq!(t.duration_ns(500_000, 5_000_000), 162_000);
    // 1/3 us and 1/3 us per bit, rounded per phase.
    assert_eq!(t.duration_ns(3_000_000, 3_000_000), 8_667 + 183_333);
}

fn any_id() -> impl Strategy<Value = CanId> {
    prop_oneof![
        (0..=0x7FFu16).prop_map(std_id),
        (0..=0x1FFF_FFFFu32).prop_map(ext_id),
        Just(std_id(0)),
        Just(ext_id(0x1FFF_FFFF)),
    ]
}

/// Bytes that stuff a lot and bytes at random.
fn any_byte() -> impl Strategy<Value = u8> + Clone {
    prop_oneof![
        any::<u8>(),
        prop::sample::select(vec![0x00, 0xFF, 0x0F, 0xF0, 0x3C, 0xC3, 0x78, 0x87, 0x1E, 0xE1]),
    ]
}

fn any_frame() -> impl Strategy<Value = CanFrame> {
    let lengths = vec![0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64usize];
    let data = prop::collection::vec(any_byte(), 64);
    prop_oneof![
        (any_id(), data.clone(), 0..=8usize).prop_map(|(id, data, n)| CanFrame::classic(
            id,
            &data[..n]
        )
        .unwrap()),
        (any_id(), 0..=8u8)
            .prop_map(|(id, dlc)| CanFrame::remote(id, Dlc::new(dlc).unwrap()).unwrap()),
        (any_id(), data, prop::sample::select(lengths), any::<bool>(), any::<bool>()).prop_map(
            |(id, data, n, brs, esi)| { CanFrame::fd(id, &data[..n], brs, esi).unwrap() }
        ),
    ]
}

proptest! {
    #[test]
    fn lengths_equal_encoded_bits(frame in any_frame()) {
        let wire = super::naive::encode(&frame);
        let t = FrameTiming::of(&frame);
        prop_assert_eq!(t.total_bits() as usize, wire.bits.len());
        prop_assert_eq!(usize::from(t.data_bits), wire.data_phase.len());
        prop_assert_eq!(usize::from(t.stuff_bits), wire.dynamic_stuff);
    }

    #[test]
    fn wire_frame_equals_naive_encoder(frame in any_frame()) {
        let wire = super::naive::encode(&frame);
        let encoded = WireFrame::new(&frame);
        prop_assert_eq!(encoded.bits().collect::<Vec<_>>(), wire.bits);
        prop_assert_eq!(encoded.data_phase(), wire.data_phase);
        prop_assert_eq!(encoded.stuff_bits(), wire.dynamic_stuff);
    }

    /// Known bounds: at most one stuff bit after the first five bits, and then one after every
    /// four.
    #[test]
    fn lengths_are_within_frame_bits(frame in any_frame()) {
        let extended = frame.id().is_extended();
        let data = 8 * frame.data().len() as u32;
        let (least, stuffed) = match frame.kind() {
            FrameKind::Fd { .. } => {
                let head = if extended { 41 } else { 22 };
                let crc_field = if data <= 128 { 27 } else { 32 };
                (head + data + crc_field + 10, head + data)
            }
            _ if extended => (64 + data, 54 + data),
            _ => (44 + data, 34 + data),
        };
        let total = FrameTiming::of(&frame).total_bits();
        prop_assert!(total >= least);
        prop_assert!(total <= least + (stuffed - 1) / 4);
    }

    /// The bounds that the host uses for planning hold in each phase, intermission included.
    #[test]
    fn frame_bits_bound_each_phase(frame in any_frame()) {
        let exact = FrameTiming::of(&frame);
        let nominal = u32::from(exact.nominal_bits) + INTERMISSION_BITS;
        let data = u32::from(exact.data_bits);
        let (least, most) = (FrameBits::least(frame.as_ref()), FrameBits::most(frame.as_ref()));
        prop_assert!(least.nominal <= nominal && nominal <= most.nominal);
        prop_assert!(least.data <= data && data <= most.data);
        // Without stuff bits they are equal.
        prop_assert_eq!(least.total(), nominal + data - u32::from(exact.stuff_bits));
    }
}

/// Frames without pause on a real 500 kbit/s bus are as far apart as the second one and the
/// intermission are long. The recorder's clock varies by some microseconds, so the exact distance
/// must be by far the most frequent one, and none may be much shorter.
#[test]
fn recorded_bus_has_calculated_frame_times() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/vehicle-can.log");
    let Ok(log) = std::fs::read_to_string(&path) else {
        println!("skipped: no recording at ../shared/data/vehicle-can.log");
        return;
    };
    let mut deviations = BTreeMap::<i64, u32>::new();
    let mut before: Option<u64> = None;
    for line in log.lines() {
        let Some(record) = ecan_can_io::candump::parse_line(line).unwrap() else {
            continue;
        };
        let bits = FrameTiming::of(&record.frame).total_bits() + INTERMISSION_BITS;
        let expected_us = i64::from(bits) * 2;
        let now = record.time_ns / 1000;
        if let Some(before) = before {
            *deviations.entry(now as i64 - before as i64 - expected_us).or_default() += 1;
        }
        before = Some(now);
    }
    let (&shortest, _) = deviations.first_key_value().unwrap();
    assert!(shortest > -30, "a gap {shortest} us shorter than its frame");
    let (&usual, _) = deviations.iter().max_by_key(|(_, count)| **count).unwrap();
    assert_eq!(usual, 0);
}
