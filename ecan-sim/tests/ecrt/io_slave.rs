//! A slave of another vendor on the line: a digital I/O, called like from a C program.

use std::path::Path;
use std::ptr::null_mut;

use super::c_master::{CMaster, PATIENCE, slave_info};
use crate::ecrt_support::stepped;
use ecan_sim::{
    BackendError, Fault, IoBehaviour, IoSpec, Scenario, Simulation, Wire, echo, libethercat as c,
};
use ecrt_sys::{
    EC_WC_COMPLETE, EC_WC_ZERO, EC_WD_DEFAULT, EC_WD_ENABLE, ec_domain_state_t,
    ec_pdo_entry_info_t, ec_slave_info_t,
};

/// A program that configures the I/O and leaves the gateway in PREOP.
struct Program {
    owner: CMaster,
    data: *mut u8,
    outputs: usize,
    inputs: usize,
}

fn world(io: IoSpec, gateways: usize) -> Simulation {
    let scenario = Scenario { ios: vec![io], ..echo(gateways) };
    stepped(scenario).simulation.expect("it is simulated")
}

/// Entries of one direction, 8 bits each.
fn entries(object: u16, bytes: u8) -> Vec<ec_pdo_entry_info_t> {
    (1..=bytes)
        .map(|subindex| ec_pdo_entry_info_t { index: object, subindex, bit_length: 8 })
        .collect()
}

impl Program {
    fn new(io: IoSpec, mapped: (u8, u8)) -> Self {
        let position = io.position as u16;
        let owner = CMaster::of_slave(world(io, 1), position);
        owner.set_pdos([
            (0, EC_WD_ENABLE, 0x1600, entries(0x7000, mapped.0)),
            (1, EC_WD_DEFAULT, 0x1A00, entries(0x6000, mapped.1)),
        ]);
        let (result, offsets) = owner.register_by_list();
        assert_eq!(result, 0);
        let [outputs, inputs] = offsets.map(|offset| offset as usize);
        Self { owner, data: null_mut(), outputs, inputs }
    }

    fn activated(mut self) -> Self {
        self.owner.activate();
        // SAFETY: the handle is the library's.
        self.data = unsafe { c::domain_data(self.owner.domain) };
        assert!(!self.data.is_null());
        self
    }

    fn into_op(self) -> Self {
        let program = self.activated();
        assert!(program.reaches_op(), "{}", program.owner.log());
        program
    }

    fn reaches_op(&self) -> bool {
        (0..PATIENCE).any(|_| {
            let is_complete = self.cycle().wc_state == EC_WC_COMPLETE;
            is_complete && self.owner.state().operational() == 1
        })
    }

    fn cycle(&self) -> ec_domain_state_t {
        self.cycle_with(&[])
    }

    /// One cycle; the first output bytes are written between receive and send.
    fn cycle_with(&self, outputs: &[u8]) -> ec_domain_state_t {
        self.owner.cycle_with(|| {
            for (at, value) in outputs.iter().enumerate() {
                // SAFETY: the domain has this byte.
                unsafe { self.data.add(self.outputs + at).write(*value) };
            }
        })
    }

    fn read(&self, at: usize) -> u8 {
        // SAFETY: the domain has this byte.
        unsafe { self.data.add(self.inputs + at).read() }
    }

    fn driven(&self) -> Vec<u8> {
        self.owner.simulation.with_world(|world| {
            let now = world.now_ns();
            world.io(0).map(|io| io.outputs(now).collect()).unwrap_or_default()
        })
    }
}

fn name(info: &ec_slave_info_t) -> String {
    info.name.iter().map(|byte| *byte as u8 as char).take_while(|byte| *byte != '\0').collect()
}

#[test]
fn io_lies_at_its_position_and_the_gateways_at_the_others() {
    let io = IoSpec { name: "EL1859".into(), serial: 7, ..IoSpec::at(1) };
    let simulation = world(io.clone(), 2);
    assert!(simulation.banner().contains("2 gateways, 1 I/O slave, 8 nodes"));
    let master = c::open_master(&simulation, 0);
    let infos: Vec<_> = (0..3).map(|position| slave_info(master, position).1).collect();
    let names: Vec<_> = infos.iter().map(name).collect();
    assert_eq!(names, ["ECAN-Lite", "EL1859", "ECAN-Lite"]);
    let found = &infos[1];
    assert_eq!((found.vendor_id, found.product_code), (io.vendor_id, io.product_code));
    assert_eq!((found.serial_number, found.sync_count, found.sdo_count), (7, 2, 0));
    assert_eq!(found.al_state, 2, "PREOP");
    assert_ne!(slave_info(master, 3).0, 0);
}

#[test]
fn outputs_are_looped_back_by_the_owners_domain() {
    let program = Program::new(IoSpec::at(0), (2, 2)).into_op();
    // SAFETY: the handle is the library's.
    assert_eq!(unsafe { c::domain_size(program.owner.domain) }, 4);
    program.cycle_with(&[0x5A, 0xC3]);
    assert_eq!(program.cycle().working_counter, 3, "LRW: 2 + 1");
    program.cycle();
    program.cycle();
    assert_eq!((program.read(0), program.read(1)), (0x5A, 0xC3));
    assert_eq!(program.driven(), [0x5A, 0xC3]);
}

#[test]
fn inputs_follow_the_behaviour() {
    let counter = IoSpec { behaviour: IoBehaviour::Counter, inputs: 3, ..IoSpec::at(1) };
    let program = Program::new(counter, (2, 3)).into_op();
    let first = program.read(0);
    program.cycle();
    assert_eq!(program.read(0), first.wrapping_add(1));
    let fixed = IoBehaviour::Fixed(vec![9, 8]);
    program.owner.simulation.with_world(|world| world.io_mut(0).expect("it").set_behaviour(fixed));
    program.cycle();
    program.cycle();
    assert_eq!([0, 1, 2].map(|at| program.read(at)), [9, 8, 0]);
}

#[test]
fn io_without_mailbox_answers_no_sdo() {
    let simulation = world(IoSpec::at(1), 1);
    let master = c::open_master(&simulation, 0);
    let (mut data, mut size, mut abort) = ([0_u8; 4], 0, 0);
    // SAFETY: the handle is the library's, the places are there.
    let result = unsafe {
        c::master_sdo_upload(master, 1, 0x1018, 1, data.as_mut_ptr(), 4, &mut size, &mut abort)
    };
    assert_eq!((result, abort), (-libc::EPROTONOSUPPORT, 0));
}

#[test]
fn mapping_of_another_length_is_rejected_in_safeop() {
    let program = Program::new(IoSpec::at(1), (1, 2)).activated();
    assert!(!program.reaches_op());
    let (_, info) = slave_info(program.owner.master, 1);
    assert_eq!((info.al_state, info.error_flag), (2, 1));
    let log = program.owner.log();
    assert!(log.contains("0-1: does not support changing its PDO assignment"), "{log}");
    assert!(log.contains("0-1: rejected the change to SAFEOP: AL status code 0x001D"), "{log}");
}

#[test]
fn startup_sdo_of_an_io_fails() {
    let program = Program::new(IoSpec::at(1), (2, 2));
    // SAFETY: the handle is the library's.
    assert_eq!(unsafe { c::slave_config_sdo8(program.owner.config, 0x8000, 1, 1) }, 0);
    let program = program.activated();
    assert!(!program.reaches_op());
    let log = program.owner.log();
    assert!(log.contains("the slave does not support CoE"), "{log}");
}

#[test]
fn watchdog_clears_outputs_without_a_cycle() {
    let program = Program::new(IoSpec::at(0), (2, 2)).into_op();
    program.cycle_with(&[0xFF]);
    assert_eq!(program.driven(), [0xFF, 0]);
    program.owner.simulation.pass_ns(99_000_000);
    assert_eq!(program.driven(), [0, 0]);
    program.cycle();
    assert_eq!(program.driven(), [0xFF, 0], "the next write drives them again");
}

#[test]
fn io_returns_configured_after_a_loss_of_supply() {
    let program = Program::new(IoSpec::at(1), (2, 2)).into_op();
    program.owner.simulation.inject(Fault::IoPowerCycle { io: 0, off_ms: 200 });
    program.cycle();
    program.cycle();
    assert_eq!(program.cycle().wc_state, EC_WC_ZERO);
    assert!(program.reaches_op(), "{}", program.owner.log());
}

#[test]
fn wire_rejects_an_io() {
    let scenario = Scenario { ios: vec![IoSpec::at(1)], ..echo(1) };
    let Err(BackendError::IoOnWire(name)) = Wire::new(&scenario, 0) else { panic!("accepted") };
    assert_eq!(name, "Digital I/O");
}

#[test]
fn keys_of_an_io_are_read() {
    let text = r#"
[[gateway]]
[[io]]
position = 0
name = "EL1859"
alias = 4
vendor_id = 2
product_code = 0x07433052
revision = 0x100000
serial = 9
boot_ms = 20
outputs = 1
inputs = 3
behaviour = "fixed"
values = [1, 2]
[[fault]]
cycle = 5
kind = "io_power_cycle"
io = 0
off_ms = 30
"#;
    let scenario = Scenario::from_toml(text, "test", Path::new(".")).expect("it is good");
    let io = IoSpec {
        position: 0,
        name: "EL1859".into(),
        alias: 4,
        vendor_id: 2,
        product_code: 0x0743_3052,
        revision: 0x10_0000,
        serial: 9,
        boot_ms: 20,
        outputs: 1,
        inputs: 3,
        behaviour: IoBehaviour::Fixed(vec![1, 2]),
    };
    assert_eq!(scenario.ios, [io]);
    assert_eq!(scenario.faults[0].fault, Fault::IoPowerCycle { io: 0, off_ms: 30 });
}

#[test]
fn faulty_io_is_rejected_with_its_line() {
    let cases = [
        ("", "line 2: missing field `position`"),
        (
            "position = 2",
            "line 2: `position` 2 is out of range; the line has 2 slave(s), 1 of them",
        ),
        ("position = 1\noutputs = 65", "`outputs` is out of range; allowed: 0 to 64 bytes"),
        ("position = 1\noutputs = 0\ninputs = 0", "needs `outputs` or `inputs`; both are 0"),
        ("position = 1\nvalues = [1]", "`values` belongs to behaviour \"fixed\" only"),
        ("position = 1\nbehaviour = \"fixed\"", "needs `values`, the input bytes"),
        (
            "position = 1\nbehaviour = \"fixed\"\nvalues = [1, 2, 3]",
            "`values` has 3 bytes; `inputs` is 2",
        ),
        ("position = 1\nbehaviour = \"echo\"", "line 4: unknown variant `echo`"),
        ("position = 1\nnode_id = 3", "unknown field `node_id`"),
        ("position = 1\n[[io]]\nposition = 1", "line 4: position 1 is used twice"),
        (
            "position = 1\n[[fault]]\ncycle = 1\nkind = \"io_power_cycle\"\nio = 1",
            "line 4: I/O 1 does not exist; there are 1",
        ),
    ];
    for (keys, expected) in cases {
        let text = format!("[[gateway]]\n[[io]]\n{keys}\n");
        let error = Scenario::from_toml(&text, "test", Path::new(".")).expect_err(keys).to_string();
        assert!(error.contains(expected), "{keys}: {error}");
    }
}
