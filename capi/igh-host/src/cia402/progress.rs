//! Progress of the calls that wait

use std::ffi::{CString, c_char, c_void};

use ecan_c_export::export;
use ecan_cia402::{AxisError, AxisPhase, AxisProgress};

use super::context::igh_cia402_context_t;
use crate::callback::ProgressCallback;

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
