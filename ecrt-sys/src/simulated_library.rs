//! The functions that the simulated libethercat has in addition to those of the real one.
//!
//! They identify it, and share its clock: in stepped time only sleeping on that clock lets time pass.

use std::ffi::{CStr, c_char, c_int};

use crate::clock::Clock;
use crate::symbol_source::SymbolSource;

const SYMBOL_SCENARIO: &str = "ecan_sim_scenario";

/// The additional functions of a loaded library. Valid while it is loaded.
#[derive(Clone, Copy)]
pub(crate) struct SimulatedLibrary {
    scenario: unsafe extern "C" fn() -> *const c_char,
    now_ns: unsafe extern "C" fn() -> u64,
    sleep_until_ns: unsafe extern "C" fn(deadline_ns: u64, spin_ns: u64),
    clock_is_stepped: unsafe extern "C" fn() -> c_int,
    gateways_ready: unsafe extern "C" fn(),
}

impl SimulatedLibrary {
    /// `None` for a library that is not simulated.
    pub(crate) fn look_up(source: &mut SymbolSource<'_>) -> Option<Self> {
        let scenario = source.find(SYMBOL_SCENARIO)?;
        let now_ns = source.required("ecan_sim_now_ns");
        let sleep_until_ns = source.required("ecan_sim_sleep_until_ns");
        let clock_is_stepped = source.required("ecan_sim_clock_is_stepped");
        let gateways_ready = source.required("ecan_sim_gateways_ready");
        Some(Self {
            scenario,
            now_ns: now_ns?,
            sleep_until_ns: sleep_until_ns?,
            clock_is_stepped: clock_is_stepped?,
            gateways_ready: gateways_ready?,
        })
    }

    /// Scenario of its world, which this call opens; `None` if that fails. The library has then
    /// written the reason to stderr.
    pub(crate) fn scenario(&self) -> Option<String> {
        // SAFETY: the library is loaded, and its function takes nothing.
        let text = unsafe { (self.scenario)() };
        if text.is_null() {
            return None;
        }
        // SAFETY: not null, so a text that lives as long as the library.
        Some(unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned())
    }
}

/// The clock of a simulated library.
pub(crate) struct SimulatedClock<L> {
    pub(crate) functions: SimulatedLibrary,
    /// Keeps the library loaded.
    pub(crate) _library: L,
}

impl<L: Send + Sync> Clock for SimulatedClock<L> {
    fn now_ns(&self) -> u64 {
        // SAFETY: the library is loaded, and its function takes nothing.
        unsafe { (self.functions.now_ns)() }
    }

    fn sleep_until_ns(&self, deadline_ns: u64) {
        self.sleep_and_spin_until_ns(deadline_ns, 0);
    }

    fn sleep_and_spin_until_ns(&self, deadline_ns: u64, spin_ns: u64) {
        // SAFETY: the library is loaded, and its function takes any numbers.
        unsafe { (self.functions.sleep_until_ns)(deadline_ns, spin_ns) }
    }

    fn is_free_running(&self) -> bool {
        // SAFETY: the library is loaded, and its function takes nothing.
        unsafe { (self.functions.clock_is_stepped)() == 0 }
    }

    fn gateways_ready(&self) {
        // SAFETY: the library is loaded, and its function takes nothing.
        unsafe { (self.functions.gateways_ready)() }
    }
}
