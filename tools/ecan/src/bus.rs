//! The bus that the commands look at, and which of its slaves is meant.

use std::str::FromStr;

use ecan_host::{Clock, Diagnostics, Ecrt, Error, SlaveInfo};
use ecan_protocol::{AlState, Recognition};
use ecan_sim::{Backend, ClockKind, EcrtSetting, SimOptions};

use crate::failure::Failure;
use crate::global::GlobalOptions;
use crate::output::Output;

/// The slave that the user names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlaveChoice {
    /// By its place in the ring, from 0.
    Position(usize),
    /// By its station alias.
    Alias(u16),
    /// By the serial number of 0xF000:07 and :08.
    Serial(u64),
}

impl FromStr for SlaveChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let wrong = || "expected a position, alias=NUMBER or serial=NUMBER".to_owned();
        match text.split_once('=') {
            None => text.parse().map(Self::Position).map_err(|_| wrong()),
            Some(("alias", number)) => {
                let alias = crate::value::parse_unsigned(number).ok_or_else(wrong)?;
                u16::try_from(alias).map(Self::Alias).map_err(|_| wrong())
            }
            Some(("serial", number)) => {
                crate::value::parse_unsigned(number).map(Self::Serial).ok_or_else(wrong)
            }
            Some(_) => Err(wrong()),
        }
    }
}

/// A bus, looked at through a handle that reserves nothing.
#[derive(Debug)]
pub struct Bus {
    ecrt: Ecrt,
    diagnostics: Diagnostics,
    choice: Option<SlaveChoice>,
}

impl Bus {
    /// Opens the library and the master; says on standard error when they are simulated.
    pub fn open(global: &GlobalOptions, output: &Output) -> Result<Self, Failure> {
        Self::open_with_clock(global, output, ClockKind::Stepped)
    }

    /// As [`open`](Self::open), with the clock of a simulation that names none.
    pub fn open_with_clock(
        global: &GlobalOptions,
        output: &Output,
        clock: ClockKind,
    ) -> Result<Self, Failure> {
        let setting = EcrtSetting::resolve(global.ecrt.as_deref())?;
        let options = SimOptions { clock: Some(clock), ..SimOptions::default() };
        Self::of(&ecan_sim::open(&setting, &options)?, global, output)
    }

    /// The bus of a library that is open already.
    pub fn of(backend: &Backend, global: &GlobalOptions, output: &Output) -> Result<Self, Failure> {
        if let Some(simulation) = &backend.simulation {
            output.note(simulation.banner());
        }
        let master = |error: Error| Failure::Master(error.to_string());
        let diagnostics = Diagnostics::of_bus(&backend.ecrt, global.master).map_err(master)?;
        if !diagnostics.master_state().map_err(master)?.link_up {
            let words = format!(
                "master {} has no link: is the cable plugged in, is the first slave powered?",
                global.master
            );
            return Err(Failure::Master(words));
        }
        Ok(Self { ecrt: backend.ecrt.clone(), diagnostics, choice: global.slave })
    }

    /// The library.
    pub fn ecrt(&self) -> &Ecrt {
        &self.ecrt
    }

    pub fn diagnostics(&self) -> &Diagnostics {
        &self.diagnostics
    }

    /// The clock that waiting for a slave goes by.
    pub fn clock(&self) -> &dyn Clock {
        self.ecrt.clock().as_ref()
    }

    /// What the master knows of each slave.
    pub fn slaves(&self) -> Result<Vec<SlaveInfo>, Failure> {
        let infos = (0..self.diagnostics.slave_count()).map(|at| self.diagnostics.slave_info(at));
        infos.collect::<Result<_, _>>().map_err(Failure::Device)
    }

    /// Whether a slave is an ECAN-Lite, by 0xF000. A slave that cannot be asked is none.
    pub fn is_gateway(&self, slave: usize) -> bool {
        let has_mailbox = self.diagnostics.al_state(slave).is_ok_and(|state| {
            state.is_some_and(|state| state.has_mailbox() && state != AlState::Boot)
        });
        let upload = |subindex| self.diagnostics.sdo_upload_u32(slave, 0xF000, subindex);
        has_mailbox && Recognition::read(upload).is_ok_and(|it| it.looks_like_ecan_lite())
    }

    /// Whether the user named a slave.
    pub fn is_chosen(&self) -> bool {
        self.choice.is_some()
    }

    /// The slave that the command is about: the one chosen, or the only gateway.
    pub fn slave(&self) -> Result<usize, Failure> {
        let count = self.diagnostics.slave_count();
        let has_serial = |slave: usize, serial| {
            self.is_gateway(slave) && self.serial(slave).is_ok_and(|own| own == serial)
        };
        let found = match self.choice {
            None => return self.only_gateway(),
            Some(SlaveChoice::Position(position)) => (position < count).then_some(position),
            Some(SlaveChoice::Alias(alias)) => {
                self.slaves()?.iter().position(|slave| slave.alias == alias)
            }
            Some(SlaveChoice::Serial(serial)) => {
                (0..count).find(|slave| has_serial(*slave, serial))
            }
        };
        found.ok_or_else(|| none_found(self.choice, count))
    }

    fn only_gateway(&self) -> Result<usize, Failure> {
        let count = self.diagnostics.slave_count();
        let gateways: Vec<_> = (0..count).filter(|slave| self.is_gateway(*slave)).collect();
        match gateways[..] {
            [only] => Ok(only),
            [] => Err(none_found(None, count)),
            [..] => Err(Failure::Slave(several_found(gateways))),
        }
    }

    /// Serial number of a gateway.
    pub fn serial(&self, slave: usize) -> Result<u64, Failure> {
        let half = |subindex| {
            let value = self.diagnostics.sdo_upload_u32(slave, 0xF000, subindex);
            value.map(u64::from).map_err(Failure::Device)
        };
        Ok(half(7)? | half(8)? << 32)
    }

    /// Uploads an object of at most 4 bytes.
    pub fn read(&self, slave: usize, index: u16, subindex: u8) -> Result<u32, Failure> {
        self.diagnostics.sdo_upload_u32(slave, index, subindex).map_err(Failure::Device)
    }

    /// Downloads a number, in the size that the table gives the object.
    pub fn write(&self, slave: usize, index: u16, subindex: u8, value: u32) -> Result<(), Failure> {
        let entry = ecan_protocol::lookup(index, subindex).map(|(_, entry)| entry);
        let size = entry.and_then(|entry| entry.ty.size_bytes()).unwrap_or(4);
        let bytes = value.to_le_bytes();
        let data = bytes.get(..size).unwrap_or(&bytes);
        self.diagnostics.sdo_download(slave, index, subindex, data).map_err(Failure::Device)
    }

    /// A text object; empty where the slave does not have it.
    pub fn text(&self, slave: usize, index: u16) -> String {
        let mut bytes = [0; 64];
        let length = self.diagnostics.sdo_upload(slave, index, 0, &mut bytes).unwrap_or(0);
        let text = String::from_utf8_lossy(bytes.get(..length).unwrap_or_default());
        text.trim_end_matches('\0').to_owned()
    }
}

/// Why none of so many slaves is the one that is meant.
pub fn none_found(choice: Option<SlaveChoice>, slaves: usize) -> Failure {
    let words = match (choice, slaves) {
        (_, 0) => "no slave answers on the bus".to_owned(),
        (None, _) => format!(
            "none of the {slaves} slaves shows itself as an ECAN-Lite; choose one with --slave"
        ),
        (Some(SlaveChoice::Position(position)), 1) => {
            format!("there is no slave {position}: there is only slave 0")
        }
        (Some(SlaveChoice::Position(position)), _) => {
            format!("there is no slave {position}: there are slaves 0 to {}", slaves - 1)
        }
        (Some(SlaveChoice::Alias(alias)), _) => {
            format!("no slave has the alias {alias}; see `ecan scan`")
        }
        (Some(SlaveChoice::Serial(serial)), _) => {
            format!("no gateway has the serial number {serial}; see `ecan scan`")
        }
    };
    Failure::Slave(words)
}

/// That the gateways at these positions leave a choice.
pub fn several_found(positions: impl IntoIterator<Item = usize>) -> String {
    let places: Vec<_> = positions.into_iter().map(|it| it.to_string()).collect();
    format!("there are several gateways; choose one with --slave, of {}", places.join(", "))
}

/// A bus over a simulation that a test holds in its hands.
#[cfg(test)]
impl Bus {
    pub fn over(ecrt: &Ecrt) -> Self {
        let diagnostics = Diagnostics::of_bus(ecrt, 0).unwrap();
        Self { ecrt: ecrt.clone(), diagnostics, choice: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slaves_are_chosen_by_position_alias_or_serial_number() {
        let parse = |text: &str| text.parse::<SlaveChoice>();
        assert_eq!(parse("3"), Ok(SlaveChoice::Position(3)));
        assert_eq!(parse("alias=0x1001"), Ok(SlaveChoice::Alias(0x1001)));
        assert_eq!(parse("serial=4294967297"), Ok(SlaveChoice::Serial(0x1_0000_0001)));
        for wrong in ["", "-1", "alias=", "alias=65536", "name=x", "0x"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
