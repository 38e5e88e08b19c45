//! NMT state of a node (CiA 301, 7.3.2).

use crate::{NmtCommand, NmtState};

/// NMT state of one node.
///
/// Only the node's own reports, boot-up message and heartbeat, are certain. A node without heartbeat
/// reports nothing after a command, so the expected state is kept, too.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct NmtTracker {
    reported: Option<NmtState>,
    expected: Option<NmtState>,
    boot_ups: u32,
}

impl NmtTracker {
    /// The boot-up message arrived: the node then enters Pre-operational.
    pub(super) fn booted(&mut self) {
        self.reported = Some(NmtState::PreOperational);
        self.expected = Some(NmtState::PreOperational);
        self.boot_ups = self.boot_ups.wrapping_add(1);
    }

    pub(super) fn reported_by_node(&mut self, state: NmtState) {
        self.reported = Some(state);
    }

    pub(super) fn commanded(&mut self, command: NmtCommand) {
        self.expected = Some(match command {
            NmtCommand::Start => NmtState::Operational,
            NmtCommand::Stop => NmtState::Stopped,
            NmtCommand::EnterPreOperational => NmtState::PreOperational,
            NmtCommand::ResetNode | NmtCommand::ResetCommunication => {
                self.reported = None;
                NmtState::Initialising
            }
        });
    }

    #[inline]
    pub(super) fn reported(&self) -> Option<NmtState> {
        self.reported
    }

    #[inline]
    pub(super) fn expected(&self) -> Option<NmtState> {
        self.expected
    }

    #[inline]
    pub(super) fn boot_ups(&self) -> u32 {
        self.boot_ups
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn command_sets_only_the_expected_state() {
        let mut tracker = NmtTracker::default();
        tracker.booted();
        tracker.commanded(NmtCommand::Start);
        assert_eq!(tracker.reported(), Some(NmtState::PreOperational));
        assert_eq!(tracker.expected(), Some(NmtState::Operational));
        tracker.reported_by_node(NmtState::Operational);
        assert_eq!(tracker.reported(), Some(NmtState::Operational));
    }

    #[test]
    fn reset_makes_the_state_unknown_until_boot_up() {
        let mut tracker = NmtTracker::default();
        tracker.reported_by_node(NmtState::Operational);
        tracker.commanded(NmtCommand::ResetNode);
        assert_eq!(tracker.reported(), None);
        tracker.booted();
        assert_eq!(tracker.reported(), Some(NmtState::PreOperational));
        assert_eq!(tracker.boot_ups(), 1);
    }
}
