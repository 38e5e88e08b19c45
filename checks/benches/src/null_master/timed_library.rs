//! Processor time of the calls into a libethercat, simulated or real.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

use crate::measure::thread_cpu_ns;
use ecrt_sys::{
    Ecrt, Functions, OpenMaster, Status, ec_domain_state_t, ec_domain_t, ec_master_state_t,
    ec_master_t, ec_reg_request_t, ec_request_state_t, ec_sdo_request_t, ec_slave_config_state_t,
    ec_slave_config_t, status,
};
use libc::{c_int, size_t};

static LIBRARY: OnceLock<Functions> = OnceLock::new();
static TIME_NS: AtomicU64 = AtomicU64::new(0);
static CALLS: AtomicU64 = AtomicU64::new(0);
/// Calls of the measurement of its own cost.
const CALIBRATION_CALLS: u32 = 10_000;

/// Timed calls of this process so far, of all threads.
#[derive(Clone, Copy, Debug)]
pub struct LibraryTime {
    /// Number of calls.
    pub calls: u64,
    /// Processor time in them, ns.
    pub ns: u64,
}

impl LibraryTime {
    /// Calls and time so far.
    #[must_use]
    pub fn now() -> Self {
        Self { calls: CALLS.load(Ordering::Relaxed), ns: TIME_NS.load(Ordering::Relaxed) }
    }

    /// Processor time that the measurement adds to a call outside of its counted time, ns.
    #[must_use]
    pub fn cost_ns() -> f64 {
        let (before, start_ns) = (Self::now(), thread_cpu_ns());
        for _ in 0..CALIBRATION_CALLS {
            time(|_| ());
        }
        let whole_ns = thread_cpu_ns() - start_ns;
        let counted_ns = Self::now().ns - before.ns;
        whole_ns.saturating_sub(counted_ns) as f64 / f64::from(CALIBRATION_CALLS)
    }
}

/// The same library, with the calls of a cycle timed: receive, send, and those of domains, states and
/// requests. The calls of distributed clocks are not.
///
/// # Panics
/// It was called before in this process.
pub fn timed(ecrt: &Ecrt) -> Ecrt {
    let mut table = *ecrt.functions();
    LIBRARY.set(table).expect("one timed library in a process");
    table.master_receive = Status::Reported(master_receive);
    table.master_send = Status::Reported(master_send);
    table.domain_process = Status::Reported(domain_process);
    table.domain_queue = Status::Reported(domain_queue);
    table.domain_state = Status::Reported(domain_state);
    table.slave_config_state = Status::Reported(slave_config_state);
    table.master_state = Status::Reported(master_state);
    table.sdo_request_state = sdo_request_state;
    table.sdo_request_read = Status::Reported(sdo_request_read);
    table.sdo_request_write = Status::Reported(sdo_request_write);
    table.reg_request_state = reg_request_state;
    table.reg_request_read = Status::Reported(reg_request_read);
    table.reg_request_write = Status::Reported(reg_request_write);
    let (major, minor) = ecrt.version();
    let version_magic = u32::from(major) << 8 | u32::from(minor);
    let clock = ecrt.clock().clone();
    // SAFETY: the handles are those of the library, and the replaced functions call its functions
    // with the same arguments.
    unsafe {
        Ecrt::simulated(table, Arc::new(Masters(ecrt.clone())), version_magic, "timed", clock)
    }
}

struct Masters(Ecrt);

impl OpenMaster for Masters {
    fn request(&self, index: u32) -> *mut ec_master_t {
        self.0.request_master(index)
    }

    fn open(&self, index: u32) -> *mut ec_master_t {
        self.0.open_master(index)
    }
}

fn time<R>(call: impl FnOnce(&Functions) -> R) -> R {
    let library = LIBRARY.get().expect("set before the functions are in a table");
    let start_ns = thread_cpu_ns();
    let result = call(library);
    TIME_NS.fetch_add(thread_cpu_ns() - start_ns, Ordering::Relaxed);
    CALLS.fetch_add(1, Ordering::Relaxed);
    result
}

macro_rules! timed_functions {
    ($($name:ident($($argument:ident: $type:ty),*) $(-> $result:ty)?;)*) => {
        $( timed_functions!(@ $name($($argument: $type),*) $(-> $result)?); )*
    };
    (@ $name:ident($($argument:ident: $type:ty),*)) => {
        unsafe extern "C" fn $name($($argument: $type),*) -> c_int {
            // SAFETY: the same arguments under the same promises.
            time(|library| unsafe { status!(library.$name, $($argument),*) })
        }
    };
    (@ $name:ident($($argument:ident: $type:ty),*) -> $result:ty) => {
        unsafe extern "C" fn $name($($argument: $type),*) -> $result {
            // SAFETY: the same arguments under the same promises.
            time(|library| unsafe { (library.$name)($($argument),*) })
        }
    };
}

timed_functions! {
    master_receive(master: *mut ec_master_t);
    master_send(master: *mut ec_master_t);
    master_state(master: *const ec_master_t, state: *mut ec_master_state_t);
    domain_process(domain: *mut ec_domain_t);
    domain_queue(domain: *mut ec_domain_t);
    domain_state(domain: *const ec_domain_t, state: *mut ec_domain_state_t);
    slave_config_state(config: *const ec_slave_config_t, state: *mut ec_slave_config_state_t);
    sdo_request_state(request: *mut ec_sdo_request_t) -> ec_request_state_t;
    sdo_request_read(request: *mut ec_sdo_request_t);
    sdo_request_write(request: *mut ec_sdo_request_t);
    reg_request_state(request: *mut ec_reg_request_t) -> ec_request_state_t;
    reg_request_read(request: *mut ec_reg_request_t, address: u16, size: size_t);
    reg_request_write(request: *mut ec_reg_request_t, address: u16, size: size_t);
}
