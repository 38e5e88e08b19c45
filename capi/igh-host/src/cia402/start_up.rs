//! Start-up and shutdown that wait
//!
//! These calls run the cycle themselves, with all axes at their last targets, until every axis is
//! where it is to be or cannot get there: so not on a master of another owner, and not in a loop
//! that has other work. There the calls of the next section begin the same, and
//! igh_cia402_get_axis_state() tells how far it is.

use std::ffi::c_int;

use ecan_cia402::{AxisProgress, Cia402, Cia402Error};
use ecan_mcan_port::Port;

use super::context::igh_cia402_context_t;
use super::progress::Reporter;
use crate::entry::{Entry, enter};
use crate::errors::OrCode as _;
use crate::milliseconds::duration;

/// Waits with the cycle running, and reports progress.
fn wait(
    entry: Entry<igh_cia402_context_t>,
    work: impl FnOnce(&mut Cia402, &mut Port, &mut dyn FnMut(&AxisProgress)) -> Result<(), Cia402Error>,
) -> c_int {
    entry.on_bus(|call, bus| {
        bus.need_owned(call)?;
        let mut reporter = Reporter::new(bus.axes_mut().and_then(|axes| axes.progress));
        let (cia402, port) = bus.need_axes(call)?;
        work(cia402, port, &mut |progress| reporter.see(progress)).or_code(call)
    })
}

/// Configures every drive in the mode of its axis, which is CSP where the axis table does not say
/// otherwise, and waits: NMT, identity, heartbeats, PDO mapping, limits, Operational, mode with
/// confirmation. Drives that are configured already are left alone. An enabled drive is switched
/// off first.
///
/// @param timeout_ms  Milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  ECAN_OK; ECAN_ERR_AXES, where ecan_last_error() names each axis that is not configured,
///          the step at which it stands and what its drive answered; ECAN_ERR_ATTACHED on a master
///          of another owner; ECAN_ERR_ORDER where the bus is not active; ECAN_ERR_AXIS_STATE,
///          ECAN_ERR_MASTER, ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_BUSY.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_configure_csp_all_timeout(
    context: *mut igh_cia402_context_t,
    timeout_ms: u32,
) -> c_int {
    wait(enter!(igh_cia402_configure_csp_all_timeout, context), |cia402, port, progress| {
        cia402.configure_all_timeout(port, duration(timeout_ms), progress)
    })
}

/// Establishes where all axes are, from fresh TPDOs that show them at rest, and waits. An axis that
/// is not configured is refused.
///
/// @param timeout_ms  Milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes whose position
///          is not known, and what hinders it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_request_actual_position_all_timeout(
    context: *mut igh_cia402_context_t,
    timeout_ms: u32,
) -> c_int {
    wait(
        enter!(igh_cia402_request_actual_position_all_timeout, context),
        |cia402, port, progress| {
            cia402.request_actual_position_all_timeout(port, duration(timeout_ms), progress)
        },
    )
}

/// Enables all drives and waits until every axis follows targets. The first target of each is the
/// actual position just read.
///
/// @param timeout_ms  Milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes that are not
///          enabled, with the state of each drive and what hinders it. Those that are enabled stay
///          so.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_enable_all_timeout(
    context: *mut igh_cia402_context_t,
    timeout_ms: u32,
) -> c_int {
    wait(enter!(igh_cia402_enable_all_timeout, context), |cia402, port, progress| {
        cia402.enable_all_timeout(port, duration(timeout_ms), progress)
    })
}

/// The three calls above in a row: from drives in whatever state to axes that follow targets.
///
/// @param timeout_ms  Milliseconds, for each of the three.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  As those calls.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_start_up_timeout(
    context: *mut igh_cia402_context_t,
    timeout_ms: u32,
) -> c_int {
    wait(enter!(igh_cia402_start_up_timeout, context), |cia402, port, progress| {
        cia402.start_up_timeout(port, duration(timeout_ms), progress)
    })
}

/// Waits until the changes of mode and the homings of all axes are done.
///
/// @param timeout_ms  Milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes whose last
///          command failed, and why.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_finish_all_timeout(
    context: *mut igh_cia402_context_t,
    timeout_ms: u32,
) -> c_int {
    wait(enter!(igh_cia402_finish_all_timeout, context), |cia402, port, progress| {
        cia402.finish_all_timeout(port, duration(timeout_ms), progress)
    })
}

/// Ends in order, as igh_cia402_begin_shutdown(), and waits.
///
/// @param timeout_ms  Milliseconds.
///
/// @usage   not rt, the cycle's thread, active bus
/// @return  As igh_cia402_configure_csp_all_timeout(); ECAN_ERR_AXES names the axes that could not
///          be switched off. The end is complete all the same, as far as it goes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn igh_cia402_shutdown_timeout(
    context: *mut igh_cia402_context_t,
    timeout_ms: u32,
) -> c_int {
    wait(enter!(igh_cia402_shutdown_timeout, context), |cia402, port, progress| {
        cia402.shutdown_timeout(port, duration(timeout_ms), progress)
    })
}
