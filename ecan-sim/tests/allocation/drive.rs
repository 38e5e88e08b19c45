//! A moving drive allocates no memory: cycles of RPDO, SYNC and TPDO, heartbeats, SDO transfers.

use crate::drive::fixture::config;
use crate::ecrt_support::{Program, frame, stepped};
use ecan_canopen::DriveState;
use ecan_protocol::can::{CanFrame, CanId};
use ecan_sim::{Drive, Node, NodeOutput, drives};
use ecan_test_support::allocations;

struct Host {
    drive: Drive,
    out: NodeOutput,
    now: u64,
    received: u64,
}

impl Host {
    fn send(&mut self, id: u16, data: &[u8]) {
        let frame = CanFrame::classic(CanId::standard(id).unwrap(), data).unwrap();
        self.drive.received(self.now, &frame, &mut self.out);
        self.drain();
    }

    fn drain(&mut self) {
        while let Some(frame) = self.out.pop() {
            self.received += 1;
            self.drive.transmitted(self.now, &frame, &mut self.out);
        }
    }

    fn pass(&mut self, ns: u64) {
        let end = self.now + ns;
        while let Some(at) = self.drive.next_event().filter(|at| *at <= end) {
            self.now = at;
            self.drive.advance(at, &mut self.out);
            self.drain();
        }
        self.now = end;
    }

    fn write(&mut self, index: u16, sub: u8, value: u32, bytes: u8) {
        let [low, high] = index.to_le_bytes();
        let [a, b, c, d] = value.to_le_bytes();
        self.send(0x605, &[0x23 | (4 - bytes) << 2, low, high, sub, a, b, c, d]);
    }

    fn cycle(&mut self, word: u16, target: i32) {
        let [a, b] = word.to_le_bytes();
        let [c, d, e, f] = target.to_le_bytes();
        self.send(0x205, &[a, b, c, d, e, f]);
        self.send(0x080, &[]);
        self.send(0x77F, &[5]);
        // device name, segmented; device type, expedited; a parameter
        self.send(0x605, &[0x40, 0x08, 0x10, 0, 0, 0, 0, 0]);
        self.send(0x605, &[0x60, 0, 0, 0, 0, 0, 0, 0]);
        self.write(0x6081, 0, 1000, 4);
        self.pass(1_000_000);
    }
}

#[test]
fn cycles_allocate_nothing() {
    let mut host =
        Host { drive: Drive::new(&config()), out: NodeOutput::new(), now: 1, received: 0 };
    host.drive.started(1, &mut host.out);
    host.pass(100_000_000);
    for (index, sub, value, bytes) in [
        (0x1017, 0, 10, 2),
        (0x1016, 1, 0x007F_0064, 4),
        (0x1400, 1, 0xC000_0205, 4),
        (0x1400, 2, 1, 1),
        (0x1600, 0, 0, 1),
        (0x1600, 1, 0x6040_0010, 4),
        (0x1600, 2, 0x607A_0020, 4),
        (0x1600, 0, 2, 1),
        (0x1400, 1, 0x4000_0205, 4),
        (0x6060, 0, 8, 1),
    ] {
        host.write(index, sub, value, bytes);
    }
    host.send(0, &[1, 0]);
    let mut target = 1000;
    for word in [0x06, 0x07, 0x0F] {
        host.cycle(word, target);
    }
    let mut run = |host: &mut Host, cycles: usize| {
        for _ in 0..cycles {
            target += 20;
            host.cycle(0x0F, target);
        }
    };
    // buffers grow to their final size
    run(&mut host, 2_000);
    let before = (allocations(), host.received);
    run(&mut host, 3_000);
    assert_eq!(allocations(), before.0);
    assert!(host.received > before.1 + 9_000);
    assert_eq!(host.drive.state(), DriveState::OperationEnabled);
    assert!(host.drive.position() > 50_000);
}

#[test]
fn world_of_drives_allocates_nothing() {
    let mut program = Program::new(stepped(drives(1, 4)), &[8]).into_op();
    program.received.reserve(100_000);
    program.cycles(100);
    let on_all = |frame: CanFrame| (0..4u8).map(move |channel| (0, channel, frame));
    // heartbeats every 5 ms and events of all drives
    for node in 1..=4 {
        let write = frame(0x600 + node, &[0x2B, 0x17, 0x10, 0, 5, 0, 0, 0]);
        program.cycle_with(&on_all(write).collect::<Vec<_>>());
        program.cycles(10);
    }
    let start: Vec<_> = on_all(frame(0, &[1, 0])).collect();
    let shutdown: Vec<_> = (1..=4).flat_map(|node| on_all(frame(0x200 + node, &[6, 0]))).collect();
    let disable: Vec<_> = (1..=4).flat_map(|node| on_all(frame(0x200 + node, &[0, 0]))).collect();
    program.cycle_with(&start);
    let run = |program: &mut Program, cycles: usize| {
        for _ in 0..cycles {
            program.cycle_with(&shutdown);
            program.cycles(4);
            program.cycle_with(&disable);
            program.cycles(4);
        }
    };
    run(&mut program, 100);
    let (before, frames) = (allocations(), program.received.len());
    run(&mut program, 200);
    assert_eq!(allocations(), before);
    assert!(program.received.len() > frames + 5_000, "{}", program.received.len() - frames);
}
