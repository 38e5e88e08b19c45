//! Values that are read of the slaves before they are configured.

use std::thread;
use std::time::Duration;

use ecan_protocol::device::{Capabilities, OptionalObject};
use ecan_protocol::mapping::Direction;
use ecan_protocol::object::describe;

use tracing::warn;

use super::Adapter;
use crate::bus::mapping::{Unit, read_mapping};
use crate::bus::{CapabilityValues, Diagnostics, identification};
use crate::config::{AdapterConfig, Identity};
use crate::error::Error;
use crate::startup::StartupPlan;

/// Subindex of 0xF000 that each gateway has: the size of a PDO unit.
const SIZE_UNIT: u8 = 17;

#[derive(Debug)]
pub(super) struct Prepared {
    pub(super) identity: Identity,
    pub(super) capabilities: CapabilityValues,
    pub(super) rx_units: Vec<Unit>,
    pub(super) tx_units: Vec<Unit>,
    /// Time of an SDO transfer, measured once.
    pub(super) sdo_time: Duration,
    /// Objects of the startup that the slave does not have.
    pub(super) missing: Vec<OptionalObject>,
}

fn prepare(
    diagnostics: &Diagnostics,
    config: &AdapterConfig,
    startup: &StartupPlan,
    slave: usize,
) -> Result<Prepared, Error> {
    let count = config.slaves.len();
    let settings = config.slaves.get(slave).ok_or(Error::SlaveIndex { slave, count })?;
    let identified = identification::identify(diagnostics, slave, settings)?;
    let mut capabilities = identified.capabilities;
    let steps = startup.preparation(config, slave);
    diagnostics.run_startup_with(slave, &steps, &mut capabilities, |_| {})?;
    let begun_ns = diagnostics.clock().now_ns();
    diagnostics.sdo_upload_u32(slave, Capabilities::INDEX, SIZE_UNIT)?;
    let sdo_time = Duration::from_nanos(diagnostics.clock().now_ns().saturating_sub(begun_ns));
    let missing = find_missing(diagnostics, startup, slave)?;
    let mapping = |direction, n| read_mapping(diagnostics, slave, direction, n);
    Ok(Prepared {
        identity: identified.identity,
        capabilities,
        rx_units: mapping(Direction::RxPdo, settings.rx_multiplier)?,
        tx_units: mapping(Direction::TxPdo, settings.tx_multiplier)?,
        sdo_time,
        missing,
    })
}

/// Reads an entry of each optional object of the startup, since a write that the slave rejects would end the startup.
fn find_missing(
    diagnostics: &Diagnostics,
    startup: &StartupPlan,
    slave: usize,
) -> Result<Vec<OptionalObject>, Error> {
    let mut missing = Vec::new();
    for object in startup.optional_objects(slave) {
        let (index, subindex) = object.probe();
        match diagnostics.sdo_upload_u32(slave, index, subindex) {
            Err(error) if error.is_missing_object() => {
                let name = describe(index, subindex);
                warn!(
                    slave,
                    "slave {slave}: the firmware does not have {name} (assumption H42): not configured, it keeps its \
                     own behaviour"
                );
                missing.push(object);
            }
            // One that cannot be read can still be written.
            Err(error @ Error::Sdo { abort_code: None, .. }) => return Err(error),
            _ => {}
        }
    }
    Ok(missing)
}

impl Adapter {
    /// Reads every slave; in real time all of them at once, because the master serves the mailboxes
    /// of its slaves in parallel.
    pub(super) fn prepare_slaves(&self) -> Result<Vec<Prepared>, Error> {
        let slaves = 0..self.config.slaves.len();
        if slaves.len() < 2 || !self.ecrt.clock().is_free_running() {
            let prepare = |slave| {
                self.check_stop()?;
                prepare(&self.diagnostics, &self.config, &self.startup, slave)
            };
            return slaves.map(prepare).collect();
        }
        let (config, startup) = (&self.config, &self.startup);
        thread::scope(|scope| {
            let workers: Vec<_> = slaves
                .map(|slave| {
                    let open = self.diagnostics_opener();
                    scope.spawn(move || prepare(&open()?, config, startup, slave))
                })
                .collect();
            let join = |worker: thread::ScopedJoinHandle<'_, _>| {
                worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            };
            workers.into_iter().map(join).collect()
        })
    }
}
