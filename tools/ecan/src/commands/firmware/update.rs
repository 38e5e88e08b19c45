//! Update of one gateway: write, wait, read the version back, evaluate.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use super::access::{Gateways, Running, reason_against};
use super::package::{Cause, FirmwareFile, Rejection};
use crate::context::{Failure, Result};
use crate::ethercat_tool::SlaveEntry;

/// Time for which a gateway with an unchanged version is observed: it may have missed a response
/// and restart later.
const SETTLING: Duration = Duration::from_secs(5);
/// Time for a restart after a transfer whose last answer is missing.
const LATE_RESTART: Duration = Duration::from_secs(20);

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "result")]
pub enum Outcome {
    /// Another version runs, which is the expected one, if given.
    Updated,
    /// The gateway restarted with the same version, which was expected.
    Reinstalled,
    Unchanged {
        has_restarted: bool,
    },
    /// Another version runs, but not the expected one.
    WrongVersion {
        expected: String,
    },
    Rejected {
        rejection: Rejection,
    },
    NotBack {
        reason: String,
    },
    NotTried {
        reason: String,
        /// True if the cause is a gateway: this one, or the one before.
        #[serde(skip)]
        is_rejection: bool,
    },
}

#[derive(Clone, Debug, Serialize)]
pub struct GatewayUpdate {
    pub position: usize,
    pub before: Option<Running>,
    pub after: Option<Running>,
    #[serde(flatten)]
    pub outcome: Outcome,
}

impl GatewayUpdate {
    pub fn is_good(&self) -> bool {
        matches!(self.outcome, Outcome::Updated | Outcome::Reinstalled)
    }

    /// Returns whether the gateway failed, as opposed to an unexpected version.
    pub fn is_rejected(&self) -> bool {
        use Outcome::{NotBack, NotTried, Rejected};
        matches!(
            self.outcome,
            Rejected { .. } | NotBack { .. } | NotTried { is_rejection: true, .. }
        )
    }

    /// Returns whether the problem affects all gateways.
    pub fn is_about_host(&self) -> bool {
        matches!(&self.outcome, Outcome::Rejected { rejection } if rejection.cause == Cause::Host)
    }

    /// Reason to stop before the next gateway; `None` to continue.
    pub fn halts(&self) -> Option<String> {
        let position = self.position;
        match self.outcome {
            Outcome::NotBack { .. } => {
                Some(format!("slave {position} did not respond after the restart"))
            }
            Outcome::WrongVersion { .. } => Some(format!("slave {position} runs a wrong version")),
            _ if self.is_about_host() => Some("the master is not accessible".to_owned()),
            _ => None,
        }
    }

    /// Gateway without update; `is_rejection`: because of its own error or that of the one before.
    pub fn not_tried(position: usize, reason: String, is_rejection: bool) -> Self {
        let outcome = Outcome::NotTried { reason, is_rejection };
        Self { position, before: None, after: None, outcome }
    }

    pub fn line(&self) -> String {
        let versions = match (&self.before, &self.after) {
            (Some(before), Some(after)) if before != after => format!("{before} -> {after}, "),
            (Some(before), _) => format!("{before}, "),
            (None, _) => String::new(),
        };
        format!("slave {}: {versions}{}", self.position, self.text())
    }

    pub fn text(&self) -> String {
        match &self.outcome {
            Outcome::Updated => "updated".to_owned(),
            Outcome::Reinstalled => "reinstalled, same version".to_owned(),
            Outcome::Unchanged { has_restarted: true } => {
                "version unchanged: the file contains the same version, or the gateway rolled back"
                    .to_owned()
            }
            Outcome::Unchanged { has_restarted: false } => {
                "version unchanged, no restart observed, or the master has not rescanned the bus; \
                 power-cycle the gateway or restart the master, and check \
                 with `ecan firmware version`"
                    .to_owned()
            }
            Outcome::WrongVersion { expected } => format!("wrong version, expected {expected}"),
            Outcome::Rejected { rejection } => rejection.to_string(),
            Outcome::NotBack { reason } => {
                format!("written, but the gateway does not respond ({reason}); version unknown")
            }
            Outcome::NotTried { reason, .. } => format!("nothing written: {reason}"),
        }
    }
}

pub struct Update<'a> {
    pub gateways: &'a dyn Gateways,
    pub file: &'a FirmwareFile,
    pub expected: Option<&'a str>,
    /// Time limit for the restart.
    pub time_limit: Duration,
}

impl Update<'_> {
    /// Updates one gateway. `is_first`: no gateway has restarted before, so it must respond at
    /// once.
    pub fn run(&self, slave: &SlaveEntry, is_first: bool) -> GatewayUpdate {
        let position = slave.position;
        let report = |before, after, outcome| GatewayUpdate { position, before, after, outcome };
        let before = match self.read_before(position, is_first) {
            Ok(before) => before,
            Err(error) => {
                return GatewayUpdate::not_tried(position, error.to_string(), true);
            }
        };
        if let Some(reason) = reason_against(self.gateways, slave) {
            return report(Some(before), None, Outcome::NotTried { reason, is_rejection: true });
        }
        let bar = self.progress_bar(position);
        let written = self.gateways.write(position, self.file, &|taken| bar.set_position(taken));
        if let Err(mut rejection) = written {
            if rejection.cause == Cause::Interrupted {
                bar.set_style(spinner("slave {msg}: no answer, waiting for a restart  {elapsed}"));
                if let Some(after) = self.wait_for_change(position, &before) {
                    bar.finish_and_clear();
                    let outcome = self.outcome(&before, &after, true);
                    return report(Some(before), Some(after), outcome);
                }
            }
            bar.finish_and_clear();
            // Status of the last firmware transfer.
            if let Ok(status) = self.gateways.number(position, 0xB000, 11) {
                rejection.add_status(status);
            }
            // It may be restarting; the report then has no version.
            let after = Running::read(self.gateways, position).ok();
            return report(Some(before), after, Outcome::Rejected { rejection });
        }
        bar.set_style(spinner("slave {msg}: written, waiting for the restart  {elapsed}"));
        let (after, has_restarted) = match self.wait(position, &before) {
            Ok(back) => back,
            Err(error) => {
                bar.finish_and_clear();
                let outcome = Outcome::NotBack { reason: error.to_string() };
                return report(Some(before), None, outcome);
            }
        };
        bar.finish_and_clear();
        let outcome = self.outcome(&before, &after, has_restarted);
        report(Some(before), Some(after), outcome)
    }

    fn outcome(&self, before: &Running, after: &Running, has_restarted: bool) -> Outcome {
        let is_expected = self.expected.is_none_or(|expected| after.version.is_version(expected));
        match (after != before, is_expected) {
            (true, true) => Outcome::Updated,
            (true, false) => {
                Outcome::WrongVersion { expected: self.expected.unwrap_or_default().to_owned() }
            }
            (false, true) if self.expected.is_some() && has_restarted => Outcome::Reinstalled,
            (false, _) => Outcome::Unchanged { has_restarted },
        }
    }

    /// Waits for another version: the gateway may have restarted before the master fetched its answer
    /// to the last packet.
    fn wait_for_change(&self, position: usize, before: &Running) -> Option<Running> {
        let deadline = self.gateways.now() + self.time_limit.min(LATE_RESTART);
        loop {
            if let Ok(running) = Running::read(self.gateways, position)
                && running != *before
                && running.serial == before.serial
                // Read twice, so that both halves are from after the restart.
                && Running::read(self.gateways, position).is_ok_and(|again| again == running)
            {
                return Some(running);
            }
            if self.gateways.now() >= deadline {
                return None;
            }
            self.gateways.pause();
        }
    }

    /// Slaves after a restarting one are unreachable for a while.
    fn read_before(&self, position: usize, is_first: bool) -> Result<Running> {
        let deadline = self.gateways.now() + self.time_limit;
        loop {
            let read = Running::read(self.gateways, position);
            if read.is_ok() || is_first || self.gateways.now() >= deadline {
                return read;
            }
            self.gateways.pause();
        }
    }

    /// Reads the version after the update, and whether the gateway was unreachable in between.
    /// Another gateway at its position counts as unreachable.
    fn wait(&self, position: usize, before: &Running) -> Result<(Running, bool)> {
        let deadline = self.gateways.now() + self.time_limit;
        let (mut was_away, mut back_since) = (false, None);
        let last = loop {
            let last = Running::read(self.gateways, position);
            let now = self.gateways.now();
            match &last {
                Ok(running) if running.serial != before.serial => was_away = true,
                // Read twice, so that both halves are from after the restart.
                Ok(running) if running != before => {
                    let again = Running::read(self.gateways, position);
                    if again.as_ref().is_ok_and(|again| again == running) {
                        return again.map(|running| (running, true));
                    }
                }
                Ok(_) if was_away => back_since = back_since.or(Some(now)),
                Ok(_) => {}
                Err(_) => (was_away, back_since) = (true, None),
            }
            if now >= deadline || back_since.is_some_and(|since| now >= since + SETTLING) {
                break last;
            }
            self.gateways.pause();
        };
        let running = last?;
        if running.serial == before.serial {
            return Ok((running, was_away));
        }
        let message = "another gateway, with serial number";
        Err(Failure::Rejected(format!("{message} {}, is at its position", running.serial)))
    }

    /// Progress bar, on a terminal only. The tool reports nothing before the end, so its bar shows
    /// only the time.
    fn progress_bar(&self, position: usize) -> ProgressBar {
        let bytes = self.file.bytes.len() as u64;
        let bar = ProgressBar::new(bytes).with_message(position.to_string());
        bar.set_style(spinner("slave {msg}: writing {total_bytes}  {wide_bar} {elapsed}"));
        bar.enable_steady_tick(Duration::from_millis(200));
        bar
    }
}

fn spinner(template: &str) -> ProgressStyle {
    let template = format!("{{spinner}} {template}");
    ProgressStyle::with_template(&template).unwrap_or_else(|_| ProgressStyle::default_spinner())
}
