use std::fmt::Write;

use super::{Report, StepReport};
use crate::step::Status;

/// Lines of the kernel log in the text of a step that failed.
const KERNEL_LINES: usize = 30;

impl StepReport {
    /// The lines of a step.
    pub fn text(&self) -> String {
        let mut text = format!(
            "{:<8} {:<36} {:>8.1} s",
            self.status.text(),
            format!("{}/{}", self.group, self.name),
            self.seconds
        );
        for (name, value) in &self.figures {
            let _ = write!(text, "  {name} {value:.3}");
        }
        text.push('\n');
        match (self.status, &self.reason) {
            (Status::Failed, Some(reason)) => {
                let _ = writeln!(text, "  proves: {}", self.proves);
                let _ = writeln!(text, "  failed: {}", reason.replace('\n', "\n  "));
                if let Some(last) = self.commands.last() {
                    let _ = writeln!(text, "  last command: {}", last.command);
                }
                let start = self.kernel_log.len().saturating_sub(KERNEL_LINES);
                for line in &self.kernel_log[start..] {
                    let _ = writeln!(text, "  kernel: {line}");
                }
            }
            (_, Some(reason)) => {
                let _ = writeln!(text, "  {reason}");
            }
            (_, None) => {}
        }
        text
    }
}

impl Report {
    /// Versions, before the steps.
    pub fn head(&self) -> String {
        let mut text = String::from("Acceptance of the ECAN-Lite host SDK\n");
        for (name, value) in self.versions.rows() {
            let _ = writeln!(text, "{name:<10} {value}");
        }
        if !self.has_kernel_log {
            text.push_str("kernel log not included\n");
        }
        text.push('\n');
        text
    }

    /// Numbers, after the steps.
    pub fn summary(&self) -> String {
        let mut text = format!(
            "\n{} passed, {} failed, {} skipped",
            self.count(Status::Passed),
            self.count(Status::Failed),
            self.count(Status::Skipped)
        );
        text.push_str(if self.is_complete { "\n" } else { ", not complete\n" });
        for step in self.steps.iter().filter(|step| step.status == Status::Failed) {
            let _ = writeln!(text, "failed: {}/{}", step.group, step.name);
        }
        text
    }

    pub(super) fn text(&self) -> String {
        let steps: String = self.steps.iter().map(StepReport::text).collect();
        format!("{}{steps}{}", self.head(), self.summary())
    }
}
