//! Functions that only the simulated library has: they identify it, and share its clock.

use std::ffi::{c_char, c_int};
use std::panic::catch_unwind;
use std::ptr::null;

use ecrt_sys::{Clock, Errno, MonotonicClock};

use crate::world;

/// Returns the scenario of the process: the name of a built-in one, or the file that `ECAN_ECRT`
/// names; null with the error number set if its world cannot be opened. The text stays valid.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_sim_scenario() -> *const c_char {
    match catch_unwind(world::scenario).unwrap_or(Err(libc::EIO)) {
        Ok(text) => text.as_ptr(),
        Err(errno) => {
            Errno::new(errno).set_last();
            null()
        }
    }
}

/// Returns 1 if time passes only in `ecan_sim_sleep_until_ns` and in blocking calls, else 0.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_sim_clock_is_stepped() -> c_int {
    on_clock(|clock| (!clock.is_free_running()).into())
}

/// Returns the time of the simulated world, ns; without a world that of `CLOCK_MONOTONIC`.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_sim_now_ns() -> u64 {
    on_clock(|clock| clock.now_ns())
}

/// Sleeps until the world's clock shows `deadline_ns`, the last `spin_ns` polling.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_sim_sleep_until_ns(deadline_ns: u64, spin_ns: u64) {
    on_clock(|clock| clock.sleep_and_spin_until_ns(deadline_ns, spin_ns));
}

/// Begins the times of the scenario that count from the first time that all gateways are ready.
#[unsafe(no_mangle)]
pub extern "C" fn ecan_sim_gateways_ready() {
    on_clock(|clock| clock.gateways_ready());
}

/// Uses the clock of the world, otherwise that of the system; catches panics.
fn on_clock<R: Default>(action: impl FnOnce(&dyn Clock) -> R + std::panic::UnwindSafe) -> R {
    let answer = catch_unwind(|| match world::clock() {
        Ok(clock) => action(&clock),
        Err(_) => action(&MonotonicClock),
    });
    answer.unwrap_or_default()
}
