//! Results of trials, and their summary.

use std::collections::{BTreeMap, HashSet};
use std::fmt::Write as _;

use ecan_test_support::Sums;

use crate::monitor::StopKind;
use crate::sdk::Class;

/// Rule that was violated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// A stop had no effect although process data reached the drive.
    StopByPdo,
    /// A stop had no effect although the drive answered.
    StopBySdo,
    /// The drive was enabled without a command of the application that is newer than its last stop.
    EnabledWithoutCommand,
    /// The SDK switched the current off at speed.
    Coasting,
    /// After a stop the motor moved longer than its deceleration needs.
    NotAtRest,
    /// After a stop the motor moved farther than its deceleration needs.
    StopDistance,
    /// Velocity of the motor over the limit.
    Velocity,
    /// Travel of the motor in some periods over the limit.
    Travel,
    /// Torque of the motor over the limit.
    Torque,
    /// A halted axis does not come to rest.
    Halt,
    /// The SDK reports an axis as running although none of its TPDOs arrives.
    LossNotDetected,
    /// Change of velocity in CSV over the limit.
    Acceleration,
    /// Distance of targets over the limit.
    TargetStep,
    /// Targets over the limit that took effect within less than a period.
    TargetsTogether,
    /// First target away from the actual position, or from 0.
    FirstTarget,
    /// Feed-forward beyond its limits, or at the first target of an enabled drive.
    FeedForward,
    /// Target beyond the bounds.
    Bounds,
    /// The SDK reports the axis as stopped while the drive follows targets.
    NotStopped,
    /// The drive follows a velocity while the SDK reports that the axis is stopped.
    Uncontrolled,
    /// An axis did not return to following targets.
    NoRecovery,
    /// The SDK reports an axis as running whose drive does not follow.
    NotFollowing,
    /// The gateways did not become ready at the start.
    NoStart,
    /// The trial itself failed.
    Trial,
    Panic,
}

#[derive(Debug, Clone)]
pub struct Finding {
    pub kind: Kind,
    pub axis: usize,
    pub at_ns: u64,
    pub text: String,
}

/// Time from a stop to the drive's deceleration.
#[derive(Debug, Clone, Copy)]
pub struct StopSample {
    pub kind: StopKind,
    pub class: Class,
    /// Process data reached the drive, or the SDK knew how.
    pub was_configured: bool,
    /// The drive ignores the quick stop: another command follows after 250 ms.
    pub ignores_quick_stop: bool,
    pub is_moving: bool,
    /// The path was blocked before the drive obeyed.
    pub was_blocked: bool,
    /// The application skipped calls before the drive obeyed.
    pub was_paused: bool,
    pub ns: u64,
    /// Time for which a frame could reach the drive since the last disturbance.
    pub clear_ns: u64,
}

/// Phase in which an axis was that was the last one to run again.
pub type Shares = BTreeMap<&'static str, u64>;

#[derive(Debug, Default)]
pub struct Outcome {
    pub findings: Vec<Finding>,
    pub stops: Vec<StopSample>,
    /// Time until all axes ran again after the last event, ns, and its shares.
    pub recovery_ns: Option<u64>,
    pub shares: Shares,
    pub fastest: f64,
    /// Axes that got a feed-forward.
    pub feed_forwards: u64,
    pub simulated_ns: u64,
    pub cycles: u64,
    /// Different states of SDK and drive in the cycles of a history.
    pub states: HashSet<u64>,
}

#[derive(Default)]
pub struct Summary {
    pub trials: u64,
    pub failed: Vec<u64>,
    findings: BTreeMap<Kind, Vec<(u64, Finding)>>,
    stops: Vec<(u64, StopSample)>,
    recoveries: Vec<(u64, u64, Shares)>,
    fastest: (f64, u64),
    feed_forwards: u64,
    simulated_ns: u64,
    cycles: u64,
    states: HashSet<u64>,
}

impl Sums<Outcome> for Summary {
    fn add(&mut self, seed: u64, outcome: Outcome) {
        self.trials += 1;
        self.simulated_ns += outcome.simulated_ns;
        self.cycles += outcome.cycles;
        self.feed_forwards += outcome.feed_forwards;
        self.states.extend(outcome.states);
        if !outcome.findings.is_empty() {
            self.failed.push(seed);
        }
        for finding in outcome.findings {
            self.findings.entry(finding.kind).or_default().push((seed, finding));
        }
        self.stops.extend(outcome.stops.into_iter().map(|stop| (seed, stop)));
        if let Some(ns) = outcome.recovery_ns {
            self.recoveries.push((ns, seed, outcome.shares));
        }
        if outcome.fastest > self.fastest.0 {
            self.fastest = (outcome.fastest, seed);
        }
    }

    fn progress(&self, seconds: f64) -> String {
        format!(
            "{} trials, {} with violations, {:.0} simulated seconds per second",
            self.trials,
            self.failed.len(),
            self.simulated_s() / seconds
        )
    }
}

impl Summary {
    pub fn simulated_s(&self) -> f64 {
        self.simulated_ns as f64 / 1e9
    }

    pub fn text(&mut self) -> String {
        let mut text = String::new();
        // infallible: writing to a string
        let _ = self.write(&mut text);
        text
    }

    fn write(&mut self, out: &mut String) -> std::fmt::Result {
        self.failed.sort_unstable();
        let (trials, failed, cycles) = (self.trials, self.failed.len(), self.cycles);
        writeln!(out, "{trials} trials, {failed} with violations, {cycles} cycles")?;
        for (kind, findings) in &mut self.findings {
            findings.sort_by_key(|(seed, _)| *seed);
            writeln!(out, "  {kind:?}: {}", findings.len())?;
            for (seed, finding) in findings.iter().take(6) {
                writeln!(
                    out,
                    "    seed {seed}, axis {}, {} ms: {}",
                    finding.axis,
                    finding.at_ns / 1_000_000,
                    finding.text
                )?;
            }
        }
        writeln!(
            out,
            "fastest CSP motion: {:.3} of the limit (seed {})",
            self.fastest.0, self.fastest.1
        )?;
        writeln!(out, "axes with feed-forward: {}", self.feed_forwards)?;
        if !self.states.is_empty() {
            writeln!(out, "different states: {}", self.states.len())?;
        }
        self.write_stops(out)?;
        self.write_recoveries(out)
    }

    fn write_stops(&self, out: &mut String) -> std::fmt::Result {
        let title = "from stop to deceleration of a drive that follows, ms";
        writeln!(out, "{title:<58}  count   min median   99 %    max (seed)")?;
        let mut rows: BTreeMap<String, Vec<(u64, u64)>> = BTreeMap::new();
        for (seed, stop) in &self.stops {
            let (ns, path) = match (stop.was_blocked, stop.was_paused) {
                (false, false) => (stop.ns, "path clear"),
                (false, true) => (stop.clear_ns, "calls skipped, without these"),
                (true, _) => (stop.clear_ns, "path disturbed, since then"),
            };
            if stop.ignores_quick_stop {
                rows.entry(format!("3 drives that ignore quick stop, {path}"))
                    .or_default()
                    .push((ns, *seed));
                continue;
            }
            let group = match stop.kind {
                StopKind::Takeover => "takeover",
                _ if stop.was_configured => "configured",
                _ => "not configured",
            };
            rows.entry(format!("1 all, {group}, {path}")).or_default().push((ns, *seed));
            let row = format!("2 {:?}, {:?}, {path}", stop.kind, stop.class);
            rows.entry(row).or_default().push((ns, *seed));
            if stop.is_moving {
                rows.entry(format!("0 moving, {path}")).or_default().push((ns, *seed));
            }
        }
        for (name, mut times) in rows {
            times.sort_unstable();
            let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize].0 as f64 / 1e6;
            writeln!(
                out,
                "  {:<56} {:>6} {:>5.1} {:>6.1} {:>6.1} {:>6.1} ({})",
                &name[2..],
                times.len(),
                at(0.0),
                at(0.5),
                at(0.99),
                at(1.0),
                times.last().map_or(0, |last| last.1),
            )?;
        }
        Ok(())
    }

    fn write_recoveries(&mut self, out: &mut String) -> std::fmt::Result {
        self.recoveries.sort_by_key(|(ns, seed, _)| (*ns, *seed));
        let Some(last) = self.recoveries.len().checked_sub(1) else { return Ok(()) };
        let at = |share: f64| self.recoveries[(last as f64 * share) as usize].0 as f64 / 1e9;
        writeln!(
            out,
            "recovery: {} trials, median {:.2} s, 90 % {:.2} s, 99 % {:.2} s, longest {:.2} s; \
             more than 12 s: {}",
            last + 1,
            at(0.5),
            at(0.9),
            at(0.99),
            at(1.0),
            self.recoveries.iter().filter(|(ns, ..)| *ns > 12_000_000_000).count(),
        )?;
        let mut shares = Shares::new();
        let mut slow = Shares::new();
        for (ns, _, own) in &self.recoveries {
            for (name, time) in own {
                *shares.entry(name).or_default() += time;
                if *ns > 5_000_000_000 {
                    *slow.entry(name).or_default() += time;
                }
            }
        }
        for (title, shares) in [("all", shares), ("those above 5 s", slow)] {
            let total: u64 = shares.values().sum::<u64>().max(1);
            write!(out, "  time of {title}:")?;
            for (name, time) in shares {
                write!(out, " {name} {:.1} %,", time as f64 * 100.0 / total as f64)?;
            }
            writeln!(out)?;
        }
        for (ns, seed, shares) in self.recoveries.iter().rev().take(8) {
            let worst = shares.iter().max_by_key(|(_, time)| **time);
            writeln!(out, "  seed {seed}: {:.1} s, mostly {worst:?}", *ns as f64 / 1e9)?;
        }
        Ok(())
    }
}
