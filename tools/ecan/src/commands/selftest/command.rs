//! Arguments of `ecan selftest`, and its run.

use std::collections::BTreeSet;

use ecan_sim::ClockKind;
use ecan_tool_support::command_line::interrupt::Interrupt;
use ecan_tool_support::command_line::screen::Stream;
use serde::Serialize;

use super::gateways::{TestedGateway, of_active_channels, read, restore};
use super::group::{GroupEnd, GroupTest, Member};
use super::plan::{Rate, SelftestArguments, TestPlan, Wiring};
use super::report::GatewayReport;
use crate::config_file;
use crate::context::{Bus, Context, Failure, Output, Result, note};

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

#[derive(Debug, Serialize)]
struct Selftest {
    is_good: bool,
    is_complete: bool,
    gateways: Vec<GatewayReport>,
}

pub fn run(arguments: &SelftestArguments, context: &Context) -> Result {
    let file = arguments.config.as_deref().map(super::plan::read_rates).transpose()?;
    let rates = file.as_ref().map_or_else(Rate::usual, Rate::of_file);
    let global = context.global;
    let master = file.as_ref().map_or(global.master(), |file| config_file::master(file, global));
    let plan = TestPlan::new(arguments, &rates, master)?;
    let interrupt = Interrupt::install_with_message("stopping after restoring the configuration")?;
    let options = config_file::ecrt_options(arguments.config.as_deref())?;
    let bus = context.bus_of_master(master, ClockKind::Stepped, options)?;
    let slaves = slaves(&bus, arguments)?;
    if let Some(directory) = &arguments.report {
        super::report::prepare(directory)?;
    }
    let (run, mut reports) = match bus.service() {
        Some(connection) => super::in_service::test(&bus, connection, &plan, &slaves, &interrupt)?,
        None => {
            if !arguments.force {
                let traffic = of_active_channels(&bus, &slaves, plan.tested(), arguments.observe);
                super::gateways::require_no_traffic(&traffic, arguments.observe)?;
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
        report.conclude();
        if let Some(directory) = &arguments.report
            && let Err(failure) = report.write(directory, is_duplicate)
        {
            // The test is printed.
            unwritten.get_or_insert(failure);
        }
    }
    let is_good = run.is_ok() && reports.iter().all(|report| report.is_good);
    let is_tested = reports.iter().any(GatewayReport::has_frames);
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

/// Tests one gateway as the command does without other arguments, and restores it. What prevents the test is part
/// of the report.
pub fn test_one(
    bus: &Bus,
    slave: usize,
    wiring: Option<Wiring>,
    interrupt: &Interrupt,
) -> GatewayReport {
    let test = || {
        let arguments = SelftestArguments::with_wiring(wiring)?;
        let rates = Rate::usual();
        let plan = TestPlan::new(&arguments, &rates, bus.master())?;
        let traffic = of_active_channels(bus, &[slave], plan.tested(), arguments.observe);
        super::gateways::require_no_traffic(&traffic, arguments.observe)?;
        test_and_restore(bus, &plan, &[slave], interrupt)
    };
    let (run, reports) = test().unwrap_or_else(|failure| (Err(failure), Vec::new()));
    let untested = || GatewayReport { position: slave, ..GatewayReport::default() };
    let mut report = reports.into_iter().next().unwrap_or_else(untested);
    if let Err(failure) = run {
        report.add("test", Err(failure.to_string()));
    }
    report.conclude();
    report
}

/// Tests slaves; the inner result is that of the test.
fn test_and_restore(
    bus: &Bus,
    plan: &TestPlan<'_>,
    slaves: &[usize],
    interrupt: &Interrupt,
) -> Result<(Result<GroupEnd>, Vec<GatewayReport>)> {
    let mut tested = read(bus, slaves, plan.arguments());
    let run = test(bus, plan, interrupt, &mut tested);
    restore(bus, plan, &mut tested)?;
    if matches!(run, Ok(GroupEnd::Stopped)) {
        tested.iter_mut().for_each(|gateway| gateway.report.stop());
    }
    Ok((run, tested.into_iter().map(|gateway| gateway.report).collect()))
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
        .filter(|gateway| gateway.saved.is_some())
        .map(|gateway| Member {
            position: gateway.report.position,
            report: &mut gateway.report,
            is_changed: &mut gateway.is_changed,
            was_lost: &mut gateway.was_lost,
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

fn print(is_good: bool, gateways: Vec<GatewayReport>, output: &Output) -> Result {
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

#[cfg(test)]
#[path = "command_tests.rs"]
mod tests;
