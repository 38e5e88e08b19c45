//! Record of the running step.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use crate::child::{CommandRecord, Finished};

/// Record of the running step.
#[derive(Debug, Default)]
pub struct Record {
    pub commands: Vec<CommandRecord>,
    /// Measured values; names end with their unit.
    pub figures: BTreeMap<String, f64>,
    /// Lines of the kernel about EtherCAT.
    pub kernel_log: Vec<String>,
    /// Complete output of all programs.
    pub log: String,
}

impl Record {
    /// Adds a program that has ended, with its output.
    pub fn add(&mut self, finished: &Finished) {
        let _ = writeln!(self.log, "$ {}", finished.command);
        for line in &finished.lines {
            let _ = writeln!(self.log, "{:9.3} {}", line.at.as_secs_f64(), line.text);
        }
        let _ = writeln!(self.log, "= {:?}\n", finished.status.code());
        self.commands.push(finished.record());
    }
}
