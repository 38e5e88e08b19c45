//! Simulated gateways in this process; their state ends with the program.

use std::time::Duration;

use ecan_host::{Identity, SlaveQuery};
use ecan_sim::{FirmwareProgress, FirmwareUpdateError, Gateway, Simulation};

use super::gateways::{Gateways, POLL_INTERVAL};
use super::package::FirmwareFile;
use super::rejection::Rejection;
use crate::context::{Bus, Failure, Result};
use crate::ethercat_tool::SlaveEntry;

const PIECE: usize = 1024;
/// Wait before a write is repeated, in ns.
const BUSY_NS: u64 = 10_000_000;

/// The simulated bus, accessed directly: libethercat has no FoE functions.
#[derive(Debug)]
pub struct Simulated {
    pub bus: Bus,
    pub simulation: Simulation,
}

impl Simulated {
    fn until_done(
        &self,
        slave: usize,
        action: impl Fn(&mut Gateway, u64) -> Result<FirmwareProgress, FirmwareUpdateError>,
    ) -> Result<(), Rejection> {
        loop {
            let done = self.simulation.with_world(|world| {
                world.gateway_at(slave).and_then(|index| world.with_gateway(index, &action))
            });
            match done {
                None => return Err(Rejection::new(format!("slave {slave} is not a gateway"))),
                Some(Ok(FirmwareProgress::Done)) => return Ok(()),
                Some(Ok(FirmwareProgress::Busy { .. })) => self.simulation.pass_ns(BUSY_NS),
                Some(Err(error)) => {
                    return Err(Rejection::new(format!("{}: {error}", error.foe_text())));
                }
            }
        }
    }
}

impl Gateways for Simulated {
    fn present(&self) -> Result<Vec<SlaveEntry>> {
        let mut present = Vec::new();
        for (slave, info) in self.bus.slaves()?.into_iter().enumerate() {
            let state = self.bus.diagnostics().al_state(slave)?;
            present.push(SlaveEntry {
                position: info.position.into(),
                alias: (info.alias != 0).then_some(info.alias),
                state: state.map_or_else(|| info.al_state.to_string(), |it| it.to_string()),
                al_state: state,
            });
        }
        Ok(present)
    }

    fn identity(&self, slave: usize) -> Result<Identity> {
        SlaveQuery::identity(self.bus.diagnostics(), slave).map_err(Failure::Device)
    }

    fn number(&self, slave: usize, index: u16, subindex: u8) -> Result<u32> {
        self.bus.read(slave, index, subindex)
    }

    fn is_denial(&self, failure: &Failure) -> bool {
        matches!(failure, Failure::Device(error) if self.bus.diagnostics().is_denial(error))
    }

    fn software_version(&self, slave: usize) -> Result<String> {
        self.bus.text(slave, 0x100A)
    }

    fn write(
        &self,
        slave: usize,
        file: &FirmwareFile,
        progress: &dyn Fn(u64),
    ) -> Result<(), Rejection> {
        self.until_done(slave, |gateway, now| {
            gateway.begin_firmware_update(now).map(|()| FirmwareProgress::Done)
        })?;
        let mut taken = 0;
        for piece in file.bytes.chunks(PIECE) {
            self.until_done(slave, |gateway, now| gateway.write_firmware(now, piece))?;
            taken += piece.len() as u64;
            progress(taken);
        }
        self.until_done(slave, Gateway::finish_firmware_update)
    }

    fn pause(&self) {
        self.simulation.pass_ns(POLL_INTERVAL.as_nanos() as u64);
    }

    fn now(&self) -> Duration {
        Duration::from_nanos(self.bus.clock().now_ns())
    }
}
