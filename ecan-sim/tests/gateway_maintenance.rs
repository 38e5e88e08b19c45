//! 0xB000, 0xA000..0xA003 and 0x9011: access modes, maintenance commands, register access and
//! cycle statistics (manual 13.2.4, 13.6, 13.7).

mod gateway_support;

use ecan_protocol::WRITABLE_REGISTERS;
use gateway_support::{Bench, MS, chunks, standard};

fn register(bench: &mut Bench, offset: u32, command: u8) -> (u32, u32) {
    bench.download(0xA000, 1, &offset.to_le_bytes()).unwrap();
    bench.write_u8(0xA000, 2, command);
    (bench.upload(0xA000, 3), bench.upload(0xA000, 5))
}

#[test]
fn commands_without_a_memory_behind_them_are_denied() {
    let mut bench = Bench::preop();
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
    let mut bench = Bench::preop();
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
    let mut bench = Bench::op(chunks(3), chunks(24));
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
fn registers_are_read_where_they_exist() {
    let mut bench = Bench::op(chunks(3), chunks(3));
    bench.gateway.bus_state(bench.now, 0, ecan_sim::ErrorState::Warning, 100, 3);
    assert_eq!(register(&mut bench, 0x40, 1), (0, 100 | 3 << 8), "ECR");
    // 1 Mbit/s at 80 MHz, one clock a quantum
    let (status, nbtp) = register(&mut bench, 0x1C, 1);
    let (tseg1, tseg2) = (nbtp >> 8 & 0xFF, nbtp & 0x7F);
    assert_eq!((status, nbtp >> 16 & 0x1FF), (0, 0));
    assert_eq!(1 + (tseg1 + 1) + (tseg2 + 1), 80);
    let (_, dbtp) = register(&mut bench, 0x0C, 1);
    assert_eq!(dbtp >> 23 & 1, 1, "delay compensation");
    let (_, cccr) = register(&mut bench, 0x18, 1);
    assert_eq!(cccr, 3 << 8, "FD with bit rate switch");
    assert_ne!(register(&mut bench, 0x48, 1).1, 0, "TDCR");
    for (offset, expected) in [(0, 1), (2, 1), (0x41, 1), (0x408, 1), (0x404, 0), (0x0FC, 0)] {
        assert_eq!(register(&mut bench, offset, 1).0, expected, "{offset:#x}");
    }
    assert_eq!(bench.upload(0xA000, 6), bench.now as u32);
}

#[test]
fn registers_are_written_by_the_whitelist_and_in_engineering_mode() {
    let mut bench = Bench::op(chunks(3), chunks(3));
    bench.gateway.bus_state(bench.now, 0, ecan_sim::ErrorState::Warning, 100, 3);
    for offset in (4..=0x404).step_by(4) {
        let writable = WRITABLE_REGISTERS.iter().any(|&(known, _)| u32::from(known) == offset);
        let expected = if writable { 4 } else { 2 };
        assert_eq!(register(&mut bench, offset, 2).0, expected, "{offset:#x}");
    }
    bench.write_u8(0xB000, 1, 1);
    let ir = bench.upload(0x9000, 3);
    assert_ne!(ir, 0);
    bench.download(0xA000, 4, &ir.to_le_bytes()).unwrap();
    assert_eq!(register(&mut bench, 0x50, 2).0, 0);
    assert_eq!(bench.upload(0x9000, 3), 0, "IR is cleared by writing ones");
    assert_eq!(register(&mut bench, 0x18, 2).0, 4, "CCCR is protected while running");
}

#[test]
fn cycle_statistics_count_and_clear() {
    let mut bench = Bench::configured(chunks(3), chunks(3));
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
