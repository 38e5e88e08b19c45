//! 0xB000 and 0x9011: access modes, diagnostics and cycle statistics (manual 13.2.4, 13.7).

mod gateway_support;

use ecan_protocol::image::Schedule;
use gateway_support::{Fixture, MS, chunks, standard};

#[test]
fn commands_are_denied_in_run_mode() {
    let mut bench = Fixture::preop();
    for (count, command) in [(1, 0x01), (2, 0x02), (3, 0x04), (4, 0x08), (5, 0x10), (6, 0x40)] {
        bench.write_u8(0xB000, 4, command);
        assert_eq!((bench.upload(0xB000, 5), bench.upload(0xB000, 12)), (2, count));
    }
    bench.write_u8(0xB000, 4, 0x60);
    assert_eq!(bench.upload(0xB000, 5), 2, "clear diagnostics stands alone");
    bench.write_u8(0xB000, 4, 0x20);
    assert_eq!((bench.upload(0xB000, 5), bench.upload(0xB000, 12)), (0, 8));
}

#[test]
fn access_mode_is_granted_and_times_out() {
    let mut bench = Fixture::preop();
    bench.download(0xB000, 3, &2u16.to_le_bytes()).unwrap();
    for mode in [1, 2] {
        bench.write_u8(0xB000, 1, mode);
        assert_eq!(bench.upload(0xB000, 2), u32::from(mode));
        bench.pass(2_000 * MS - 1);
        assert_eq!(bench.upload(0xB000, 2), u32::from(mode));
        bench.pass(1);
        assert_eq!(bench.upload(0xB000, 2), 0);
    }
    bench.download(0xB000, 3, &0u16.to_le_bytes()).unwrap();
    bench.write_u8(0xB000, 1, 1);
    bench.pass(100_000 * MS);
    assert_eq!(bench.upload(0xB000, 2), 1, "without a timeout it stays");
    bench.write_u8(0xB000, 1, 0);
    assert_eq!(bench.upload(0xB000, 2), 0);
}

#[test]
fn clear_diagnostics_resets_the_channels_counters() {
    let mut bench = Fixture::op(chunks(3), chunks(24));
    for id in 0..70 {
        bench.push(0, standard(id, &[]));
        bench.deliver(0, standard(id, &[]));
    }
    bench.cycle();
    assert_ne!(bench.upload(0x9020, 5), 0);
    assert_ne!(bench.upload(0x9020, 12), 0);
    bench.write_u8(0xB000, 4, 0x20);
    for counter in 2..=18 {
        assert_eq!(bench.upload(0x9020, counter), 0, "{counter}");
    }
    assert_eq!(bench.upload(0xB000, 6), 0);
}

#[test]
fn cycle_statistics_count_and_clear() {
    let mut bench = Fixture::configured(chunks(3), chunks(3));
    let start = bench.start_sync0();
    bench.pass(MS);
    bench.start();
    bench.now = start + 10 * MS + 200_000;
    bench.gateway.advance(bench.now);
    for _ in 0..5 {
        bench.push(0, standard(1, &[]));
        bench.cycle();
    }
    let reads_before_op = 1;
    assert_eq!(bench.upload(0x9011, 1), reads_before_op + 10);
    assert_eq!(bench.upload(0x9011, 2), 16);
    assert_eq!(bench.upload(0x9011, 3), 0);
    // 200 us at 400 MHz
    assert_eq!((bench.upload(0x9011, 4), bench.upload(0x9011, 5)), (80_000, 80_000));
    for cost in 6..=12 {
        assert_ne!(bench.upload(0x9011, cost), 0, "{cost}");
    }
    bench.write_u8(0x9011, 14, 1);
    for entry in 1..=24 {
        assert_eq!(bench.upload(0x9011, entry), 0, "{entry}");
    }
    bench.cycle();
    assert_eq!((bench.upload(0x9011, 1), bench.upload(0x9011, 2)), (2, 1));
}

#[test]
fn clearing_the_cycle_statistics_clears_the_channels_service_times() {
    let mut bench = Fixture::op(chunks(3), chunks(3));
    bench.cycle();
    for subindex in [17, 18] {
        assert_ne!(bench.upload(0x9020, subindex), 0, "{subindex}");
    }
    bench.write_u8(0x9011, 14, 1);
    for subindex in [17, 18] {
        assert_eq!(bench.upload(0x9020, subindex), 0, "{subindex}");
    }
}

#[test]
fn data_path_diagnostics_show_what_happens() {
    let mut bench = Fixture::op(chunks(3), chunks(24));
    for id in 0..3 {
        bench.deliver(0, standard(id, &[]));
        bench.deliver(1, standard(id, &[]));
    }
    bench.push(1, standard(9, &[]));
    bench.cycle();
    let show = |bench: &mut Fixture, index| (1..=18).map(|at| bench.upload(index, at)).collect();
    // two frames a service; one frame costs 260 cycles beside 1500
    let quiet: Vec<u32> = show(&mut bench, 0x9022);
    assert_eq!(quiet, [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1_500, 1_500]);
    let receiving: Vec<u32> = show(&mut bench, 0x9020);
    assert_eq!(receiving, [0, 2, 2, 2, 0, 0, 0, 0, 2, 2, 0, 0, 0, 0, 0, 0, 2_020, 2_020]);
    let both: Vec<u32> = show(&mut bench, 0x9021);
    assert_eq!(both, [0, 2, 2, 2, 0, 0, 0, 0, 2, 2, 0, 0, 0, 0, 0, 0, 2_280, 2_280]);
    bench.cycle();
    let later: Vec<u32> = show(&mut bench, 0x9021);
    assert_eq!(later, [0, 2, 1, 2, 0, 0, 0, 0, 1, 2, 0, 0, 0, 0, 0, 0, 2_280, 1_760]);
    bench.gateway.bus_state(bench.now, 1, ecan_sim::ErrorState::BusOff, 256, 0);
    for _ in 0..4 {
        bench.cycle();
    }
    let bus_off: Vec<u32> = [13, 14, 16].map(|at| bench.upload(0x9021, at)).to_vec();
    assert_eq!(bus_off, [1, 1, 4]);
}

#[test]
fn costs_follow_the_work() {
    let mut bench = Fixture::configured(chunks(2), chunks(3));
    bench.start_sync0();
    bench.pass(MS);
    bench.start();
    bench.write_u8(0x9011, 14, 1);
    for id in 0..3 {
        bench.push(0, standard(id, &[]));
    }
    for tag in 0..2 {
        let frame = standard(9, &[]);
        let schedule = Schedule { tag, offset_ns: 300_000 };
        bench.writer.push_scheduled(&mut bench.image, 1, 0, frame.as_ref(), schedule).unwrap();
    }
    bench.deliver(2, standard(1, &[]));
    bench.cycle();
    bench.pass(2 * MS);
    let costs: Vec<u32> = (6..=13).map(|at| bench.upload(0x9011, at)).collect();
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
