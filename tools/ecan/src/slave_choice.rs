//! Which slave of a bus is meant, and what speaks against it.

use std::fmt::{self, Display};
use std::str::FromStr;

use clap::Args;
use ecan_host::SlaveKind;

use crate::failure::Failure;
use crate::value::parse_unsigned;

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

/// `--all` of a command that takes one gateway otherwise.
#[derive(Clone, Copy, Debug, Args)]
pub struct AllArgument {
    /// All gateways of the bus, one after the other; with --json a list
    #[arg(long)]
    pub all: bool,
}

impl FromStr for SlaveChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let wrong = || "expected a position, alias=NUMBER or serial=NUMBER".to_owned();
        let unset = |why: &str| Err(format!("{why}; choose the slave by its position"));
        match text.split_once('=') {
            None => text.parse().map(Self::Position).map_err(|_| wrong()),
            Some(("alias", number)) => {
                let alias = parse_unsigned(number).ok_or_else(wrong)?;
                match u16::try_from(alias).map_err(|_| wrong())? {
                    0 => unset("alias 0 means that none is set"),
                    alias => Ok(Self::Alias(alias)),
                }
            }
            Some(("serial", number)) => match parse_unsigned(number).ok_or_else(wrong)? {
                0 | u64::MAX => {
                    unset(&format!("serial number {number} means that none is programmed"))
                }
                serial => Ok(Self::Serial(serial)),
            },
            Some(_) => Err(wrong()),
        }
    }
}

/// Which slaves are gateways, and which cannot be asked.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Recognised {
    /// Positions of those that are.
    pub gateways: Vec<usize>,
    /// Those that may be.
    pub unknown: Vec<Unknown>,
}

/// A slave that does not tell what it is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unknown {
    /// Place in the ring.
    pub position: usize,
    /// Why it does not.
    pub reason: String,
}

impl Display for Unknown {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "slave {} {}", self.position, self.words())
    }
}

impl Unknown {
    /// That it cannot be asked, and why.
    pub fn words(&self) -> String {
        format!("cannot be asked whether it is an ECAN-Lite: {}", self.reason)
    }
}

impl Recognised {
    /// From what each of the slaves is.
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

/// The slaves of a bus, one of which is meant.
pub trait Candidates {
    /// Position and alias of each; alias 0 is none.
    fn places(&self) -> Result<Vec<(usize, u16)>, Failure>;

    /// Which of them are gateways.
    fn recognised(&self) -> Result<Recognised, Failure>;

    /// Serial number of a gateway.
    fn serial(&self, slave: usize) -> Result<u64, Failure>;
}

/// The slave that is named, or else the only gateway.
///
/// # Errors
/// [`Failure::Slave`] where it is not there, or where a choice is left.
pub fn choose(candidates: &impl Candidates, choice: Option<SlaveChoice>) -> Result<usize, Failure> {
    let places = candidates.places()?;
    let count = places.len();
    let positions = |is_it: &dyn Fn(&(usize, u16)) -> bool| -> Vec<_> {
        places.iter().filter(|place| is_it(place)).map(|(position, _)| *position).collect()
    };
    match choice {
        None => only_gateway(&candidates.recognised()?, count),
        Some(SlaveChoice::Position(wanted)) => {
            one_of(&positions(&|(position, _)| *position == wanted), choice, count)
        }
        Some(SlaveChoice::Alias(wanted)) => {
            one_of(&positions(&|(_, alias)| *alias == wanted), choice, count)
        }
        Some(SlaveChoice::Serial(wanted)) => of_serial(candidates, wanted, count),
    }
}

fn one_of(found: &[usize], choice: Option<SlaveChoice>, slaves: usize) -> Result<usize, Failure> {
    match found {
        [only] => Ok(*only),
        [] => Err(none_found(choice, slaves)),
        several => {
            let what = match choice {
                Some(SlaveChoice::Serial(serial)) => format!("serial number {serial}"),
                Some(SlaveChoice::Alias(alias)) => format!("alias {alias}"),
                Some(SlaveChoice::Position(_)) | None => "place".to_owned(),
            };
            let several = list(several);
            let words =
                format!("slaves {several} have the same {what}; choose one by its position");
            Err(Failure::Slave(words))
        }
    }
}

/// The only slave that is a gateway, where no other may be one.
///
/// # Errors
/// [`Failure::Slave`] where there is none, or a choice is left.
pub fn only_gateway(recognised: &Recognised, slaves: usize) -> Result<usize, Failure> {
    match (&recognised.gateways[..], &recognised.unknown[..]) {
        ([only], []) => Ok(*only),
        ([], []) => Err(none_found(None, slaves)),
        (several, []) => Err(Failure::Slave(several_found(several))),
        (gateways, [first, ..]) => {
            let unknown = recognised.unknown.iter().map(|slave| slave.position);
            let mut all: Vec<_> = gateways.iter().copied().chain(unknown).collect();
            all.sort_unstable();
            let words = match all[..] {
                [only] => format!("{first}; if it is one, choose it with --slave {only}"),
                _ => format!("{first}; choose one with --slave, of {}", list(&all)),
            };
            Err(Failure::Slave(words))
        }
    }
}

/// The gateways of a command that takes one, or all where the user says so (`--all`).
///
/// # Errors
/// [`Failure::Usage`] where the user says both.
/// [`Failure::Slave`] where one is meant and is not there, or a choice is left; where all are meant
/// and none is there. Of all, those that cannot be asked are left to the caller.
pub fn one_or_all(
    candidates: &impl Candidates,
    choice: Option<SlaveChoice>,
    all: bool,
) -> Result<Recognised, Failure> {
    let only = |gateway| Recognised { gateways: vec![gateway], unknown: Vec::new() };
    if choice.is_some() && all {
        return Err(Failure::Usage("--slave chooses one gateway, --all all: take one".to_owned()));
    }
    if choice.is_some() {
        return choose(candidates, choice).map(only);
    }
    let recognised = candidates.recognised()?;
    match recognised.gateways.len() + recognised.unknown.len() {
        1.. if all => Ok(recognised),
        count => match only_gateway(&recognised, candidates.places()?.len()) {
            // Names the other way out, where several are in question.
            Err(Failure::Slave(words)) if count > 1 => {
                Err(Failure::Slave(format!("{words}, or take --all")))
            }
            other => other.map(only),
        },
    }
}

/// Every gateway, where no other slave may be one.
///
/// # Errors
/// [`Failure::Slave`] where there is none, or a slave cannot be asked.
pub fn every_gateway(candidates: &impl Candidates) -> Result<Vec<usize>, Failure> {
    let recognised = candidates.recognised()?;
    if recognised.gateways.is_empty() || !recognised.unknown.is_empty() {
        // Tells why.
        only_gateway(&recognised, candidates.places()?.len())?;
    }
    Ok(recognised.gateways)
}

fn of_serial(candidates: &impl Candidates, wanted: u64, slaves: usize) -> Result<usize, Failure> {
    let recognised = candidates.recognised()?;
    let mut unread = recognised.unknown.first().map(ToString::to_string);
    let mut found = Vec::new();
    for slave in recognised.gateways {
        match candidates.serial(slave) {
            Ok(serial) if serial == wanted => found.push(slave),
            Ok(_) => {}
            Err(error) => unread = unread.or(Some(error.to_string())),
        }
    }
    match (one_of(&found, Some(SlaveChoice::Serial(wanted)), slaves), unread) {
        (Err(Failure::Slave(words)), Some(reason)) if found.is_empty() => {
            Err(Failure::Slave(format!("{words}; but {reason}")))
        }
        (found, _) => found,
    }
}

/// Why none of so many slaves is the one that is meant.
fn none_found(choice: Option<SlaveChoice>, slaves: usize) -> Failure {
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
fn several_found(positions: &[usize]) -> String {
    format!("there are several gateways; choose one with --slave, of {}", list(positions))
}

fn list(positions: &[usize]) -> String {
    positions.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
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
        assert!(parse("alias=0").unwrap_err().contains("none is set"));
        assert!(parse("serial=0x0").unwrap_err().contains("none is programmed"));
    }
}
