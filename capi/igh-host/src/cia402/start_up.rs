//! Calls that wait for startup and shutdown of all axes, and the reports of their progress.

use std::ffi::{CString, c_char, c_void};

use ecan_c_boundary::Call;
use ecan_c_boundary::result::ecan_result_t;
use ecan_c_export::export;
use ecan_cia402::{AxisError, AxisPhase, AxisProgress, Blocking, Cia402Error};

use super::context::igh_cia402_context_t;
use crate::bus::Bus;
use crate::callback::{ProgressCallback, duration};
use crate::errors::OrCode as _;
use crate::handle::Entered;

// Section: Startup and shutdown that wait
//
// These calls run the cycle, with all axes at their last targets, until every axis has reached the
// requested state or cannot reach it: not on a master of another owner, and not in a loop with
// other work. There use the calls of the next section and igh_cia402_get_axis_state().

/// Waits with the cycle running, and reports progress.
fn wait(
    call: Call,
    bus: &mut Entered<Bus>,
    timeout_ms: u32,
    work: impl FnOnce(&mut Blocking<'_>) -> Result<(), Cia402Error>,
) -> Result<(), ecan_result_t> {
    bus.run_to_end(call)?;
    let mut reporter = Reporter::new(bus.axes_mut().and_then(|axes| axes.progress));
    let (cia402, port) = bus.need_axes(call)?;
    let waiting = cia402.blocking(port, duration(timeout_ms));
    work(&mut waiting.on_progress(|progress| reporter.see(progress))).or_code(call)
}

/// Configures every drive in the mode of its axis, CSP by default, and waits: NMT, identity,
/// heartbeats, PDO mapping, limits, Operational, mode with confirmation. Drives that are configured
/// already stay unchanged. An enabled drive is disabled first.
///
/// @param timeout_ms  Milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  ECAN_OK; ECAN_ERR_AXES, where ecan_last_error() names each axis that is not
///          configured, the step at which it stands and what its drive answered; ECAN_ERR_ATTACHED
///          on a master of another owner; ECAN_ERR_ORDER if the bus is not active;
///          ECAN_ERR_AXIS_STATE, ECAN_ERR_MASTER.
#[export(call, bus bus)]
pub fn igh_cia402_configure_csp_all_timeout(context: *mut igh_cia402_context_t, timeout_ms: u32) {
    wait(call, bus, timeout_ms, |waiting| waiting.configure())
}

/// Determines the actual position of all axes from fresh TPDOs at rest, and waits. Rejects an axis
/// that is not configured.
///
/// @param timeout_ms  Milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes whose position
///          is unknown, and the reason.
#[export(call, bus bus)]
pub fn igh_cia402_request_actual_position_all_timeout(
    context: *mut igh_cia402_context_t,
    timeout_ms: u32,
) {
    wait(call, bus, timeout_ms, |waiting| waiting.read_positions())
}

/// Enables all drives and waits until every axis follows targets. The first target of each is the
/// actual position just read.
///
/// @param timeout_ms  Milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes that are not
///          enabled, with the state of each drive and the reason. Enabled axes stay enabled.
#[export(call, bus bus)]
pub fn igh_cia402_enable_all_timeout(context: *mut igh_cia402_context_t, timeout_ms: u32) {
    wait(call, bus, timeout_ms, |waiting| waiting.enable())
}

/// Runs the three calls above: from drives in any state to axes that follow targets.
///
/// @param timeout_ms  Milliseconds, for each of the three.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  As those calls.
#[must_use]
#[export(call, bus bus)]
pub fn igh_cia402_start_up_timeout(context: *mut igh_cia402_context_t, timeout_ms: u32) {
    wait(call, bus, timeout_ms, |waiting| waiting.start_up())
}

/// Waits until the changes of mode and the homings of all axes are done.
///
/// @param timeout_ms  Milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes whose last
///          command failed, and the reason.
#[must_use]
#[export(call, bus bus)]
pub fn igh_cia402_finish_all_timeout(context: *mut igh_cia402_context_t, timeout_ms: u32) {
    wait(call, bus, timeout_ms, |waiting| waiting.finish())
}

/// Brings all axes back to their targets, as igh_cia402_recover() with IGH_CIA402_ALL_AXES, and waits.
///
/// @param timeout_ms  Milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes that do not
///          follow targets, and the reason.
#[must_use]
#[export(call, bus bus)]
pub fn igh_cia402_recover_all_timeout(context: *mut igh_cia402_context_t, timeout_ms: u32) {
    wait(call, bus, timeout_ms, |waiting| waiting.recover())
}

/// Stops all axes, as igh_cia402_stop_all(), and waits until every one has reported that it has stopped, also
/// while the gateway or the path is away.
///
/// @param timeout_ms  Milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes that did not
///          report that they have stopped, and may still move. Their stop continues in later cycles.
#[must_use]
#[export(call, bus bus)]
pub fn igh_cia402_stop_all_timeout(context: *mut igh_cia402_context_t, timeout_ms: u32) {
    wait(call, bus, timeout_ms, |waiting| waiting.stop())
}

/// Shuts down in order, as igh_cia402_begin_shutdown(), and waits until every axis has reported that it is off.
/// While the gateway or the path is away, the whole time is used: at most half of it, and five seconds, for
/// the ramps.
///
/// @param timeout_ms  Milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes that could not
///          be disabled, and may still move. The shutdown of the other axes is complete.
#[must_use]
#[export(call, bus bus)]
pub fn igh_cia402_shutdown_timeout(context: *mut igh_cia402_context_t, timeout_ms: u32) {
    wait(call, bus, timeout_ms, |waiting| waiting.shut_down())
}

// Section: Progress of the calls that wait

/// Calls the application when the progress of an axis changes.
pub(crate) struct Reporter {
    callback: Option<ProgressCallback>,
    /// By axis.
    reported: Vec<Option<ReportedProgress>>,
}

/// Part of an axis' progress whose change is reported; not the time, and not the single steps of
/// its configuration.
#[derive(Clone, Copy, PartialEq)]
struct ReportedProgress {
    phase: AxisPhase,
    error: Option<AxisError>,
}

impl Reporter {
    pub(crate) fn new(callback: Option<ProgressCallback>) -> Self {
        Self { callback, reported: Vec::new() }
    }

    pub(crate) fn see(&mut self, progress: &AxisProgress) {
        let Some(callback) = self.callback else { return };
        let now = ReportedProgress { phase: progress.phase, error: progress.error };
        if self.reported.len() <= progress.axis {
            self.reported.resize(progress.axis + 1, None);
        }
        if self.reported[progress.axis].replace(now) == Some(now) {
            return;
        }
        let text = CString::new(progress.to_string()).unwrap_or_default();
        callback.report(progress.axis, &text);
    }
}

/// Sets a function to which the waiting calls report the progress of the axes: at their start, and
/// on every change. It runs inside these calls, between two cycles, so it should be quick; a call
/// to the library with this context returns ECAN_ERR_BUSY there.
///
/// @param callback  Gets `user`, the axis, and a text, "axis 0, node 1 (slave 0, channel 0): being
///                  enabled, switched on, for 120 ms" for example, which is valid until it returns;
///                  NULL for none. It must return, as that of ecan_igh_stop_waiting_when().
/// @param user      Is passed to it, in the thread that waits.
///
/// @usage   not rt, the cycle's thread, after init
#[export(_, bus bus)]
pub fn igh_cia402_set_progress_callback(
    context: *mut igh_cia402_context_t,
    callback: Option<
        unsafe extern "C-unwind" fn(user: *mut c_void, axis: usize, text: *const c_char),
    >,
    user: *mut c_void,
) {
    if let Some(axes) = bus.axes_mut() {
        axes.progress = callback.map(|function| ProgressCallback {
            function,
            user,
            setter: "igh_cia402_set_progress_callback()",
        });
    }
}
