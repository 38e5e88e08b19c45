//! The report: text, JSON and JUnit.

mod json;
mod junit;
mod text;
mod versions;

use std::collections::BTreeMap;
use std::path::Path;

use ecan_tool_support::command_line::new_file;
use serde::Serialize;

use crate::child::CommandRecord;
use crate::step::Status;

pub use versions::Versions;

/// Result of a step.
#[derive(Debug, Serialize)]
pub struct StepReport {
    pub group: &'static str,
    pub name: &'static str,
    pub proves: &'static str,
    pub status: Status,
    /// Reason of a failure or a skip.
    pub reason: Option<String>,
    pub seconds: f64,
    pub commands: Vec<CommandRecord>,
    /// Measured values; names end with their unit.
    pub figures: BTreeMap<String, f64>,
    /// Lines of the kernel about EtherCAT, with their times in s.
    pub kernel_log: Vec<String>,
    /// Outputs of all programs, in a file of their own.
    #[serde(skip)]
    pub log: String,
}

/// Results of a run.
#[derive(Debug, Serialize)]
pub struct Report {
    pub versions: Versions,
    /// Start of the run, in s since 1970.
    pub started: u64,
    #[serde(rename = "quick")]
    pub is_quick: bool,
    /// The kernel log could be read.
    pub has_kernel_log: bool,
    /// Every selected step has a result.
    #[serde(rename = "complete")]
    pub is_complete: bool,
    pub steps: Vec<StepReport>,
}

impl Report {
    fn count(&self, status: Status) -> usize {
        self.steps.iter().filter(|step| step.status == status).count()
    }

    /// Returns whether all steps have passed or were skipped.
    pub fn is_success(&self) -> bool {
        self.is_complete
            && self.steps.iter().all(|step| matches!(step.status, Status::Passed | Status::Skipped))
    }

    /// Writes `report.txt`, `report.json` and `report.xml`, and a file with the outputs of each step.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn write(&self, directory: &Path) -> Result<(), String> {
        let outputs = directory.join("outputs");
        std::fs::create_dir_all(&outputs)
            .map_err(|error| format!("{}: {error}", outputs.display()))?;
        let mut files = vec![
            (directory.join("report.txt"), self.text()),
            (directory.join("report.json"), self.json()),
            (directory.join("report.xml"), self.junit()),
        ];
        // The outputs of the earlier steps exist already.
        if let Some(step) = self.steps.last() {
            files.push((
                outputs.join(format!("{}-{}.log", step.group, step.name)),
                step.log.clone(),
            ));
        }
        for (path, text) in files {
            new_file::write(&path, text).map_err(|error| format!("{}: {error}", path.display()))?;
        }
        Ok(())
    }
}
