//! The bus of a command and the selection of its slaves.

use ecan_host::{Clock, Diagnostics, Ecrt, Error, SlaveInfo, SlaveKind, SlaveQuery as _};
use ecan_protocol::device::Capabilities;
use ecan_sim::{Backend, BackendError, ClockKind, EcrtSetting, SimOptions};

use crate::failure::Failure;
use crate::firmware_version::{FirmwareVersion, serial_number};
use crate::global::GlobalOptions;
use crate::output::Output;
use crate::slave_choice::{Candidates, Recognised, SlaveChoice, choose, every_gateway, one_or_all};

/// A bus, opened without reserving the master.
#[derive(Debug)]
pub struct Bus {
    ecrt: Ecrt,
    diagnostics: Diagnostics,
    choice: Option<SlaveChoice>,
}

/// Options of a simulated library, with the clock of a scenario that names none.
pub fn sim_options(clock: ClockKind) -> SimOptions {
    SimOptions { clock: Some(clock), bridges: Some(ecan_sim_bridge::make), ..SimOptions::default() }
}

impl Bus {
    /// Opens the library and the master; reports a simulation on standard error.
    pub fn open(global: &GlobalOptions, output: &Output) -> Result<Self, Failure> {
        Self::open_with_clock(global, output, ClockKind::Stepped)
    }

    /// As [`open`](Self::open), with the default clock of a simulation.
    pub fn open_with_clock(
        global: &GlobalOptions,
        output: &Output,
        clock: ClockKind,
    ) -> Result<Self, Failure> {
        let setting = EcrtSetting::resolve(global.ecrt.as_deref()).map_err(BackendError::from)?;
        let options = sim_options(clock);
        Self::of(&ecan_sim::open(&setting, &options)?, global, output)
    }

    /// Opens the bus of a loaded library.
    pub fn of(backend: &Backend, global: &GlobalOptions, output: &Output) -> Result<Self, Failure> {
        if let Some(simulation) = &backend.simulation {
            output.note(simulation.banner());
        }
        let master = |error: Error| Failure::Master(error.to_string());
        let diagnostics = Diagnostics::of_bus(&backend.ecrt, global.master()).map_err(master)?;
        tracing::debug!(master = global.master(), slaves = diagnostics.slave_count(), "bus opened");
        if !diagnostics.master_state().map_err(master)?.link_up {
            let words = format!(
                "master {} has no link; check the cable and the supply of the first slave",
                global.master()
            );
            return Err(Failure::Master(words));
        }
        Ok(Self { ecrt: backend.ecrt.clone(), diagnostics, choice: global.slave })
    }

    pub fn ecrt(&self) -> &Ecrt {
        &self.ecrt
    }

    pub fn diagnostics(&self) -> &Diagnostics {
        &self.diagnostics
    }

    /// Clock for waiting on slaves.
    pub fn clock(&self) -> &dyn Clock {
        self.ecrt.clock().as_ref()
    }

    /// Information of the master about each slave.
    pub fn slaves(&self) -> Result<Vec<SlaveInfo>, Failure> {
        let infos = (0..self.diagnostics.slave_count()).map(|at| self.diagnostics.slave_info(at));
        infos.collect::<Result<_, _>>().map_err(Failure::Device)
    }

    /// Identifies each slave now.
    pub fn kinds(&self) -> Vec<SlaveKind<Error>> {
        self.diagnostics.slave_kinds()
    }

    /// Returns whether `--slave` was given.
    pub fn is_chosen(&self) -> bool {
        self.choice.is_some()
    }

    /// Returns the selected slave, or the only gateway.
    pub fn slave(&self) -> Result<usize, Failure> {
        choose(self, self.choice)
    }

    /// Returns the selected gateway, or every gateway.
    pub fn chosen_or_every_gateway(&self) -> Result<Vec<usize>, Failure> {
        match self.choice {
            Some(_) => Ok(vec![self.slave()?]),
            None => every_gateway(self),
        }
    }

    /// Returns the selected or only gateway, or all gateways with `--all`.
    pub fn one_or_all(&self, all: bool) -> Result<Recognised, Failure> {
        one_or_all(self, self.choice, all)
    }

    /// Serial number of a gateway.
    pub fn serial(&self, slave: usize) -> Result<u64, Failure> {
        serial_number(|subindex| self.read(slave, Capabilities::INDEX, subindex))
    }

    /// Firmware version of a gateway.
    pub fn firmware_version(&self, slave: usize) -> Result<FirmwareVersion, Failure> {
        let text = match self.text(slave, 0x100A) {
            Err(Failure::Device(error)) if self.diagnostics.is_denial(&error) => None,
            read => Some(read?),
        };
        FirmwareVersion::read(text, |subindex| self.read(slave, Capabilities::INDEX, subindex))
    }

    /// Uploads an object of at most 4 bytes.
    pub fn read(&self, slave: usize, index: u16, subindex: u8) -> Result<u32, Failure> {
        self.diagnostics.sdo_upload_u32(slave, index, subindex).map_err(Failure::Device)
    }

    /// Downloads a number, in the size of the object in the table.
    pub fn write(&self, slave: usize, index: u16, subindex: u8, value: u32) -> Result<(), Failure> {
        let entry = ecan_protocol::object::lookup(index, subindex).map(|(_, entry)| entry);
        let size = entry.and_then(|entry| entry.ty.size_bytes()).unwrap_or(4);
        let bytes = value.to_le_bytes();
        let data = bytes.get(..size).unwrap_or(&bytes);
        self.diagnostics.sdo_download(slave, index, subindex, data).map_err(Failure::Device)
    }

    /// Uploads a text object.
    pub fn text(&self, slave: usize, index: u16) -> Result<String, Failure> {
        let mut bytes = [0; 64];
        let length = self.diagnostics.sdo_upload(slave, index, 0, &mut bytes);
        let read = bytes.get(..length.map_err(Failure::Device)?).unwrap_or_default();
        Ok(String::from_utf8_lossy(read).trim_end_matches('\0').to_owned())
    }
}

impl Candidates for Bus {
    fn positions(&self) -> Result<Vec<(usize, u16)>, Failure> {
        Ok(self.slaves()?.iter().map(|slave| slave.alias).enumerate().collect())
    }

    fn recognised(&self) -> Result<Recognised, Failure> {
        Ok(Recognised::new(self.kinds().into_iter().enumerate()))
    }

    fn serial(&self, slave: usize) -> Result<u64, Failure> {
        Bus::serial(self, slave)
    }
}

/// Bus of a simulation in a test.
#[cfg(test)]
impl Bus {
    pub fn over(ecrt: &Ecrt) -> Self {
        let diagnostics = Diagnostics::of_bus(ecrt, 0).unwrap();
        Self { ecrt: ecrt.clone(), diagnostics, choice: None }
    }
}
