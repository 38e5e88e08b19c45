//! One gateway's update: write, wait, read the version back, and judge.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use super::gateways::{Gateways, Running, SlaveEntry, reason_against};
use super::package::FirmwareFile;
use super::rejection::{Cause, Rejection};
use crate::failure::Failure;
use crate::slave_choice::Unknown;

/// How long a gateway that is back with the same version is looked at before that counts: it may
/// have missed an answer only, and restart yet.
const SETTLING: Duration = Duration::from_secs(5);

/// What became of an update.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "result")]
pub enum Outcome {
    /// Another version runs, and it is the expected one if one was named.
    Updated,
    /// The gateway restarted with the version that ran before, and that was expected.
    Reinstalled,
    /// The version is what it was.
    Unchanged {
        /// Whether the gateway was seen to restart.
        has_restarted: bool,
    },
    /// Another version runs, but not the expected one.
    WrongVersion {
        /// The expected one.
        expected: String,
    },
    /// The file was not taken.
    Refused {
        /// Why.
        refusal: Rejection,
    },
    /// The gateway does not answer since.
    NotBack {
        /// What was said last.
        reason: String,
    },
    /// Nothing was written.
    NotTried {
        /// Why.
        reason: String,
        /// Whether it is for what a gateway did: this one, or the one before.
        #[serde(skip)]
        is_refusal: bool,
    },
}

/// What became of one gateway.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Place in the ring.
    pub position: usize,
    /// What ran before.
    pub before: Option<Running>,
    /// What runs now, read back.
    pub after: Option<Running>,
    /// The judgement.
    #[serde(flatten)]
    pub outcome: Outcome,
}

impl Report {
    pub fn is_good(&self) -> bool {
        matches!(self.outcome, Outcome::Updated | Outcome::Reinstalled)
    }

    /// Whether it is the gateway that failed, and not the version that is another.
    pub fn is_refused(&self) -> bool {
        use Outcome::{NotBack, NotTried, Refused};
        matches!(self.outcome, Refused { .. } | NotBack { .. } | NotTried { is_refusal: true, .. })
    }

    /// Whether the fault is in front of all gateways.
    pub fn is_about_host(&self) -> bool {
        matches!(&self.outcome, Outcome::Refused { refusal } if refusal.cause == Cause::Host)
    }

    /// Why no further gateway gets this file; `None` where it may.
    pub fn halts(&self) -> Option<String> {
        let position = self.position;
        match self.outcome {
            Outcome::NotBack { .. } => Some(format!("slave {position} did not come back")),
            Outcome::WrongVersion { .. } => {
                Some(format!("slave {position} came back with a wrong version"))
            }
            _ if self.is_about_host() => Some("the master cannot be reached".to_owned()),
            _ => None,
        }
    }

    /// One that keeps what it has, for what it or the one before it did.
    pub fn left(position: usize, reason: String) -> Self {
        let outcome = Outcome::NotTried { reason, is_refusal: true };
        Self { position, before: None, after: None, outcome }
    }

    /// One that is left out for a reason that is no gateway's fault.
    pub fn left_out(position: usize, reason: String) -> Self {
        let outcome = Outcome::NotTried { reason, is_refusal: false };
        Self { position, before: None, after: None, outcome }
    }

    /// One that cannot be asked whether it is a gateway.
    pub fn unknown(slave: &Unknown) -> Self {
        Self::left_out(slave.position, format!("it {}", slave.words()))
    }

    /// The gateway, its versions and the judgement.
    pub fn line(&self) -> String {
        let versions = match (&self.before, &self.after) {
            (Some(before), Some(after)) if before != after => format!("{before} -> {after}, "),
            (Some(before), _) => format!("{before}, "),
            (None, _) => String::new(),
        };
        format!("slave {}: {versions}{}", self.position, self.words())
    }

    /// The judgement in words.
    pub fn words(&self) -> String {
        match &self.outcome {
            Outcome::Updated => "updated".to_owned(),
            Outcome::Reinstalled => "installed again, the same version".to_owned(),
            Outcome::Unchanged { has_restarted: true } => {
                "the version has not changed: the file holds the same version, or the gateway has \
                 gone back to the old one"
                    .to_owned()
            }
            Outcome::Unchanged { has_restarted: false } => {
                "the version has not changed: the gateway was not seen to restart, or the master \
                 has not scanned it again; switch it off and on, or restart the master, and look \
                 with `ecan firmware version`"
                    .to_owned()
            }
            Outcome::WrongVersion { expected } => format!("wrong version, {expected} was expected"),
            Outcome::Refused { refusal } => refusal.to_string(),
            Outcome::NotBack { reason } => format!(
                "written, but the gateway does not answer since ({reason}); what it runs is unknown"
            ),
            Outcome::NotTried { reason, .. } => format!("nothing was written: {reason}"),
        }
    }
}

/// What every gateway gets.
#[derive(Debug)]
pub struct Update<'a> {
    pub gateways: &'a dyn Gateways,
    pub file: &'a FirmwareFile,
    pub expected: Option<&'a str>,
    /// How long a gateway may take to come back.
    pub patience: Duration,
}

impl std::fmt::Debug for dyn Gateways + '_ {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("Gateways")
    }
}

impl Update<'_> {
    /// Updates one gateway. `is_first`: none restarted before, so that it has to answer at once.
    pub fn run(&self, slave: &SlaveEntry, is_first: bool) -> Report {
        let position = slave.position;
        let report = |before, after, outcome| Report { position, before, after, outcome };
        let before = match self.read_before(position, is_first) {
            Ok(before) => before,
            Err(error) => {
                return Report::left(position, error.to_string());
            }
        };
        if let Some(reason) = reason_against(self.gateways, slave) {
            return report(Some(before), None, Outcome::NotTried { reason, is_refusal: true });
        }
        let bar = self.progress_bar(position);
        let written = self.gateways.write(position, self.file, &|taken| bar.set_position(taken));
        if let Err(mut refusal) = written {
            bar.finish_and_clear();
            if let Ok(status) = self.gateways.foe_status(position) {
                refusal.add_status(status);
            }
            // It may be away just now; then the report says nothing of what runs.
            let after = Running::read(self.gateways, position).ok();
            return report(Some(before), after, Outcome::Refused { refusal });
        }
        bar.set_style(spinner("slave {msg}: written, waiting for it to come back  {elapsed}"));
        let (after, has_restarted) = match self.wait(position, &before) {
            Ok(back) => back,
            Err(error) => {
                bar.finish_and_clear();
                let outcome = Outcome::NotBack { reason: error.to_string() };
                return report(Some(before), None, outcome);
            }
        };
        bar.finish_and_clear();
        let outcome = self.judge(&before, &after, has_restarted);
        report(Some(before), Some(after), outcome)
    }

    fn judge(&self, before: &Running, after: &Running, has_restarted: bool) -> Outcome {
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

    /// The slaves behind one that restarts are away with it for a while.
    fn read_before(&self, position: usize, is_first: bool) -> Result<Running, Failure> {
        let deadline = self.gateways.now() + self.patience;
        loop {
            let read = Running::read(self.gateways, position);
            if read.is_ok() || is_first || self.gateways.now() >= deadline {
                return read;
            }
            self.gateways.pause();
        }
    }

    /// What runs afterwards, and whether the gateway was away meanwhile. Another gateway in its
    /// place counts as away.
    fn wait(&self, position: usize, before: &Running) -> Result<(Running, bool), Failure> {
        let deadline = self.gateways.now() + self.patience;
        let (mut was_away, mut back_since) = (false, None);
        let last = loop {
            let last = Running::read(self.gateways, position);
            let now = self.gateways.now();
            match &last {
                Ok(running) if running.serial != before.serial => was_away = true,
                // Read twice, so that no half of it is of the time before.
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
        let words = "another gateway, of serial number";
        Err(Failure::Refused(format!("{words} {}, is at its position", running.serial)))
    }

    /// On a terminal only. The tool says nothing before it is done, so that its bar shows the time
    /// alone.
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
