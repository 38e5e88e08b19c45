//! 0xA000..0xA003: reading and writing MCAN registers (manual 13.6).

use super::fixture::{Fixture, MS, chunks, extended, standard};
use ecan_protocol::object::WRITABLE_REGISTERS;
use ecan_sim::{StationConfig, StationMode};
use proptest::prelude::*;

const READ: u8 = 1;
const WRITE: u8 = 2;

const DBTP: u32 = 0x0C;
const TEST: u32 = 0x10;
const CCCR: u32 = 0x18;
const NBTP: u32 = 0x1C;
const TDCR: u32 = 0x48;
const IR: u32 = 0x50;
const GFC: u32 = 0x80;
const XIDAM: u32 = 0x90;
const RXF0S: u32 = 0xA4;
const RXF0A: u32 = 0xA8;
const TXBCR: u32 = 0xD4;

/// INIT without and with CCE.
const INIT: u32 = 1;
const CHANGE: u32 = 3;
/// FD with bit rate switch.
const FD: u32 = 3 << 8;

fn read(fixture: &mut Fixture, offset: u32) -> u32 {
    let (status, value) = fixture.register(offset, READ);
    assert_eq!(status, 0);
    value
}

fn write(fixture: &mut Fixture, offset: u32, value: u32) {
    fixture.download(0xA000, 4, &value.to_le_bytes()).unwrap();
    assert_eq!(fixture.register(offset, WRITE).0, 0, "{offset:#x}");
}

/// In OP and engineering mode.
fn engineering() -> Fixture {
    let mut fixture = Fixture::op(chunks(3), chunks(3));
    fixture.gateway.set_watchdog_ns(0);
    fixture.write_u8(0xB000, 1, 1);
    fixture
}

#[test]
fn registers_are_read_where_they_exist() {
    let mut fixture = Fixture::op(chunks(3), chunks(3));
    fixture.gateway.bus_state(fixture.now, 0, ecan_sim::ErrorState::Warning, 100, 3);
    assert_eq!(fixture.register(0x40, 1), (0, 100 | 3 << 8), "ECR");
    // 1 Mbit/s at 80 MHz, one clock a quantum
    let (status, nbtp) = fixture.register(0x1C, 1);
    let (tseg1, tseg2) = (nbtp >> 8 & 0xFF, nbtp & 0x7F);
    assert_eq!((status, nbtp >> 16 & 0x1FF), (0, 0));
    assert_eq!(1 + (tseg1 + 1) + (tseg2 + 1), 80);
    let (_, dbtp) = fixture.register(0x0C, 1);
    assert_eq!(dbtp >> 23 & 1, 1, "delay compensation");
    let (_, cccr) = fixture.register(0x18, 1);
    assert_eq!(cccr, 3 << 8, "FD with bit rate switch");
    assert_ne!(fixture.register(0x48, 1).1, 0, "TDCR");
    for (offset, expected) in [(0, 1), (2, 1), (0x41, 1), (0x408, 1), (0x404, 0), (0x0FC, 0)] {
        assert_eq!(fixture.register(offset, 1).0, expected, "{offset:#x}");
    }
    assert_eq!(fixture.upload(0xA000, 6), fixture.now as u32);
}

#[test]
fn only_the_whitelist_is_writable_in_engineering_mode() {
    for mode in 0..=2 {
        let mut fixture = Fixture::op(chunks(3), chunks(3));
        fixture.write_u8(0xB000, 1, mode);
        for offset in (4..=0x404).step_by(4) {
            let writable = WRITABLE_REGISTERS.iter().any(|&(known, _)| u32::from(known) == offset);
            let expected = match (writable, mode) {
                (false, _) => 2,
                (true, 0) => 4,
                (true, _) => 0,
            };
            assert_eq!(fixture.register(offset, WRITE).0, expected, "{offset:#x}");
        }
    }
}

#[test]
fn protected_registers_are_locked_while_running() {
    let mut fixture = engineering();
    for offset in [DBTP, TEST, 0x14, NBTP, TDCR, GFC, XIDAM] {
        let before = read(&mut fixture, offset);
        for control in [FD, FD | INIT, FD | CHANGE] {
            write(&mut fixture, CCCR, control);
            write(&mut fixture, offset, !before);
            let changes = control & CHANGE == CHANGE && offset != TEST;
            assert_eq!(read(&mut fixture, offset) != before, changes, "{offset:#x} {control:#x}");
        }
        write(&mut fixture, CCCR, FD);
        assert_eq!(read(&mut fixture, CCCR), FD);
    }
}

/// Bits of a register that a write of ones sets, in a controller open for changes.
#[test]
fn written_registers_are_read_back() {
    let mut fixture = engineering();
    write(&mut fixture, CCCR, INIT);
    write(&mut fixture, CCCR, CHANGE);
    write(&mut fixture, CCCR, CHANGE | 1 << 7);
    for (offset, expected) in [
        (DBTP, 0x009F_1FFF),
        (TEST, 0xF0),
        (0x14, 0xFF),
        (NBTP, 0xFFFF_FF7F),
        (TDCR, 0x7F7F),
        (0x54, 0x3FFF_FFFF),
        (0x58, 0x3FFF_FFFF),
        (0x5C, 3),
        (GFC, 0x3F),
        (XIDAM, 0x1FFF_FFFF),
        (RXF0A, 0x3F),
        (0xB8, 0x3F),
        (0xD0, 0),
        (TXBCR, 0),
        (0xF8, 0x1F),
    ] {
        write(&mut fixture, offset, u32::MAX);
        assert_eq!(read(&mut fixture, offset), expected, "{offset:#x}");
        write(&mut fixture, offset, 0);
        let left = if offset == TEST { 0x80 } else { 0 };
        assert_eq!(read(&mut fixture, offset), left, "{offset:#x}");
    }
    // an apply restarts the controller
    fixture.apply_channel(0, ecan_protocol::config::McanChannelConfig::classic(500_000));
    assert_eq!(read(&mut fixture, CCCR), 0);
    assert_ne!(read(&mut fixture, NBTP), 0);
}

#[test]
fn interrupt_flags_are_cleared_by_writing_ones() {
    let mut fixture = engineering();
    fixture.gateway.bus_state(fixture.now, 0, ecan_sim::ErrorState::Warning, 100, 3);
    let ir = fixture.upload(0x9000, 3);
    assert_ne!(ir, 0);
    write(&mut fixture, IR, !ir);
    assert_eq!(fixture.upload(0x9000, 3), ir);
    write(&mut fixture, IR, ir);
    assert_eq!(fixture.upload(0x9000, 3), 0);
}

#[test]
fn init_takes_the_controller_off_the_bus_and_back() {
    let mut fixture = engineering();
    let station = StationConfig::fd(1_000_000, 5_000_000);
    assert_eq!(fixture.gateway.station_config(0), Some(station));
    fixture.push(0, standard(1, &[]));
    fixture.push(0, standard(2, &[]));
    fixture.cycle();
    assert_eq!(fixture.gateway.next_transmit(0), Some(standard(1, &[])), "in arbitration");
    let generation = fixture.gateway.station_generation(0);
    write(&mut fixture, CCCR, FD | INIT);
    assert_ne!(fixture.gateway.station_generation(0), generation);
    assert_eq!(fixture.gateway.station_config(0), None);
    assert_eq!(fixture.gateway.next_transmit(0), None);
    fixture.deliver(0, standard(3, &[]));
    fixture.cycle();
    assert_eq!(fixture.received(), []);
    assert_eq!(fixture.upload(0x9000, 9) & 0xF, 0, "disabled");
    let generation = fixture.gateway.station_generation(0);
    write(&mut fixture, CCCR, FD);
    assert_ne!(fixture.gateway.station_generation(0), generation);
    assert_eq!(fixture.gateway.station_config(0), Some(station));
    assert_eq!(Fixture::identifiers(&fixture.sent(0)), [1, 2], "nothing is lost");
}

#[test]
fn cce_empties_the_controller() {
    let mut fixture = engineering();
    fixture.push(0, standard(1, &[]));
    fixture.cycle();
    let before = *fixture.gateway.counters();
    write(&mut fixture, CCCR, FD | CHANGE);
    assert_eq!(read(&mut fixture, CCCR), FD | INIT, "INIT first");
    assert_eq!(*fixture.gateway.counters(), before);
    fixture.deliver(0, standard(1, &[]));
    write(&mut fixture, CCCR, FD | CHANGE);
    assert_eq!(fixture.gateway.counters().transmit_losses.stale, before.transmit_losses.stale + 1);
    write(&mut fixture, CCCR, FD);
    assert_eq!(fixture.sent(0), []);
}

#[test]
fn changed_timing_and_modes_take_effect() {
    let mut fixture = engineering();
    let mut with = |writes: &[(u32, u32)], control: u32| {
        write(&mut fixture, CCCR, INIT);
        write(&mut fixture, CCCR, CHANGE);
        write(&mut fixture, CCCR, CHANGE | control);
        for &(offset, value) in writes {
            write(&mut fixture, offset, value);
        }
        write(&mut fixture, CCCR, control);
        fixture.gateway.station_config(0).unwrap()
    };
    // 80 MHz / 8 / (1 + 15 + 4), and / 2 / (1 + 15 + 4)
    let timing = [(NBTP, 3 << 25 | 7 << 16 | 14 << 8 | 3), (DBTP, 1 << 16 | 14 << 8 | 3 << 4 | 3)];
    assert_eq!(with(&timing, FD), StationConfig::fd(500_000, 2_000_000));
    let fd = StationConfig::fd(500_000, 2_000_000);
    let mode = |mode| StationConfig { mode, ..fd };
    assert_eq!(with(&[], FD | 1 << 5), mode(StationMode::Listen));
    assert_eq!(with(&[(TEST, 1 << 4)], FD | 1 << 7), mode(StationMode::ExternalLoopback));
    assert_eq!(with(&[(TEST, 1 << 4)], FD | 1 << 5 | 1 << 7), mode(StationMode::InternalLoopback));
    assert_eq!(with(&[], FD | 1 << 6), StationConfig { auto_retransmit: false, ..fd });
    assert_eq!(with(&[], 0), StationConfig { fd: false, ..fd });
}

#[test]
fn changed_global_filters_take_effect() {
    let mut fixture = engineering();
    write(&mut fixture, CCCR, INIT);
    write(&mut fixture, CCCR, CHANGE | FD);
    // standard frames without a filter are rejected, extended ones go into FIFO1
    write(&mut fixture, GFC, 2 << 4 | 1 << 2);
    write(&mut fixture, CCCR, FD);
    fixture.deliver(0, standard(1, &[]));
    fixture.deliver(0, extended(2));
    assert_eq!((fixture.upload(0x9000, 4) & 0x7F, fixture.upload(0x9000, 5) & 0x7F), (0, 1));
    fixture.cycle();
    assert_eq!(fixture.received(), [(0, extended(2))]);
}

#[test]
fn acknowledged_fifo_elements_are_removed() {
    let mut fixture = engineering();
    fixture.deliver_ids(0, 0..5);
    assert_eq!(read(&mut fixture, RXF0S), 5 | 5 << 16);
    write(&mut fixture, RXF0A, 7);
    assert_eq!(read(&mut fixture, RXF0S), 5 | 5 << 16, "no such element");
    write(&mut fixture, RXF0A, 2);
    assert_eq!(read(&mut fixture, RXF0S), 2 | 3 << 8 | 5 << 16);
    assert_eq!(fixture.gateway.counters().receive_losses.flushed, 3);
    fixture.cycle();
    assert_eq!(fixture.received(), [(0, standard(3, &[])), (0, standard(4, &[]))]);
}

#[test]
fn cancelled_frames_are_removed() {
    let mut fixture = engineering();
    fixture.push(0, standard(1, &[]));
    fixture.cycle();
    write(&mut fixture, TXBCR, 0);
    assert_eq!(fixture.upload(0x9000, 6) & 0x3F, 31);
    write(&mut fixture, TXBCR, 1);
    assert_eq!(fixture.upload(0x9000, 6) & 0x3F, 32);
    assert_eq!(fixture.upload(0x9020, 12), 1, "stale");
}

#[test]
fn leaving_init_requests_bus_off_recovery() {
    let mut fixture = engineering();
    let policy = ecan_protocol::config::DataPathConfig {
        bus_off_recovery: ecan_protocol::config::BusOffRecovery::Manual,
        ..Default::default()
    };
    fixture.apply_data_path(0, policy);
    fixture.gateway.bus_state(fixture.now, 0, ecan_sim::ErrorState::BusOff, 256, 0);
    fixture.pass(10 * MS);
    assert!(!fixture.gateway.take_recovery_request(0));
    assert_eq!(read(&mut fixture, CCCR), FD | INIT);
    write(&mut fixture, CCCR, FD);
    assert!(fixture.gateway.take_recovery_request(0));
}

#[test]
fn unapplied_controller_stays_in_init() {
    let mut fixture = Fixture::preop();
    fixture.write_u8(0xB000, 1, 1);
    assert_eq!(read(&mut fixture, CCCR), INIT);
    write(&mut fixture, CCCR, CHANGE);
    write(&mut fixture, NBTP, 0x0203_0405);
    assert_eq!(read(&mut fixture, NBTP), 0x0203_0405);
    write(&mut fixture, CCCR, 0);
    assert_eq!(read(&mut fixture, CCCR), INIT);
    assert_eq!(fixture.gateway.station_config(0), None);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// After any register writes in any order, cycles continue and no frame is lost uncounted.
    #[test]
    fn any_writes_leave_a_gateway_that_works(
        writes in proptest::collection::vec(
            (0..WRITABLE_REGISTERS.len(), prop_oneof![0u32..0x400, any::<u32>()], any::<bool>()),
            1..60,
        ),
    ) {
        let mut fixture = engineering();
        for (which, value, open) in writes {
            if open {
                write(&mut fixture, CCCR, INIT);
                write(&mut fixture, CCCR, CHANGE);
            }
            write(&mut fixture, WRITABLE_REGISTERS[which].0.into(), value);
            fixture.push(0, standard(1, &[1]));
            fixture.deliver(0, standard(2, &[2]));
            fixture.cycle();
            fixture.sent(0);
            if let Some(station) = fixture.gateway.station_config(0) {
                prop_assert!(station.nominal_bitrate > 0 && station.data_bitrate > 0);
            }
        }
        let counters = *fixture.gateway.counters();
        let losses = counters.transmit_losses;
        let lost = losses.invalid_channel + losses.bus_off + losses.ring_full + losses.stale;
        let waiting = u64::from(fixture.upload(0x9000, 11));
        prop_assert_eq!(counters.frames_parsed, counters.frames_on_bus + lost + waiting);
    }
}
