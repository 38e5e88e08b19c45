//! Error history of a node: reading and clearing 0x1003.

use std::time::Duration;

use ecan_mcan_port::Port;

use super::address::NodeHandle;
use super::configurator::Configurator;
use super::error::WaitError;
use super::network::Network;
use super::node_action::Step;
use crate::{HistoryEntry, object};

/// Most entries of an error history.
const MAX_ENTRIES: u8 = 254;

/// Steps for the error history of a node (0x1003), newest entry first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ErrorHistory;

impl ErrorHistory {
    /// Returns the steps that read the number of entries and at most `limit` entries, 1 to 254. A node aborts reading
    /// an entry that it does not have; the steps tolerate that.
    pub fn steps(limit: u8) -> Vec<Step> {
        let count = Step::read(object::ERROR_HISTORY, 0).named("number of errors");
        let entries = (1..=limit.min(MAX_ENTRIES))
            .map(|nth| Step::read(object::ERROR_HISTORY, nth).named("error").if_accepted());
        std::iter::once(count).chain(entries).collect()
    }

    /// Entries that the steps have read; `None` before the number of entries was read. Allocates.
    pub fn uploaded(configurator: &Configurator, node: NodeHandle) -> Option<Vec<HistoryEntry>> {
        let value = |subindex| configurator.uploaded(node, object::ERROR_HISTORY, subindex);
        let count = u8::try_from(value(0)?).unwrap_or(u8::MAX);
        let entries = (1..=count.min(MAX_ENTRIES)).map_while(value);
        Some(entries.map(|raw| HistoryEntry::from_raw(raw as u32)).collect())
    }

    /// Returns the step that clears the history.
    pub fn clearing_step() -> Step {
        Step::write(object::ERROR_HISTORY, 0, 0u8).named("clear the error history")
    }
}

impl Network {
    /// Reads the error history of a node, newest entry first. Blocks.
    ///
    /// # Errors
    /// [`WaitError::Sdo`] names node, object and cause; [`WaitError::TimedOut`] after `timeout` for one entry.
    pub fn error_history_blocking(
        &mut self,
        port: &mut Port,
        handle: NodeHandle,
        timeout: Duration,
    ) -> Result<Vec<HistoryEntry>, WaitError> {
        let mut read = |subindex| {
            let value =
                self.upload_blocking(port, handle, (object::ERROR_HISTORY, subindex), timeout)?;
            Ok::<u32, WaitError>(
                value.iter().rev().fold(0, |raw, byte| raw << 8 | u32::from(*byte)),
            )
        };
        let count = u8::try_from(read(0)?).unwrap_or(MAX_ENTRIES).min(MAX_ENTRIES);
        (1..=count).map(|nth| read(nth).map(HistoryEntry::from_raw)).collect()
    }
}
