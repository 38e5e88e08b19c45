//! The functions as a C program calls them, on the simulated drives.

use std::ffi::{CStr, c_char, c_int, c_void};
use std::ptr::{from_mut, null, null_mut};

use ecan_c_boundary::frames::igh_mcan_rx_frame_t;
use ecan_c_boundary::result::ecan_result_t::*;
use ecan_mcan_host::common::ecan_last_abort_code;

use super::axis::*;
use super::commands::*;
use super::context::*;
use super::cycle::*;
use super::numbers::{igh_canopen_nmt_t, igh_cia402_drive_state_t, igh_cia402_mode_t};
use super::sdo::*;
use super::state::*;
use crate::adapter::config::*;
use crate::adapter::context::*;
use crate::mcan_port::config::*;
use crate::mcan_port::context::*;
use crate::mcan_port::cycle::*;
use crate::test_caller::{code, error, garbage, ok};

const AXES: usize = 2;

/// A bus in operation, in places that do not move.
struct Fixture {
    igh: Box<ecan_igh_context_t>,
    port: Box<igh_mcan_port_t>,
    motors: Box<igh_cia402_context_t>,
    axes: [igh_cia402_axis_t; AXES],
}

impl Fixture {
    /// With gateways and drives in operation, without axes on the Port.
    fn new() -> Self {
        let mut config: Box<ecan_igh_config_t> = garbage();
        let mut mcan: Box<igh_mcan_port_config_t> = garbage();
        let mut rig = Self { igh: garbage(), port: garbage(), motors: garbage(), axes: *garbage() };
        // SAFETY: every pointer is valid.
        unsafe {
            ok(ecan_igh_default_config(&mut *config));
            ok(ecan_igh_config_set_ecrt(&mut *config, c"sim:drives".as_ptr()));
            ok(ecan_igh_config_set_stepped_clock(&mut *config, 1));
            ok(ecan_igh_config_set_cycle_us(&mut *config, 2_000));
            ok(igh_mcan_port_default_config(&mut *mcan));
            ok(igh_mcan_port_set_classic_channel(&mut *mcan, 0, 0, 1_000_000));
            ok(igh_mcan_port_apply_config(&mut *config, &*mcan));
            ok(ecan_igh_init(&mut *rig.igh, &*config));
            ok(igh_mcan_port_init(&mut *rig.port, &mut *rig.igh, &*mcan));
            ok(ecan_igh_wait_op_timeout(&mut *rig.igh, 30_000));
            for (axis, node_id) in rig.axes.iter_mut().zip(1..) {
                ok(igh_cia402_axis_init(axis, 0, 0, node_id, 10));
            }
        }
        rig
    }

    fn with_axes() -> Self {
        let mut rig = Self::new();
        ok(rig.init());
        rig
    }

    fn init(&mut self) -> c_int {
        // SAFETY: every pointer is valid.
        unsafe {
            igh_cia402_context_init(&mut *self.motors, &mut *self.port, self.axes.as_ptr(), AXES)
        }
    }

    fn motors(&mut self) -> *mut igh_cia402_context_t {
        from_mut(&mut *self.motors)
    }

    fn start_up(&mut self) {
        let motors = self.motors();
        // SAFETY: the pointer is valid.
        unsafe {
            let reset = igh_canopen_nmt_t::IGH_CANOPEN_NMT_START;
            ok(igh_cia402_send_nmt_all(motors, reset as c_int));
            ok(igh_cia402_configure_csp_all_timeout(motors, 20_000));
            ok(igh_cia402_request_actual_position_all_timeout(motors, 5_000));
            ok(igh_cia402_enable_all(motors));
            ok(igh_cia402_enable_all_timeout(motors, 10_000));
        }
    }

    fn cycle(&mut self, work: impl FnOnce(*mut igh_cia402_context_t)) {
        // SAFETY: the pointers are valid.
        unsafe {
            ok(igh_mcan_port_wait_next_cycle(&mut *self.port));
            ok(igh_mcan_port_cycle_begin(&mut *self.port));
            work(self.motors());
            ok(igh_mcan_port_cycle_end(&mut *self.port));
        }
    }

    fn state(&mut self, axis: usize) -> igh_cia402_axis_state_t {
        let mut state: Box<igh_cia402_axis_state_t> = garbage();
        // SAFETY: the pointers are valid.
        ok(unsafe { igh_cia402_get_axis_state(self.motors(), axis, &mut *state) });
        *state
    }
}

impl Drop for Fixture {
    fn drop(&mut self) {
        // SAFETY: the pointer is valid.
        unsafe { ecan_igh_deinit(&mut *self.igh) };
    }
}

#[test]
fn calls_of_the_manual_move_the_axes() {
    let mut rig = Fixture::with_axes();
    rig.start_up();
    let before = rig.state(1);
    assert_eq!((before.is_running, before.is_configured, before.has_actual), (1, 1, 1));
    assert_eq!(before.mode, igh_cia402_mode_t::IGH_CIA402_MODE_CSP as i8);
    let enabled = igh_cia402_drive_state_t::IGH_CIA402_DRIVE_OPERATION_ENABLED;
    assert_eq!(before.drive_state, enabled as u8);
    let mut moved = 0;
    for _ in 0..100 {
        rig.cycle(|motors| {
            // SAFETY: the pointers are valid.
            unsafe {
                ok(igh_cia402_process_rx(motors));
                ok(igh_cia402_send_target_step(motors));
                let mut summary = igh_cia402_send_summary_t::default();
                ok(igh_cia402_get_send_summary(motors, &mut summary));
                moved += i32::from(summary.all_moved);
            }
        });
    }
    let after = rig.state(1);
    assert!(moved > 90, "{moved}");
    assert!(after.target - before.target >= 900, "{} {}", before.target, after.target);
    assert!(after.actual > before.actual + 800, "{} {}", before.actual, after.actual);
    assert_eq!(after.decision, igh_cia402_decision_t::IGH_CIA402_DECISION_TARGET as u8);
    let motors = rig.motors();
    let mut statistics: Box<igh_cia402_axis_statistics_t> = garbage();
    let mut loads: [igh_cia402_bus_load_t; 1] = *garbage();
    let mut count = 0;
    // SAFETY: the pointers are valid.
    unsafe {
        assert_eq!(igh_cia402_all_running(motors), 1);
        assert_eq!(igh_cia402_axis_count(motors), AXES);
        ok(igh_cia402_get_axis_statistics(motors, 1, &mut *statistics));
        assert!(statistics.targets_sent >= 90 && statistics.holds == 0);
        ok(igh_cia402_get_bus_load(motors, loads.as_mut_ptr(), 1, &mut count));
        assert_eq!((count, loads[0].axes), (1, 2));
        ok(igh_cia402_shutdown_timeout(motors, 10_000));
        assert_eq!(igh_cia402_shutdown_is_done(motors), 1);
        assert_eq!(igh_cia402_all_running(motors), 0);
    }
}

/// Returns whether a new context finds a drive enabled, and has to stop it.
fn is_stopped_by_next_owner(rig: &mut Fixture) -> bool {
    ok(rig.init());
    let mut has_stopped = false;
    for _ in 0..500 {
        rig.cycle(|motors| {
            // SAFETY: the pointer is valid.
            unsafe {
                ok(igh_cia402_process_rx(motors));
                ok(igh_cia402_send_targets_all(motors));
            }
        });
        let phases = [
            igh_cia402_phase_t::IGH_CIA402_PHASE_STOPPING,
            igh_cia402_phase_t::IGH_CIA402_PHASE_STOPPED,
        ];
        let phase = rig.state(0).phase;
        has_stopped |= phases.into_iter().any(|stop| stop as u8 == phase);
    }
    has_stopped
}

#[test]
fn deinit_stops_axes_that_move() {
    for stop_time_ms in [10_000, 0] {
        let mut rig = Fixture::with_axes();
        rig.start_up();
        for _ in 0..50 {
            rig.cycle(|motors| {
                // SAFETY: the pointer is valid.
                unsafe {
                    ok(igh_cia402_process_rx(motors));
                    ok(igh_cia402_send_target_step(motors));
                }
            });
        }
        // SAFETY: the pointer is valid.
        unsafe {
            ok(igh_cia402_set_stop_time_ms(rig.motors(), stop_time_ms));
            ok(igh_cia402_context_deinit(rig.motors()));
        }
        assert_eq!(is_stopped_by_next_owner(&mut rig), stop_time_ms == 0, "{stop_time_ms} ms");
    }
}

#[test]
fn repeated_calls_in_a_cycle_send_one_target() {
    let mut rig = Fixture::with_axes();
    rig.start_up();
    for _ in 0..50 {
        let before = rig.state(0).target;
        rig.cycle(|motors| {
            // SAFETY: the pointers are valid.
            unsafe {
                for target in [before + 1_000, before + 2_000] {
                    ok(igh_cia402_process_rx(motors));
                    ok(igh_cia402_set_target(motors, 0, target));
                    ok(igh_cia402_send_targets_all(motors));
                }
                ok(igh_cia402_send_target_step(motors));
                let mut summary = igh_cia402_send_summary_t::default();
                ok(igh_cia402_get_send_summary(motors, &mut summary));
                assert_eq!((summary.targets, summary.closed as usize), (0, AXES));
            }
        });
        assert!(rig.state(0).target - before <= 1_000);
        // The later target is too far from the first one.
        rig.cycle(|motors| {
            // SAFETY: the pointers are valid.
            unsafe {
                ok(igh_cia402_process_rx(motors));
                ok(igh_cia402_set_target(motors, 0, before));
                ok(igh_cia402_send_targets_all(motors));
            }
        });
    }
    assert_eq!(rig.state(0).is_running, 1);
}

#[test]
fn target_beyond_the_limit_is_rejected_with_its_reason() {
    let mut rig = Fixture::with_axes();
    rig.start_up();
    let far = rig.state(0).target + 1_001;
    rig.cycle(|motors| {
        // SAFETY: the pointer is valid.
        unsafe {
            ok(igh_cia402_process_rx(motors));
            ok(igh_cia402_set_target(motors, 0, far));
            ok(igh_cia402_send_targets_all(motors));
        }
    });
    let state = rig.state(0);
    assert_eq!(state.decision, igh_cia402_decision_t::IGH_CIA402_DECISION_REJECTED as u8);
    assert_eq!(state.decision_reason, igh_cia402_rejection_t::IGH_CIA402_REJECTION_STEP as u8);
    // SAFETY: the pointer is valid.
    unsafe {
        let no_angle = igh_cia402_set_target_radians(rig.motors(), 0, f64::NAN);
        assert_eq!(no_angle, code(ECAN_ERR_ARGUMENT));
        ok(igh_cia402_set_target_radians(rig.motors(), 0, 1.0));
        ok(igh_cia402_set_target_step(rig.motors(), 0, 5));
        let none = igh_cia402_set_target(rig.motors(), AXES, 0);
        assert_eq!(none, code(ECAN_ERR_AXIS), "{}", error());
    }
}

/// Reports to the callback of the next test.
struct Seen {
    motors: *mut igh_cia402_context_t,
    texts: Vec<String>,
    inner: c_int,
}

unsafe extern "C-unwind" fn note(user: *mut c_void, axis: usize, text: *const c_char) {
    // SAFETY: the test gave this pointer, and the text is valid until the return.
    unsafe {
        let seen = &mut *user.cast::<Seen>();
        assert!(axis < AXES);
        seen.texts.push(CStr::from_ptr(text).to_str().unwrap().to_owned());
        seen.inner = igh_cia402_set_target(seen.motors, axis, 0);
    }
}

#[test]
fn progress_is_reported_once_per_change() {
    let mut rig = Fixture::with_axes();
    let mut seen = Box::new(Seen { motors: rig.motors(), texts: Vec::new(), inner: 0 });
    // SAFETY: the pointers are valid as long as the rig.
    ok(unsafe {
        igh_cia402_set_progress_callback(rig.motors(), Some(note), from_mut(&mut *seen).cast())
    });
    rig.start_up();
    let count = seen.texts.len();
    assert!(seen.texts.iter().any(|text| text.contains("axis 1, node 2 (slave 0, channel 0)")));
    assert!(seen.texts.iter().any(|text| text.contains("being enabled")), "{:?}", seen.texts);
    assert!((10..500).contains(&count), "{count}");
    assert_eq!(seen.inner, code(ECAN_ERR_BUSY));
    // SAFETY: the pointers are valid.
    unsafe {
        ok(igh_cia402_set_progress_callback(rig.motors(), None, null_mut()));
        ok(igh_cia402_finish_all_timeout(rig.motors(), 100));
        let mut text = [1; 8];
        let cut = igh_cia402_get_axis_text(rig.motors(), 0, text.as_mut_ptr(), 8, null_mut());
        assert_eq!(cut, code(ECAN_ERR_BUFFER));
        assert_eq!(CStr::from_ptr(text.as_ptr()), c"axis 0,");
    }
    assert_eq!(seen.texts.len(), count);
}

#[test]
fn objects_are_transferred_while_axes_run() {
    let mut rig = Fixture::with_axes();
    rig.start_up();
    let motors = rig.motors();
    let mut data = [0_u8; 8];
    let (buffer, mut length) = (data.as_mut_ptr().cast::<c_void>(), 0);
    // SAFETY: the pointers are valid.
    unsafe {
        ok(igh_cia402_sdo_upload(motors, 0, 0x1000, 0, buffer, 8, &mut length, 1_000));
        assert_eq!((length, u16::from_le_bytes([data[0], data[1]])), (4, 402));
        let short = igh_cia402_sdo_upload(motors, 0, 0x1000, 0, buffer, 2, &mut length, 1_000);
        assert_eq!((short, length), (code(ECAN_ERR_BUFFER), 4));
        let time = 123_u16.to_le_bytes();
        ok(igh_cia402_sdo_download(motors, 0, 0x1017, 0, time.as_ptr().cast(), 2, 1_000));
        ok(igh_cia402_sdo_upload(motors, 0, 0x1017, 0, buffer, 8, &mut length, 1_000));
        assert_eq!((length, &data[..2]), (2, &time[..]));
        let none = igh_cia402_sdo_upload(motors, 0, 0x5FFF, 0, buffer, 8, &mut length, 1_000);
        assert_eq!((none, ecan_last_abort_code()), (code(ECAN_ERR_SDO), 0x0602_0000));
        let wrong = igh_cia402_sdo_upload(motors, 9, 0x1000, 0, buffer, 8, &mut length, 1_000);
        assert_eq!(wrong, code(ECAN_ERR_AXIS));
        assert_eq!(igh_cia402_all_running(motors), 1, "the axes went on meanwhile");
        ok(igh_cia402_sdo_start_upload(motors, 1, 0x6061, 0));
    }
    let (mut state, running) = (0, igh_cia402_sdo_state_t::IGH_CIA402_SDO_RUNNING as u8);
    for _ in 0..50 {
        rig.cycle(|motors| {
            // SAFETY: the pointers are valid.
            unsafe {
                ok(igh_cia402_process_rx(motors));
                ok(igh_cia402_sdo_poll(motors, 1, &mut state, buffer, 8, &mut length));
                ok(igh_cia402_send_targets_all(motors));
            }
        });
        if state != running {
            break;
        }
    }
    assert_eq!(state, igh_cia402_sdo_state_t::IGH_CIA402_SDO_DONE as u8);
    assert_eq!((length, data[0]), (1, 8));
}

#[test]
fn node_is_reached_without_and_with_axes() {
    let mut rig = Fixture::new();
    let port: *mut igh_mcan_port_t = &mut *rig.port;
    let mut data = [0_u8; 8];
    let (buffer, mut length) = (data.as_mut_ptr().cast::<c_void>(), 0);
    // SAFETY: the pointers are valid.
    unsafe {
        let mut upload = |slave, channel, node| {
            let object = (0x1000, 0);
            igh_canopen_sdo_upload(
                port,
                slave,
                channel,
                node,
                object.0,
                object.1,
                buffer,
                8,
                &mut length,
                2_000,
            )
        };
        ok(upload(0, 0, 3));
        assert_eq!(upload(0, 0, 0), code(ECAN_ERR_ARGUMENT));
        assert_eq!(upload(1, 0, 3), code(ECAN_ERR_SLAVE));
        assert_eq!(upload(0, 4, 3), code(ECAN_ERR_CHANNEL));
        assert_eq!(upload(0, 0, 99), code(ECAN_ERR_TIMEOUT), "{}", error());
        let time = 50_u16.to_le_bytes();
        ok(igh_canopen_sdo_download(port, 0, 0, 3, 0x1017, 0, time.as_ptr().cast(), 2, 2_000));
        ok(rig.init());
        let with_axes =
            igh_canopen_sdo_upload(port, 0, 0, 3, 0x1000, 0, buffer, 8, &mut length, 2_000);
        assert_eq!(with_axes, code(ECAN_ERR_NODE), "{}", error());
        ok(igh_canopen_sdo_upload(port, 0, 0, 2, 0x1000, 0, buffer, 8, &mut length, 2_000));
    }
    assert_eq!(u16::from_le_bytes([data[0], data[1]]), 402);
}

#[test]
fn frames_of_other_nodes_are_returned() {
    let mut rig = Fixture::new();
    let port: *mut igh_mcan_port_t = &mut *rig.port;
    let time = 10_u16.to_le_bytes();
    // SAFETY: the pointers are valid.
    unsafe {
        ok(igh_canopen_sdo_download(port, 0, 0, 3, 0x1017, 0, time.as_ptr().cast(), 2, 2_000));
    }
    ok(rig.init());
    let mut heartbeats = 0;
    let mut lost = false;
    for round in 0..200 {
        rig.cycle(|motors| {
            let mut frames: [igh_mcan_rx_frame_t; 4] = *garbage();
            let capacity = if round < 100 { 4 } else { 0 };
            let mut count = 9;
            // SAFETY: the pointers are valid.
            unsafe {
                let result =
                    igh_cia402_process_rx_ex(motors, frames.as_mut_ptr(), capacity, &mut count);
                lost |= result == code(ECAN_ERR_BUFFER);
                ok(igh_cia402_send_targets_all(motors));
            }
            let is_heartbeat = |frame: &&igh_mcan_rx_frame_t| frame.can_id == 0x703;
            heartbeats += frames[..count].iter().filter(is_heartbeat).count();
        });
    }
    assert!(heartbeats >= 10, "{heartbeats}");
    assert!(lost, "missing capacity was not reported");
}

#[test]
fn context_lives_from_init_to_deinit() {
    let mut rig = Fixture::new();
    let motors = rig.motors();
    // SAFETY: the pointers are valid, or NULL if that is rejected.
    unsafe {
        assert_eq!(igh_cia402_process_rx(motors), code(ECAN_ERR_NOT_INITIALISED));
        assert_eq!(igh_cia402_axis_count(motors), 0);
        ok(igh_cia402_context_deinit(motors));
        let port: *mut igh_mcan_port_t = &mut *rig.port;
        let table = igh_cia402_context_init(motors, port, null(), 1);
        assert_eq!(table, code(ECAN_ERR_NULL));
        let unfilled: [igh_cia402_axis_t; 1] = *garbage();
        let table = igh_cia402_context_init(motors, port, unfilled.as_ptr(), 1);
        assert_eq!(table, code(ECAN_ERR_NOT_INITIALISED));
        rig.axes[1].step_limit = 0;
        rig.axes[0].tpdo_timeout = 0;
        assert_eq!(rig.init(), code(ECAN_ERR_CONFIG));
        assert!(error().contains("axis 0: ") && error().contains("axis 1: "), "{}", error());
        rig.axes[1].step_limit = 1_000;
        rig.axes[0].tpdo_timeout = 5;
        rig.axes[0].max_velocity_rad_s = -1.0;
        rig.axes[1].max_jerk_rad_s3 = 1e-9;
        assert_eq!(rig.init(), code(ECAN_ERR_CONFIG));
        assert!(error().contains("velocity limit -1 rad/s"), "{}", error());
        rig.axes[0].max_velocity_rad_s = 100.0;
        assert_eq!(rig.init(), code(ECAN_ERR_CONFIG));
        assert!(error().contains("jerk limit 0.000000001 rad/s^3"), "{}", error());
        rig.axes[0].max_velocity_rad_s = 0.0;
        rig.axes[1].max_jerk_rad_s3 = 0.0;
        rig.axes[1].channel = 1;
        assert_eq!(rig.init(), code(ECAN_ERR_CHANNEL));
        rig.axes[1].channel = 0;
        ok(rig.init());
        assert_eq!(rig.init(), code(ECAN_ERR_ORDER));
        let mut other: Box<igh_cia402_context_t> = garbage();
        let second = igh_cia402_context_init(&mut *other, port, rig.axes.as_ptr(), AXES);
        assert_eq!(second, code(ECAN_ERR_ORDER));
        ok(igh_cia402_context_deinit(motors));
        ok(igh_cia402_context_deinit(motors));
        assert_eq!(igh_cia402_enable_all(motors), code(ECAN_ERR_NOT_INITIALISED));
        let mut settings: Box<igh_cia402_settings_t> = garbage();
        ok(igh_cia402_default_settings(&mut *settings));
        let axes = rig.axes.as_ptr();
        ok(igh_cia402_context_init_ex(motors, port, axes, AXES, &*settings));
        ok(igh_mcan_port_deinit(port));
        assert_eq!(igh_cia402_process_rx(motors), code(ECAN_ERR_NOT_INITIALISED));
    }
}

#[test]
fn commands_check_their_arguments_and_their_time() {
    let mut rig = Fixture::with_axes();
    let motors = rig.motors();
    let mut homing: Box<igh_cia402_homing_t> = garbage();
    // SAFETY: the pointers are valid, or NULL if that is rejected.
    unsafe {
        assert_eq!(igh_cia402_send_nmt_all(motors, 3), code(ECAN_ERR_ARGUMENT));
        assert_eq!(igh_cia402_send_nmt(motors, AXES, 1), code(ECAN_ERR_AXIS));
        ok(igh_cia402_send_nmt(motors, 0, 1));
        assert_eq!(igh_cia402_enable(motors, 0), code(ECAN_ERR_AXIS_STATE));
        assert_eq!(igh_cia402_change_mode(motors, 0, 5), code(ECAN_ERR_ARGUMENT));
        assert_eq!(igh_cia402_home(motors, 0, null()), code(ECAN_ERR_NULL));
        let at = igh_cia402_set_scheduled_tx(motors, 1, 100_000, 200_000);
        assert_eq!(at, code(ECAN_ERR_SCHEDULE), "without Sync0");
        ok(igh_cia402_set_scheduled_tx(motors, 0, 100_000, 200_000));
        ok(igh_cia402_set_motion_div(motors, 2));
        rig.start_up();
        ok(igh_cia402_homing_init(&mut *homing, 35));
        ok(igh_cia402_home(motors, 0, &*homing));
        assert_eq!(igh_cia402_home(motors, 0, &*homing), code(ECAN_ERR_AXIS_STATE));
        ok(igh_cia402_finish_all_timeout(motors, 20_000));
        assert_eq!(rig.state(0).is_running, 1);
        ok(igh_cia402_halt(motors, 0));
        ok(igh_cia402_resume(motors, 0));
        ok(igh_cia402_quick_stop(motors, IGH_CIA402_ALL_AXES));
        ok(igh_cia402_disable(motors, IGH_CIA402_ALL_AXES));
        assert_eq!(rig.state(0).is_running, 0);
        ok(igh_cia402_begin_shutdown(motors));
        assert_eq!(igh_cia402_shutdown_is_done(motors), 0);
    }
}
