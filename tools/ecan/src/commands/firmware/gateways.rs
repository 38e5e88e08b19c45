//! The gateways of a bus, as keeping their firmware needs them.

use std::time::Duration;

use ecan_host::{Identity, SlaveInquiry, SlaveKind, slave_kinds};
use ecan_protocol::AlState;
use serde::Serialize;

use super::refusal::Refusal;
use crate::failure::Failure;
use crate::slave_choice::{Candidates, Recognised, SlaveChoice, Unknown, choose, only_gateway};

/// A slave that is there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Present {
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
    fn present(&self) -> Result<Vec<Present>, Failure>;

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
    ) -> Result<(), Refusal>;

    /// Lets [`LOOK_EVERY`] pass.
    fn pause(&self);

    /// Time of the clock that waiting goes by, since any moment.
    fn now(&self) -> Duration;
}

/// Which firmware a gateway runs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Running {
    /// 0x100A, where the gateway has it.
    pub software_version: Option<String>,
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
        let word = |subindex| gateways.number(slave, subindex).map(|value| value as u16);
        Ok(Self {
            version: word(5)?,
            build: word(6)?,
            serial: serial(gateways, slave)?,
            software_version: match gateways.software_version(slave) {
                Err(failure) if gateways.is_denial(&failure) => None,
                read => Some(read?),
            },
        })
    }

    /// As MAJOR.MINOR.BUILD.
    pub fn numbers(&self) -> String {
        let [major, minor] = self.version.to_be_bytes();
        format!("{major}.{minor}.{}", self.build)
    }

    /// Whether it is the version that the user names: by 0x100A, or in numbers.
    pub fn is_version(&self, named: &str) -> bool {
        Some(named) == self.software_version.as_deref() || named == self.numbers()
    }
}

impl std::fmt::Display for Running {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let numbers = self.numbers();
        match &self.software_version {
            Some(text) if *text != numbers => write!(formatter, "{text} ({numbers})"),
            _ => formatter.write_str(&numbers),
        }
    }
}

fn serial(gateways: &dyn Gateways, slave: usize) -> Result<u64, Failure> {
    let half = |subindex| gateways.number(slave, subindex).map(u64::from);
    Ok(half(7)? | half(8)? << 32)
}

/// The slaves that are there, to be asked.
struct Asked<'a> {
    gateways: &'a dyn Gateways,
    present: &'a [Present],
}

impl SlaveInquiry for Asked<'_> {
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

impl Candidates for Asked<'_> {
    fn places(&self) -> Result<Vec<(usize, u16)>, Failure> {
        let place = |slave: &Present| (slave.position, slave.alias.unwrap_or(0));
        Ok(self.present.iter().map(place).collect())
    }

    fn recognised(&self) -> Result<Recognised, Failure> {
        let positions: Vec<_> = self.present.iter().map(|slave| slave.position).collect();
        let kinds = slave_kinds(self, &positions);
        Ok(Recognised::new(positions.into_iter().zip(kinds)))
    }

    fn serial(&self, slave: usize) -> Result<u64, Failure> {
        serial(self.gateways, slave)
    }
}

/// Why a slave gets no firmware for an ECAN-Lite; `None` where it is one.
pub fn reason_against(gateways: &dyn Gateways, slave: &Present) -> Option<String> {
    let asked = Asked { gateways, present: std::slice::from_ref(slave) };
    match slave_kinds(&asked, &[slave.position]).into_iter().next() {
        Some(SlaveKind::Gateway) => None,
        Some(SlaveKind::Unknown(why)) => Some(why.to_string()),
        Some(SlaveKind::Other) | None => {
            Some("it does not show itself as an ECAN-Lite (0xF000)".to_owned())
        }
    }
}

/// What the user means.
pub struct Chosen {
    /// The gateways: one, or all.
    pub gateways: Vec<Present>,
    /// Of all, those that cannot be asked.
    pub unknown: Vec<Unknown>,
}

/// The gateways that the user means: one, or all.
pub fn chosen(
    gateways: &dyn Gateways,
    choice: Option<SlaveChoice>,
    all: bool,
) -> Result<Chosen, Failure> {
    let present = gateways.present()?;
    let asked = Asked { gateways, present: &present };
    let (meant, unknown) = match choice {
        Some(_) => (vec![choose(&asked, choice)?], Vec::new()),
        None => {
            let recognised = asked.recognised()?;
            match recognised.gateways.len() + recognised.unknown.len() {
                1.. if all => (recognised.gateways, recognised.unknown),
                count => {
                    let only = only_gateway(&recognised, present.len());
                    (vec![only.map_err(|failure| or_all(failure, count))?], Vec::new())
                }
            }
        }
    };
    let is_meant = |slave: &Present| meant.contains(&slave.position);
    Ok(Chosen { gateways: present.iter().filter(|it| is_meant(it)).cloned().collect(), unknown })
}

/// Names the other way out, where several are in question.
fn or_all(failure: Failure, count: usize) -> Failure {
    match failure {
        Failure::Slave(words) if count > 1 => Failure::Slave(format!("{words}, or take --all")),
        other => other,
    }
}
