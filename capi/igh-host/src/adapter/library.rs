//! The EtherCAT master library of a context: the setting `ecrt` resolved and loaded.

use std::fmt::Display;
use std::path::PathBuf;

use ecan_c_boundary::Call;
#[cfg(feature = "sim")]
use ecan_c_boundary::result::ecan_result_t::ECAN_ERR_FILE;
use ecan_c_boundary::result::ecan_result_t::{self, ECAN_ERR_ECRT};
use ecan_host::{Ecrt, EcrtSetting};

use super::config::IghConfig;

pub(crate) struct Library {
    pub(crate) ecrt: Ecrt,
    /// The library is simulated, and its time passes only while the program waits.
    pub(crate) is_stepped: bool,
}

impl Library {
    pub(crate) fn of(ecrt: Ecrt) -> Self {
        let is_stepped = ecrt.is_simulated() && !ecrt.clock().is_free_running();
        Self { ecrt, is_stepped }
    }
}

/// Path that the build sets in place of the installed libethercat (CMake's ECRT_LIBRARY).
fn default_library() -> Option<PathBuf> {
    option_env!("ECAN_DEFAULT_ECRT").filter(|path| !path.is_empty()).map(PathBuf::from)
}

/// Loads the library that the configuration selects. A simulated one identifies itself on standard
/// error.
pub(crate) fn open(call: Call, config: &IghConfig) -> Result<Library, ecan_result_t> {
    let explicit = explicit(config);
    let setting = match EcrtSetting::resolve(explicit).map_err(|error| failed(call, &error))? {
        EcrtSetting::Library(None) if explicit.is_none() => EcrtSetting::Library(default_library()),
        setting => setting,
    };
    load(&setting, config).map(Library::of).map_err(|error| not_loaded(call, &error))
}

/// The library that this process has loaded, of which the owner of a master has its handle.
pub(crate) fn find_loaded(call: Call, config: &IghConfig) -> Result<Library, ecan_result_t> {
    let setting = EcrtSetting::resolve(explicit(config)).map_err(|error| failed(call, &error))?;
    setting.find_loaded().map(Library::of).map_err(|error| failed(call, &error))
}

fn explicit(config: &IghConfig) -> Option<&str> {
    config.ecrt.as_ref().map(|text| text.get().unwrap_or_default())
}

#[cold]
fn failed(call: Call, error: &dyn Display) -> ecan_result_t {
    call.fail(ECAN_ERR_ECRT, format_args!("{error}"))
}

#[cfg(not(feature = "sim"))]
fn not_loaded(call: Call, error: &ecan_host::LoadError) -> ecan_result_t {
    failed(call, error)
}

#[cfg(feature = "sim")]
fn not_loaded(call: Call, error: &ecan_sim::BackendError) -> ecan_result_t {
    match error.is_scenario() {
        true => call.fail(ECAN_ERR_FILE, format_args!("{error}")),
        false => failed(call, error),
    }
}

#[cfg(not(feature = "sim"))]
fn load(setting: &EcrtSetting, _: &IghConfig) -> Result<Ecrt, ecan_host::LoadError> {
    setting.load()
}

#[cfg(feature = "sim")]
fn load(setting: &EcrtSetting, config: &IghConfig) -> Result<Ecrt, ecan_sim::BackendError> {
    use ecan_sim::{ClockKind, SimOptions};

    let clock = if config.is_stepped { ClockKind::Stepped } else { ClockKind::Real };
    let last_position = config.configured().slaves.iter().map(|slave| slave.position).max();
    let options = SimOptions {
        suggested: config.scenario.get().map(str::to_owned),
        clock: Some(clock),
        seed: config.seed,
        slaves: last_position.map(|position| usize::from(position) + 1),
        carries_large_pdos: config.adapter.allow_large_pdos.then_some(true),
        bridges: Some(ecan_sim::bridge::make),
    };
    let backend = ecan_sim::open(setting, &options)?;
    if let Some(simulation) = &backend.simulation {
        crate::standard_error::write_line(&simulation.banner());
    }
    Ok(backend.ecrt)
}
