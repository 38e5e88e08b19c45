//! Runs the list and reports on it.

use std::time::{Instant, SystemTime, UNIX_EPOCH};

use ecan_tool_support::command_line::interrupt::Interrupt;
use ecan_tool_support::command_line::screen::{Stream, print};
use ecan_tool_support::print_line;

use crate::arguments::Arguments;
use crate::bench::Bench;
use crate::record::Record;
use crate::report::{Report, StepReport, Versions};
use crate::step::{Group, Status, Step};
use crate::steps::GROUPS;
use crate::stop::Stop;

fn is_selected(arguments: &Arguments, group: &Group, step: &Step) -> bool {
    let name = format!("{}/{}", group.name, step.name);
    let has = |texts: &[String]| texts.iter().any(|text| name.contains(text.as_str()));
    (arguments.only.is_empty() || has(&arguments.only)) && !has(&arguments.except)
}

pub fn selected(arguments: &Arguments) -> impl Iterator<Item = (&'static Group, &'static Step)> {
    let all = GROUPS.iter().flat_map(|group| group.steps.iter().map(move |step| (*group, step)));
    all.filter(|(group, step)| is_selected(arguments, group, step))
}

/// Prints the list.
pub fn list(arguments: &Arguments) {
    for (group, step) in selected(arguments) {
        print_line!("{}/{}: {}", group.name, step.name, step.proves);
    }
}

/// Runs the list; true if nothing failed.
///
/// # Errors
/// The options contradict each other, or the report cannot be written.
pub fn run(arguments: &Arguments, interrupt: Interrupt) -> Result<bool, String> {
    let steps: Vec<_> = selected(arguments).collect();
    if steps.is_empty() {
        return Err("no step has this name; see --list".to_owned());
    }
    let directory = arguments.report.clone();
    let mut bench = Bench::new(arguments.clone(), interrupt)?;
    let mut report = Report {
        versions: Versions::read(&mut bench),
        started: unix_seconds(),
        is_quick: bench.arguments.quick,
        has_kernel_log: bench.has_kernel_log(),
        steps: Vec::new(),
        is_complete: false,
    };
    print(Stream::Output, report.head());
    for (group, step) in steps {
        let result = execute(&mut bench, group, step);
        print(Stream::Output, result.text());
        let is_end = result.status == Status::Interrupted;
        report.steps.push(result);
        // An unexpected end of this program leaves the results so far.
        report.write(&directory)?;
        if is_end {
            break;
        }
    }
    report.is_complete = !bench.interrupt.is_set();
    if let Err(stop) = bench.stop_slave() {
        print_line!("simulated gateways: {stop}");
    }
    report.write(&directory)?;
    print(Stream::Output, report.summary());
    print_line!("report: {}", directory.display());
    Ok(report.is_success())
}

pub fn unix_seconds() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs())
}

pub fn execute(bench: &mut Bench, group: &Group, step: &Step) -> StepReport {
    let start = Instant::now();
    bench.record = Record::default();
    bench.forget_kernel_log();
    let missing = step.needs.iter().find_map(|need| need.missing(bench));
    let outcome = match missing {
        Some(reason) => Err(Stop::Skipped(reason)),
        None => (step.run)(bench).and_then(|()| bench.check_slave()),
    };
    let (status, reason) = match outcome {
        Ok(()) => (Status::Passed, None),
        Err(Stop::Skipped(reason)) => (Status::Skipped, Some(reason)),
        Err(Stop::Failed(reason)) => (Status::Failed, Some(reason)),
        Err(Stop::Interrupted) => (Status::Interrupted, Some("by the user".to_owned())),
    };
    if status == Status::Failed {
        // The next step begins with gateways that have just been switched on; what these have
        // logged belongs to this step.
        let _ = bench.stop_slave();
    }
    bench.kernel_lines();
    let record = std::mem::take(&mut bench.record);
    StepReport {
        group: group.name,
        name: step.name,
        proves: step.proves,
        status,
        reason,
        seconds: start.elapsed().as_secs_f64(),
        commands: record.commands,
        figures: record.figures,
        kernel_log: record.kernel_log,
        log: record.log,
    }
}
