//! Gateways of a file on a bus: which slave is meant, and writing the configuration to it.

use ecan_host::{Diagnostics, Error, SlaveConfig, StartupStep};
use ecan_protocol::device::AlState;
use thiserror::Error;

/// Where a gateway of a file is on a bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResolvedGateway {
    /// Its index in the file.
    pub gateway: usize,
    /// Its index in the [`Diagnostics`] of the bus.
    pub slave: usize,
}

/// Why a gateway of a file cannot be addressed.
#[derive(Debug, Error)]
pub enum ResolveError {
    /// No slave has the alias.
    #[error("gateway {gateway} of the file: no slave has the alias {alias}")]
    NoAlias {
        /// Its index in the file.
        gateway: usize,
        /// The alias.
        alias: u16,
    },
    /// There is no slave in the place.
    #[error(
        "gateway {gateway} of the file: there is no slave {position} places behind alias {alias}, \
         the bus has {count}"
    )]
    NoSlave {
        /// Its index in the file.
        gateway: usize,
        /// The alias, 0 for the start of the bus.
        alias: u16,
        /// The position behind it.
        position: u16,
        /// Slaves on the bus.
        count: usize,
    },
    /// Two gateways of the file are one slave, one by its alias and the other by its position.
    #[error(
        "gateways {first} and {second} of the file are the same slave {slave}: each needs a slave \
         of its own, by alias or by position"
    )]
    Same {
        /// Index in the file of the one that stands before.
        first: usize,
        /// Of the other.
        second: usize,
        /// Index of the slave that both mean.
        slave: usize,
    },
    /// Its state does not let the configuration be changed.
    #[error(
        "slave {slave} is in {state}: the layout of its process data is changed in PREOP; stop the \
         program that drives the bus, or request the state (ethercat states PREOP)"
    )]
    State {
        /// Index of the slave.
        slave: usize,
        /// Its state.
        state: AlState,
    },
    /// The slave cannot be asked.
    #[error(transparent)]
    Device(#[from] Error),
}

/// Finds the slave of each gateway, on a handle of the whole bus
/// ([`Diagnostics::of_bus`]).
///
/// # Errors
/// The first gateway that is not there, or that is the slave of another.
pub fn find(
    bus: &Diagnostics,
    slaves: &[SlaveConfig],
) -> Result<Vec<ResolvedGateway>, ResolveError> {
    let count = bus.slave_count();
    let place = |(gateway, settings): (usize, &SlaveConfig)| {
        let SlaveConfig { alias, position, .. } = *settings;
        let mut start = 0;
        if alias != 0 {
            let has_alias =
                |slave: &usize| bus.slave_info(*slave).is_ok_and(|it| it.alias == alias);
            start = (0..count).find(has_alias).ok_or(ResolveError::NoAlias { gateway, alias })?;
        }
        let slave = start + usize::from(position);
        match slave < count {
            true => Ok(ResolvedGateway { gateway, slave }),
            false => Err(ResolveError::NoSlave { gateway, alias, position, count }),
        }
    };
    let mut places: Vec<ResolvedGateway> = Vec::with_capacity(slaves.len());
    for gateway in slaves.iter().enumerate() {
        let found = place(gateway)?;
        if let Some(other) = places.iter().find(|other| other.slave == found.slave) {
            let (first, second) = (other.gateway, found.gateway);
            return Err(ResolveError::Same { first, second, slave: found.slave });
        }
        places.push(found);
    }
    Ok(places)
}

/// Runs a startup sequence on a slave: downloads, and readbacks that must read what is expected.
/// `report` is told each step that is done.
///
/// Blocks for a transfer per step, some hundred for a gateway with four channels.
///
/// # Errors
/// The slave is in a state in which its layout cannot change; the first step that failed, with the
/// abort code or what was read instead. The steps before it are done.
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
    Ok(bus.run_startup(slave, steps, report)?)
}
