//! Kernel log of the simulated master.

use std::collections::VecDeque;

use ecan_protocol::object::{AbortCode, describe};

use super::sdo_transfer::{SdoFailure, SdoObject};

const MAX_LINES: usize = 1000;

/// The last lines that the master wrote to the kernel log.
#[derive(Debug, Default)]
pub(crate) struct KernelLog {
    lines: VecDeque<String>,
}

impl KernelLog {
    pub(crate) fn push(&mut self, line: String) {
        if self.lines.len() == MAX_LINES {
            self.lines.pop_front();
        }
        self.lines.push_back(line);
    }

    /// Writes a line about a slave.
    pub(crate) fn push_slave(&mut self, slave: usize, text: &str) {
        self.push(format!("EtherCAT 0-{slave}: {text}"));
    }

    /// Writes the failure of an SDO download to a slave.
    pub(crate) fn push_sdo(
        &mut self,
        slave: usize,
        what: &str,
        object: SdoObject,
        failure: SdoFailure,
    ) {
        let object = describe(object.index, object.subindex);
        let text = if failure == SdoFailure::NO_COE {
            format!("{what} {object}: the slave does not support CoE")
        } else if failure.abort_code == 0 {
            format!("{what} {object}: no response")
        } else {
            format!("{what} {object} aborted: {}", AbortCode(failure.abort_code))
        };
        self.push_slave(slave, &text);
    }

    /// The lines, oldest first.
    pub(crate) fn lines(&self) -> impl Iterator<Item = &str> {
        self.lines.iter().map(String::as_str)
    }
}
