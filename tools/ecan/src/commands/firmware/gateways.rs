//! The gateways of a bus, as keeping their firmware needs them.

use std::time::Duration;

use ecan_protocol::Recognition;
use serde::Serialize;

use super::refusal::Refusal;
use crate::bus::{SlaveChoice, none_found, several_found};
use crate::failure::Failure;

/// A slave that is there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Present {
    /// Place in the ring.
    pub position: usize,
    /// Its alias, if it has one.
    pub alias: Option<u16>,
    /// AL state in words.
    pub state: String,
}

/// An object of a gateway that is read here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Number {
    /// 16 bits of 0xF000.
    U16(u8),
    /// 32 bits of 0xF000.
    U32(u8),
}

/// How often a gateway is looked for while it restarts.
pub const LOOK_EVERY: Duration = Duration::from_millis(500);

/// A bus, and how a firmware file gets to a gateway on it.
pub trait Gateways {
    /// Who is there.
    fn present(&self) -> Result<Vec<Present>, Failure>;

    /// A number of 0xF000.
    fn number(&self, slave: usize, which: Number) -> Result<u32, Failure>;

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
    ) -> Result<(), Refusal>;

    /// Lets [`LOOK_EVERY`] pass.
    fn pause(&self);
}

/// Which firmware a gateway runs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Running {
    /// 0x100A.
    pub software_version: String,
    /// 0xF000:05, the high byte is major and the low byte is minor.
    pub version: u16,
    /// 0xF000:06.
    pub build: u16,
    /// 0xF000:07 and :08.
    pub serial: u64,
}

impl Running {
    /// Reads all of it.
    pub fn read(gateways: &dyn Gateways, slave: usize) -> Result<Self, Failure> {
        let number = |which| gateways.number(slave, which);
        let word = |which| number(which).map(|value| value as u16);
        Ok(Self {
            version: word(Number::U16(5))?,
            build: word(Number::U16(6))?,
            serial: serial(gateways, slave)?,
            software_version: gateways.software_version(slave)?,
        })
    }

    /// As MAJOR.MINOR.BUILD.
    pub fn numbers(&self) -> String {
        let [major, minor] = self.version.to_be_bytes();
        format!("{major}.{minor}.{}", self.build)
    }

    /// Whether it is the version that the user names: by 0x100A, or in numbers.
    pub fn is_version(&self, named: &str) -> bool {
        named == self.software_version || named == self.numbers()
    }
}

impl std::fmt::Display for Running {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (text, numbers) = (&self.software_version, self.numbers());
        if *text == numbers || text.is_empty() {
            formatter.write_str(&numbers)
        } else {
            write!(formatter, "{text} ({numbers})")
        }
    }
}

fn serial(gateways: &dyn Gateways, slave: usize) -> Result<u64, Failure> {
    let half = |subindex| gateways.number(slave, Number::U32(subindex)).map(u64::from);
    Ok(half(7)? | half(8)? << 32)
}

/// Whether a slave is an ECAN-Lite, by 0xF000. One that cannot be asked is none.
pub fn is_gateway(gateways: &dyn Gateways, slave: &Present) -> bool {
    let read = |subindex| gateways.number(slave.position, Number::U16(subindex));
    slave.state != "INIT" && Recognition::read(read).is_ok_and(|it| it.looks_like_ecan_lite())
}

/// The gateways that the user means: one, or all.
pub fn chosen(
    gateways: &dyn Gateways,
    choice: Option<SlaveChoice>,
    all: bool,
) -> Result<Vec<Present>, Failure> {
    let present = gateways.present()?;
    let count = present.len();
    let of_serial = |slave: &Present, wanted| {
        is_gateway(gateways, slave)
            && serial(gateways, slave.position).is_ok_and(|own| own == wanted)
    };
    let found: Vec<_> = match choice {
        None => present.into_iter().filter(|slave| is_gateway(gateways, slave)).collect(),
        Some(SlaveChoice::Position(position)) => {
            present.into_iter().filter(|slave| slave.position == position).collect()
        }
        Some(SlaveChoice::Alias(alias)) => {
            present.into_iter().filter(|slave| slave.alias == Some(alias)).collect()
        }
        Some(SlaveChoice::Serial(serial)) => {
            present.into_iter().filter(|slave| of_serial(slave, serial)).collect()
        }
    };
    match (&found[..], choice) {
        ([], _) => Err(none_found(choice, count)),
        ([_], _) => Ok(found),
        ([_, ..], None) if all => Ok(found),
        ([first, ..], Some(_)) => Ok(vec![first.clone()]),
        ([_, ..], None) => {
            let words = several_found(found.iter().map(|it| it.position));
            Err(Failure::Slave(format!("{words}, or take --all")))
        }
    }
}
