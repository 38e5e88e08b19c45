//! Maintenance by SDO through the simulated master: a flash fault of a scenario is reported, and a
//! stopped controller keeps its frames.

use std::path::Path;

use crate::ecrt_support::{Program, frame, stepped, stepped_echo};
use ecan_host::Master;
use ecan_sim::{Gateway, Scenario};

fn upload(master: &Master, index: u16, subindex: u8) -> u32 {
    let mut data = [0; 4];
    master.sdo_upload(0, index, subindex, &mut data).unwrap();
    u32::from_le_bytes(data)
}

/// Executes a maintenance command and polls for its end, as in the manual; returns its status.
fn maintain(master: &Master, command: u8) -> u32 {
    let sequence = upload(master, 0xB000, 12);
    master.sdo_download(0, 0xB000, 4, &[command]).unwrap();
    for _ in 0..50 {
        let status = upload(master, 0xB000, 5);
        if upload(master, 0xB000, 12) != sequence {
            return upload(master, 0xB000, 5);
        }
        assert_eq!(status, 1, "busy");
    }
    panic!("the command never ends");
}

#[test]
fn scenario_injects_a_flash_failure() {
    let text =
        "[[gateway]]\n[[fault]]\nat_ms = 0\nkind = \"flash_failure\"\ngateway = 0\ntimes = 2\n";
    let backend = stepped(Scenario::from_toml(text, "broken", Path::new(".")).unwrap());
    let master = Master::open(&backend.ecrt, 0).unwrap();
    master.sdo_download(0, 0xB000, 1, &[1]).unwrap();
    let statuses: Vec<u32> = (0..3).map(|_| maintain(&master, 1)).collect();
    assert_eq!(statuses, [5, 5, 0]);
}

/// Writes a register of channel 0 through the register service.
fn write_register(program: &Program, offset: u32, value: u32) {
    let writes: [(u16, u8, Vec<u8>); 4] = [
        (0xB000, 1, vec![1]),
        (0xA000, 1, offset.to_le_bytes().to_vec()),
        (0xA000, 4, value.to_le_bytes().to_vec()),
        (0xA000, 2, vec![2]),
    ];
    let write = |gateway: &mut Gateway, now| {
        for (index, subindex, data) in &writes {
            gateway.sdo_download(now, *index, *subindex, data).unwrap();
        }
        let mut status = Vec::new();
        gateway.sdo_upload(now, 0xA000, 3, &mut status).unwrap();
        assert_eq!(status, [0]);
    };
    program.simulation().with_world(|world| world.with_gateway(0, write)).unwrap();
}

#[test]
fn stopped_controller_keeps_its_frames() {
    const CCCR: u32 = 0x18;
    const INIT: u32 = 1;
    let mut program = Program::new(stepped_echo(1), &[3]).into_op();
    let frames: Vec<_> = (1..=6).map(|id| (0, 0, frame(id, &[7; 8]))).collect();
    // stopped at each phase of the transmission
    for delay_us in (0..1_500).step_by(100) {
        program.received.clear();
        program.cycle_with(&frames);
        program.simulation().pass_ns(delay_us * 1_000);
        write_register(&program, CCCR, INIT);
        let before = program.counters(0).frames_on_bus;
        program.cycles(5);
        assert_eq!(program.counters(0).frames_on_bus, before, "off the bus");
        write_register(&program, CCCR, 0);
        program.cycles(20);
        let sent = program.counters(0);
        assert_eq!(sent.frames_on_bus, sent.frames_parsed, "delay {delay_us} us");
    }
}
