//! Investigation of slaves that are not in OP.

use ecan_protocol::device::Capabilities;
use ecan_protocol::mapping::Direction;

use super::{Adapter, Slave};
use crate::bus::Diagnostics;
use crate::error::{Error, NotOperational, SlaveReport};
use crate::startup::StartupStep;

impl NotOperational {
    /// The blocking transfers that find the causes, for
    /// [`run_in_parallel`](crate::run_in_parallel).
    pub fn investigation(
        &self,
        adapter: &Adapter,
    ) -> impl FnOnce(&Diagnostics) -> Vec<(usize, Error)> + Send + use<> {
        let work: Vec<(usize, Vec<StartupStep>)> = self
            .held()
            .filter_map(|report| {
                let slave = adapter.slaves.get(report.slave)?;
                let steps = adapter.startup.steps(&adapter.config, report.slave);
                Some((report.slave, steps_to_try(&steps, slave)))
            })
            .collect();
        move |diagnostics| {
            let failure = |(slave, steps): &(usize, Vec<StartupStep>)| {
                diagnostics.run_startup(*slave, steps, |_| {}).err().map(|error| (*slave, error))
            };
            work.iter().filter_map(failure).collect()
        }
    }

    /// Takes over what an [`investigation`](Self::investigation) found.
    pub fn explain(&mut self, causes: Vec<(usize, Error)>) {
        for (slave, error) in causes {
            if let Some(report) = self.slaves.iter_mut().find(|report| report.slave == slave) {
                report.cause = Some(Box::new(error));
            }
        }
    }
}

/// The startup steps once more, on the very gateway, and then the sizes that it has active: one
/// that does not fit the process data is answered with AL status 0x001D or 0x001E.
fn steps_to_try(startup: &[StartupStep], slave: &Slave) -> Vec<StartupStep> {
    let layout = slave.layout;
    let [low, high] = slave.capabilities.serial();
    let same = [(7, low), (8, high)]
        .map(|(subindex, half)| StartupStep::expect(Capabilities::INDEX, subindex, half));
    let sizes = [(Direction::RxPdo, layout.rx_bytes), (Direction::TxPdo, layout.tx_bytes)]
        .map(|(direction, bytes)| StartupStep::expect(direction.profile_object(), 9, bytes as u32));
    [&same[..], startup, &sizes].concat()
}

impl Adapter {
    /// The slaves that are not in OP now, without what takes blocking transfers.
    pub fn not_operational(&self, waited_ms: u64) -> Result<NotOperational, Error> {
        let mut slaves = Vec::new();
        for (index, slave) in self.slaves.iter().enumerate() {
            let state = self.slave_state(index)?;
            let domain = self.domain_report(index);
            if state.operational && domain.is_complete() {
                continue;
            }
            let info = self.diagnostics.slave_info(index).ok();
            let slave_config = self.config.slaves.get(index);
            slaves.push(SlaveReport {
                slave: index,
                alias: slave_config.map_or(0, |settings| settings.alias),
                position: slave_config.map_or(0, |settings| settings.position),
                master_index: self.config.master_index,
                ring_position: info.as_ref().map(|info| info.position),
                online: state.online,
                al_state: info
                    .as_ref()
                    .map(|info| info.al_state)
                    .or(state.online.then_some(state.al_state)),
                error_flag: info.is_some_and(|info| info.error_flag),
                was_held: slave.al_status.was_held(),
                al_status_code: slave.al_status.last(),
                sync_managers: slave.al_status.sync_managers(),
                uses_sync0: self.config.dc.is_some(),
                cause: None,
                working_counter: domain.working_counter,
                expected_working_counter: domain.expected_working_counter,
            });
        }
        Ok(NotOperational { waited_ms, slaves })
    }
}
