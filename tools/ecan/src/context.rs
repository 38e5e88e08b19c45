//! Options and output of a command, with the types that every command uses.

use std::sync::Once;

use ecan_sim::{Backend, BackendError, ClockKind, EcrtSetting, SimOptions};

pub use crate::bus::Bus;
pub use crate::failure::{Failure, Result};
pub use crate::global::GlobalOptions;
use crate::via;

pub use crate::output::{FullScreen, Output, Tone, note};

#[derive(Clone, Copy, Debug)]
pub struct Context<'a> {
    pub global: &'a GlobalOptions,
    pub output: Output,
}

impl Context<'_> {
    /// Opens the bus through a service, or the library and the master; reports a service or a
    /// simulation on standard error.
    pub fn bus(&self) -> Result<Bus> {
        self.bus_of_master(self.global.master(), ClockKind::Stepped)
    }

    /// As [`bus`](Self::bus), with the default clock of a simulation.
    pub fn bus_of_master(&self, master: u32, clock: ClockKind) -> Result<Bus> {
        if let Some(connection) = via::connect(self.global, master)? {
            return Bus::of_service(connection, self.global.slave);
        }
        Bus::of(&self.backend(&self.setting()?, clock)?, master, self.global.slave)
    }

    /// Redirects the output to standard error if standard output is in use.
    pub fn on_stderr(&self, is_stdout_used: bool) -> Self {
        Self { output: self.output.on_stderr(is_stdout_used), ..*self }
    }

    pub fn setting(&self) -> Result<EcrtSetting> {
        let setting = EcrtSetting::resolve(self.global.ecrt.as_deref());
        setting.map_err(|error| BackendError::from(error).into())
    }

    /// Loads the library, with the clock of a scenario that names none; reports a simulation.
    pub fn backend(
        &self,
        setting: &EcrtSetting,
        clock: ClockKind,
    ) -> Result<Backend, BackendError> {
        let mut options = SimOptions { clock: Some(clock), ..SimOptions::default() };
        options.bridges = Some(ecan_sim::bridge::make);
        let backend = ecan_sim::open(setting, &options)?;
        if let Some(simulation) = &backend.simulation {
            // A search for bit rates opens a simulation for each of them.
            static BANNER: Once = Once::new();
            BANNER.call_once(|| note(simulation.banner()));
            simulation.observe_faults(|record| note(record));
        }
        Ok(backend)
    }
}
