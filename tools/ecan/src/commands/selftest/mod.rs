//! `ecan selftest`: the production line's check of gateways.

mod active_config;
mod exchange;
mod frames;
mod gateway;
mod identity;
mod rates;
mod report;
mod saved;
mod wiring;

use std::collections::BTreeSet;
use std::io::IsTerminal;
use std::path::PathBuf;

use clap::Args;
use ecan_command_line::interrupt::Interrupt;
use ecan_command_line::real_time::RealTimeArguments;
use serde::Serialize;

use crate::bus::Bus;
use crate::config_file;
use crate::failure::Failure;
use crate::frames::channels::Channels;
use crate::global::GlobalOptions;
use crate::output::Output;

use rates::Rate;
use report::Report;
use wiring::Wiring;

/// Examples for the end of the help.
pub const EXAMPLES: &str = "\
Examples:
  ecan selftest                         every gateway of the bus, each channel by loopback
  ecan selftest --wired 0-1,2-3         and by real frames where channels are wired
  ecan selftest --expect-version 2.2.1 --gateways 4 --report /var/lib/line
  ecan --slave serial=4294967297 selftest --config cell.toml

Without --config the bit rates are 125, 250, 500 and 1000 kbit/s, and 500/2000 and 1000/5000 kbit/s
with CAN FD. Every gateway that shows itself as an ECAN-Lite is tested, one after the other, unless
--slave names one. The loopback stays inside the CAN controller; wired channels must be alone on
their bus.

What the test changes of a gateway's configuration is put back at the end. Where its channels were
off, it restarts for that: no command takes a channel off its bus again. Its Flash is not written.

Reports are SERIAL.json, or position-POSITION.json without a serial number. None replaces an earlier
one: the next is SERIAL-2.json.

The exit status is 0 when all is good and 1 when something failed.";

/// Arguments of `selftest`.
#[derive(Debug, Args)]
pub struct SelftestArguments {
    /// Test at the bit rates of this configuration file
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Channels to test by loopback: numbers with commas between, or all
    #[arg(long, value_name = "CHANNELS", default_value = "all")]
    channels: Channels,
    /// Channels that are wired together, in pairs: 0-1,2-3
    #[arg(long, value_name = "PAIRS")]
    wired: Option<Wiring>,
    /// The firmware must have this version, as `ecan firmware version` tells it
    #[arg(long, value_name = "VERSION")]
    expect_version: Option<String>,
    /// There must be so many gateways on the bus
    #[arg(long, value_name = "COUNT")]
    gateways: Option<usize>,
    /// Frames in each direction at each bit rate; 96 have every length
    #[arg(long, value_name = "COUNT", default_value_t = 96,
          value_parser = clap::value_parser!(u16).range(1..=i64::from(frames::MOST)))]
    frames: u16,
    /// Write a report for each gateway into this directory
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// PDO size per direction, in chunks of 128 bytes
    #[arg(long, value_name = "N", default_value_t = 5)]
    pdo_n: u8,
    /// The installed master carries more than 1486 bytes of process data per sync manager
    #[arg(long)]
    large_pdos: bool,
    /// EtherCAT cycle in microseconds
    #[arg(long, value_name = "US", default_value_t = 1000,
          value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    cycle_us: u32,
    #[command(flatten)]
    real_time: RealTimeArguments,
}

/// What is printed.
#[derive(Debug, Serialize)]
struct Selftest {
    is_good: bool,
    gateways: Vec<Report>,
}

pub fn run(
    arguments: &SelftestArguments,
    global: &GlobalOptions,
    output: &Output,
) -> Result<(), Failure> {
    let file = arguments.config.as_deref().map(rates::read).transpose()?;
    let rates = file.as_ref().map_or_else(Rate::usual, Rate::of_file);
    let master = file.as_ref().map_or(global.master(), |file| config_file::master(file, global));
    let global = GlobalOptions { master: Some(master), ..global.clone() };
    let is_watched = std::io::stderr().is_terminal();
    let test = gateway::Test { arguments, rates: &rates, master, is_watched, output };
    test.check()?;
    let interrupt =
        Interrupt::install_with_message("stopping: the configuration is put back first")?;
    let bus = Bus::open(&global, output)?;
    let slaves = slaves(&bus, arguments, output)?;
    if let Some(directory) = &arguments.report {
        report::prepare(directory)?;
    }
    let granted = arguments.real_time.apply(|line| output.note(line));
    granted.map_err(|error| Failure::Host(error.to_string()))?;
    let (mut reports, mut serials) = (Vec::new(), BTreeSet::new());
    let (mut stopped, mut unwritten) = (None, None);
    for slave in slaves {
        let mut report = match test.run(&bus, slave, &interrupt) {
            Ok(report) => report,
            // What is known of the gateways before is told all the same.
            Err(failure) => {
                stopped = Some(failure);
                break;
            }
        };
        let serial = report.own_serial();
        let is_duplicate = serial.is_some_and(|serial| !serials.insert(serial));
        if let Some(serial) = serial.filter(|_| is_duplicate) {
            report.add("serial number", Err(format!("{serial} is that of another gateway too")));
            report.is_good = false;
        }
        if let Some(directory) = &arguments.report
            && let Err(failure) = report.write(directory, is_duplicate)
        {
            // The test goes on, and is printed.
            unwritten.get_or_insert(failure);
        }
        let was_stopped = report.was_stopped;
        reports.push(report);
        if was_stopped {
            stopped = Some(Failure::TooFew("stopped before the test was over".to_owned()));
            break;
        }
    }
    if let Some(failure) = stopped {
        if !reports.is_empty() {
            print(false, reports, output)?;
        }
        return Err(failure);
    }
    let is_good = reports.iter().all(|report| report.is_good);
    print(is_good, reports, output)?;
    match unwritten {
        Some(failure) => Err(failure),
        None if is_good => Ok(()),
        None => Err(Failure::ProblemsFound),
    }
}

fn print(is_good: bool, gateways: Vec<Report>, output: &Output) -> Result<(), Failure> {
    let selftest = Selftest { is_good, gateways };
    output.data(&selftest, |out| {
        selftest.gateways.iter().try_for_each(|report| report.print(output, out))
    })
}

/// The slaves to test: the one chosen, or every gateway.
fn slaves(
    bus: &Bus,
    arguments: &SelftestArguments,
    output: &Output,
) -> Result<Vec<usize>, Failure> {
    if bus.is_chosen() {
        if arguments.gateways.is_some() {
            let words = "--gateways counts those of the whole bus, --slave names one: give either";
            return Err(Failure::Usage(words.to_owned()));
        }
        return Ok(vec![bus.slave()?]);
    }
    // One that cannot be asked is tested, and fails by that.
    let (all, kinds) = (0..bus.diagnostics().slave_count(), bus.kinds());
    let (gateways, others): (Vec<_>, Vec<_>) = all.partition(|at| kinds[*at].may_be_gateway());
    if let Some(expected) = arguments.gateways.filter(|expected| *expected != gateways.len()) {
        let words = format!("{expected} gateways must be there, but {}", gateways.len());
        return Err(Failure::Slave(format!("{words} show themselves; see `ecan scan`")));
    }
    if gateways.is_empty() {
        // Tells why there is none.
        return Ok(vec![bus.slave()?]);
    }
    for other in others {
        output.note(format_args!("slave {other} does not show itself as an ECAN-Lite: not tested"));
    }
    Ok(gateways)
}
