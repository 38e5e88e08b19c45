//! `ecan config replace`: gives a new gateway the place of a broken one.
//!
//! A log next to the configuration file holds serial number and firmware of each gateway, by which a missing one is
//! known.

use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use clap::Args;
use ecan_host::SlaveConfig;
use ecan_lite::EcrtOptions;
use ecan_lite::config::{ResolveError, ResolvedGateway, find};
use ecan_mcan_port::Config;
use ecan_protocol::text::Printable;
use ecan_sim::{Backend, ClockKind};
use serde::{Deserialize, Serialize};

use super::apply::{self, Applied};
use super::flash;
use crate::config_file;
use crate::context::{self, Bus, Context, Failure, Output, Result, note};
use crate::ethercat_tool::EthercatTool;
use crate::output::{Progress, confirm};
use crate::slave_choice::{Candidates as _, Recognised};

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  ecan config replace cell.toml           note the gateways, or replace the one that is missing
  ecan config replace cell.toml --gateway 1 --save
  ecan --slave 2 config replace cell.toml --gateway 1

Run it once while the machine is well: it notes serial number and firmware of each gateway in
cell.gateways.jsonl. When a gateway is broken, connect the new one in its place and run it again. It
finds which gateway is missing and which is new, compares the firmware, writes the alias (by IgH's
tool ethercat) and the configuration, reads them back, and notes the replacement. It asks before it
writes. See docs/guide/gateways.md.")]
pub struct ReplaceArguments {
    /// Configuration file
    file: PathBuf,
    /// Index of the broken gateway in the file [default: the missing one]
    #[arg(long, value_name = "INDEX")]
    gateway: Option<usize>,
    /// Accept another firmware than that of the broken gateway
    #[arg(long)]
    any_firmware: bool,
    /// Save the configuration in the Flash of the new gateway
    #[arg(long)]
    save: bool,
    /// Do not ask for confirmation
    #[arg(long)]
    yes: bool,
    /// Where the gateways are noted [default: FILE with the extension gateways.jsonl]
    #[arg(long, value_name = "NOTES")]
    notes: Option<PathBuf>,
    /// Path of IgH's tool ethercat, which writes the alias [default: PATH, IgH's paths]
    #[arg(long, value_name = "PATH")]
    ethercat: Option<PathBuf>,
}

/// A line of the log: a gateway of the file as it was found, or in the place of another one.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Noted {
    time: String,
    /// Index in the file.
    gateway: usize,
    position: usize,
    serial: u64,
    firmware: String,
    /// Serial number of the gateway that it replaces, 0 if that was not noted.
    #[serde(skip_serializing_if = "Option::is_none")]
    replaces: Option<u64>,
}

/// A gateway on the bus.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Present {
    position: usize,
    alias: u16,
    serial: u64,
    firmware: String,
}

#[derive(Debug, Serialize)]
struct Report {
    log: String,
    noted: Vec<Noted>,
    applied: Option<Applied>,
    is_saved: bool,
}

pub fn run(arguments: &ReplaceArguments, context: &Context) -> Result {
    let path = &arguments.file;
    let file = config_file::read(path)?;
    let log = Log::read(arguments)?;
    let master = config_file::master(&file, context.global);
    if let Some(connection) = context::connect(context.global, master)? {
        let program = connection.program();
        return Err(Failure::Master(format!("{program} holds the master; end that program first")));
    }
    let options = EcrtOptions::for_gateways(&file.adapter);
    let backend = context.backend_with(&context.setting()?, ClockKind::Stepped, options)?;
    let bus = Bus::of(&backend, master, context.global.slave)?;
    let machine = Machine::survey(&bus, &file, &log, arguments.gateway)?;
    let Some(broken) = machine.broken(&log, arguments.gateway)? else {
        let noted = machine.noted();
        log.append(&mut log.open()?, &noted)?;
        let report = Report { log: log.name(), noted, applied: None, is_saved: false };
        return context.output.data(&report, |out| report.print(path, &context.output, out));
    };
    let new = machine.replacement(&bus, broken, &log)?;
    if !arguments.any_firmware {
        machine.check_firmware(new, log.latest(broken))?;
    }
    let alias = missing_alias(&bus, &file, broken, new)?;
    let Present { position, serial, firmware, .. } = new;
    let of = match log.latest(broken) {
        Some(known) => format!("in place of serial number {}", known.serial),
        None => "which was not noted before".to_owned(),
    };
    let writes = [
        Some("its configuration".to_owned()),
        alias.map(|alias| format!("alias {alias}")),
        arguments.save.then(|| "its Flash".to_owned()),
    ];
    let question = format_args!(
        "Make slave {position} (serial number {serial}, firmware {firmware}) gateway {broken} of {}, {of}? This \
         writes {}.",
        Printable(path.display()),
        writes.into_iter().flatten().collect::<Vec<_>>().join(", ")
    );
    confirm(arguments.yes, "the replacement", question, "nothing written")?;
    let mut notes = log.open()?;
    if let Some(alias) = alias {
        write_alias(&backend, &bus, *position, alias, arguments)?;
        note(format_args!("slave {position}: alias {alias} written"));
    }
    let gateway = ResolvedGateway { gateway: broken, slave: *position };
    let (applied, written) = apply::write_gateway(&bus, &file, gateway);
    let result =
        written.and_then(|()| if arguments.save { flash::save(&bus, *position) } else { Ok(()) });
    let is_saved = result.is_ok() && arguments.save;
    let replaces = Some(log.latest(broken).map_or(0, |known| known.serial));
    let noted = vec![Noted { replaces, ..new.as_gateway(broken) }];
    let result = result.and_then(|()| log.append(&mut notes, &noted));
    let report = Report { log: log.name(), noted, applied: Some(applied), is_saved };
    context.output.data(&report, |out| report.print(path, &context.output, out))?;
    result
}

/// The log of the gateways of a file.
struct Log {
    path: PathBuf,
    lines: Vec<Noted>,
}

impl Log {
    fn read(arguments: &ReplaceArguments) -> Result<Self> {
        let usual = || arguments.file.with_extension("gateways.jsonl");
        let path = arguments.notes.clone().unwrap_or_else(usual);
        let text = match std::fs::read_to_string(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => String::new(),
            read => read.map_err(|error| Failure::file("read", &path, error))?,
        };
        let line = |(number, line): (usize, &str)| {
            serde_json::from_str(line).map_err(|error| {
                Failure::file("understand", &path, format!("line {}: {error}", number + 1))
            })
        };
        let lines = text.lines().enumerate().map(line).collect::<Result<_>>()?;
        Ok(Self { path, lines })
    }

    fn name(&self) -> String {
        self.path.display().to_string()
    }

    fn latest(&self, gateway: usize) -> Option<&Noted> {
        self.lines.iter().rev().find(|noted| noted.gateway == gateway)
    }

    fn open(&self) -> Result<File> {
        let file = OpenOptions::new().create(true).append(true).open(&self.path);
        file.map_err(|error| Failure::file("write", &self.path, error))
    }

    /// Writes what is not the latest about its gateway.
    fn append(&self, file: &mut File, noted: &[Noted]) -> Result {
        let is_new = |noted: &&Noted| {
            self.latest(noted.gateway).is_none_or(|latest| {
                (latest.position, latest.serial, &latest.firmware)
                    != (noted.position, noted.serial, &noted.firmware)
            })
        };
        let mut text = String::new();
        for noted in noted.iter().filter(is_new) {
            let line = serde_json::to_string(noted).map_err(std::io::Error::from)?;
            text += &(line + "\n");
        }
        file.write_all(text.as_bytes())
            .and_then(|()| file.sync_all())
            .map_err(|error| Failure::file("write", &self.path, error))
    }
}

/// The gateways of a file and those of the bus.
struct Machine {
    /// By their index in the file; `None` if missing.
    gateways: Vec<Option<Present>>,
    /// Gateways that are none of the file.
    others: Vec<Present>,
}

impl Machine {
    /// Finds the gateways of a file by the serial numbers that were noted, or else by their places. `replaced` is
    /// looked for by its serial number only.
    fn survey(bus: &Bus, file: &Config, log: &Log, replaced: Option<usize>) -> Result<Self> {
        let _progress = Progress::show("reading the gateways");
        let Recognised { gateways, unknown } = bus.recognised()?;
        for unknown in unknown {
            note(format_args!("{unknown}: left out"));
        }
        let slaves = bus.slaves()?;
        let read = |bus: &Bus, position: usize| {
            let (serial, firmware) = (bus.serial(position)?, bus.firmware_version(position)?);
            let alias = slaves.get(position).map_or(0, |slave| slave.alias);
            Ok(Present { position, alias, serial, firmware: firmware.to_string() })
        };
        let present = bus.in_parallel(&gateways, read).into_iter().collect::<Result<Vec<_>>>()?;
        let count = file.adapter.slaves.len();
        if replaced.is_some_and(|replaced| replaced >= count) {
            let text = format!("--gateway: the file has {count} gateways, 0 to {}", count - 1);
            return Err(Failure::Usage(text));
        }
        let mut others = present;
        let mut take = |is_meant: &dyn Fn(&Present) -> bool| {
            others.iter().position(is_meant).map(|at| others.remove(at))
        };
        let is_programmed = |serial: &u64| !matches!(*serial, 0 | u64::MAX);
        let noted = (0..count)
            .map(|gateway| log.latest(gateway).map(|noted| noted.serial).filter(is_programmed));
        let mut gateways: Vec<_> =
            noted.clone().map(|serial| take(&|slave| Some(slave.serial) == serial)).collect();
        for (index, (gateway, serial)) in gateways.iter_mut().zip(noted).enumerate() {
            if serial.is_none() && replaced != Some(index) {
                let place = place(bus, file, index).ok();
                *gateway = take(&|slave| Some(slave.position) == place);
            }
        }
        Ok(Self { gateways, others })
    }

    /// Index in the file of the gateway to replace; `None` if none is missing.
    fn broken(&self, log: &Log, named: Option<usize>) -> Result<Option<usize>> {
        let missing: Vec<_> =
            (0..).zip(&self.gateways).filter(|(_, slave)| slave.is_none()).collect();
        let missing: Vec<usize> = missing.into_iter().map(|(index, _)| index).collect();
        match (named, &missing[..]) {
            (None, []) => Ok(None),
            (None, [only]) => Ok(Some(*only)),
            (None, several) => {
                let describe = |index: &usize| match log.latest(*index) {
                    Some(Noted { serial, .. }) => format!("{index} (serial number {serial})"),
                    None => index.to_string(),
                };
                let list: Vec<_> = several.iter().map(describe).collect();
                let list = list.join(", ");
                Err(Failure::Slave(format!(
                    "gateways {list} are missing; select one with --gateway"
                )))
            }
            (Some(named), _) if missing.contains(&named) => Ok(Some(named)),
            (Some(named), _) => Err(Failure::Slave(format!(
                "gateway {named} is on the bus, with the serial number that was noted; disconnect it first"
            ))),
        }
    }

    /// The new gateway: the selected one, or the only one that is none of the file.
    fn replacement(&self, bus: &Bus, broken: usize, log: &Log) -> Result<&Present> {
        let chosen = if bus.is_chosen() { Some(bus.slave()?) } else { None };
        let mut new = self.others.iter();
        if let Some(chosen) = chosen {
            let found = new.find(|other| other.position == chosen);
            let text =
                || format!("slave {chosen} is no new gateway: it is another one of the file");
            return found.ok_or_else(|| Failure::Slave(text()));
        }
        let whose = match log.latest(broken) {
            Some(Noted { serial, .. }) => format!("gateway {broken} (serial number {serial})"),
            None => format!("gateway {broken}"),
        };
        match &self.others[..] {
            [only] => Ok(only),
            [] => Err(Failure::Slave(format!(
                "{whose} is missing, and the bus has no other gateway; connect the new one in its place"
            ))),
            several => {
                let list: Vec<_> = several.iter().map(|new| new.position.to_string()).collect();
                Err(Failure::Slave(format!(
                    "{whose} is missing, and slaves {} are new; select one with --slave",
                    list.join(", ")
                )))
            }
        }
    }

    /// The new gateway must have the firmware that was noted, or else that of all others.
    fn check_firmware(&self, new: &Present, known: Option<&Noted>) -> Result {
        let others = || self.gateways.iter().flatten().map(|gateway| &gateway.firmware);
        let expected = known.map(|known| &known.firmware).or_else(|| others().next());
        match expected.filter(|expected| **expected != new.firmware) {
            None => Ok(()),
            Some(expected) => Err(Failure::Rejected(format!(
                "slave {}: firmware {}, expected {expected}; nothing was written; use \
                 `ecan --slave serial={} firmware update PACKAGE`, or accept it with --any-firmware",
                new.position, new.firmware, new.serial
            ))),
        }
    }

    fn noted(&self) -> Vec<Noted> {
        let present = (0..).zip(&self.gateways);
        present.filter_map(|(index, slave)| Some(slave.as_ref()?.as_gateway(index))).collect()
    }
}

impl Present {
    fn as_gateway(&self, gateway: usize) -> Noted {
        let Self { position, serial, firmware, .. } = self.clone();
        let time = jiff::Timestamp::now().to_string();
        Noted { time, gateway, position, serial, firmware, replaces: None }
    }
}

/// Slave at the place of a gateway of the file.
fn place(bus: &Bus, file: &Config, gateway: usize) -> Result<usize, ResolveError> {
    let settings = file.adapter.slaves.get(gateway..=gateway).unwrap_or_default();
    let found = find(bus.diagnostics(), settings)?;
    Ok(found.first().map_or(usize::MAX, |found| found.slave))
}

/// The alias that the new gateway lacks. A gateway whose place is a position must be there.
fn missing_alias(bus: &Bus, file: &Config, broken: usize, new: &Present) -> Result<Option<u16>> {
    let alias = match file.adapter.slaves.get(broken) {
        Some(SlaveConfig { alias, position: 0, .. }) if *alias != 0 => Some(*alias),
        _ => None,
    };
    match place(bus, file, broken) {
        Ok(place) if place == new.position => Ok(None),
        Ok(place) => Err(Failure::Slave(format!(
            "gateway {broken} belongs where slave {place} is, the new one is slave {}; connect it there",
            new.position
        ))),
        Err(ResolveError::NoAlias { .. }) if alias.is_some() => Ok(alias),
        Err(error) => Err(config_file::resolve_failure(error)),
    }
}

fn write_alias(
    backend: &Backend,
    bus: &Bus,
    slave: usize,
    alias: u16,
    arguments: &ReplaceArguments,
) -> Result {
    match &backend.simulation {
        Some(simulation) => {
            simulation.write_alias(slave, alias);
        }
        None => EthercatTool::find(arguments.ethercat.as_deref(), bus.master())
            .and_then(|tool| tool.write_alias(slave, alias))?,
    }
    let found = bus.again()?.slaves()?.get(slave).map_or(0, |slave| slave.alias);
    if found != alias {
        return Err(Failure::Rejected(format!(
            "slave {slave}: alias {alias} was written, the master reports {found}; power-cycle the gateway and \
             repeat the command"
        )));
    }
    Ok(())
}

impl Report {
    fn print(&self, path: &Path, output: &Output, out: &mut dyn Write) -> std::io::Result<()> {
        for Noted { gateway, position, serial, firmware, .. } in &self.noted {
            writeln!(
                out,
                "gateway {gateway}: slave {position}, serial number {serial}, firmware {firmware}"
            )?;
        }
        let Some(applied) = &self.applied else {
            return writeln!(out, "no gateway is missing; noted in {}", Printable(&self.log));
        };
        applied.print(path, false, output, out)?;
        if self.is_saved {
            writeln!(out, "  saved in the Flash")?;
        }
        match applied.is_complete() {
            true => writeln!(out, "noted in {}", Printable(&self.log)),
            false => Ok(()),
        }
    }
}
