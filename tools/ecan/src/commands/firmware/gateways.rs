//! Gateways of a bus, for firmware updates.

use std::time::Duration;

use ecan_host::{Identity, SlaveKind, SlaveQuery, slave_kinds};
use ecan_protocol::device::{AlState, Capabilities};
use serde::Serialize;

use super::rejection::Rejection;
use crate::context::{Failure, Result};
use crate::ethercat_tool::SlaveEntry;
use crate::firmware_version::{FirmwareVersion, serial_number};
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
        unknown: unknown.into_iter().filter_map(|it| Some((at(it.position)?, it))).collect(),
    })
}
