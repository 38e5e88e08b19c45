//! The simulated world of the process.

use std::ffi::{CStr, CString};
use std::sync::{Mutex, OnceLock, PoisonError};

use ecan_sim::{
    BackendError, BridgeFactory, ClockKind, EcrtSetting, ScenarioChoice, SimClock, SimOptions,
    Simulation,
};
use libc::c_int;

use crate::report::line;

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
