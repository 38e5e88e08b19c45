//! State of one node: NMT state, life sign, emergency messages, and its SDO client.

use std::sync::Arc;
use std::time::Duration;

use super::boot::{ParameterDownload, ParameterSet, ParameterState};
use super::config::{GuardingConfig, NodeAddress, NodeConfig};
use super::error::{NodeAccessError, SdoFault};
use super::life_sign::{GuardErrors, GuardResult, Heartbeat, HeartbeatWatch, NodeGuard};
use super::sdo::SdoClient;
use crate::{Emcy, GuardResponse, NmtCommand, NmtState};

#[derive(Debug)]
pub(super) struct Node {
    pub(super) address: NodeAddress,
    /// Index of the node's channel in the network.
    pub(super) channel: usize,
    pub(super) nmt: NmtTracker,
    heartbeat: HeartbeatWatch,
    /// Guarding in place of the heartbeat.
    pub(super) guard: Option<NodeGuard>,
    pub(super) emcy: EmcyLog,
    pub(super) sdo: SdoClient,
    /// Parameters for [`NodeAction::WriteParameters`](super::NodeAction).
    parameters: Option<ParameterDownload>,
}

impl Node {
    pub(super) fn new(address: NodeAddress, channel: usize, config: NodeConfig) -> Self {
        Self {
            address,
            channel,
            nmt: NmtTracker::default(),
            heartbeat: HeartbeatWatch::new(config.heartbeat_timeout),
            guard: config.guarding.map(NodeGuard::new),
            emcy: EmcyLog::default(),
            sdo: SdoClient::new(config.sdo),
            parameters: None,
        }
    }

    /// Life sign, by heartbeat or guarding.
    #[inline]
    pub(super) fn life(&self) -> Heartbeat {
        self.guard.as_ref().map_or(self.heartbeat.state(), NodeGuard::state)
    }

    #[inline]
    pub(super) fn status(&self) -> NodeStatus {
        NodeStatus {
            address: self.address,
            nmt_state: self.nmt.reported(),
            expected_nmt_state: self.nmt.expected(),
            boot_ups: self.nmt.boot_ups(),
            heartbeat: self.life(),
            heartbeat_timeouts: self
                .guard
                .map_or(self.heartbeat.timeouts(), |guard| guard.timeouts),
            guard_errors: self.guard.map_or(GuardErrors::default(), |guard| guard.errors),
            emcy_count: self.emcy.count(),
            error_code: self.emcy.last_code(),
        }
    }

    /// Watches the heartbeat with another timeout, and ends guarding unless the timeout is zero.
    pub(super) fn set_heartbeat_timeout(&mut self, timeout: Duration) {
        self.heartbeat.set_timeout(timeout);
        if !timeout.is_zero() {
            self.guard = None;
        }
    }

    /// Guards the node in place of its heartbeat; `None` stops guarding. Ignores an invalid configuration.
    pub(super) fn set_guarding(&mut self, guarding: Option<GuardingConfig>) {
        if let Some(guarding) = guarding {
            if !guarding.is_valid() {
                return;
            }
            self.heartbeat.set_timeout(Duration::ZERO);
        }
        self.guard = guarding.map(NodeGuard::new);
    }

    pub(super) fn set_parameters(&mut self, set: Arc<ParameterSet>) {
        let is_empty = *set == ParameterSet::default();
        self.parameters = (!is_empty).then(|| ParameterDownload::new(set));
    }

    /// Writes the parameters, as far as possible in a cycle. Returns whether that is complete.
    pub(super) fn write_parameters(&mut self, starts_over: bool) -> Result<bool, NodeAccessError> {
        let Some(download) = &mut self.parameters else { return Ok(true) };
        if starts_over {
            download.restart();
        }
        match download.advance(&mut self.sdo) {
            ParameterState::Running => Ok(false),
            ParameterState::Written | ParameterState::Unchanged => Ok(true),
            ParameterState::Failed(error) => Err(error.into()),
        }
    }

    /// Takes note that an NMT command for the node was handed over to its gateway.
    pub(super) fn on_command(&mut self, command: NmtCommand) {
        self.nmt.on_command(command);
        if let Some(guard) = &mut self.guard {
            guard.on_command();
        }
    }

    /// Checks the waiting times of the node.
    pub(super) fn tick(&mut self, now_ns: u64) {
        if self.heartbeat.tick(now_ns) {
            tracing::warn!("{}: heartbeat lost", self.address);
        }
        if self.guard.as_mut().is_some_and(|guard| guard.tick(now_ns)) {
            tracing::warn!("{}: no response to guarding", self.address);
        }
        self.sdo.tick(now_ns);
    }

    /// Processes an emergency message; returns whether it is valid.
    pub(super) fn on_emcy(&mut self, data: &[u8], now_ns: u64) -> bool {
        let Some(emcy) = Emcy::parse(data) else { return false };
        self.emcy.push(now_ns, emcy);
        true
    }

    /// Processes a boot-up message, a heartbeat or a guarding response; returns whether it is valid.
    pub(super) fn on_error_control(&mut self, data: &[u8], now_ns: u64) -> bool {
        let Some(response) = GuardResponse::parse(data) else { return false };
        let address = self.address;
        if response.state == NmtState::Initialising {
            tracing::info!("{address}: boot-up");
            self.nmt.on_boot_up();
            self.heartbeat.on_boot_up();
            if let Some(guard) = &mut self.guard {
                guard.on_boot_up();
            }
            if self.sdo.is_known_to_node() {
                self.sdo.drop_transfer(SdoFault::NodeRestarted);
            }
            return true;
        }
        let was_overdue = match &mut self.guard {
            None => self.heartbeat.on_heartbeat(now_ns),
            Some(guard) => {
                let result = guard.on_response(response, now_ns);
                let is_new = guard.has_new_error();
                match result {
                    GuardResult::Accepted(was_overdue) => was_overdue,
                    GuardResult::State(was_overdue) => {
                        if is_new {
                            let state = response.state;
                            tracing::warn!(
                                "{address}: guarding reports {state}, not the commanded state"
                            );
                        }
                        was_overdue
                    }
                    GuardResult::Toggle => {
                        if is_new {
                            tracing::warn!("{address}: toggle bit of guarding did not alternate");
                        }
                        return true;
                    }
                }
            }
        };
        self.nmt.on_report(response.state);
        if was_overdue {
            tracing::info!("{address}: life sign received again");
        }
        true
    }
}

/// Status of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NodeStatus {
    /// Address of the node.
    pub address: NodeAddress,
    /// NMT state that it reported last, by boot-up message, heartbeat or guarding; `None` before the first report, and
    /// after a reset command until its boot-up message.
    pub nmt_state: Option<NmtState>,
    /// NMT state to which the last boot-up message or command leads: the only information about a node
    /// without heartbeat. The node may have rejected the command.
    pub expected_nmt_state: Option<NmtState>,
    /// Number of boot-up messages.
    pub boot_ups: u32,
    /// State of its life sign: of its heartbeat, or of node guarding.
    pub heartbeat: Heartbeat,
    /// Number of timeouts of the life sign.
    pub heartbeat_timeouts: u32,
    /// Number of errors of node guarding; 0 without guarding.
    pub guard_errors: GuardErrors,
    /// Number of emergency messages.
    pub emcy_count: u32,
    /// Error code of the last one; 0 for none, or after the node reset its error.
    pub error_code: u16,
}

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
    /// Takes note of a boot-up message: the node then enters Pre-operational.
    pub(super) fn on_boot_up(&mut self) {
        self.reported = Some(NmtState::PreOperational);
        self.expected = Some(NmtState::PreOperational);
        self.boot_ups = self.boot_ups.wrapping_add(1);
    }

    pub(super) fn on_report(&mut self, state: NmtState) {
        self.reported = Some(state);
    }

    pub(super) fn on_command(&mut self, command: NmtCommand) {
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

/// Emergency messages that are kept per node.
pub const EMCY_DEPTH: usize = 8;

/// Emergency message with its time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EmcyRecord {
    /// Time of the cycle that received it, in nanoseconds of the bus clock.
    pub at_ns: u64,
    /// The message; error code 0 resets an error.
    pub emcy: Emcy,
}

/// Last emergency messages of one node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EmcyLog {
    records: [Option<EmcyRecord>; EMCY_DEPTH],
    count: u32,
    last_code: u16,
}

impl EmcyLog {
    pub(super) fn push(&mut self, at_ns: u64, emcy: Emcy) {
        let slot = self.count as usize % EMCY_DEPTH;
        if let Some(record) = self.records.get_mut(slot) {
            *record = Some(EmcyRecord { at_ns, emcy });
        }
        self.count = self.count.wrapping_add(1);
        self.last_code = emcy.code;
    }

    /// Error code of the last message; 0 before the first, or after the node reset its error.
    #[inline]
    pub fn last_code(&self) -> u16 {
        self.last_code
    }

    /// Number of messages, including those that reset an error.
    #[inline]
    pub fn count(&self) -> u32 {
        self.count
    }

    /// The last message.
    pub fn last(&self) -> Option<EmcyRecord> {
        self.recent().next()
    }

    /// The last [`EMCY_DEPTH`] messages, newest first.
    pub fn recent(&self) -> impl Iterator<Item = EmcyRecord> + '_ {
        (1..=EMCY_DEPTH as u32).map_while(|back| {
            let slot = self.count.wrapping_sub(back) as usize % EMCY_DEPTH;
            self.records.get(slot).copied().flatten()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn command_sets_only_the_expected_state() {
        let mut tracker = NmtTracker::default();
        tracker.on_boot_up();
        tracker.on_command(NmtCommand::Start);
        assert_eq!(tracker.reported(), Some(NmtState::PreOperational));
        assert_eq!(tracker.expected(), Some(NmtState::Operational));
        tracker.on_report(NmtState::Operational);
        assert_eq!(tracker.reported(), Some(NmtState::Operational));
    }

    #[test]
    fn reset_makes_the_state_unknown_until_boot_up() {
        let mut tracker = NmtTracker::default();
        tracker.on_report(NmtState::Operational);
        tracker.on_command(NmtCommand::ResetNode);
        assert_eq!(tracker.reported(), None);
        tracker.on_boot_up();
        assert_eq!(tracker.reported(), Some(NmtState::PreOperational));
        assert_eq!(tracker.boot_ups(), 1);
    }
}
