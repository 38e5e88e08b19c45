//! Commands, addresses, working counters and registers of the slave controllers on the wire.

use crate::wire_support::{Datagram, Line, MS, command::*};
use ecan_sim::{Fault, LossDirection};

#[test]
fn positions_and_stations_find_their_slave() {
    let mut line = Line::addressed(3);
    assert_eq!(line.read(BRD, 0, 0x0000, 1).1, 3);
    for (station, expected) in [(0x1001, 1), (0x1002, 1), (0x1003, 1), (0x1004, 0)] {
        assert_eq!(line.read(FPRD, station, 0x0010, 2).1, expected);
    }
    // the second from the start
    let (data, counter) = line.read(APRD, 0xFFFF, 0x0010, 2);
    assert_eq!((data, counter), (vec![0x02, 0x10], 1));
    let back = line.one(Datagram::new(APRD, 0xFFFF, 0x0010, &[0, 0]));
    assert_eq!(back.slave, 2, "each slave counts it up");
    assert_eq!(line.one(Datagram::new(BRD, 0, 0x0010, &[0, 0])).slave, 3);
}

#[test]
fn broadcasts_read_by_or_and_write_everywhere() {
    let mut line = Line::addressed(3);
    let (data, counter) = line.read(BRD, 0, 0x0010, 2);
    assert_eq!((data, counter), (vec![0x03, 0x10], 3));
    assert_eq!(line.write(BWR, 0, 0x0F80, &[0xA5]), 3);
    assert_eq!(line.read(FPRD, 0x1002, 0x0F80, 1), (vec![0xA5], 1));
    let back = line.one(Datagram::new(BRW, 0, 0x0F80, &[0x5A]));
    assert_eq!(back.counter, 3 * 3, "a read counts 1, a write 2");
}

#[test]
fn exchange_reads_before_it_writes() {
    let mut line = Line::addressed(1);
    assert_eq!(line.write(FPWR, 0x1001, 0x0F80, &[1, 2]), 1);
    let back = line.one(Datagram::new(FPRW, 0x1001, 0x0F80, &[8, 9]));
    assert_eq!((back.data, back.counter), (vec![1, 2], 3));
    assert_eq!(line.read(FPRD, 0x1001, 0x0F80, 2).0, [8, 9]);
    let back = line.one(Datagram::new(APRW, 0, 0x0F80, &[0, 0]));
    assert_eq!((back.data, back.counter), (vec![8, 9], 3));
}

#[test]
fn armw_reads_one_slave_and_writes_the_others() {
    let mut line = Line::addressed(3);
    line.write(FPWR, 0x1002, 0x0F80, &[7]);
    let back = line.one(Datagram::new(FRMW, 0x1002, 0x0F80, &[1]));
    assert_eq!((back.data, back.counter), (vec![7], 3));
    let stored = [1, 2, 3].map(|nth| line.read(FPRD, 0x1000 + nth, 0x0F80, 1).0[0]);
    assert_eq!(stored, [1, 7, 7], "the first slave has got what the frame held before");
    let back = line.one(Datagram::new(ARMW, 0, 0x0F80, &[9]));
    assert_eq!((back.data, back.counter), (vec![1], 3));
    assert_eq!(line.read(FPRD, 0x1003, 0x0F80, 1).0, [1]);
}

#[test]
fn many_datagrams_of_a_frame_are_served_in_order() {
    let mut line = Line::addressed(2);
    let back = line
        .exchange(&[
            Datagram::new(FPWR, 0x1001, 0x0F80, &[0x11]),
            Datagram::new(FPRD, 0x1001, 0x0F80, &[0]),
            Datagram::new(0, 0, 0, &[0xEE]),
            Datagram::new(77, 0, 0, &[0xEE]),
            Datagram::new(BRD, 0, 0x0130, &[0, 0]),
        ])
        .unwrap();
    let counters: Vec<_> = back.iter().map(|datagram| datagram.counter).collect();
    assert_eq!(counters, [1, 1, 0, 0, 2]);
    assert_eq!((back[1].data[0], back[3].data[0], back[4].data[0]), (0x11, 0xEE, 1));
}

#[test]
fn information_and_port_registers_are_readable() {
    let mut line = Line::addressed(2);
    let (information, _) = line.read(FPRD, 0x1001, 0x0000, 10);
    assert_eq!(information[4..8], [8, 8, 8, 0x0F], "FMMUs, sync managers, KiB, ports");
    assert_eq!(information[8] & 0x0C, 0x0C, "distributed clocks, 64 bits");
    // port 1 of the first connects the second, that of the second is closed
    assert_eq!(line.read_u16(0x1001, 0x0110), 0x5A33);
    assert_eq!(line.read_u16(0x1002, 0x0110), 0x5613);
}

#[test]
fn rejected_register_write_is_not_counted() {
    let mut line = Line::addressed(1);
    for read_only in [0x0000, 0x0110, 0x0130, 0x0134, 0x0918, 0x092C] {
        assert_eq!(line.write(FPWR, 0x1001, read_only, &[0xFF]), 0, "{read_only:#06x}");
    }
    assert_eq!(line.read(FPRD, 0x1001, 0x3000, 4).1, 0, "after the memory");
    assert_eq!(line.write(FPWR, 0x1001, 0xFFFF, &[1, 2, 3]), 0);
    assert_eq!(line.write(FPWR, 0x1001, 0x2FFF, &[1, 2]), 1, "its last byte");
}

#[test]
fn state_requests_are_answered_with_state_and_code() {
    let mut line = Line::addressed(1);
    line.request(0x1001, 2);
    assert_eq!(line.state(0x1001), (0x11, 0x16), "no mailboxes");
    line.set_up_mailboxes(0x1001);
    line.request(0x1001, 2);
    assert_eq!(line.state(0x1001), (0x11, 0x16), "the error is not acknowledged");
    line.request(0x1001, 0x12);
    assert_eq!(line.state(0x1001), (2, 0));
    line.request(0x1001, 4);
    assert_eq!(line.state(0x1001), (0x12, 0x1D), "SM2");
    line.request(0x1001, 0x15);
    assert_eq!(line.state(0x1001), (0x12, 0x12), "there is no state 5");
    line.request(0x1001, 0x18);
    assert_eq!(line.state(0x1001), (0x12, 0x11));
    line.request(0x1001, 0x11);
    assert_eq!(line.state(0x1001), (1, 0));
    line.request(0x1001, 3);
    assert_eq!(line.state(0x1001), (3, 0), "BOOT");
}

#[test]
fn events_follow_the_event_mask() {
    let mut line = Line::preop(1);
    assert_eq!(line.one(Datagram::new(FPRD, 0x1001, 0x0000, &[0])).events, 0);
    line.write(FPWR, 0x1001, 0x0200, &[0xFF, 0x0F]);
    line.read(FPRD, 0x1001, 0x0130, 2);
    line.request(0x1001, 1);
    line.pass(1_000);
    let back = line.one(Datagram::new(FPRD, 0x1001, 0x0000, &[0]));
    assert_eq!(back.events & 0x08, 0x08, "AL status has changed");
    line.read(FPRD, 0x1001, 0x0130, 2);
    assert_eq!(line.one(Datagram::new(FPRD, 0x1001, 0x0000, &[0])).events & 0x08, 0);
}

#[test]
fn eeprom_is_read_written_and_checked() {
    let mut line = Line::addressed(2);
    let [vendor, _] = line.eeprom(0x1001, 0x0008);
    assert_eq!(vendor, 0x4543);
    assert_eq!(line.eeprom(0x1002, 0x0018), [0x1000, 0x0080]);
    // station alias: write, reload, use
    assert_eq!(line.write(FPWR, 0x1001, 0x0502, &[1, 2, 4, 0, 0, 0, 0x34, 0x12]), 1);
    line.pass(MS);
    assert_eq!(line.eeprom(0x1001, 4)[0], 0x1234);
    assert_eq!(line.read_u16(0x1001, 0x0012), 0, "not loaded yet");
    assert_eq!(line.write(FPWR, 0x1001, 0x0502, &[0, 4]), 1);
    line.pass(MS);
    assert_eq!(line.read_u16(0x1001, 0x0012), 0, "nor by a reload");
    assert_eq!(line.read_u16(0x1001, 0x0502) & 0x0800, 0x0800, "the checksum is the old one");
    line.wire.world_mut().inject(Fault::PowerCycle { gateway: 0, off_ms: 10 });
    line.pass(500 * MS);
    line.address(0);
    assert_eq!(line.read(FPRD, 0x1234, 0x0012, 2).1, 0);
    line.write(FPWR, 0x1001, 0x0103, &[1]);
    assert_eq!(line.read(FPRD, 0x1234, 0x0012, 2), (vec![0x34, 0x12], 1), "as an address");
    // assigned to the device, it ignores the master
    line.write(FPWR, 0x1001, 0x0500, &[1]);
    assert_eq!(line.write(FPWR, 0x1001, 0x0502, &[0, 1, 8, 0]), 0);
}

#[test]
fn lost_gateway_closes_the_line_after_it() {
    let mut line = Line::addressed(3);
    line.wire.world_mut().inject(Fault::PowerOff { gateway: 1 });
    assert_eq!(line.read(BRD, 0, 0x0000, 1).1, 1);
    assert_eq!(line.read_u16(0x1001, 0x0110), 0x5613, "port 1 is closed");
    assert_eq!(line.read(FPRD, 0x1001, 0x0311, 1).0, [1], "a lost link on port 1");
    line.wire.world_mut().inject(Fault::PowerOff { gateway: 0 });
    assert!(line.exchange(&[Datagram::new(BRD, 0, 0, &[0])]).is_none(), "no slave");
}

#[test]
fn power_cycle_clears_registers_and_keeps_the_eeprom() {
    let mut line = Line::preop(2);
    line.write(FPWR, 0x1001, 0x0502, &[1, 2, 4, 0, 0, 0, 0x34, 0x12]);
    line.wire.world_mut().inject(Fault::PowerCycle { gateway: 0, off_ms: 10 });
    line.pass(500 * MS);
    assert_eq!(line.read(FPRD, 0x1001, 0x0130, 2).1, 0, "no station address");
    line.address(0);
    assert_eq!(line.state(0x1001), (1, 0));
    assert_eq!(line.read_u16(0x1001, 0x0012), 0x1234);
}

#[test]
fn scenario_faults_affect_process_data_frames() {
    let mut line = Line::of(1);
    line.wire.world_mut().inject(Fault::LostFrame { direction: LossDirection::Return, cycles: 2 });
    assert_eq!(line.read(BRD, 0, 0x0000, 1).1, 1, "no process data");
    for _ in 0..2 {
        assert!(line.exchange(&[Datagram::logical(LRD, 0, &[0])]).is_none());
    }
    assert_eq!(line.one(Datagram::logical(LRD, 0, &[0])).counter, 0);
    line.wire.world_mut().inject(Fault::WorkingCounterOffset { offset: 5, cycles: 1 });
    assert_eq!(line.one(Datagram::logical(LRD, 0, &[0])).counter, 5);
    assert_eq!(line.wire.statistics().lost, 2);
}

#[test]
fn error_counters_count_and_are_cleared_by_a_write() {
    let mut line = Line::addressed(1);
    let mut torn = crate::wire_support::encode(&[Datagram::new(BRD, 0, 0, &[0])]);
    torn.truncate(torn.len() - 1);
    line.wire.pass(line.now, &mut torn);
    assert_eq!(line.read(FPRD, 0x1001, 0x030C, 1).0, [1]);
    line.write(FPWR, 0x1001, 0x0300, &[0; 20]);
    assert_eq!(line.read(FPRD, 0x1001, 0x030C, 1).0, [0]);
    let mut foreign = vec![0; 60];
    assert!(!line.wire.pass(line.now, &mut foreign), "other protocols are destroyed");
    assert_eq!(line.wire.statistics().foreign, 1);
}
