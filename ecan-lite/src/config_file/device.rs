//! Gateways of a file on a bus: finding the slave, and writing the configuration to it.

use ecan_host::{Diagnostics, Error, SlaveConfig, StartupStep};
use ecan_protocol::device::AlState;
use thiserror::Error;

/// A gateway of a file and its slave on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResolvedGateway {
    /// Its index in the file.
    pub gateway: usize,
    /// Its index in the [`Diagnostics`] of the bus.
    pub slave: usize,
}

/// Error: a gateway of a file cannot be found or configured.
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
                |slave: &usize| bus.slave_info(*slave).is_ok_and(|it| it.alias == alias);
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
/// `report` is called after each step.
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
    Ok(bus.run_startup(slave, steps, report)?)
}
