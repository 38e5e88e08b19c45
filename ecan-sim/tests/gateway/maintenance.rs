//! 0xB000 and 0x9011: access modes, diagnostics and cycle statistics (manual 13.2.4, 13.7).

use super::fixture::{Fixture, MS, chunks, standard};
use ecan_protocol::image::Schedule;

#[test]
fn access_mode_is_granted_and_times_out() {
    let mut fixture = Fixture::preop();
    fixture.download(0xB000, 3, &2u16.to_le_bytes()).unwrap();
    for mode in [1, 2] {
        fixture.write_u8(0xB000, 1, mode);
        assert_eq!(fixture.upload(0xB000, 2), u32::from(mode));
        fixture.pass(2_000 * MS - 1);
        assert_eq!(fixture.upload(0xB000, 2), u32::from(mode));
        fixture.pass(1);
        assert_eq!(fixture.upload(0xB000, 2), 0);
    }
    fixture.download(0xB000, 3, &0u16.to_le_bytes()).unwrap();
    fixture.write_u8(0xB000, 1, 1);
    fixture.pass(100_000 * MS);
    assert_eq!(fixture.upload(0xB000, 2), 1, "without a timeout it stays");
    fixture.write_u8(0xB000, 1, 0);
    assert_eq!(fixture.upload(0xB000, 2), 0);
}

#[test]
fn clear_diagnostics_resets_the_channels_counters() {
    let mut fixture = Fixture::op(chunks(3), chunks(24));
    fixture.push_ids(0, 0..70);
    fixture.deliver_ids(0, 0..70);
    fixture.cycle();
    assert_ne!(fixture.upload(0x9020, 5), 0);
    assert_ne!(fixture.upload(0x9020, 12), 0);
    fixture.write_u8(0xB000, 4, 0x20);
    for counter in 2..=18 {
        assert_eq!(fixture.upload(0x9020, counter), 0, "{counter}");
    }
    assert_eq!(fixture.upload(0xB000, 6), 0);
}

#[test]
fn cycle_statistics_count_and_clear() {
    let mut fixture = Fixture::configured(chunks(3), chunks(3));
    let start = fixture.start_with_sync0(0);
    fixture.now = start + 10 * MS + 200_000;
    fixture.gateway.advance(fixture.now);
    for _ in 0..5 {
        fixture.push(0, standard(1, &[]));
        fixture.cycle();
    }
    let reads_before_op = 1;
    fixture.has(&[(0x9011, 1, reads_before_op + 10), (0x9011, 2, 16), (0x9011, 3, 0)]);
    // 200 us at 400 MHz
    assert_eq!((fixture.upload(0x9011, 4), fixture.upload(0x9011, 5)), (80_000, 80_000));
    for cost in 6..=12 {
        assert_ne!(fixture.upload(0x9011, cost), 0, "{cost}");
    }
    fixture.write_u8(0x9011, 14, 1);
    for entry in 1..=24 {
        assert_eq!(fixture.upload(0x9011, entry), 0, "{entry}");
    }
    fixture.cycle();
    assert_eq!((fixture.upload(0x9011, 1), fixture.upload(0x9011, 2)), (2, 1));
}

#[test]
fn clearing_the_cycle_statistics_clears_the_channels_service_times() {
    let mut fixture = Fixture::op(chunks(3), chunks(3));
    fixture.cycle();
    for subindex in [17, 18] {
        assert_ne!(fixture.upload(0x9020, subindex), 0, "{subindex}");
    }
    fixture.write_u8(0x9011, 14, 1);
    for subindex in [17, 18] {
        assert_eq!(fixture.upload(0x9020, subindex), 0, "{subindex}");
    }
}

#[test]
fn data_path_diagnostics_show_what_happens() {
    let mut fixture = Fixture::op(chunks(3), chunks(24));
    fixture.deliver_ids(0, 0..3);
    fixture.deliver_ids(1, 0..3);
    fixture.push(1, standard(9, &[]));
    fixture.cycle();
    let show =
        |fixture: &mut Fixture, index| (1..=18).map(|at| fixture.upload(index, at)).collect();
    // two frames per service; one frame costs 260 cycles in addition to 1500
    let quiet: Vec<u32> = show(&mut fixture, 0x9022);
    assert_eq!(quiet, [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1_500, 1_500]);
    let receiving: Vec<u32> = show(&mut fixture, 0x9020);
    assert_eq!(receiving, [0, 2, 2, 2, 0, 0, 0, 0, 2, 2, 0, 0, 0, 0, 0, 0, 2_020, 2_020]);
    let both: Vec<u32> = show(&mut fixture, 0x9021);
    assert_eq!(both, [0, 2, 2, 2, 0, 0, 0, 0, 2, 2, 0, 0, 0, 0, 0, 0, 2_280, 2_280]);
    fixture.cycle();
    let later: Vec<u32> = show(&mut fixture, 0x9021);
    assert_eq!(later, [0, 2, 1, 2, 0, 0, 0, 0, 1, 2, 0, 0, 0, 0, 0, 0, 2_280, 1_760]);
    fixture.gateway.bus_state(fixture.now, 1, ecan_sim::ErrorState::BusOff, 256, 0);
    for _ in 0..4 {
        fixture.cycle();
    }
    let bus_off: Vec<u32> = [13, 14, 16].map(|at| fixture.upload(0x9021, at)).to_vec();
    assert_eq!(bus_off, [1, 1, 4]);
}

#[test]
fn costs_follow_the_work() {
    let mut fixture = Fixture::configured(chunks(2), chunks(3));
    fixture.start_with_sync0(300_000);
    fixture.write_u8(0x9011, 14, 1);
    fixture.push_ids(0, 0..3);
    for tag in 0..2 {
        fixture.push_scheduled(1, standard(9, &[]), Schedule { tag, offset_ns: 300_000 });
    }
    fixture.deliver(2, standard(1, &[]));
    fixture.cycle();
    fixture.pass(2 * MS);
    let costs: Vec<u32> = (6..=13).map(|at| fixture.upload(0x9011, at)).collect();
    // 384 bytes out, 256 in; four frames served, five parsed, two released at once
    let expected = [
        400 + 2 * 384,
        700 + 3 * 256,
        1_500 + 4 * 260,
        300 + 256,
        600 + 5 * 180,
        200 + 2 * 384,
        200 + 2 * 256,
        150 + 2 * 200,
    ];
    assert_eq!(costs, expected);
}
