//! Life of an observer
//!
//! A handle for other threads than the cycle's: it reads a snapshot of the last cycle, and gives
//! commands that the next cycle executes. The cycle never waits for it. Only ecan_igh_observer_init()
//! uses the context: from another thread it returns ECAN_ERR_BUSY while a cycle runs. All other
//! functions work also then.
//!
//! ```c
//! static ecan_igh_observer_t observer;             for the monitor and the signal handler
//! ecan_igh_observer_init(&observer, &igh);         in the thread of the cycle
//! ...
//! if (ecan_igh_observer_update(&observer) == 0) {  in the monitor's thread
//!     igh_cia402_observer_get_axis_state(&observer, 0, &state);
//! }
//! ...
//! ecan_igh_observer_request_stop(&observer, NULL); in a signal handler
//! ```

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, pointers};
use ecan_c_export::export;

use super::slot;
use crate::adapter::context::ecan_igh_context_t;
use crate::handle::Words;

/// A handle of other threads to the cycle. Any number of them per ecan_igh_context_t, one for each
/// thread that reads. Do not move or copy it.
#[repr(C)]
#[derive(Debug)]
pub struct ecan_igh_observer_t {
    /// Not for the application.
    pub opaque: [u64; 4],
}

const _: () = assert!(size_of::<ecan_igh_observer_t>() == size_of::<Words>());

/// Creates an observer. It outlives its context: ecan_igh_observer_update() reports the end. While a
/// context has observers its cycle publishes a snapshot at its end.
///
/// @param observer  Any content.
/// @param igh       The context, with or without Port and axes, which may be opened later.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_ORDER for an observer that is initialised already.
#[export(call, layer adapter, of igh)]
pub fn ecan_igh_observer_init(observer: *mut ecan_igh_observer_t, igh: *mut ecan_igh_context_t) {
    pointers!(call, out(observer));
    // SAFETY: `out` was promised that the pointer is valid for writing.
    unsafe { slot::init(call, observer.as_ptr().cast(), adapter.observer()) }
}

/// Ends an observer, after calls of other threads with it that are in progress. Later calls return
/// ECAN_ERR_NOT_INITIALISED. Calling it again is harmless.
///
/// @usage   not rt, any thread but no signal handler, any time
#[export(call)]
pub fn ecan_igh_observer_deinit(observer: *mut ecan_igh_observer_t) {
    need(call, observer)?;
    // SAFETY: the pointer is not NULL, so valid for reading by the header's rules.
    unsafe { slot::deinit(observer.cast()) };
}

fn need(call: Call, observer: *const ecan_igh_observer_t) -> Result<(), ecan_result_t> {
    // SAFETY: the header demands NULL or a valid pointer.
    unsafe { call.read("observer", observer) }.map(|_| ())
}
