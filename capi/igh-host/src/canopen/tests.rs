//! Networks as a C program uses them, on the simulated machine of examples/network.

use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::ptr::{from_mut, null, null_mut};

use ecan_c_boundary::frames::igh_mcan_rx_frame_t;
use ecan_c_boundary::result::ecan_result_t::*;

use super::boot::*;
use super::node::*;
use crate::adapter::config::*;
use crate::adapter::context::*;
use crate::cia402::commands::*;
use crate::cia402::context::*;
use crate::cia402::cycle::*;
use crate::cia402::numbers::igh_canopen_nmt_state_t;
use crate::cia402::sdo::igh_canopen_sdo_upload;
use crate::cia402::state::*;
use crate::mcan_port::config::*;
use crate::mcan_port::config_file::*;
use crate::mcan_port::context::*;
use crate::mcan_port::cycle::{igh_mcan_port_send_can, *};
use crate::test_caller::{code, error, garbage, ok};

const GRIPPER: usize = 2;

fn example(name: &str) -> CString {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/network");
    CString::new(format!("{root}/{name}")).unwrap()
}

/// The machine in operation, without axes and nodes on the Port.
pub(super) struct Machine {
    igh: Box<ecan_igh_context_t>,
    pub(super) port: Box<igh_mcan_port_t>,
    motors: Box<igh_cia402_context_t>,
}

impl Machine {
    fn new() -> Self {
        let mut config: Box<ecan_igh_config_t> = garbage();
        let mut mcan: Box<igh_mcan_port_config_t> = garbage();
        let mut machine = Self { igh: garbage(), port: garbage(), motors: garbage() };
        let setting = CString::new(format!("sim:{}", example("simulated.toml").to_str().unwrap()));
        let (setting, path) = (setting.unwrap(), example("machine.toml"));
        // SAFETY: every pointer is valid.
        unsafe {
            ok(ecan_igh_default_config(&mut *config));
            ok(ecan_igh_config_set_ecrt(&mut *config, setting.as_ptr()));
            ok(ecan_igh_config_set_stepped_clock(&mut *config, 1));
            let (config, mcan) = (&raw mut *config, &raw mut *mcan);
            ok(igh_mcan_port_load_config(config, mcan, path.as_ptr(), null_mut(), 0, null_mut()));
            ok(ecan_igh_init(&mut *machine.igh, config));
            ok(igh_mcan_port_init(&mut *machine.port, &mut *machine.igh, mcan));
            ok(ecan_igh_wait_op_timeout(&mut *machine.igh, 30_000));
        }
        machine
    }

    fn init_file(&mut self, path: &CStr) -> c_int {
        // SAFETY: the pointers are valid.
        unsafe {
            igh_cia402_context_init_file(&mut *self.motors, &mut *self.port, path.as_ptr(), null())
        }
    }

    /// With the axes and nodes of a file.
    pub(super) fn of_file(path: &CStr) -> Self {
        let mut machine = Self::new();
        ok(machine.init_file(path));
        machine
    }

    pub(super) fn of_example() -> Self {
        Self::of_file(&example("machine.toml"))
    }

    pub(super) fn motors(&mut self) -> *mut igh_cia402_context_t {
        from_mut(&mut *self.motors)
    }

    fn cycle(&mut self) {
        // SAFETY: the pointers are valid.
        unsafe {
            ok(igh_mcan_port_wait_next_cycle(&mut *self.port));
            ok(igh_mcan_port_cycle_begin(&mut *self.port));
            ok(igh_cia402_process_rx(self.motors()));
            ok(igh_cia402_send_targets_all(self.motors()));
            ok(igh_mcan_port_cycle_end(&mut *self.port));
        }
    }

    /// Sends an RPDO in each of 200 cycles; returns the number of TPDOs.
    fn exchange_pdos(&mut self, channel: u8, (rpdo, data): (u32, [u8; 2]), tpdo: u32) -> usize {
        let (motors, port) = (self.motors(), &raw mut *self.port);
        let mut frames: [igh_mcan_rx_frame_t; 16] = *garbage();
        let mut received = 0;
        for _ in 0..200 {
            let mut count = 0;
            // SAFETY: the pointers are valid.
            unsafe {
                ok(igh_mcan_port_wait_next_cycle(port));
                ok(igh_mcan_port_cycle_begin(port));
                ok(igh_cia402_process_rx_ex(motors, frames.as_mut_ptr(), 16, &mut count));
                ok(igh_mcan_port_send_can(port, 0, channel, rpdo, 0, data.as_ptr(), 2));
                ok(igh_cia402_send_targets_all(motors));
                ok(igh_mcan_port_cycle_end(port));
            }
            let is_tpdo = |frame: &&igh_mcan_rx_frame_t| {
                (frame.slave, frame.channel, frame.can_id) == (0, channel, tpdo)
            };
            received += frames[..count].iter().filter(is_tpdo).count();
        }
        received
    }

    /// Reads an object of two bytes.
    fn upload(&mut self, channel: u8, node: u8, index: u16) -> [u8; 2] {
        let (mut data, mut length) = ([0_u8; 2], 0);
        let buffer = data.as_mut_ptr().cast::<c_void>();
        let port = &raw mut *self.port;
        // SAFETY: the pointers are valid.
        ok(unsafe {
            igh_canopen_sdo_upload(port, 0, channel, node, index, 0, buffer, 2, &mut length, 2_000)
        });
        assert_eq!(length, 2);
        data
    }

    fn boot_state(&mut self) -> u8 {
        let mut state = 99;
        // SAFETY: the pointers are valid.
        ok(unsafe { igh_canopen_get_boot_state(self.motors(), &mut state) });
        state
    }

    fn boot_progress(&mut self, node: usize) -> igh_canopen_boot_progress_t {
        let mut progress: Box<igh_canopen_boot_progress_t> = garbage();
        // SAFETY: the pointers are valid.
        ok(unsafe { igh_canopen_get_boot_progress(self.motors(), node, &mut *progress) });
        *progress
    }

    fn boot_text(&mut self, node: usize) -> String {
        let mut text = [1; 256];
        let motors = self.motors();
        // SAFETY: the pointers are valid, and the text ends with NUL.
        unsafe {
            ok(igh_canopen_get_boot_text(motors, node, text.as_mut_ptr(), 256, null_mut()));
            CStr::from_ptr(text.as_ptr()).to_str().unwrap().to_owned()
        }
    }

    pub(super) fn node_state(&mut self, node: usize) -> igh_canopen_node_state_t {
        let mut state: Box<igh_canopen_node_state_t> = garbage();
        // SAFETY: the pointers are valid.
        ok(unsafe { igh_canopen_get_node_state(self.motors(), node, &mut *state) });
        *state
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        // SAFETY: the pointer is valid.
        unsafe { ecan_igh_deinit(&mut *self.igh) };
    }
}

/// Texts of the callback.
#[derive(Default)]
struct Seen {
    texts: Vec<(usize, String)>,
}

unsafe extern "C-unwind" fn note(user: *mut c_void, node: usize, text: *const c_char) {
    // SAFETY: the test gave this pointer, and the text is valid until the return.
    unsafe {
        let text = CStr::from_ptr(text).to_str().unwrap().to_owned();
        (*user.cast::<Seen>()).texts.push((node, text));
    }
}

#[test]
fn machine_of_a_file_boots_and_moves() {
    let mut machine = Machine::of_example();
    let motors = machine.motors();
    let mut seen = Box::new(Seen::default());
    let mut node = 99;
    // SAFETY: the pointers are valid as long as the machine.
    unsafe {
        assert_eq!((igh_cia402_axis_count(motors), igh_canopen_node_count(motors)), (2, 3));
        ok(igh_canopen_find_node(motors, 0, 1, 4, &mut node));
        assert_eq!(node, GRIPPER);
        let running = igh_canopen_boot_state_t::IGH_CANOPEN_BOOT_RUNNING as u8;
        assert_eq!(machine.boot_state(), running);
        ok(igh_canopen_set_boot_callback(motors, Some(note), from_mut(&mut *seen).cast()));
        ok(igh_canopen_wait_booted_timeout(motors, 20_000));
        assert_eq!(machine.boot_state(), igh_canopen_boot_state_t::IGH_CANOPEN_BOOT_DONE as u8);
    }
    let text = |(_, text): &(usize, String)| text.contains("gripper, node 4 (slave 0, channel 1)");
    assert!(seen.texts.iter().all(text), "{:?}", seen.texts);
    assert!(seen.texts.iter().all(|(node, _)| *node == GRIPPER));
    assert!(seen.texts.last().unwrap().1.contains("booted after"), "{:?}", seen.texts);
    assert!((4..=9).contains(&seen.texts.len()), "{:?}", seen.texts);

    let progress = machine.boot_progress(GRIPPER);
    assert_eq!(progress.phase, igh_canopen_boot_phase_t::IGH_CANOPEN_BOOT_PHASE_BOOTED as u8);
    assert_eq!((progress.done, progress.of, progress.status), (1, 1, 0));
    assert_eq!((progress.is_mandatory, progress.is_unchanged), (1, 0));
    assert!(progress.elapsed_ms > 0);
    let axis = machine.boot_progress(0);
    assert_eq!(axis.phase, igh_canopen_boot_phase_t::IGH_CANOPEN_BOOT_PHASE_NONE as u8);
    assert_eq!(machine.boot_text(0), "");
    assert!(machine.boot_text(GRIPPER).contains("1 parameter"), "{}", machine.boot_text(GRIPPER));

    let motors = machine.motors();
    // SAFETY: the pointers are valid.
    unsafe {
        ok(igh_cia402_start_up_timeout(motors, 20_000));
        assert_eq!(igh_cia402_all_running(motors), 1);
    }
    let state = machine.node_state(GRIPPER);
    let operational = igh_canopen_nmt_state_t::IGH_CANOPEN_NMT_STATE_OPERATIONAL as u8;
    assert_eq!((state.nmt_state, state.expected_nmt_state), (operational, operational));
    assert_eq!((state.slave, state.channel, state.node_id), (0, 1, 4));
    assert!(state.boot_ups >= 1);
}

/// Without settings of the application those of the file apply.
#[test]
fn settings_of_the_network_are_those_of_the_file() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("machine.toml");
    let text = std::fs::read_to_string(example("machine.toml").to_str().unwrap()).unwrap();
    let folder = example("").into_string().unwrap();
    let text = text.replace("device_file = \"", &format!("device_file = \"{folder}"));
    std::fs::write(&path, text + "[network]\ntarget_cycles = 2\n").unwrap();
    let path = CString::new(path.to_str().unwrap()).unwrap();
    let mut settings: Box<igh_cia402_settings_t> = garbage();
    // SAFETY: the pointer is valid.
    ok(unsafe { igh_cia402_default_settings(&mut *settings) });
    for (settings, waits) in [(null(), 5), (&raw const *settings, 0)] {
        let mut machine = Machine::new();
        let (motors, port) = (machine.motors(), &raw mut *machine.port);
        // SAFETY: the pointers are valid.
        unsafe {
            ok(igh_cia402_context_init_file(motors, port, path.as_ptr(), settings));
            ok(igh_cia402_start_up_timeout(motors, 20_000));
        }
        let not_due = igh_cia402_wait_t::IGH_CIA402_WAIT_NOT_DUE as u8;
        let waiting = igh_cia402_decision_t::IGH_CIA402_DECISION_WAIT as u8;
        let mut state: Box<igh_cia402_axis_state_t> = garbage();
        // The second target waits until the first one has taken effect.
        (0..4).for_each(|_| machine.cycle());
        let mut seen = 0;
        for _ in 0..10 {
            machine.cycle();
            // SAFETY: the pointers are valid.
            ok(unsafe { igh_cia402_get_axis_state(machine.motors(), 0, &mut *state) });
            seen += u32::from((state.decision, state.decision_reason) == (waiting, not_due));
        }
        assert_eq!(seen, waits);
    }
}

#[test]
fn node_boots_again_in_the_cycle() {
    let mut machine = Machine::of_example();
    let motors = machine.motors();
    // SAFETY: the pointers are valid.
    unsafe {
        ok(igh_canopen_wait_booted_timeout(motors, 20_000));
        assert_eq!(igh_canopen_boot_again(motors, 0), code(ECAN_ERR_ORDER), "{}", error());
        assert_eq!(igh_canopen_boot_again(motors, 3), code(ECAN_ERR_NODE), "{}", error());
        ok(igh_canopen_boot_again(motors, GRIPPER));
    }
    let running = igh_canopen_boot_state_t::IGH_CANOPEN_BOOT_RUNNING as u8;
    assert_eq!(machine.boot_state(), running);
    for _ in 0..5_000 {
        machine.cycle();
        if machine.boot_state() != running {
            break;
        }
    }
    assert_eq!(machine.boot_state(), igh_canopen_boot_state_t::IGH_CANOPEN_BOOT_DONE as u8);
    // Its own reset is not a restart; one by the application is.
    assert_eq!(machine.boot_progress(GRIPPER).restarts, 0);
    let motors = machine.motors();
    // SAFETY: the pointer is valid.
    unsafe { ok(igh_canopen_send_nmt(motors, GRIPPER, 0x81)) };
    for _ in 0..5_000 {
        machine.cycle();
    }
    assert_eq!(machine.boot_state(), igh_canopen_boot_state_t::IGH_CANOPEN_BOOT_DONE as u8);
    assert_eq!(machine.boot_progress(GRIPPER).restarts, 1);
    let motors = machine.motors();
    // SAFETY: the pointer is valid.
    unsafe {
        ok(igh_canopen_boot_again(motors, IGH_CANOPEN_ALL_NODES));
        ok(igh_canopen_wait_booted_timeout(motors, 20_000));
    }
}

#[test]
fn process_data_of_a_node_belong_to_the_application() {
    let eds = example("servo_drive.eds");
    let text = format!(
        "cycle_us = 2000\n[[gateway]]\nn = 4\ncan0 = {{ bitrate = 1_000_000 }}\n\
         can1 = {{ bitrate = 500_000 }}\n\
         [[node]]\ngateway = 0\nchannel = 0\nnode = 2\ndevice_file = {eds:?}\n\
         [[node.rpdo]]\nnumber = 1\ntransmission = 1\nobjects = [\"Target torque\"]\n\
         [[node.tpdo]]\nnumber = 1\ntransmission = 1\nobjects = [\"Statusword\"]\n"
    );
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("network.toml");
    std::fs::write(&path, text).unwrap();
    let mut machine = Machine::of_file(&CString::new(path.to_str().unwrap()).unwrap());
    let motors = machine.motors();
    // SAFETY: the pointer is valid.
    ok(unsafe { igh_canopen_wait_booted_timeout(motors, 20_000) });
    let torque = 77_u16.to_le_bytes();
    let received = machine.exchange_pdos(0, (0x202, torque), 0x182);
    assert_eq!(machine.upload(0, 2, 0x6071), torque);
    assert!(received > 150, "{received}");
}

/// The gripper of the example takes its RPDO, and sends its TPDO, with SYNC.
#[test]
fn gripper_of_the_example_follows_sync() {
    let mut machine = Machine::of_example();
    let motors = machine.motors();
    // SAFETY: the pointer is valid.
    ok(unsafe { igh_canopen_wait_booted_timeout(motors, 20_000) });
    let force = 300_u16.to_le_bytes();
    let received = machine.exchange_pdos(1, (0x204, force), 0x184);
    assert_eq!(machine.upload(1, 4, 0x2000), force);
    assert!((190..=201).contains(&received), "{received}");
}

/// A machine with one gripper of another maker, and a second one that does not exist.
const WRONG: &str = r#"
    cycle_us = 2000
    [[gateway]]
    n = 4
    can0 = { bitrate = 1_000_000 }
    can1 = { bitrate = 500_000 }
    [[node]]
    name = "gripper"
    gateway = 0
    channel = 1
    node = 4
    vendor_id = 0x99
    [[node]]
    name = "sensor"
    gateway = 0
    channel = 1
    node = 9
    boot_timeout_ms = 300
    [[node]]
    gateway = 0
    channel = 1
    node = 10
    mandatory = false
    boot_timeout_ms = 300
"#;

#[test]
fn failed_nodes_are_named_with_their_status() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("wrong.toml");
    std::fs::write(&path, WRONG).unwrap();
    let mut machine = Machine::of_file(&CString::new(path.to_str().unwrap()).unwrap());
    let motors = machine.motors();
    // SAFETY: the pointer is valid.
    unsafe {
        let failed = igh_canopen_wait_booted_timeout(motors, 20_000);
        assert_eq!(failed, code(ECAN_ERR_BOOT));
    }
    let text = error();
    assert!(text.contains("2 mandatory nodes not booted"), "{text}");
    assert!(
        text.contains("gripper, node 4 (slave 0, channel 1): boot-up failed (status D)"),
        "{text}"
    );
    assert!(
        text.contains("sensor, node 9 (slave 0, channel 1): boot-up failed (status B)"),
        "{text}"
    );
    assert!(!text.contains("node 10"), "{text}");
    let failed = igh_canopen_boot_phase_t::IGH_CANOPEN_BOOT_PHASE_FAILED as u8;
    for (node, status, is_mandatory) in [(0, b'D', 1), (1, b'B', 1), (2, b'B', 0)] {
        let progress = machine.boot_progress(node);
        assert_eq!(
            (progress.phase, progress.status, progress.is_mandatory),
            (failed, status, is_mandatory)
        );
    }
    assert_eq!(machine.boot_state(), igh_canopen_boot_state_t::IGH_CANOPEN_BOOT_FAILED as u8);
}

#[test]
fn file_with_faults_opens_nothing() {
    let mut machine = Machine::new();
    assert_eq!(machine.init_file(c"/no/such/file.toml"), code(ECAN_ERR_FILE));
    assert!(error().contains("/no/such/file.toml"), "{}", error());
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("wrong.toml");
    let c_path = CString::new(path.to_str().unwrap()).unwrap();
    for (change, expected, part) in [
        (("node = 10", "node = 9"), ECAN_ERR_CONFIG, "node 9"),
        (("node = 10", "node = 127"), ECAN_ERR_CONFIG, "127"),
        (("vendor_id", "vendor"), ECAN_ERR_CONFIG, "vendor"),
        // The gateway of the Port does not have what another file describes.
        (("can1 = {", "can2 = {"), ECAN_ERR_CONFIG, "channel"),
    ] {
        std::fs::write(&path, WRONG.replace(change.0, change.1)).unwrap();
        assert_eq!(machine.init_file(&c_path), code(expected), "{change:?}: {}", error());
        assert!(error().contains(part), "{}", error());
        let motors = machine.motors();
        // SAFETY: the pointer is valid.
        assert_eq!(unsafe { igh_cia402_process_rx(motors) }, code(ECAN_ERR_NOT_INITIALISED));
    }
    let other = WRONG.replace("can1 = {", "can2 = {").replace("channel = 1", "channel = 2");
    std::fs::write(&path, other).unwrap();
    assert_eq!(machine.init_file(&c_path), code(ECAN_ERR_CHANNEL), "{}", error());
    ok(machine.init_file(&example("machine.toml")));
}

#[test]
fn node_is_added_and_commanded() {
    let mut machine = Machine::new();
    let motors = machine.motors();
    let port: *mut igh_mcan_port_t = &mut *machine.port;
    let mut node = 99;
    // SAFETY: the pointers are valid, or NULL if that is allowed.
    unsafe {
        ok(igh_cia402_context_init(motors, port, null(), 0));
        assert_eq!(igh_canopen_find_node(motors, 0, 1, 4, &mut node), code(ECAN_ERR_NODE));
        ok(igh_canopen_add_node(motors, 0, 1, 4, &mut node));
        assert_eq!((node, igh_canopen_node_count(motors)), (0, 1));
        assert_eq!(igh_canopen_add_node(motors, 0, 1, 4, null_mut()), code(ECAN_ERR_CONFIG));
        assert_eq!(igh_canopen_add_node(motors, 0, 2, 4, null_mut()), code(ECAN_ERR_CHANNEL));
        assert_eq!(igh_canopen_add_node(motors, 1, 1, 4, null_mut()), code(ECAN_ERR_SLAVE));
        assert_eq!(igh_canopen_add_node(motors, 0, 1, 127, null_mut()), code(ECAN_ERR_CONFIG));
        assert_eq!(igh_canopen_add_node(motors, 0, 1, 128, null_mut()), code(ECAN_ERR_ARGUMENT));
        assert_eq!(igh_cia402_send_nmt(motors, 0, 0x82), code(ECAN_ERR_AXIS), "it has no axis");
        assert_eq!(igh_canopen_send_nmt(motors, 1, 0x82), code(ECAN_ERR_NODE));
        ok(igh_canopen_send_nmt(motors, 0, 0x82));
        ok(igh_canopen_wait_booted_timeout(motors, 1_000));
    }
    for _ in 0..1_000 {
        machine.cycle();
    }
    let state = machine.node_state(0);
    assert_eq!(state.boot_ups, 1);
    let pre_operational = igh_canopen_nmt_state_t::IGH_CANOPEN_NMT_STATE_PRE_OPERATIONAL as u8;
    assert_eq!(state.expected_nmt_state, pre_operational);
    assert_eq!(state.boot_phase, igh_canopen_boot_phase_t::IGH_CANOPEN_BOOT_PHASE_NONE as u8);
}
