//! Gateways of a file on a bus: finding the slave, and writing the configuration to it.

use ecan_host::{
    Clock, Diagnostics, Error, Maintenance, MaintenanceError, SlaveConfig, StartupStep,
};
use ecan_protocol::config::{ConfigObject, DiagnosticTest};
use ecan_protocol::device::{AccessMode, AlState, MaintenanceCommand};

/// A gateway of a file and its slave on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResolvedGateway {
    /// Its index in the file.
    pub gateway: usize,
    /// Its index in the [`Diagnostics`] of the bus.
    pub slave: usize,
}

/// Error: a gateway of a file cannot be found or configured.
#[derive(Debug, thiserror::Error)]
pub enum ResolveError {
    /// No slave has the alias.
    #[error("gateway {gateway} of the file: no slave has the alias {alias}")]
    NoAlias {
        /// Its index in the file.
        gateway: usize,
        /// The alias.
        alias: u16,
    },
    /// No slave at the position.
    #[error(
        "gateway {gateway} of the file: no slave at alias {alias}, position {position}; the bus has \
         {count} slaves"
    )]
    NoSlave {
        /// Its index in the file.
        gateway: usize,
        /// The alias, 0 for the start of the bus.
        alias: u16,
        /// The position relative to it.
        position: u16,
        /// Slaves on the bus.
        count: usize,
    },
    /// Two gateways of the file are the same slave, one by alias and the other by position.
    #[error(
        "gateways {first} and {second} of the file are the same slave {slave}; change alias or \
         position of one of them"
    )]
    Same {
        /// Index in the file of the first one.
        first: usize,
        /// Index in the file of the second one.
        second: usize,
        /// Index of the slave.
        slave: usize,
    },
    /// The configuration cannot change in the state of the slave.
    #[error(
        "slave {slave} is in {state}; its process data layout can only change in PREOP: stop the \
         program that runs the bus, or request the state (ethercat states PREOP)"
    )]
    State {
        /// Index of the slave.
        slave: usize,
        /// Its state.
        state: AlState,
    },
    /// A transfer to the slave failed.
    #[error(transparent)]
    Device(#[from] Error),
}

/// Finds the slave of each gateway, with a handle of the whole bus ([`Diagnostics::of_bus`]).
///
/// # Errors
/// [`ResolveError`] for the first gateway that is not found, or that is the slave of another one.
pub fn find(
    bus: &Diagnostics,
    slaves: &[SlaveConfig],
) -> Result<Vec<ResolvedGateway>, ResolveError> {
    let count = bus.slave_count();
    let resolve = |(gateway, settings): (usize, &SlaveConfig)| {
        let SlaveConfig { alias, position, .. } = *settings;
        let mut start = 0;
        if alias != 0 {
            let has_alias =
                |slave: &usize| bus.slave_info(*slave).is_ok_and(|slave| slave.alias == alias);
            start = (0..count).find(has_alias).ok_or(ResolveError::NoAlias { gateway, alias })?;
        }
        let slave = start + usize::from(position);
        match slave < count {
            true => Ok(ResolvedGateway { gateway, slave }),
            false => Err(ResolveError::NoSlave { gateway, alias, position, count }),
        }
    };
    let mut resolved: Vec<ResolvedGateway> = Vec::with_capacity(slaves.len());
    for gateway in slaves.iter().enumerate() {
        let found = resolve(gateway)?;
        if let Some(other) = resolved.iter().find(|other| other.slave == found.slave) {
            let (first, second) = (other.gateway, found.gateway);
            return Err(ResolveError::Same { first, second, slave: found.slave });
        }
        resolved.push(found);
    }
    Ok(resolved)
}

/// Runs a startup sequence on a slave: downloads, and readbacks that must return the expected values.
/// `report` is called after each step. If the sequence expects that no diagnostic test is active (0x8030), an
/// active one is ended before.
///
/// Blocks for one transfer per step, several hundred for a gateway with four channels.
///
/// # Errors
/// [`ResolveError::State`] if the layout cannot change in the state of the slave; the error of the
/// first step that failed, with the abort code or the value read. The steps before it are done.
pub fn apply(
    bus: &Diagnostics,
    slave: usize,
    steps: &[StartupStep],
    report: &mut dyn FnMut(&StartupStep),
) -> Result<(), ResolveError> {
    if let Some(state) = bus.al_state(slave)?
        && state != AlState::PreOp
    {
        return Err(ResolveError::State { slave, state });
    }
    let expects_no_test = steps.iter().any(|step| {
        matches!(step, StartupStep::Expect { index: DiagnosticTest::INDEX, expected, .. } if expected.is_met_by(0))
    });
    if expects_no_test {
        end_test(bus, slave, report)?;
    }
    Ok(bus.run_startup(slave, steps, report)?)
}

/// Ends an active diagnostic test.
fn end_test(
    bus: &Diagnostics,
    slave: usize,
    report: &mut dyn FnMut(&StartupStep),
) -> Result<(), Error> {
    let index = DiagnosticTest::INDEX;
    let read = |subindex| match bus.sdo_upload_u32(slave, index, subindex) {
        // Firmware without the object, or the entry, has no test.
        Err(error) if error.is_missing_object() => Ok(0),
        value => value,
    };
    if DiagnosticTest::read(read)?.is_idle() {
        return Ok(());
    }
    let writes: Vec<_> = DiagnosticTest::OFF.writes().map(StartupStep::Download).collect();
    bus.run_startup(slave, &writes, report)
}

const MAINTENANCE: u16 = 0xB000;
const ACTIVE_CRC: u8 = 7;
const STORED_CRC: u8 = 8;

/// A command for the configuration in the flash, 0xB000:04.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlashCommand {
    /// Saves the active configuration.
    Save,
    /// Loads the saved configuration.
    Load,
    /// Restores the factory configuration and deletes the saved one.
    Factory,
}

/// Checksums of the configurations of a gateway after a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConfigChecksums {
    /// CRC32 of the active configuration, 0xB000:07.
    pub active_crc: u32,
    /// CRC32 of the saved configuration, 0xB000:08.
    pub stored_crc: u32,
}

impl FlashCommand {
    fn command(self) -> MaintenanceCommand {
        match self {
            Self::Save => MaintenanceCommand::Save,
            Self::Load => MaintenanceCommand::Load,
            Self::Factory => MaintenanceCommand::Factory,
        }
    }

    /// The access mode that the command needs. The manual does not define what each mode permits; see
    /// docs/ASSUMPTIONS.md.
    fn mode(self) -> AccessMode {
        match self {
            Self::Save | Self::Load => AccessMode::Engineering,
            Self::Factory => AccessMode::Factory,
        }
    }

    /// Runs the command in the access mode that it needs, restores the previous mode in any case, and
    /// reads the checksums.
    ///
    /// Blocks up to 10 s. The gateway denies the command in OP.
    ///
    /// # Errors
    /// [`MaintenanceError`] of the step that failed.
    pub fn run(
        self,
        bus: &Diagnostics,
        slave: usize,
        clock: &dyn Clock,
    ) -> Result<ConfigChecksums, MaintenanceError> {
        let maintenance = Maintenance::new(bus, slave);
        maintenance.in_mode(self.mode(), || {
            maintenance.command(self.command(), clock)?;
            let crc = |subindex| bus.sdo_upload_u32(slave, MAINTENANCE, subindex);
            Ok(ConfigChecksums { active_crc: crc(ACTIVE_CRC)?, stored_crc: crc(STORED_CRC)? })
        })
    }
}
