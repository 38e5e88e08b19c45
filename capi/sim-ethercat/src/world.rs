//! The simulated world of the process.

use std::sync::{Mutex, PoisonError};

use ecan_sim::{
    BackendError, BridgeFactory, ClockKind, EcrtSetting, ScenarioChoice, SimOptions, Simulation,
};
use libc::c_int;

use crate::report::line;

static WORLD: Mutex<Option<Simulation>> = Mutex::new(None);

/// Returns the simulation, which the first call opens. An error is reported on stderr and returned
/// as an error number.
pub(crate) fn simulation() -> Result<Simulation, c_int> {
    // a panic while opening leaves no world, so a poisoned lock is harmless
    let mut world = WORLD.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(simulation) = &*world {
        return Ok(simulation.clone());
    }
    let simulation = open().map_err(|error| {
        line(format_args!("{error}"));
        error_number(&error)
    })?;
    line(format_args!("{}", simulation.banner()));
    if simulation.clock_kind() == ClockKind::Stepped {
        line(format_args!(
            "the scenario requests stepped time, which stops while this program sleeps"
        ));
    }
    *world = Some(simulation.clone());
    Ok(simulation)
}

fn open() -> Result<Simulation, BackendError> {
    let choice = match EcrtSetting::from_environment()? {
        Some(EcrtSetting::Simulated(name)) => ScenarioChoice::from_setting(name.as_deref())?,
        // the path of a library, probably this one, selects no scenario
        Some(EcrtSetting::Library(_)) | None => ScenarioChoice::Suggested,
    };
    let bridges = Some(ecan_sim_bridge::make as BridgeFactory);
    ecan_sim::simulate(&choice, &SimOptions { bridges, ..SimOptions::default() })
}

fn error_number(error: &BackendError) -> c_int {
    match error {
        BackendError::Read(_, error) => error.raw_os_error().unwrap_or(libc::EIO),
        _ => libc::EINVAL,
    }
}
