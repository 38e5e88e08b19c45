//! Runs the seeds on all processors, reports findings and the sums.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use ecan_test_support::{Sums, catch_panic, run_seeds};
use ecan_tool_support::command_line::interrupt::Interrupt;
use ecan_tool_support::command_line::new_file;
use ecan_tool_support::command_line::screen::{Stream, print};
use ecan_tool_support::print_line;

use crate::Arguments;
use crate::finding::{Finding, Outcome, Rule};
use crate::plan::Plan;
use crate::shrink::shrink;
use crate::trial::Trial;

/// The outcome of a plan; a panic is a finding.
pub fn trial(plan: &Plan) -> Outcome {
    catch_panic(|| Trial::run(plan)).unwrap_or_else(|text| {
        let finding = Finding { rule: Rule::Panic, cycle: 0, text };
        Outcome { finding: Some(finding), ..Outcome::default() }
    })
}

#[derive(Default)]
struct SoakSums {
    trials: u64,
    findings: u64,
    total: Outcome,
    longest_recovery: (u64, u64),
    /// The first finding that could not be written.
    error: Option<String>,
}

impl Sums<Result<Outcome, String>> for SoakSums {
    fn add(&mut self, seed: u64, outcome: Result<Outcome, String>) {
        let outcome = match outcome {
            Ok(outcome) => outcome,
            Err(text) => {
                self.error.get_or_insert(text);
                return;
            }
        };
        self.trials += 1;
        self.findings += u64::from(outcome.finding.is_some());
        self.total.cycles += outcome.cycles;
        self.total.simulated_ns += outcome.simulated_ns;
        self.total.accepted += outcome.accepted;
        self.total.on_bus += outcome.on_bus;
        self.total.received += outcome.received;
        self.total.faults += outcome.faults;
        self.total.gateways += outcome.gateways;
        self.longest_recovery = self.longest_recovery.max((outcome.recovery_ns, seed));
    }

    fn progress(&self, seconds: f64) -> String {
        let memory =
            resident_mib().map_or_else(String::new, |mib| format!("; {mib} MiB of memory"));
        format!(
            "{} seeds, {} with a finding; {} cycles of {} gateways, {:.0} s simulated in {seconds:.0} s{memory}",
            self.trials,
            self.findings,
            self.total.cycles,
            self.total.gateways,
            self.total.simulated_ns as f64 / 1e9
        )
    }
}

/// Returns true without a finding.
pub fn run(arguments: &Arguments, interrupt: &Interrupt) -> Result<bool, String> {
    if let Some(file) = &arguments.replay {
        return replay(file);
    }
    if arguments.plan {
        print(Stream::Output, text(&Plan::draw(arguments.seed, arguments.cycles))?);
        return Ok(true);
    }
    let begin = Instant::now();
    let is_over = || {
        let limit = arguments.seconds.map(Duration::from_secs);
        interrupt.is_set() || limit.is_some_and(|limit| begin.elapsed() >= limit)
    };
    let reported = |seed| {
        let plan = Plan::draw(seed, arguments.cycles);
        let outcome = trial(&plan);
        report(&plan, &outcome, &arguments.output).map(|()| outcome)
    };
    let seeds = (arguments.seed..).zip(0..arguments.seeds).map(|(seed, _)| seed);
    let print = |line: &str| print_line!("{line}");
    let sums = run_seeds(seeds, arguments.threads, is_over, reported, SoakSums::default(), print);
    if let Some(text) = sums.error {
        return Err(text);
    }
    print_line!("{}", sums.progress(begin.elapsed().as_secs_f64()));
    let total = &sums.total;
    print_line!(
        "{} frames accepted, {} on the buses, {} received; {} faults; longest recovery {:.1} s (seed {})",
        total.accepted,
        total.on_bus,
        total.received,
        total.faults,
        sums.longest_recovery.0 as f64 / 1e9,
        sums.longest_recovery.1
    );
    Ok(sums.findings == 0)
}

fn replay(file: &Path) -> Result<bool, String> {
    let name = file.display();
    let text = fs::read_to_string(file).map_err(|error| format!("cannot read {name}: {error}"))?;
    let plan: Plan = toml::from_str(&text).map_err(|error| format!("{name}: {error}"))?;
    let outcome = trial(&plan);
    match &outcome.finding {
        Some(finding) => print_line!("seed {}: {finding}", plan.seed),
        None => print_line!("no finding in {} cycles", outcome.cycles),
    }
    Ok(outcome.finding.is_none())
}

fn text(plan: &Plan) -> Result<String, String> {
    toml::to_string(plan).map_err(unwritable)
}

fn unwritable(error: toml::ser::Error) -> String {
    format!("the plan cannot be written: {error}")
}

/// Resident memory of the process, MiB.
fn resident_mib() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    line.trim().strip_suffix(" kB")?.parse::<u64>().ok().map(|kib| kib / 1_024)
}

/// Prints a finding, and writes the smallest plan that repeats it, with its scenario.
fn report(plan: &Plan, outcome: &Outcome, directory: &Path) -> Result<(), String> {
    let Some(finding) = &outcome.finding else { return Ok(()) };
    print_line!("seed {}: {finding}", plan.seed);
    let (small, outcome) = shrink(plan, outcome, &trial);
    let name = |kind: &str| directory.join(format!("soak-{}{kind}.toml", plan.seed));
    let write = |path: &Path, text: &str| {
        new_file::write(path, text)
            .map_err(|error| format!("cannot write {}: {error}", path.display()))
    };
    let smallest = outcome.finding.as_ref().unwrap_or(finding);
    let file = name("");
    let comment = smallest.to_string().replace('\n', "\n# ");
    write(&file, &format!("# {comment}\n{}", text(&small)?))?;
    write(&name("-scenario"), &small.scenario_text().map_err(unwritable)?)?;
    print_line!(
        "  {} gateways, {} events: {smallest}\n  repeat: ecan-soak --replay {}",
        small.machine.gateway.len(),
        small.event.len(),
        file.display()
    );
    Ok(())
}
