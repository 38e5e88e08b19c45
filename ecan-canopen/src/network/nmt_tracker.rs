//! What is known of a node's NMT state (CiA 301, 7.3.2).

use crate::{NmtCommand, NmtState};

/// Follows one node's NMT state.
///
/// Certain is only what the node itself says, by boot-up message and heartbeat. A node without
/// heartbeat says nothing after a command, so what it should have done is kept beside it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct NmtTracker {
    reported: Option<NmtState>,
    expected: Option<NmtState>,
    boot_ups: u32,
}

impl NmtTracker {
    /// The boot-up message: from here the node goes to Pre-operational by itself.
    pub(super) fn booted(&mut self) {
        self.reported = Some(NmtState::PreOperational);
        self.expected = Some(NmtState::PreOperational);
        self.boot_ups = self.boot_ups.wrapping_add(1);
    }

    pub(super) fn heard(&mut self, state: NmtState) {
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

    pub(super) fn reported(&self) -> Option<NmtState> {
        self.reported
    }

    pub(super) fn expected(&self) -> Option<NmtState> {
        self.expected
    }

    pub(super) fn boot_ups(&self) -> u32 {
        self.boot_ups
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_is_an_expectation_until_the_node_confirms_it() {
        let mut tracker = NmtTracker::default();
        tracker.booted();
        tracker.commanded(NmtCommand::Start);
        assert_eq!(tracker.reported(), Some(NmtState::PreOperational));
        assert_eq!(tracker.expected(), Some(NmtState::Operational));
        tracker.heard(NmtState::Operational);
        assert_eq!(tracker.reported(), Some(NmtState::Operational));
    }

    #[test]
    fn a_reset_makes_the_state_unknown_until_the_boot_up_message() {
        let mut tracker = NmtTracker::default();
        tracker.heard(NmtState::Operational);
        tracker.commanded(NmtCommand::ResetNode);
        assert_eq!(tracker.reported(), None);
        tracker.booted();
        assert_eq!(tracker.reported(), Some(NmtState::PreOperational));
        assert_eq!(tracker.boot_ups(), 1);
    }
}
