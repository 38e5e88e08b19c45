//! Gateways of a bus for firmware updates, by the ethercat tool or simulated in this process.

use std::path::Path;
use std::time::{Duration, Instant};

use ecan_host::{Identity, SlaveKind, SlaveQuery, slave_kinds};
use ecan_protocol::device::{AlState, Capabilities};
use ecan_sim::{FirmwareProgress, FirmwareUpdateError, Gateway, Simulation};
use serde::Serialize;

use super::package::{FirmwareFile, Rejection};
use crate::bus::{FirmwareVersion, serial_number};
use crate::context::{Bus, Failure, Result};
use crate::ethercat_tool::{EthercatTool, SlaveEntry, is_denial};
use crate::slave_choice::{Candidates, Recognised, SlaveChoice, Unknown, one_or_all};

/// Poll interval during the restart of a gateway.
pub const POLL_INTERVAL: Duration = Duration::from_millis(500);

/// Bus with access to the firmware of its gateways.
pub trait Gateways {
    fn present(&self) -> Result<Vec<SlaveEntry>>;

    /// Vendor ID and product code in the SII.
    fn identity(&self, slave: usize) -> Result<Identity>;

    fn number(&self, slave: usize, index: u16, subindex: u8) -> Result<u32>;

    /// Returns whether an error means that the slave does not have the object.
    fn is_denial(&self, failure: &Failure) -> bool;

    /// Reads 0x100A.
    fn software_version(&self, slave: usize) -> Result<String>;

    /// Writes the file; `progress` gets the number of accepted bytes, if known.
    fn write(
        &self,
        slave: usize,
        file: &super::package::FirmwareFile,
        progress: &dyn Fn(u64),
    ) -> Result<(), Rejection>;

    fn pause(&self);

    fn now(&self) -> Duration;
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Running {
    #[serde(flatten)]
    pub version: FirmwareVersion,
    /// 0xF000:07 and :08.
    pub serial: u64,
}

impl Running {
    pub fn read(gateways: &dyn Gateways, slave: usize) -> Result<Self> {
        let number = |subindex| gateways.number(slave, Capabilities::INDEX, subindex);
        // The numbers first: they show whether the gateway responds.
        let (mut version, serial) = (FirmwareVersion::read(None, number)?, serial_number(number)?);
        version.firmware = match gateways.software_version(slave) {
            Err(failure) if gateways.is_denial(&failure) => None,
            read => Some(read?),
        };
        Ok(Self { version, serial })
    }
}

impl std::fmt::Display for Running {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.version.fmt(formatter)
    }
}

struct SlaveQueryAdapter<'a> {
    gateways: &'a dyn Gateways,
    present: &'a [SlaveEntry],
}

impl SlaveQuery for SlaveQueryAdapter<'_> {
    type Error = Failure;

    fn al_state(&self, slave: usize) -> Result<Option<AlState>> {
        let found = self.present.iter().find(|present| present.position == slave);
        Ok(found.and_then(|present| present.al_state))
    }

    fn identity(&self, slave: usize) -> Result<Identity> {
        self.gateways.identity(slave)
    }

    fn upload(&self, slave: usize, subindex: u8) -> Result<u32> {
        self.gateways.number(slave, Capabilities::INDEX, subindex)
    }

    fn is_denial(&self, error: &Failure) -> bool {
        self.gateways.is_denial(error)
    }
}

impl Candidates for SlaveQueryAdapter<'_> {
    fn positions(&self) -> Result<Vec<(usize, u16)>> {
        let position = |slave: &SlaveEntry| (slave.position, slave.alias.unwrap_or(0));
        Ok(self.present.iter().map(position).collect())
    }

    fn recognised(&self) -> Result<Recognised> {
        let positions: Vec<_> = self.present.iter().map(|slave| slave.position).collect();
        let kinds = slave_kinds(self, &positions);
        Ok(Recognised::new(positions.into_iter().zip(kinds)))
    }

    fn serial(&self, slave: usize) -> Result<u64> {
        serial_number(|subindex| self.upload(slave, subindex))
    }
}

/// Reason why a slave is not an ECAN-Lite; `None` if it is one.
pub fn reason_against(gateways: &dyn Gateways, slave: &SlaveEntry) -> Option<String> {
    let asked = SlaveQueryAdapter { gateways, present: std::slice::from_ref(slave) };
    match slave_kinds(&asked, &[slave.position]).into_iter().next() {
        Some(SlaveKind::Gateway) => None,
        Some(SlaveKind::Unknown(why)) => Some(why.to_string()),
        Some(SlaveKind::Other) | None => Some("not identified as an ECAN-Lite (0xF000)".to_owned()),
    }
}

pub struct Selection {
    pub gateways: Vec<SlaveEntry>,
    /// Slaves that cannot be identified, with `--all`.
    pub unknown: Vec<(SlaveEntry, Unknown)>,
}

pub fn chosen(
    gateways: &dyn Gateways,
    choice: Option<SlaveChoice>,
    all: bool,
) -> Result<Selection> {
    let present = gateways.present()?;
    let asked = SlaveQueryAdapter { gateways, present: &present };
    let Recognised { gateways: meant, unknown } = one_or_all(&asked, choice, all)?;
    let at = |position| present.iter().find(|slave| slave.position == position).cloned();
    Ok(Selection {
        gateways: meant.into_iter().filter_map(at).collect(),
        unknown: unknown
            .into_iter()
            .filter_map(|unknown| Some((at(unknown.position)?, unknown)))
            .collect(),
    })
}

/// Name of the firmware file on a gateway (manual 15.3.1).
const FILE_NAME: &str = "ecan_lite_app";

/// Uses the tool for every access, so that the checks before and after the update use the same
/// master.
#[derive(Debug)]
pub struct ByTool {
    tool: EthercatTool,
    opened: Instant,
}

impl ByTool {
    pub fn open(named: Option<&Path>, master: u32) -> Result<Self> {
        let tool = EthercatTool::find(named, master).map_err(Failure::from)?;
        Ok(Self { tool, opened: Instant::now() })
    }

    /// Variant for writing: Ctrl-C does not terminate the tool during a transfer.
    pub fn shielded(self) -> Self {
        Self { tool: self.tool.shielded(), ..self }
    }
}

impl Gateways for ByTool {
    fn present(&self) -> Result<Vec<SlaveEntry>> {
        self.tool.slaves().map_err(Failure::from)
    }

    fn identity(&self, slave: usize) -> Result<Identity> {
        let (vendor_id, product_code) = self.tool.identity(slave).map_err(Failure::from)?;
        Ok(Identity { vendor_id, product_code })
    }

    fn number(&self, slave: usize, index: u16, subindex: u8) -> Result<u32> {
        self.tool.upload_number(slave, index, subindex).map_err(Failure::from)
    }

    fn is_denial(&self, failure: &Failure) -> bool {
        matches!(failure, Failure::Rejected(message) if is_denial(message))
    }

    fn software_version(&self, slave: usize) -> Result<String> {
        self.tool.upload_text(slave, 0x100A).map_err(Failure::from)
    }

    fn write(
        &self,
        slave: usize,
        file: &FirmwareFile,
        _progress: &dyn Fn(u64),
    ) -> Result<(), Rejection> {
        Ok(self.tool.foe_write(slave, FILE_NAME, &file.path)?)
    }

    fn pause(&self) {
        std::thread::sleep(POLL_INTERVAL);
    }

    fn now(&self) -> Duration {
        self.opened.elapsed()
    }
}

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
                state: state.map_or_else(|| info.al_state.to_string(), |state| state.to_string()),
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
