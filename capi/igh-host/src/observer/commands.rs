//! Commands
//!
//! Any thread and any signal handler may give them, also while another thread reads through the same
//! observer: they use atomic operations only, and store no error text. A request to stop takes effect at
//! once. The cycle gives quick stops to the axes when it next sends targets: before the targets of this
//! cycle, or of the next one. The quick stop is then in the image of that cycle if the gateway is ready
//! and the image has room for its frame, and on the bus if the working counter of the image is complete:
//! an image that was not confirmed is repeated first.
//!
//! Each command gives a ticket, which is not 0; ecan_igh_observer_has_executed() returns 1 for it once a
//! cycle has given the command to the axis. Its effect is in the state of the axis: stop_cause and
//! phase.

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_export::export;
use ecan_host::{CommandTicket, Observer};

use super::handle::ecan_igh_observer_t;
use super::slot;
use crate::cia402::commands::IGH_CIA402_ALL_AXES;

/// Gives a command. Stores no error text, which may be in use by what a signal handler interrupts.
fn command(
    observer: *const ecan_igh_observer_t,
    ticket: *mut u64,
    give: impl FnOnce(&Observer) -> Result<CommandTicket, ecan_result_t>,
) -> Result<(), ecan_result_t> {
    let given = give_command(observer, give);
    if !ticket.is_null() {
        let number = given.as_ref().map_or(0, |given| given.number());
        // SAFETY: not NULL, so valid for writing by the header's rules.
        unsafe { ticket.write(number) };
    }
    given.map(|_| ())
}

fn give_command(
    observer: *const ecan_igh_observer_t,
    give: impl FnOnce(&Observer) -> Result<CommandTicket, ecan_result_t>,
) -> Result<CommandTicket, ecan_result_t> {
    if observer.is_null() {
        return Err(ecan_result_t::ECAN_ERR_NULL);
    }
    // SAFETY: not NULL, so valid for reading by the header's rules.
    let entered = unsafe { slot::enter(observer.cast()) };
    let entered = entered.ok_or(ecan_result_t::ECAN_ERR_NOT_INITIALISED)?;
    let observer = entered.observer().ok_or(ecan_result_t::ECAN_ERR_NOT_INITIALISED)?;
    if observer.is_closed() {
        return Err(ecan_result_t::ECAN_ERR_ORDER);
    }
    give(observer)
}

/// Requests the application to stop: calls that wait end with ECAN_ERR_STOPPED, except
/// igh_cia402_shutdown_timeout() and igh_cia402_stop_all_timeout(), and ecan_igh_is_stop_requested()
/// returns 1 until ecan_igh_clear_stop_request().
///
/// @param ticket  Gets the number of the command, 0 if it is rejected; may be NULL.
///
/// @usage   rt, any thread and signal handlers, after init
/// @return  ECAN_OK; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_ORDER if the context has
///          ended; without a text in ecan_last_error().
#[export(_)]
pub fn ecan_igh_observer_request_stop(observer: *mut ecan_igh_observer_t, ticket: *mut u64) {
    command(observer, ticket, |observer| Ok(observer.request_stop()))
}

/// Commands a quick stop, as igh_cia402_quick_stop() does: to one axis, or with IGH_CIA402_ALL_AXES
/// to all of all axis tables.
///
/// @param axis    Index in the axis table that was opened last, of those that are open.
/// @param ticket  Gets the number of the command, 0 if it is rejected; may be NULL.
///
/// @usage   rt, any thread and signal handlers, after init
/// @return  ECAN_OK; ECAN_ERR_NULL, ECAN_ERR_NOT_INITIALISED, ECAN_ERR_ORDER if the context has
///          ended, ECAN_ERR_AXIS; without a text in ecan_last_error().
#[export(_)]
pub fn igh_cia402_observer_quick_stop(
    observer: *mut ecan_igh_observer_t,
    axis: usize,
    ticket: *mut u64,
) {
    command(observer, ticket, |observer| match axis {
        IGH_CIA402_ALL_AXES if observer.axis_count() == 0 => Err(ecan_result_t::ECAN_ERR_AXIS),
        IGH_CIA402_ALL_AXES => Ok(observer.quick_stop_all()),
        axis => observer.quick_stop(axis).map_err(|_| ecan_result_t::ECAN_ERR_AXIS),
    })
}
