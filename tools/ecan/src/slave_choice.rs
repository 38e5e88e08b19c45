//! Selection of a slave on a bus.

use std::fmt::{self, Display};
use std::str::FromStr;

use clap::Args;
use ecan_host::{Error, SlaveKind};

use crate::failure::{Failure, Result};
use crate::value::parse_unsigned;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlaveChoice {
    Position(usize),
    Alias(u16),
    /// Serial number of 0xF000:07 and :08.
    Serial(u64),
}

/// `--all` of a command for one gateway.
#[derive(Clone, Copy, Debug, Args)]
pub struct AllArgument {
    /// Process all gateways of the bus in turn; JSON output is a list
    #[arg(long)]
    pub all: bool,
}

impl FromStr for SlaveChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let wrong = || "expected a position, alias=NUMBER or serial=NUMBER".to_owned();
        let unset = |why: &str| Err(format!("{why}; select the slave by its position"));
        match text.split_once('=') {
            None => text.parse().map(Self::Position).map_err(|_| wrong()),
            Some(("alias", number)) => {
                let alias = parse_unsigned(number).ok_or_else(wrong)?;
                match u16::try_from(alias).map_err(|_| wrong())? {
                    0 => unset("alias 0 means no alias"),
                    alias => Ok(Self::Alias(alias)),
                }
            }
            Some(("serial", number)) => match parse_unsigned(number).ok_or_else(wrong)? {
                0 | u64::MAX => unset(&format!("serial number {number} means no serial number")),
                serial => Ok(Self::Serial(serial)),
            },
            Some(_) => Err(wrong()),
        }
    }
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Recognised {
    pub gateways: Vec<usize>,
    /// Slaves that may be gateways.
    pub unknown: Vec<Unknown>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unknown {
    pub position: usize,
    pub reason: String,
}

impl Display for Unknown {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "slave {} {}", self.position, self.text())
    }
}

impl Unknown {
    pub fn text(&self) -> String {
        format!("cannot be identified: {}", self.reason)
    }
}

impl Recognised {
    pub fn new<E: Display>(kinds: impl IntoIterator<Item = (usize, SlaveKind<E>)>) -> Self {
        let mut recognised = Self::default();
        for (position, kind) in kinds {
            match kind {
                SlaveKind::Gateway => recognised.gateways.push(position),
                SlaveKind::Unknown(why) => {
                    let reason = why.to_string();
                    recognised.unknown.push(Unknown { position, reason });
                }
                SlaveKind::Other => {}
            }
        }
        recognised
    }
}

/// Slaves of a bus, for the selection of one.
pub trait Candidates {
    /// Position and alias of each slave; alias 0 means none.
    fn positions(&self) -> Result<Vec<(usize, u16)>>;

    fn recognised(&self) -> Result<Recognised>;

    fn serial(&self, slave: usize) -> Result<u64>;
}

/// Returns the selected slave, or the only gateway.
pub fn choose(candidates: &impl Candidates, choice: Option<SlaveChoice>) -> Result<usize> {
    let slaves = candidates.positions()?;
    let count = slaves.len();
    let positions = |is_it: &dyn Fn(&(usize, u16)) -> bool| -> Vec<_> {
        slaves.iter().filter(|slave| is_it(slave)).map(|(position, _)| *position).collect()
    };
    match choice {
        None => only_gateway(&candidates.recognised()?, count),
        Some(SlaveChoice::Position(expected)) => {
            one_of(&positions(&|(position, _)| *position == expected), choice, count)
        }
        Some(SlaveChoice::Alias(expected)) => {
            one_of(&positions(&|(_, alias)| *alias == expected), choice, count)
        }
        Some(SlaveChoice::Serial(expected)) => of_serial(candidates, expected, count),
    }
}

fn one_of(found: &[usize], choice: Option<SlaveChoice>, slaves: usize) -> Result<usize> {
    match found {
        [only] => Ok(*only),
        [] => Err(none_found(choice, slaves)),
        several => {
            let what = match choice {
                Some(SlaveChoice::Serial(serial)) => format!("serial number {serial}"),
                Some(SlaveChoice::Alias(alias)) => format!("alias {alias}"),
                Some(SlaveChoice::Position(_)) | None => "position".to_owned(),
            };
            let several = list(several);
            let message =
                format!("slaves {several} have the same {what}; select one by its position");
            Err(Failure::Slave(message))
        }
    }
}

/// Returns the only gateway, if every other slave is identified.
pub fn only_gateway(recognised: &Recognised, slaves: usize) -> Result<usize> {
    match (&recognised.gateways[..], &recognised.unknown[..]) {
        ([only], []) => Ok(*only),
        ([], []) => Err(none_found(None, slaves)),
        (several, []) => Err(Failure::Slave(several_found(several))),
        (gateways, [first, ..]) => {
            let unknown = recognised.unknown.iter().map(|slave| slave.position);
            let mut all: Vec<_> = gateways.iter().copied().chain(unknown).collect();
            all.sort_unstable();
            let message = match all[..] {
                [only] => format!("{first}; if it is an ECAN-Lite, select it with --slave {only}"),
                _ => format!("{first}; select one with --slave: {}", list(&all)),
            };
            Err(Failure::Slave(message))
        }
    }
}

/// Returns the only or selected gateway, or all with `--all`.
///
/// # Errors
/// [`Failure::Usage`] if both options are given.
/// [`Failure::Slave`] if the slave does not exist, the selection is ambiguous, or there is no
/// gateway. With `--all` the caller handles slaves that cannot be identified.
pub fn one_or_all(
    candidates: &impl Candidates,
    choice: Option<SlaveChoice>,
    all: bool,
) -> Result<Recognised> {
    let only = |gateway| Recognised { gateways: vec![gateway], unknown: Vec::new() };
    if choice.is_some() && all {
        return Err(Failure::Usage("--slave and --all exclude each other".to_owned()));
    }
    if choice.is_some() {
        return choose(candidates, choice).map(only);
    }
    let recognised = candidates.recognised()?;
    match recognised.gateways.len() + recognised.unknown.len() {
        1.. if all => Ok(recognised),
        count => match only_gateway(&recognised, candidates.positions()?.len()) {
            // Suggests --all if there are several candidates.
            Err(Failure::Slave(message)) if count > 1 => {
                Err(Failure::Slave(format!("{message}, or all with --all")))
            }
            other => other.map(only),
        },
    }
}

/// Returns every gateway, if every other slave is identified.
pub fn every_gateway(candidates: &impl Candidates) -> Result<Vec<usize>> {
    let recognised = candidates.recognised()?;
    if recognised.gateways.is_empty() || !recognised.unknown.is_empty() {
        // Returns the reason.
        only_gateway(&recognised, candidates.positions()?.len())?;
    }
    Ok(recognised.gateways)
}

fn of_serial(candidates: &impl Candidates, expected: u64, slaves: usize) -> Result<usize> {
    let recognised = candidates.recognised()?;
    let mut unread = recognised.unknown.first().map(ToString::to_string);
    let mut found = Vec::new();
    for slave in recognised.gateways {
        match candidates.serial(slave) {
            Ok(serial) if serial == expected => found.push(slave),
            Ok(_) => {}
            Err(error) => unread = unread.or(Some(error.to_string())),
        }
    }
    match (one_of(&found, Some(SlaveChoice::Serial(expected)), slaves), unread) {
        (Err(Failure::Slave(message)), Some(reason)) if found.is_empty() => {
            Err(Failure::Slave(format!("{message}; but {reason}")))
        }
        (found, _) => found,
    }
}

fn none_found(choice: Option<SlaveChoice>, slaves: usize) -> Failure {
    let message = match (choice, slaves) {
        (_, 0) => Error::NoSlaves.to_string(),
        (None, _) => format!(
            "none of the {slaves} slaves is identified as an ECAN-Lite by 0xF000:17 and :18 (assumption \
             H1); select one with --slave"
        ),
        (Some(SlaveChoice::Position(position)), 1) => {
            format!("slave {position} does not exist; allowed: 0")
        }
        (Some(SlaveChoice::Position(position)), _) => {
            format!("slave {position} does not exist; allowed: 0 to {}", slaves - 1)
        }
        (Some(SlaveChoice::Alias(alias)), _) => {
            format!("no slave has the alias {alias}; see `ecan scan`")
        }
        (Some(SlaveChoice::Serial(serial)), _) => {
            format!("no gateway has the serial number {serial}; see `ecan scan`")
        }
    };
    Failure::Slave(message)
}

fn several_found(positions: &[usize]) -> String {
    format!("several gateways; select one with --slave: {}", list(positions))
}

fn list(positions: &[usize]) -> String {
    positions.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slave_choice_parses_position_alias_and_serial() {
        let parse = |text: &str| text.parse::<SlaveChoice>();
        assert_eq!(parse("3"), Ok(SlaveChoice::Position(3)));
        assert_eq!(parse("alias=0x1001"), Ok(SlaveChoice::Alias(0x1001)));
        assert_eq!(parse("serial=4294967297"), Ok(SlaveChoice::Serial(0x1_0000_0001)));
        for wrong in ["", "-1", "alias=", "alias=65536", "name=x", "0x"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
        assert!(parse("alias=0").unwrap_err().contains("no alias"));
        assert!(parse("serial=0x0").unwrap_err().contains("no serial number"));
    }
}
