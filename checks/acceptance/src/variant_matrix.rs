//! The list with gateways that differ from the assumptions (docs/ASSUMPTIONS.md), one alternative at
//! a time.

use std::fmt::Write as _;

use ecan_tool_support::command_line::interrupt::Interrupt;
use ecan_tool_support::command_line::new_file;
use ecan_tool_support::print_line;
use serde::Deserialize;

use crate::arguments::Arguments;
use crate::bench::Bench;
use crate::report::StepReport;
use crate::runner;
use crate::step::Status;
use crate::stop::Stop;

/// A switch, as `ecan-sim variants --json` prints it.
#[derive(Deserialize)]
struct Switch {
    key: String,
    table: String,
    assumptions: Vec<String>,
    description: String,
    alternatives: Vec<Alternative>,
}

#[derive(Deserialize)]
struct Alternative {
    value: String,
    description: String,
    default: bool,
}

impl Switch {
    /// The lines of a gateway with this alternative.
    fn keys(&self, alternative: &Alternative) -> String {
        let line = format!("{} = {}\n", self.key, alternative.value);
        if self.table == "[[gateway]]" { line } else { format!("{}\n{line}", self.table) }
    }

    /// The output of a step names an assumption of this switch.
    fn is_named_in(&self, output: &str) -> bool {
        self.assumptions.iter().any(|row| {
            let name = format!("assumption {row}");
            output.match_indices(&name).any(|(at, _)| {
                !output[at + name.len()..].starts_with(|next: char| next.is_ascii_digit())
            })
        })
    }
}

/// What became of a step.
enum Outcome {
    Works,
    /// It ended with an error that names the assumption.
    Named,
    Failed(String),
}

fn outcome(switch: &Switch, step: &StepReport) -> Outcome {
    match step.status {
        Status::Failed if switch.is_named_in(&step.log) => Outcome::Named,
        Status::Failed | Status::Interrupted => {
            Outcome::Failed(step.reason.clone().unwrap_or_default())
        }
        Status::Passed | Status::Skipped => Outcome::Works,
    }
}

/// The first line of an error of a program that names the assumption.
fn error_line<'a>(switch: &Switch, log: &'a str) -> &'a str {
    let line = log.lines().find(|line| switch.is_named_in(line)).unwrap_or_default();
    // The log has the time before each line.
    line.trim_start().split_once(' ').map_or(line, |(_, text)| text.trim_start_matches("- ").trim())
}

fn switches(bench: &mut Bench) -> Result<Vec<Switch>, Stop> {
    let program = bench.plain("ecan-sim", ["variants", "--json"]);
    let finished = bench.run(program)?.expect(0)?;
    serde_json::from_str(&finished.output())
        .map_err(|error| Stop::failed(format!("ecan-sim variants --json: {error}")))
}

/// Runs the selected steps with each alternative; true if each step works or names the assumption.
///
/// # Errors
/// The options contradict each other, or the table cannot be written.
pub fn run(arguments: &Arguments, interrupt: Interrupt) -> Result<bool, String> {
    if arguments.library.as_deref() != Some("sim") {
        return Err("--each-variant needs --library sim".to_owned());
    }
    let directory = arguments.report.clone();
    let mut bench = Bench::new(arguments.clone(), interrupt)?;
    let mut switches = switches(&mut bench).map_err(|stop| stop.to_string())?;
    if !arguments.switch.is_empty() {
        if let Some(key) =
            arguments.switch.iter().find(|key| switches.iter().all(|other| other.key != **key))
        {
            return Err(format!("--switch {key}: not listed by `ecan-sim variants`"));
        }
        switches.retain(|switch| arguments.switch.contains(&switch.key));
    }
    let mut table =
        String::from("| switch | alternative | rows | outcome |\n| --- | --- | --- | --- |\n");
    let mut failed = 0;
    for switch in &switches {
        for alternative in switch.alternatives.iter().filter(|alternative| !alternative.default) {
            bench.change_gateways(switch.keys(alternative)).map_err(|stop| stop.to_string())?;
            let name = format!("{} = {}", switch.key, alternative.value);
            let (mut named, mut faulty) = (Vec::new(), Vec::new());
            let mut count = 0;
            let mut text = String::new();
            for (group, step) in runner::selected(arguments) {
                let report = runner::execute(&mut bench, group, step);
                if report.status == Status::Interrupted {
                    return Ok(false);
                }
                let step = format!("{}/{}", report.group, report.name);
                count += usize::from(report.status != Status::Skipped);
                match outcome(switch, &report) {
                    Outcome::Works => {}
                    Outcome::Named => {
                        text = error_line(switch, &report.log).to_owned();
                        named.push(step);
                    }
                    Outcome::Failed(reason) => {
                        print_line!("FAILED   {name}: {step}\n  {}", reason.replace('\n', "\n  "));
                        faulty.push(step);
                    }
                }
            }
            failed += faulty.len();
            let outcome = match (&named[..], &faulty[..]) {
                ([], []) => "works".to_owned(),
                (steps, []) => {
                    format!("{} of {count} steps end with `{text}`", steps.len())
                }
                (_, steps) => format!("**failed** in {}", steps.join(", ")),
            };
            print_line!("{name}: {outcome}");
            let _ = writeln!(
                table,
                "| {}: `{}` | `{}`: {} | {} | {outcome} |",
                switch.description,
                switch.key,
                alternative.value,
                alternative.description,
                switch.assumptions.join(", ")
            );
        }
    }
    let path = directory.join("variants.md");
    new_file::write(&path, table).map_err(|error| format!("{}: {error}", path.display()))?;
    print_line!("{failed} steps failed\ntable: {}", path.display());
    Ok(failed == 0)
}
