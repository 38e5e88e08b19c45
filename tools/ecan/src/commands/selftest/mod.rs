//! `ecan selftest`: production test of gateways.

mod channel_setup;
mod check_counts;
mod exchange;
mod frames;
mod group;
mod identity;
mod in_service;
mod observation;
mod rates;
mod report;
mod start_failure;
mod steps;
mod test_bus;
#[cfg(test)]
mod tests;
pub(super) mod wiring;

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use clap::Args;
use ecan_lite::config::DEFAULT_N;
use ecan_sim::ClockKind;
use ecan_tool_support::command_line::interrupt::Interrupt;
use ecan_tool_support::command_line::options::RealTimeArguments;
use ecan_tool_support::command_line::screen::Stream;
use serde::Serialize;

use crate::commands::saved_config::{Changes, Saved};
use crate::config_file;
use crate::context::{Bus, Context, Failure, Output, Result, note};
use crate::frames::Channels;
use crate::progress::Progress;

use group::{GroupEnd, GroupTest, Member};
use observation::of_active_channels;
use rates::Rate;
use report::Report;

use steps::TestPlan;
use wiring::Wiring;

pub const EXAMPLES: &str = "\
Examples:
  ecan selftest                         every gateway of the bus, each channel by loopback
  ecan selftest --wired 0-1,2-3         and by frames on the bus between wired channels
  ecan selftest --expect-version 2.2.1 --gateways 4 --report /var/lib/line
  ecan --slave serial=4294967297 selftest --config cell.toml

Default bit rates are 125, 250, 500 and 1000 kbit/s, and 500/2000 and 1000/5000 kbit/s with CAN FD.
Every identified ECAN-Lite is tested, unless --slave is given; several in parallel, as many as fit into
a cycle. The loopback is internal to the CAN controller: it takes the channel off its bus. Wired channels
must be alone on their bus. Before the test each channel listens, without taking part in its bus; if
there is traffic, the test ends without a loopback.

The test restores the configuration of the gateway. If its channels were off, the gateway is restarted
for that, because no command deactivates a channel. The Flash is not written. Reading and comparing about
400 values takes 20 s on a real master; --restart leaves it out and loses settings that are not saved.

Reports are named SERIAL.json, or position-POSITION.json without serial number. Earlier reports are
kept: the next one is SERIAL-2.json.

Through a service (--via, ecan serve) only what does not disturb its program is tested: identity, state,
error counters and, with control, frames between wired channels without other traffic. The rest is listed
as not tested.

Exit status 0 if no test fails, 1 if a test fails.";

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
    /// Time to listen for traffic on each bus before the test, in ms
    #[arg(long, value_name = "MS", default_value_t = 1000,
          value_parser = clap::value_parser!(u32).range(1..=600_000))]
    observe: u32,
    /// Test even if there is traffic on a bus; nodes on it lose frames
    #[arg(long, conflicts_with = "observe")]
    force: bool,
    /// Restart the gateways afterwards instead of restoring unsaved settings: faster
    #[arg(long)]
    restart: bool,
    /// PDO size per direction in chunks of 128 bytes, 1 to 24
    #[arg(long, value_name = "N", default_value_t = DEFAULT_N)]
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
    is_complete: bool,
    gateways: Vec<Report>,
}

pub fn run(arguments: &SelftestArguments, context: &Context) -> Result {
    let file = arguments.config.as_deref().map(rates::read).transpose()?;
    let rates = file.as_ref().map_or_else(Rate::usual, Rate::of_file);
    let global = context.global;
    let master = file.as_ref().map_or(global.master(), |file| config_file::master(file, global));
    let plan = TestPlan::new(arguments, &rates, master)?;
    let interrupt = Interrupt::install_with_message("stopping after restoring the configuration")?;
    let bus = context.bus_of_master(master, ClockKind::Stepped)?;
    let slaves = slaves(&bus, arguments)?;
    if let Some(directory) = &arguments.report {
        report::prepare(directory)?;
    }
    let (run, mut reports) = match bus.service() {
        Some(connection) => in_service::test(&bus, connection, &plan, &slaves, &interrupt)?,
        None => {
            if !arguments.force {
                let traffic = of_active_channels(&bus, &slaves, plan.tested(), arguments.observe);
                observation::require_no_traffic(&traffic, arguments.observe)?;
            }
            arguments.real_time.apply(|line| note(line))?;
            test_and_restore(&bus, &plan, &slaves, &interrupt)?
        }
    };
    let (mut serials, mut unwritten) = (BTreeSet::new(), None);
    for report in &mut reports {
        let serial = report.own_serial();
        let is_duplicate = serial.is_some_and(|serial| !serials.insert(serial));
        if let Some(serial) = serial.filter(|_| is_duplicate) {
            let message = format!("{serial} is also the serial number of another gateway");
            report.add("serial number", Err(message));
        }
        report.is_good = report.is_good_so_far();
        report.is_complete = report.left_out() == 0;
        if let Some(directory) = &arguments.report
            && let Err(failure) = report.write(directory, is_duplicate)
        {
            // The test is printed.
            unwritten.get_or_insert(failure);
        }
    }
    let is_good = run.is_ok() && reports.iter().all(|report| report.is_good);
    let is_tested = reports.iter().any(Report::has_frames);
    if run.is_ok() || is_tested {
        print(is_good, reports, &context.output)?;
    }
    if run? == GroupEnd::Stopped {
        return Err(Failure::Incomplete("stopped before the end of the test".to_owned()));
    }
    match unwritten {
        Some(failure) => Err(failure),
        None if is_good => Ok(()),
        None => Err(Failure::ProblemsFound),
    }
}

/// Tests slaves; the inner result is that of the test.
fn test_and_restore(
    bus: &Bus,
    plan: &TestPlan<'_>,
    slaves: &[usize],
    interrupt: &Interrupt,
) -> Result<(Result<GroupEnd>, Vec<Report>)> {
    let mut tested = read(bus, slaves, plan.arguments());
    let run = test(bus, plan, interrupt, &mut tested);
    restore(bus, plan, &mut tested)?;
    if matches!(run, Ok(GroupEnd::Stopped)) {
        tested.iter_mut().for_each(|it| it.report.stop());
    }
    Ok((run, tested.into_iter().map(|it| it.report).collect()))
}

struct TestedGateway {
    report: Report,
    /// Configuration before the test; `None` for a slave that is not tested further.
    saved: Option<Saved>,
    is_changed: bool,
    was_lost: bool,
}

/// Reads the identity and the configuration of the slaves.
fn read(bus: &Bus, slaves: &[usize], arguments: &SelftestArguments) -> Vec<TestedGateway> {
    let _progress = Progress::show("reading the configuration");
    tracing::info!(?slaves, "reading identity and configuration");
    let read = if arguments.restart { Saved::by_restart } else { Saved::read };
    let read = read_with(bus, slaves, arguments, |bus, slave, report| {
        read(bus, slave)
            .map_err(|error| report.add("configuration", Err(format!("not read: {error}"))))
            .ok()
    });
    let untouched = |(report, saved): (_, Option<Option<Saved>>)| TestedGateway {
        report,
        saved: saved.flatten(),
        is_changed: false,
        was_lost: false,
    };
    read.into_iter().map(untouched).collect()
}

/// Reads the identity of the slaves, and more of those that are gateways.
fn read_with<T: Send>(
    bus: &Bus,
    slaves: &[usize],
    arguments: &SelftestArguments,
    more: impl Fn(&Bus, usize, &mut Report) -> T + Sync,
) -> Vec<(Report, Option<T>)> {
    let expected = arguments.expect_version.as_deref();
    let read = bus.in_parallel(slaves, |bus, slave| {
        let time = jiff::Timestamp::now().to_string();
        let mut report = Report { position: slave, time, ..Report::default() };
        let is_gateway = identity::check(bus, slave, expected, &mut report);
        let found = is_gateway.then(|| more(bus, slave, &mut report));
        Ok((report, found))
    });
    let failed = |(slave, failure): (usize, Failure)| {
        let mut report = Report { position: slave, ..Report::default() };
        report.add("recognition", Err(failure.to_string()));
        (report, None)
    };
    let read = slaves.iter().zip(read);
    read.map(|(slave, read)| read.unwrap_or_else(|failure| failed((*slave, failure)))).collect()
}

/// Tests the gateways, as many in parallel as fit into a cycle.
fn test(
    bus: &Bus,
    plan: &TestPlan<'_>,
    interrupt: &Interrupt,
    tested: &mut [TestedGateway],
) -> Result<GroupEnd> {
    let mut members: Vec<_> = tested
        .iter_mut()
        .filter(|it| it.saved.is_some())
        .map(|it| Member {
            position: it.report.position,
            report: &mut it.report,
            is_changed: &mut it.is_changed,
            was_lost: &mut it.was_lost,
            is_repeated: false,
        })
        .collect();
    let is_watched = Stream::Error.is_terminal();
    let progress = |slaves: &[usize], step: &str, number: usize, count: usize| {
        tracing::info!(?slaves, step, number, count, "testing");
        if is_watched {
            let slaves: Vec<_> = slaves.iter().map(ToString::to_string).collect();
            note(format_args!("testing slave {}: {step} ({number} of {count})", slaves.join(", ")));
        }
    };
    let test = GroupTest { plan, interrupt, progress: &progress };
    while !members.is_empty() {
        let group = members.drain(..plan.group_size().min(members.len())).collect();
        if interrupt.is_set() || test.run(bus, group)? == GroupEnd::Stopped {
            return Ok(GroupEnd::Stopped);
        }
    }
    Ok(GroupEnd::Complete)
}

/// Restores the configuration of the gateways.
fn restore(bus: &Bus, plan: &TestPlan<'_>, tested: &mut [TestedGateway]) -> Result {
    let written = plan.written_objects()?;
    let _progress = Progress::show("restoring the configuration");
    tracing::info!("restoring the configuration");
    let changed = |it: &&mut TestedGateway| it.is_changed;
    let positions: Vec<_> =
        tested.iter_mut().filter(changed).map(|it| it.report.position).collect();
    let jobs: BTreeMap<_, _> = tested
        .iter()
        .filter_map(|it| Some((it.report.position, (it.saved.as_ref()?, it.was_lost))))
        .collect();
    let restored = bus.in_parallel(&positions, |bus, slave| match jobs.get(&slave) {
        Some((saved, was_lost)) => {
            let changes =
                Changes { tested: plan.tested(), written: &written, is_unknown: *was_lost };
            saved.restore(bus, &changes)
        }
        None => Ok(false),
    });
    let mut restored: BTreeMap<_, _> = positions.into_iter().zip(restored).collect();
    for it in tested.iter_mut().filter(|it| it.saved.is_some()) {
        let found = match restored.remove(&it.report.position) {
            None | Some(Ok(false)) => Ok("as before the test".to_owned()),
            Some(Ok(true)) if plan.arguments().restart => Ok("as saved, by a restart".to_owned()),
            Some(Ok(true)) => Ok("as before the test, by a restart".to_owned()),
            Some(Err(error)) => Err(format!("not restored: {error}")),
        };
        it.report.add("configuration", found);
    }
    Ok(())
}

fn print(is_good: bool, gateways: Vec<Report>, output: &Output) -> Result {
    let is_complete = gateways.iter().all(|report| report.is_complete);
    let selftest = Selftest { is_good, is_complete, gateways };
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
