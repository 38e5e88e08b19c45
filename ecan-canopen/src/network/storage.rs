//! What a node keeps: stored parameters (0x1010, 0x1011) and the error history (0x1003), CiA 301.

use std::fmt;
use std::time::Duration;

use ecan_protocol::sequence::Expectation;

use super::config::{NodeAction, NodeHandle, Step};
use super::configurator::Configurator;
use crate::{HistoryEntry, NmtCommand, object};

/// Parameters that 0x1010 stores and 0x1011 restores; the number is the subindex.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ParameterGroup {
    /// All parameters.
    All,
    /// Communication parameters, 0x1000 to 0x1FFF.
    Communication,
    /// Application parameters, 0x6000 to 0x9FFF.
    Application,
    /// Parameters of the manufacturer; subindex 4 to 127, other numbers count as 4.
    Manufacturer(u8),
}

/// Capability of a node to store or restore, the value of an entry of 0x1010 or 0x1011.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct StorageCapability(pub u32);

impl StorageCapability {
    const COMMAND: u32 = 1 << 0;
    const AUTONOMOUS: u32 = 1 << 1;

    /// Returns whether the node stores, or restores, on command.
    pub const fn on_command(self) -> bool {
        self.0 & Self::COMMAND != 0
    }

    /// Returns whether the node stores without a command.
    pub const fn is_autonomous(self) -> bool {
        self.0 & Self::AUTONOMOUS != 0
    }
}

/// "save" and "load" in ASCII, little-endian.
const SAVE: u32 = u32::from_le_bytes(*b"save");
const LOAD: u32 = u32::from_le_bytes(*b"load");

impl ParameterGroup {
    /// Subindex of the group.
    pub const fn subindex(self) -> u8 {
        match self {
            Self::All => 1,
            Self::Communication => 2,
            Self::Application => 3,
            Self::Manufacturer(subindex @ 4..=127) => subindex,
            Self::Manufacturer(_) => 4,
        }
    }

    /// Returns the steps that store the present parameters: the node must be able to store them on command. The node
    /// may respond after seconds, see [`SdoConfig::storage_timeout`](crate::SdoConfig::storage_timeout).
    pub fn store_steps(self) -> [Step; 2] {
        let index = object::STORE_PARAMETERS;
        [
            Self::check(index, self).named("stores on command"),
            Step::write(index, self.subindex(), SAVE).named("store parameters"),
        ]
    }

    /// Returns the steps that restore the defaults: the node must be able to restore them on command. The defaults
    /// become valid with the next reset.
    pub fn restore_steps(self) -> [Step; 2] {
        let index = object::RESTORE_PARAMETERS;
        [
            Self::check(index, self).named("restores on command"),
            Step::write(index, self.subindex(), LOAD).named("restore defaults"),
        ]
    }

    /// As [`restore_steps`](Self::restore_steps), then resets the node and waits for its boot-up message.
    pub fn restore_and_reset_steps(self, boot_timeout: Duration) -> [Step; 4] {
        let [check, write] = self.restore_steps();
        // Communication parameters need a reset of communication at least.
        let reset = NodeAction::Nmt(NmtCommand::ResetNode);
        let boot = NodeAction::AwaitBootUp { timeout: boot_timeout };
        [check, write, Step::device(reset), Step::device(boot)]
    }

    fn check(index: u16, group: Self) -> Step {
        let expected = Expectation::HasBits(StorageCapability::COMMAND.into());
        Step::expect_that(index, group.subindex(), expected)
    }
}

impl fmt::Display for ParameterGroup {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::All => f.write_str("all parameters"),
            Self::Communication => f.write_str("communication parameters"),
            Self::Application => f.write_str("application parameters"),
            Self::Manufacturer(_) => {
                write!(f, "manufacturer parameters (subindex {})", self.subindex())
            }
        }
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signatures_and_subindices_match_cia_301() {
        let text = |steps: [Step; 2]| steps.map(|step| step.to_string());
        assert_eq!(
            text(ParameterGroup::All.store_steps()),
            [
                "stores on command (check 0x1010:01)",
                "store parameters (write 0x1010:01 = 0x65766173)"
            ]
        );
        assert_eq!(
            text(ParameterGroup::Manufacturer(7).restore_steps()),
            [
                "restores on command (check 0x1011:07)",
                "restore defaults (write 0x1011:07 = 0x64616F6C)"
            ]
        );
        let groups = [
            (ParameterGroup::Communication, 2),
            (ParameterGroup::Application, 3),
            (ParameterGroup::Manufacturer(3), 4),
            (ParameterGroup::Manufacturer(127), 127),
            (ParameterGroup::Manufacturer(128), 4),
        ];
        for (group, subindex) in groups {
            assert_eq!(group.subindex(), subindex, "{group}");
        }
        let capability = StorageCapability(0b10);
        assert!(!capability.on_command() && capability.is_autonomous());
    }
}
