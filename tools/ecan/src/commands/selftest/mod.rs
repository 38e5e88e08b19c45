//! `ecan selftest`: production test of gateways.

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
use ecan_sim::ClockKind;
use serde::Serialize;

use crate::config_file;
use crate::context::{Bus, Context, Failure, Output, Result, note};
use crate::frames::Channels;

use rates::Rate;
use report::Report;
use wiring::Wiring;

pub const EXAMPLES: &str = "\
Examples:
  ecan selftest                         every gateway of the bus, each channel by loopback
  ecan selftest --wired 0-1,2-3         and by frames on the bus between wired channels
  ecan selftest --expect-version 2.2.1 --gateways 4 --report /var/lib/line
  ecan --slave serial=4294967297 selftest --config cell.toml

Default bit rates are 125, 250, 500 and 1000 kbit/s, and 500/2000 and 1000/5000 kbit/s with CAN FD.
Every identified ECAN-Lite is tested in turn, unless --slave is given. The loopback is internal to the
CAN controller. Wired channels must be alone on their bus.

The test restores the configuration of the gateway. If its channels were off, the gateway is restarted
for that, because no command deactivates a channel. The Flash is not written.

Reports are named SERIAL.json, or position-POSITION.json without serial number. Earlier reports are
kept: the next one is SERIAL-2.json.

Exit status 0 if all tests pass, 1 if a test fails.";

#[derive(Debug, Args)]
pub struct SelftestArguments {
    /// Use the bit rates of this configuration file
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Channels for the loopback test, 0 to 3, comma-separated, or all
    #[arg(long, value_name = "CHANNELS", default_value = "all")]
    channels: Channels,
    /// Pairs of wired channels, for example 0-1,2-3
    #[arg(long, value_name = "PAIRS")]
    wired: Option<Wiring>,
    /// Expected firmware version, as shown by `ecan firmware version`
    #[arg(long, value_name = "VERSION")]
    expect_version: Option<String>,
    /// Expected number of gateways; fail if the bus has another number
    #[arg(long, value_name = "COUNT")]
    gateways: Option<usize>,
    /// Frames per direction and bit rate; 96 cover every length
    #[arg(long, value_name = "COUNT", default_value_t = 96,
          value_parser = clap::value_parser!(u16).range(1..=i64::from(frames::MOST)))]
    frames: u16,
    /// Write a report per gateway into this directory
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// PDO size per direction in chunks of 128 bytes, 1 to 24
    #[arg(long, value_name = "N", default_value_t = 5)]
    pdo_n: u8,
    /// Allow PDO sizes above 11 chunks, for masters that support large PDOs
    #[arg(long)]
    large_pdos: bool,
    /// EtherCAT cycle time, in us
    #[arg(long, value_name = "US", default_value_t = 1000,
          value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    cycle_us: u32,
    #[command(flatten)]
    real_time: RealTimeArguments,
}

#[derive(Debug, Serialize)]
struct Selftest {
    is_good: bool,
    gateways: Vec<Report>,
}

pub fn run(arguments: &SelftestArguments, context: &Context) -> Result {
    let file = arguments.config.as_deref().map(rates::read).transpose()?;
    let rates = file.as_ref().map_or_else(Rate::usual, Rate::of_file);
    let global = context.global;
    let master = file.as_ref().map_or(global.master(), |file| config_file::master(file, global));
    let is_watched = std::io::stderr().is_terminal();
    let test = gateway::Test { arguments, rates: &rates, master, is_watched };
    test.check()?;
    let interrupt = Interrupt::install_with_message("stopping after restoring the configuration")?;
    let bus = context.bus_of_master(master, ClockKind::Stepped)?;
    let slaves = slaves(&bus, arguments)?;
    if let Some(directory) = &arguments.report {
        report::prepare(directory)?;
    }
    arguments.real_time.apply(|line| note(line))?;
    let (mut reports, mut serials) = (Vec::new(), BTreeSet::new());
    let (mut stopped, mut unwritten) = (None, None);
    for slave in slaves {
        let mut report = match test.run(&bus, slave, &interrupt) {
            Ok(report) => report,
            // Print the results of the gateways before the error.
            Err(failure) => {
                stopped = Some(failure);
                break;
            }
        };
        let serial = report.own_serial();
        let is_duplicate = serial.is_some_and(|serial| !serials.insert(serial));
        if let Some(serial) = serial.filter(|_| is_duplicate) {
            report.add(
                "serial number",
                Err(format!("{serial} is also the serial number of another gateway")),
            );
            report.is_good = false;
        }
        if let Some(directory) = &arguments.report
            && let Err(failure) = report.write(directory, is_duplicate)
        {
            // The test continues and is printed.
            unwritten.get_or_insert(failure);
        }
        let was_stopped = report.was_stopped;
        reports.push(report);
        if was_stopped {
            stopped = Some(Failure::Incomplete("stopped before the end of the test".to_owned()));
            break;
        }
    }
    if let Some(failure) = stopped {
        if !reports.is_empty() {
            print(false, reports, &context.output)?;
        }
        return Err(failure);
    }
    let is_good = reports.iter().all(|report| report.is_good);
    print(is_good, reports, &context.output)?;
    match unwritten {
        Some(failure) => Err(failure),
        None if is_good => Ok(()),
        None => Err(Failure::ProblemsFound),
    }
}

fn print(is_good: bool, gateways: Vec<Report>, output: &Output) -> Result {
    let selftest = Selftest { is_good, gateways };
    output.data(&selftest, |out| {
        selftest.gateways.iter().try_for_each(|report| report.print(output, out))
    })
}

fn slaves(bus: &Bus, arguments: &SelftestArguments) -> Result<Vec<usize>> {
    if bus.is_chosen() {
        if arguments.gateways.is_some() {
            return Err(Failure::Usage("--gateways and --slave exclude each other".to_owned()));
        }
        return Ok(vec![bus.slave()?]);
    }
    // A slave that cannot be identified is tested, and fails.
    let (all, kinds) = (0..bus.diagnostics().slave_count(), bus.kinds());
    let (gateways, others): (Vec<_>, Vec<_>) = all.partition(|at| kinds[*at].may_be_gateway());
    if let Some(expected) = arguments.gateways.filter(|expected| *expected != gateways.len()) {
        let message = format!("expected {expected} gateways, found {}", gateways.len());
        return Err(Failure::Slave(format!("{message}; see `ecan scan`")));
    }
    if gateways.is_empty() {
        // Returns the reason.
        return Ok(vec![bus.slave()?]);
    }
    for other in others {
        note(format_args!("slave {other} is not identified as an ECAN-Lite: not tested"));
    }
    Ok(gateways)
}
