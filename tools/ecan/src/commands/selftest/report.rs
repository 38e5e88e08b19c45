//! Report of a gateway: its checks, as text and as a file.

use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use ecan_tool_support::command_line::new_file::{Existing, WholeFile};
use serde::Serialize;

use super::exchange::{ChannelCounters, ChannelState, Counts};
use super::plan::{Route, TestStep};
use crate::context::{Failure, Output, Result, Tone};
use crate::output::with_simulated;

#[derive(Debug, Serialize)]
pub(super) struct Check {
    pub(super) name: String,
    /// `None` if not tested, with the reason in `detail`.
    pub(super) is_good: Option<bool>,
    pub(super) detail: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) frames: Option<Figures>,
}

impl Check {
    /// Check of the frames of a route; `states` are those of its channels before and after.
    pub(super) fn of_route(
        step: &TestStep<'_>,
        route: Route,
        counts: Counts,
        states: &[&(ChannelCounters, ChannelState)],
        found: Result<String, String>,
    ) -> Self {
        let (bitrate, data_bitrate) = step.rate.bit_rates();
        let channels = states.iter().map(|(_, after)| *after).collect();
        let Route { from, to } = route;
        let frames = Figures { from, to, bitrate, data_bitrate, counts, channels };
        let is_good = Some(found.is_ok());
        let (Ok(detail) | Err(detail)) = found;
        Self { name: step.check_name(route), is_good, detail, frames: Some(frames) }
    }
}

#[derive(Debug, Serialize)]
pub(super) struct Figures {
    pub(super) from: u8,
    pub(super) to: u8,
    pub(super) bitrate: u32,
    pub(super) data_bitrate: Option<u32>,
    #[serde(flatten)]
    pub(super) counts: Counts,
    /// Channels after the test: sender, and receiver if different.
    pub(super) channels: Vec<ChannelState>,
}

#[derive(Debug, Default, Serialize)]
pub struct GatewayReport {
    /// No check failed.
    pub is_good: bool,
    /// Nothing was left out.
    pub(super) is_complete: bool,
    pub(super) was_stopped: bool,
    /// Start time of the test, from the clock of this computer.
    pub(super) time: String,
    pub(super) position: usize,
    pub(super) serial: Option<u64>,
    pub(super) firmware: Option<String>,
    pub(super) hardware: Option<String>,
    pub(super) vendor_id: u32,
    pub(super) product_code: u32,
    pub(super) revision: u32,
    pub(super) checks: Vec<Check>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) file: Option<String>,
}

impl GatewayReport {
    /// Report about a gateway that is not tested.
    pub fn without_test(position: usize, reason: &str) -> Self {
        let mut report = Self { position, ..Self::default() };
        report.leave_out("test", reason);
        report.conclude();
        report
    }

    /// Evaluates the checks.
    pub(super) fn conclude(&mut self) {
        self.is_good = self.is_good_so_far();
        self.is_complete = self.left_out() == 0;
    }

    pub(super) fn add(&mut self, name: impl Into<String>, found: Result<String, String>) {
        let is_good = Some(found.is_ok());
        let (Ok(detail) | Err(detail)) = found;
        self.checks.push(Check { name: name.into(), is_good, detail, frames: None });
    }

    /// Adds a check that is not executed.
    pub(super) fn leave_out(&mut self, name: impl Into<String>, reason: impl Into<String>) {
        let (name, detail) = (name.into(), reason.into());
        self.checks.push(Check { name, is_good: None, detail, frames: None });
    }

    pub(super) fn left_out(&self) -> usize {
        self.checks.iter().filter(|check| check.is_good.is_none()).count()
    }

    pub(super) fn stop(&mut self) {
        self.was_stopped = true;
        self.add("test", Err("stopped before the end".to_owned()));
    }

    pub(super) fn is_good_so_far(&self) -> bool {
        self.checks.iter().all(|check| check.is_good != Some(false))
    }

    /// Returns whether any frames were exchanged.
    pub(super) fn has_frames(&self) -> bool {
        self.checks.iter().any(|check| check.frames.is_some())
    }

    pub(super) fn title(&self) -> String {
        match self.own_serial() {
            Some(serial) => format!("gateway {serial} at position {}", self.position),
            None if self.serial.is_some() => {
                format!("gateway without a serial number at position {}", self.position)
            }
            None => format!("slave at position {}", self.position),
        }
    }

    pub fn print(&self, output: &Output, out: &mut dyn Write) -> std::io::Result<()> {
        let verdict = match self.is_good {
            true => output.toned(Tone::Good, "passed"),
            false => output.toned(Tone::Bad, "FAILED"),
        };
        let left_out = match self.left_out() {
            0 => String::new(),
            count => format!(", {count} not tested"),
        };
        writeln!(out, "{}: {verdict}{left_out}", self.title())?;
        let width = self.checks.iter().map(|check| check.name.len()).max().unwrap_or(0);
        for Check { name, is_good, detail, .. } in &self.checks {
            let mark = match is_good {
                Some(true) => output.toned(Tone::Good, "good  "),
                Some(false) => output.toned(Tone::Bad, "FAILED"),
                None => output.toned(Tone::Warning, "-     "),
            };
            // The result follows the name, possibly on several lines.
            let detail = detail.replace('\n', "\n          ");
            let not_tested = if is_good.is_none() { "not tested: " } else { "" };
            writeln!(out, "  {mark}  {name:<width$}  {not_tested}{detail}")?;
        }
        match &self.file {
            Some(file) => writeln!(out, "  report: {file}"),
            None => Ok(()),
        }
    }

    /// Serial number, if programmed.
    pub(super) fn own_serial(&self) -> Option<u64> {
        self.serial.filter(|serial| !matches!(*serial, 0 | u64::MAX))
    }

    /// Writes the report to a new file in a directory, named after the serial number, or after the
    /// position if the serial number is not unique.
    pub(super) fn write(&mut self, directory: &Path, is_duplicate: bool) -> Result {
        let position = self.position;
        let name = match self.own_serial() {
            Some(serial) if is_duplicate => format!("{serial}-position-{position}"),
            Some(serial) => serial.to_string(),
            None => format!("position-{position}"),
        };
        let text = serde_json::to_string_pretty(self).map_err(std::io::Error::from)?;
        let path = write_new(directory, &name, &(with_simulated(text) + "\n"))?;
        self.file = Some(path.display().to_string());
        Ok(())
    }
}

/// Writes a file that does not exist; earlier reports are kept, also an empty one.
fn write_new(directory: &Path, name: &str, text: &str) -> Result<PathBuf> {
    let mut number = 1_u32;
    loop {
        let path = directory.join(match number {
            1 => format!("{name}.json"),
            more => format!("{name}-{more}.json"),
        });
        if path.symlink_metadata().is_ok() && number < u32::MAX {
            number += 1;
            continue;
        }
        let file = WholeFile::create(&path, Existing::Keep);
        match file.and_then(|file| file.finish(text.as_bytes())) {
            Ok(()) => return Ok(path),
            // Another program has created it just now.
            Err(error) if error.kind() == ErrorKind::AlreadyExists && number < u32::MAX => {
                number += 1;
            }
            Err(error) => return Err(Failure::file("write", &path, error)),
        }
    }
}

pub(super) fn prepare(directory: &Path) -> Result {
    if directory.exists() && !directory.is_dir() {
        return Err(Failure::file("write to", directory, "not a directory"));
    }
    std::fs::create_dir_all(directory).map_err(|error| Failure::file("write", directory, error))
}
