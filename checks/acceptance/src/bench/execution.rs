//! Runs programs and records what they do.

use std::process::Command;
use std::time::Duration;

use ecan_tool_support::command_line::interrupt::Interrupt;

use super::{Bench, Kind};
use crate::child::{Finished, Running};
use crate::stop::Stop;

/// Time limit of a program that ends without a signal of the bench.
pub(super) const PROGRAM_LIMIT: Duration = Duration::from_secs(180);

impl Bench {
    /// Runs a program to its end.
    ///
    /// # Errors
    /// It cannot be started or does not end in time, or the user interrupts.
    pub fn run(&mut self, command: Command) -> Result<Finished, Stop> {
        let running = self.start(command)?;
        let finished = running.finish(self.limit(PROGRAM_LIMIT))?;
        Ok(self.note(finished))
    }

    /// As [`run`](Self::run), for a command that restores the host: an interrupt does not end it.
    pub fn restore(&mut self, command: Command) -> Result<Finished, Stop> {
        let running = Running::start(command, &Interrupt::default())?;
        let finished = running.finish(self.limit(PROGRAM_LIMIT))?;
        Ok(self.note(finished))
    }

    /// Starts a program; pass its end to [`note`](Self::note).
    pub fn start(&mut self, command: Command) -> Result<Running, Stop> {
        if self.interrupt.is_set() {
            return Err(Stop::Interrupted);
        }
        Running::start(command, &self.interrupt)
    }

    /// Records the end of a program.
    pub fn note(&mut self, finished: Finished) -> Finished {
        self.record.add(&finished);
        finished
    }

    /// Records a measured value.
    pub fn figure(&mut self, name: impl Into<String>, value: f64) {
        self.record.figures.insert(name.into(), value);
    }

    /// Returns whether the lines of the kernel are part of the report.
    pub fn has_kernel_log(&self) -> bool {
        self.kind != Kind::Library && self.kernel_log.is_readable()
    }

    /// Ignores the lines so far.
    pub fn forget_kernel_log(&mut self) {
        self.kernel_log.take();
    }

    /// The lines of the kernel about EtherCAT since the start of the step.
    pub fn kernel_lines(&mut self) -> &[String] {
        if self.has_kernel_log() {
            let lines = self.kernel_log.take();
            self.record.kernel_log.extend(lines);
        }
        &self.record.kernel_log
    }

    /// # Errors
    /// The kernel has reported this since the start of the step.
    pub fn expect_no_kernel_line(&mut self, text: &str) -> Result<(), Stop> {
        let line = self.kernel_lines().iter().find(|line| line.contains(text)).cloned();
        line.map_or(Ok(()), |line| Err(Stop::Failed(format!("the kernel log has: {line}"))))
    }
}
