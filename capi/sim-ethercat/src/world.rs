//! The simulated world of the process.

use std::ffi::{CStr, CString, c_int};
use std::io::Write;
use std::sync::{Mutex, OnceLock, PoisonError};
use std::{fmt, io};

use ecan_sim::{
    BackendError, BridgeFactory, ClockKind, EcrtSetting, ScenarioChoice, SimClock, SimOptions,
    Simulation,
};
use ecrt_sys::Errno;
use libc::size_t;

static WORLD: Mutex<Option<Opened>> = Mutex::new(None);
/// Name of its scenario, which stays valid for the life of the process.
static SCENARIO: OnceLock<CString> = OnceLock::new();

struct Opened {
    simulation: Simulation,
    clock: SimClock,
}

/// Returns the simulation, which the first call opens. An error is reported on stderr and returned
/// as an error number.
pub(crate) fn simulation() -> Result<Simulation, c_int> {
    opened(|opened| opened.simulation.clone())
}

/// The clock of the simulation.
pub(crate) fn clock() -> Result<SimClock, c_int> {
    opened(|opened| opened.clock.clone())
}

/// Scenario of the simulation: the name of a built-in one, or a file as `ECAN_ECRT` names it.
pub(crate) fn scenario() -> Result<&'static CStr, c_int> {
    simulation()?;
    SCENARIO.get().map(CString::as_c_str).ok_or(libc::EINVAL)
}

fn opened<R>(part: impl FnOnce(&Opened) -> R) -> Result<R, c_int> {
    // a panic while opening leaves no world, so a poisoned lock is harmless
    let mut world = WORLD.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(opened) = &*world {
        return Ok(part(opened));
    }
    let simulation = open().map_err(|error| {
        line(format_args!("{error}"));
        error_number(&error)
    })?;
    line(format_args!("{}", simulation.banner()));
    if simulation.clock_kind() == ClockKind::Stepped {
        line(format_args!(
            "the scenario requests stepped time, which passes only in the waiting calls of the SDK \
             and in ecan_sim_sleep_until_ns"
        ));
    }
    let clock = simulation.clock();
    Ok(part(world.insert(Opened { simulation, clock })))
}

fn open() -> Result<Simulation, BackendError> {
    let choice = match EcrtSetting::from_environment()? {
        Some(EcrtSetting::Simulated(name)) => ScenarioChoice::from_setting(name.as_deref())?,
        // the path of a library, probably this one, selects no scenario
        Some(EcrtSetting::Library(_)) | None => ScenarioChoice::Suggested,
    };
    let bridges = Some(ecan_sim::bridge::make as BridgeFactory);
    let simulation = ecan_sim::simulate(&choice, &SimOptions { bridges, ..SimOptions::default() })?;
    SCENARIO.get_or_init(|| {
        let name = match &choice {
            ScenarioChoice::Suggested => simulation.scenario_name().into(),
            ScenarioChoice::Named(name) => name.into(),
            ScenarioChoice::File(path) => path.to_string_lossy(),
        };
        CString::new(name.as_bytes()).unwrap_or_default()
    });
    Ok(simulation)
}

fn error_number(error: &BackendError) -> c_int {
    match error {
        BackendError::Read(_, error) => error.raw_os_error().unwrap_or(libc::EIO),
        _ => libc::EINVAL,
    }
}

/// Return value of a library function.
pub(crate) trait Outcome {
    /// The error number, if the call failed.
    fn failure(&self) -> Option<Errno> {
        None
    }
}

impl Outcome for c_int {
    fn failure(&self) -> Option<Errno> {
        (*self < 0).then(|| Errno::new(self.saturating_neg()))
    }
}

impl<T> Outcome for *mut T {
    fn failure(&self) -> Option<Errno> {
        self.is_null().then(Errno::last)
    }
}

impl Outcome for () {}
impl Outcome for u32 {}
impl Outcome for size_t {}

/// Functions whose failures the real library does not report, by the beginning of their names or by
/// their names: those of the cycle and a few more.
const SILENT_GROUPS: [&str; 4] =
    ["ecrt_sdo_request_", "ecrt_reg_request_", "ecrt_soe_request_", "ecrt_voe_handler_"];
const SILENT: [&str; 18] = [
    "ecrt_domain_data",
    "ecrt_domain_process",
    "ecrt_domain_queue",
    "ecrt_domain_state",
    "ecrt_master_application_time",
    "ecrt_master_deactivate",
    "ecrt_master_receive",
    "ecrt_master_reset",
    "ecrt_master_send",
    "ecrt_master_set_send_interval",
    "ecrt_master_state",
    "ecrt_master_sync_monitor_queue",
    "ecrt_master_sync_reference_clock",
    "ecrt_master_sync_reference_clock_to",
    "ecrt_master_sync_slave_clocks",
    "ecrt_slave_config_dc",
    // programs poll for messages in the cycle; no message is not a failure
    "ecrt_slave_config_emerg_pop",
    "ecrt_slave_config_state",
];

fn is_silent(function: &str) -> bool {
    SILENT.contains(&function) || SILENT_GROUPS.iter().any(|group| function.starts_with(group))
}

/// Reports a failure on stderr, and returns the result.
pub(crate) fn reported<R: Outcome>(function: &str, result: R) -> R {
    if let Some(errno) = result.failure().filter(|_| !is_silent(function)) {
        line(format_args!("{function}: {errno}"));
        errno.set_last();
    }
    result
}

/// Writes a line to stderr; a closed stderr is ignored.
pub(crate) fn line(text: fmt::Arguments<'_>) {
    let _ = writeln!(io::stderr(), "libethercat (simulated): {text}");
}
