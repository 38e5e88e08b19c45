//! Functions of igh_canopen.h and igh_cia402_protocol.h that are real-time safe allocate nothing, also while
//! nodes boot and fail.

use std::ffi::{CString, c_void};
use std::ptr::null;

use ecan_c_boundary::result::ecan_result_t::*;
use ecan_igh_host::canopen::boot::{
    igh_canopen_boot_again, igh_canopen_boot_phase_t, igh_canopen_boot_progress_t,
    igh_canopen_boot_state_t, igh_canopen_get_boot_progress, igh_canopen_get_boot_state,
};
use ecan_igh_host::canopen::lss::{
    igh_canopen_lss_command_t, igh_canopen_lss_init, igh_canopen_lss_poll,
    igh_canopen_lss_service_t, igh_canopen_lss_start,
};
use ecan_igh_host::canopen::node::{
    igh_canopen_emergency_t, igh_canopen_find_node, igh_canopen_get_emergencies,
    igh_canopen_get_node_state, igh_canopen_node_state_t, igh_canopen_send_nmt,
};
use ecan_igh_host::canopen::services::{igh_canopen_sdo_poll, igh_canopen_sdo_start_upload};
use ecan_igh_host::cia402::context::{igh_cia402_context_init_file, igh_cia402_context_t};
use ecan_igh_host::cia402::cycle::{
    igh_cia402_arm_probe, igh_cia402_disarm_probe, igh_cia402_process_rx,
    igh_cia402_send_targets_all, igh_cia402_set_digital_outputs, igh_cia402_set_target_with,
};
use ecan_igh_host::cia402::drive_values::{
    igh_cia402_drive_limits_t, igh_cia402_drive_units_t, igh_cia402_get_drive_limits,
    igh_cia402_get_drive_units,
};
use ecan_igh_host::mcan_port::cycle::{
    igh_mcan_port_cycle_begin, igh_mcan_port_cycle_end, igh_mcan_port_wait_next_cycle,
};
use ecan_test_support::allocations;

use crate::c_port::CPort;

/// An axis and two nodes, neither of which is there: the simulated nodes are echoes.
const NETWORK: &str = r#"
    [[gateway]]
    n = 4
    can0 = { bitrate = 1_000_000 }
    [[node]]
    gateway = 0
    channel = 0
    node = 1
    [node.axis]
    step_limit = 100
    [[node]]
    name = "pump"
    gateway = 0
    channel = 0
    node = 2
    boot_timeout_ms = 200
    [[node]]
    gateway = 0
    channel = 0
    node = 3
    boot_timeout_ms = 200
    mandatory = false
"#;

fn zeroed<T>() -> T {
    // SAFETY: used for structs of integers only.
    unsafe { std::mem::zeroed() }
}

#[test]
fn services_of_nodes_allocate_nothing_in_the_cycle() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("network.toml");
    std::fs::write(&path, NETWORK).unwrap();
    let path = CString::new(path.to_str().unwrap()).unwrap();
    let mut c = CPort::ready(4);
    let mut context: Box<igh_cia402_context_t> = Box::new(zeroed());
    let context: *mut igh_cia402_context_t = &mut *context;
    // SAFETY: every pointer is valid, or NULL for the default settings.
    unsafe {
        assert_eq!(igh_cia402_context_init_file(context, c.port(), path.as_ptr(), null()), 0);
    }
    let (mut boot_state, mut state) = (99, 99);
    let mut progress: igh_canopen_boot_progress_t = zeroed();
    let (mut node_state, mut limits): (igh_canopen_node_state_t, igh_cia402_drive_limits_t) =
        (zeroed(), zeroed());
    let mut units: igh_cia402_drive_units_t = zeroed();
    let mut emergency: igh_canopen_emergency_t = zeroed();
    let mut lss: igh_canopen_lss_command_t = zeroed();
    let (mut data, mut length, mut number) = ([0_u8; 8], 0, 0);
    let failed = igh_canopen_boot_phase_t::IGH_CANOPEN_BOOT_PHASE_FAILED as u8;
    let (mut counted, mut failures, mut started) = (0, 0, 0);
    let port = c.port();
    for cycle in 0..1_500 {
        // SAFETY: every pointer is valid.
        unsafe {
            assert_eq!(igh_mcan_port_wait_next_cycle(port), 0);
            let before = allocations();
            assert_eq!(igh_mcan_port_cycle_begin(port), 0);
            assert_eq!(igh_cia402_process_rx(context), 0);
            assert_eq!(igh_canopen_get_boot_state(context, &mut boot_state), 0);
            for node in 0..3 {
                assert_eq!(igh_canopen_get_boot_progress(context, node, &mut progress), 0);
                failures += u32::from(progress.phase == failed && progress.status == b'B');
                assert_eq!(igh_canopen_get_node_state(context, node, &mut node_state), 0);
                let found =
                    igh_canopen_get_emergencies(context, node, &mut emergency, 1, &mut length);
                assert_eq!((found, length), (0, 0));
            }
            assert_eq!(igh_canopen_find_node(context, 0, 0, 3, &mut number), 0);
            let code = igh_canopen_find_node(context, 0, 0, 9, &mut number);
            assert_eq!(code, ECAN_ERR_NODE.code());
            if cycle % 500 == 400 {
                assert_eq!(igh_canopen_boot_again(context, 1), 0);
                assert_eq!(igh_canopen_send_nmt(context, 2, 0x80), 0);
                let service = igh_canopen_lss_service_t::IGH_CANOPEN_LSS_IDENTIFY_NON_CONFIGURED;
                assert_eq!(igh_canopen_lss_init(&mut lss, service as u8), 0);
                started += u32::from(igh_canopen_lss_start(context, 0, 0, &lss) == 0);
                started += u32::from(igh_canopen_sdo_start_upload(context, 2, 0x1000, 0) == 0);
            }
            igh_canopen_lss_poll(context, 0, 0, &mut state, std::ptr::null_mut());
            let buffer = data.as_mut_ptr().cast::<c_void>();
            igh_canopen_sdo_poll(context, 2, &mut state, buffer, 8, &mut length);
            assert_eq!(igh_cia402_set_target_with(context, 0, 5, 1, 1), 0);
            let code = igh_cia402_set_digital_outputs(context, 0, 1);
            assert_eq!(code, ECAN_ERR_AXIS_STATE.code());
            assert_eq!(igh_cia402_arm_probe(context, 0, 1, 1), ECAN_ERR_AXIS_STATE.code());
            assert_eq!(igh_cia402_disarm_probe(context, 0, 1), ECAN_ERR_AXIS_STATE.code());
            assert_eq!(igh_cia402_get_drive_limits(context, 0, &mut limits), 0);
            assert_eq!(igh_cia402_get_drive_units(context, 0, &mut units), 0);
            assert_eq!(igh_cia402_send_targets_all(context), 0);
            assert_eq!(igh_mcan_port_cycle_end(port), 0);
            // The simulated world grows its queues to their working size first.
            counted += if cycle < 300 { 0 } else { allocations() - before };
        }
    }
    assert!(failures > 1_000, "{failures}");
    assert!(started >= 3, "{started}");
    assert_ne!(boot_state, igh_canopen_boot_state_t::IGH_CANOPEN_BOOT_DONE as u8);
    assert_eq!(counted, 0);
}
