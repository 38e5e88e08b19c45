//! The gateways of a bus, as keeping their firmware needs them.

use std::time::Duration;

use ecan_host::{Identity, SlaveKind, SlaveQuery, slave_kinds};
use ecan_protocol::device::AlState;
use serde::Serialize;

use super::rejection::Rejection;
use crate::failure::Failure;
use crate::firmware_version::{FirmwareVersion, serial_number};
use crate::slave_choice::{Candidates, Recognised, SlaveChoice, Unknown, one_or_all};

/// A slave that is there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SlaveEntry {
    /// Place in the ring.
    pub position: usize,
    /// Its alias, if it has one.
    pub alias: Option<u16>,
    /// AL state in words.
    pub state: String,
    /// AL state; `None` for words that are none.
    pub al_state: Option<AlState>,
}

/// How often a gateway is looked for while it restarts.
pub const LOOK_EVERY: Duration = Duration::from_millis(500);

/// A bus, and how a firmware file gets to a gateway on it.
pub trait Gateways {
    /// Who is there.
    fn present(&self) -> Result<Vec<SlaveEntry>, Failure>;

    /// What the master read in the slave's SII.
    fn identity(&self, slave: usize) -> Result<Identity, Failure>;

    /// A number of 0xF000.
    fn number(&self, slave: usize, subindex: u8) -> Result<u32, Failure>;

    /// Whether this is the slave's answer that it has no such number.
    fn is_denial(&self, failure: &Failure) -> bool;

    /// 0x100A.
    fn software_version(&self, slave: usize) -> Result<String, Failure>;

    /// 0xB000:11, what the gateway itself says of its last firmware transfer.
    fn foe_status(&self, slave: usize) -> Result<u32, Failure>;

    /// Writes the file; `progress` gets the bytes that were taken so far, where that is known.
    fn write(
        &self,
        slave: usize,
        file: &super::package::FirmwareFile,
        progress: &dyn Fn(u64),
    ) -> Result<(), Rejection>;

    /// Lets [`LOOK_EVERY`] pass.
    fn pause(&self);

    /// Time of the clock that waiting goes by, since any moment.
    fn now(&self) -> Duration;
}

/// Which firmware a gateway runs, and which gateway it is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Running {
    /// Its firmware.
    #[serde(flatten)]
    pub version: FirmwareVersion,
    /// 0xF000:07 and :08.
    pub serial: u64,
}

impl Running {
    /// Reads all of it.
    pub fn read(gateways: &dyn Gateways, slave: usize) -> Result<Self, Failure> {
        let number = |subindex| gateways.number(slave, subindex);
        // The numbers first: they tell whether it answers at all.
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

/// The slaves that are there, to be asked.
struct SlaveQueryAdapter<'a> {
    gateways: &'a dyn Gateways,
    present: &'a [SlaveEntry],
}

impl SlaveQuery for SlaveQueryAdapter<'_> {
    type Error = Failure;

    fn al_state(&self, slave: usize) -> Result<Option<AlState>, Failure> {
        let found = self.present.iter().find(|present| present.position == slave);
        Ok(found.and_then(|present| present.al_state))
    }

    fn identity(&self, slave: usize) -> Result<Identity, Failure> {
        self.gateways.identity(slave)
    }

    fn upload(&self, slave: usize, subindex: u8) -> Result<u32, Failure> {
        self.gateways.number(slave, subindex)
    }

    fn is_denial(&self, error: &Failure) -> bool {
        self.gateways.is_denial(error)
    }
}

impl Candidates for SlaveQueryAdapter<'_> {
    fn places(&self) -> Result<Vec<(usize, u16)>, Failure> {
        let place = |slave: &SlaveEntry| (slave.position, slave.alias.unwrap_or(0));
        Ok(self.present.iter().map(place).collect())
    }

    fn recognised(&self) -> Result<Recognised, Failure> {
        let positions: Vec<_> = self.present.iter().map(|slave| slave.position).collect();
        let kinds = slave_kinds(self, &positions);
        Ok(Recognised::new(positions.into_iter().zip(kinds)))
    }

    fn serial(&self, slave: usize) -> Result<u64, Failure> {
        serial_number(|subindex| self.gateways.number(slave, subindex))
    }
}

/// Why a slave gets no firmware for an ECAN-Lite; `None` where it is one.
pub fn reason_against(gateways: &dyn Gateways, slave: &SlaveEntry) -> Option<String> {
    let asked = SlaveQueryAdapter { gateways, present: std::slice::from_ref(slave) };
    match slave_kinds(&asked, &[slave.position]).into_iter().next() {
        Some(SlaveKind::Gateway) => None,
        Some(SlaveKind::Unknown(why)) => Some(why.to_string()),
        Some(SlaveKind::Other) | None => {
            Some("it does not show itself as an ECAN-Lite (0xF000)".to_owned())
        }
    }
}

/// What the user means.
pub struct Selection {
    /// The gateways: one, or all.
    pub gateways: Vec<SlaveEntry>,
    /// Of all, those that cannot be asked.
    pub unknown: Vec<(SlaveEntry, Unknown)>,
}

/// The gateways that the user means: one, or all.
pub fn chosen(
    gateways: &dyn Gateways,
    choice: Option<SlaveChoice>,
    all: bool,
) -> Result<Selection, Failure> {
    let present = gateways.present()?;
    let asked = SlaveQueryAdapter { gateways, present: &present };
    let Recognised { gateways: meant, unknown } = one_or_all(&asked, choice, all)?;
    let at = |position| present.iter().find(|slave| slave.position == position).cloned();
    Ok(Selection {
        gateways: meant.into_iter().filter_map(at).collect(),
        unknown: unknown.into_iter().filter_map(|it| Some((at(it.position)?, it))).collect(),
    })
}
