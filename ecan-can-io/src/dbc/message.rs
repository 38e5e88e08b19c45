//! A message.

use ecan_protocol::can::CanId;

use crate::dbc::signal::Signal;
use crate::dbc::similar::{UnknownName, find};

/// Message of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Message {
    /// CAN ID.
    pub id: CanId,
    /// Name, unique in its file.
    pub name: String,
    /// Number of data bytes.
    pub length: usize,
    /// CAN FD: more than 8 bytes, or the attribute `VFrameFormat` names CAN FD.
    pub is_fd: bool,
    /// Bit rate switch of a CAN FD frame: the attribute `CANFD_BRS`, else on.
    pub has_bit_rate_switch: bool,
    /// Line of the file, from 1.
    pub line: usize,
    /// Signals in the order of the file.
    pub signals: Vec<Signal>,
}

impl Message {
    /// Index of a signal.
    ///
    /// # Errors
    /// No signal has this name.
    pub fn index_of(&self, name: &str) -> Result<usize, UnknownName> {
        find("signal", name, self.signals.iter().map(|it| it.name.as_str()))
    }

    /// Returns whether a signal is in a frame, by the raw values of its multiplexers.
    pub(crate) fn is_selected(&self, index: usize, raw: &impl Fn(&Signal) -> Option<u64>) -> bool {
        let Some(signal) = self.signals.get(index) else { return false };
        let Some(condition) = &signal.condition else { return true };
        // The reader rejects a multiplexer that depends on itself.
        let multiplexer = self.signals.get(condition.multiplexer);
        let is_selecting = multiplexer.and_then(raw).is_some_and(|it| condition.selects(it));
        is_selecting && self.is_selected(condition.multiplexer, raw)
    }
}
