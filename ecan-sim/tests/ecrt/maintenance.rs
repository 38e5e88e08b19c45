//! Maintenance by SDO through the simulated master: a saved channel is restored after a power
//! cycle, a flash fault is reported, and an update changes the version.

use std::path::Path;

use crate::ecrt_support::{Program, frame, stepped, stepped_echo};
use ecan_host::Master;
use ecan_sim::{
    Backend, Fault, FirmwarePackage, FirmwareProgress, FirmwareUpdateError, Gateway, Scenario,
    StationConfig,
};

const MS: u64 = 1_000_000;

type Progress = Result<FirmwareProgress, FirmwareUpdateError>;

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

fn station(backend: &Backend, channel: usize) -> Option<StationConfig> {
    let simulation = backend.simulation.as_ref().unwrap();
    simulation.with_world(|world| world.gateway(0).unwrap().station_config(channel))
}

#[test]
fn saved_channel_runs_again_after_a_power_cycle() {
    let backend = stepped_echo(1);
    let master = Master::open(&backend.ecrt, 0).unwrap();
    master.sdo_download(0, 0xB000, 1, &[1]).unwrap();
    master.sdo_download(0, 0x8003, 19, &250_000u32.to_le_bytes()).unwrap();
    master.sdo_download(0, 0x8003, 15, &[0]).unwrap();
    master.sdo_download(0, 0x8003, 1, &[1]).unwrap();
    assert_eq!(maintain(&master, 1), 0);
    let stored = upload(&master, 0xB000, 8);
    assert_eq!(upload(&master, 0xB000, 7), stored);
    let simulation = backend.simulation.as_ref().unwrap();
    simulation.inject(Fault::PowerCycle { gateway: 0, off_ms: 300 });
    simulation.pass_ns(100 * MS);
    assert_eq!(station(&backend, 2), None);
    simulation.pass_ns(5_000 * MS);
    assert_eq!(station(&backend, 2), Some(StationConfig::classic(250_000)));
    assert_eq!(station(&backend, 0), None);
    assert_eq!(upload(&master, 0xB000, 8), stored);
    assert_eq!(maintain(&master, 2), 2, "in run mode after the restart");
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

#[test]
fn update_shows_in_the_version_objects() {
    let backend = stepped_echo(1);
    let master = Master::open(&backend.ecrt, 0).unwrap();
    let simulation = backend.simulation.as_ref().unwrap();
    let file = FirmwarePackage::new(0, 0x0304_0005, vec![1; 5_000]).to_bytes();
    let on_gateway = |step: &dyn Fn(&mut Gateway, u64) -> Progress| {
        simulation.with_world(|world| world.with_gateway(0, step)).unwrap()
    };
    let wait_for = |step: &dyn Fn(&mut Gateway, u64) -> Progress| {
        let is_done = (0..1_000).any(|_| {
            simulation.pass_ns(MS);
            on_gateway(step).unwrap() == FirmwareProgress::Done
        });
        assert!(is_done, "busy for ever");
    };
    wait_for(&|gateway, now| gateway.begin_firmware_update(now).map(|()| FirmwareProgress::Done));
    wait_for(&|gateway, now| gateway.write_firmware(now, &file));
    wait_for(&Gateway::finish_firmware_update);
    assert_eq!(upload(&master, 0xF000, 5), 0x0202);
    simulation.pass_ns(5_000 * MS);
    assert_eq!((upload(&master, 0xF000, 5), upload(&master, 0xF000, 6)), (0x0304, 5));
    let mut text = [0; 16];
    let length = master.sdo_upload(0, 0x100A, 0, &mut text).unwrap();
    assert_eq!(&text[..length], b"3.4.5");
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
