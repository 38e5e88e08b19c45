//! Runs the seeds on all processors, reports findings and the sums.

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use ecan_tool_support::command_line::interrupt::Interrupt;
use ecan_tool_support::command_line::new_file;
use ecan_tool_support::command_line::screen::{Stream, print};
use ecan_tool_support::print_line;

use crate::Arguments;
use crate::finding::{Finding, Outcome, Rule};
use crate::plan::Plan;
use crate::shrink::shrink;
use crate::trial::Trial;

/// Time between two lines of progress.
const PROGRESS: Duration = Duration::from_secs(20);

/// The outcome of a plan; a panic is a finding.
pub fn trial(plan: &Plan) -> Outcome {
    catch_unwind(AssertUnwindSafe(|| Trial::run(plan))).unwrap_or_else(|cause| {
        let text = cause.downcast_ref::<String>().cloned();
        let text = text.or_else(|| cause.downcast_ref::<&str>().map(|text| (*text).to_owned()));
        let finding = Finding { rule: Rule::Panic, cycle: 0, text: text.unwrap_or_default() };
        Outcome { finding: Some(finding), ..Outcome::default() }
    })
}

#[derive(Default)]
struct Sums {
    trials: u64,
    findings: u64,
    total: Outcome,
    longest_recovery: (u64, u64),
}

impl Sums {
    fn add(&mut self, seed: u64, outcome: &Outcome) {
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

    fn line(&self, seconds: f64) -> String {
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
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = arguments.threads.unwrap_or(processors).max(1);
    let next = AtomicU64::new(0);
    let sums = Mutex::new(Sums::default());
    let error = Mutex::new(None);
    let begin = Instant::now();
    let reported = Mutex::new(begin);
    let is_over = || {
        let limit = arguments.seconds.map(Duration::from_secs);
        interrupt.is_set() || limit.is_some_and(|limit| begin.elapsed() >= limit)
    };
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                while !is_over() {
                    let nth = next.fetch_add(1, Ordering::Relaxed);
                    if nth >= arguments.seeds {
                        return;
                    }
                    let seed = arguments.seed + nth;
                    let plan = Plan::draw(seed, arguments.cycles);
                    let outcome = trial(&plan);
                    if outcome.finding.is_some()
                        && let Err(text) = report(&plan, &outcome, &arguments.output)
                    {
                        error.lock().expect("no panic").get_or_insert(text);
                    }
                    let mut sums = sums.lock().expect("no panic");
                    sums.add(seed, &outcome);
                    let mut reported = reported.lock().expect("no panic");
                    if reported.elapsed() > PROGRESS {
                        *reported = Instant::now();
                        print_line!("{}", sums.line(begin.elapsed().as_secs_f64()));
                    }
                }
            });
        }
    });
    if let Some(text) = error.into_inner().expect("no panic") {
        return Err(text);
    }
    let sums = sums.into_inner().expect("no panic");
    print_line!("{}", sums.line(begin.elapsed().as_secs_f64()));
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
