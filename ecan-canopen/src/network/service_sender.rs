//! Sends the service frames of one channel within the limits of a cycle, and counts them.

use ecan_mcan_port::{Cycle, SendError, SendOptions, SendTicket};
use ecan_protocol::can::{Dlc, FrameRef};

use super::config::{NetworkConfig, SyncConfig};
use super::error::SdoFault;
use super::lss::LssFault;
use super::node::Node;
use super::node_table::Channel;
use super::producers::TimeConfig;
use crate::{CobId, GuardResponse, NmtState, heartbeat_data};

/// Bytes that an SDO frame takes in the RxPDO image: control word, 11-bit identifier and eight
/// bytes of data (manual 8.3).
const SDO_PACKET_BYTES: usize = 12;

/// A guarding request asks for one byte.
const GUARD_DLC: Dlc = Dlc::from_raw(GuardResponse::LENGTH).unwrap();

pub(super) struct ServiceSender<'a, O> {
    pub(super) sink: &'a mut O,
    pub(super) channel: &'a mut Channel,
    pub(super) nodes: &'a mut [Node],
    pub(super) config: &'a NetworkConfig,
    pub(super) statistics: &'a mut ServiceStatistics,
}

impl<O: FrameSink> ServiceSender<'_, O> {
    pub(super) fn deliver(&mut self, time: Option<&TimeConfig>, now_ns: u64) {
        let budget = self.config.service_frames_per_cycle.max(1);
        let mut left = self.send_nmt(budget);
        if !self.channel.nodes.is_empty() {
            self.send_heartbeat(now_ns);
            self.send_time(time, now_ns);
            left = self.send_guards(left, now_ns);
        }
        left = self.send_lss(left, now_ns);
        self.send_sdo(left, now_ns);
    }

    fn send(&mut self, id: CobId, data: &[u8], options: SendOptions) -> Result<(), SendError> {
        self.send_frame(FrameRef::classic(id.can_id(), data).map_err(SendError::from), options)
    }

    fn send_frame(
        &mut self,
        frame: Result<FrameRef<'_>, SendError>,
        options: SendOptions,
    ) -> Result<(), SendError> {
        let (slave, channel) = (self.channel.slave, self.channel.channel);
        match frame.and_then(|frame| self.sink.send(slave, channel, frame, options)) {
            Ok(_) => Ok(()),
            Err(error) => {
                self.statistics.note(error);
                Err(error)
            }
        }
    }

    fn send_nmt(&mut self, budget: u8) -> u8 {
        for used in 0..budget {
            let Some(request) = self.channel.next_nmt() else { return budget - used };
            match self.send(CobId::NMT, &request.to_bytes(), SendOptions::default()) {
                Ok(()) => {
                    self.statistics.nmt_sent += 1;
                    for nth in &self.channel.nodes {
                        if let Some(node) = self.nodes.get_mut(*nth)
                            && request.concerns(node.address.node)
                        {
                            node.on_command(request.command);
                        }
                    }
                }
                // Later SDO frames must not overtake a command.
                Err(error) if error.is_temporary() => return 0,
                Err(_) => {}
            }
            self.channel.pop_nmt();
        }
        0
    }

    fn send_heartbeat(&mut self, now_ns: u64) {
        let Some(host) = self.config.host_heartbeat else { return };
        if self.channel.is_paused || !self.channel.heartbeat.is_due(now_ns) {
            return;
        }
        let data = heartbeat_data(NmtState::Operational);
        if self.send(CobId::heartbeat(host.node), &data, SendOptions::default()).is_ok() {
            self.statistics.heartbeats_sent += 1;
            self.channel.heartbeat.advance(now_ns, host.period);
        }
    }

    fn send_time(&mut self, time: Option<&TimeConfig>, now_ns: u64) {
        let Some(time) = time.filter(|_| self.channel.time.is_due(now_ns)) else { return };
        let Some(message) = time.message(now_ns) else { return };
        if self.send(CobId::TIME, &message, SendOptions::default()).is_ok() {
            self.statistics.times_sent += 1;
            self.channel.time.advance(now_ns, time.period);
        }
    }

    /// Sends the guarding requests that are due, the nodes in turn; returns the budget that is left.
    fn send_guards(&mut self, mut budget: u8, now_ns: u64) -> u8 {
        let count = self.channel.nodes.len();
        let first = self.channel.guard_turn;
        for turn in first..first + count {
            let nth = self.channel.nodes.get(turn % count).copied();
            let Some(node) = nth.and_then(|nth| self.nodes.get_mut(nth)) else { continue };
            let Some(guard) = &mut node.guard else { continue };
            if self.channel.is_paused {
                guard.pause();
                continue;
            }
            if budget == 0 || !guard.is_due(now_ns) {
                continue;
            }
            let expected = node.nmt.expected();
            let id = CobId::heartbeat(node.address.node).can_id();
            let frame = FrameRef::remote(id, GUARD_DLC).map_err(SendError::from);
            if self.send_frame(frame, SendOptions::default()).is_err() {
                return budget;
            }
            self.statistics.guards_sent += 1;
            budget -= 1;
            self.channel.guard_turn = (turn + 1) % count;
            let Some(node) = nth.and_then(|nth| self.nodes.get_mut(nth)) else { continue };
            if let Some(guard) = &mut node.guard {
                guard.on_request_sent(now_ns, expected);
            }
        }
        budget
    }

    /// Sends the LSS frame that is due; returns the budget that is left.
    fn send_lss(&mut self, budget: u8, now_ns: u64) -> u8 {
        let Some(frame) = self.channel.lss.frame().filter(|_| budget > 0) else { return budget };
        match self.send(CobId::LSS_REQUEST, &frame, SendOptions::default()) {
            Ok(()) => {
                self.statistics.lss_sent += 1;
                self.channel.lss.sent(now_ns);
                budget - 1
            }
            Err(error) if error.is_temporary() => budget,
            Err(error) => {
                self.channel.lss.cancel(LssFault::Rejected(error));
                budget
            }
        }
    }

    /// Sends SDO frames of the nodes in turn.
    fn send_sdo(&mut self, mut budget: u8, now_ns: u64) {
        let count = self.channel.nodes.len();
        let mut idle = 0;
        while budget > 0 && idle < count {
            let turn = self.channel.turn % count;
            match self.send_sdo_of(turn, now_ns) {
                Ok(true) => {
                    idle = 0;
                    budget -= 1;
                }
                Ok(false) => idle += 1,
                Err(()) => return,
            }
            self.channel.turn = turn + 1;
        }
    }

    /// Returns whether an SDO frame leaves the space that the configuration reserves for targets.
    fn may_send_sdo(&self) -> bool {
        let (slave, channel) = (self.channel.slave, self.channel.channel);
        let needed = self.config.reserved_image_bytes.saturating_add(SDO_PACKET_BYTES);
        self.sink.pending(slave, channel) < self.config.sdo_pending_limit
            && self.sink.room(slave, channel) >= needed
    }

    /// Sends one frame of a node, if it has one; an error ends the turn.
    fn send_sdo_of(&mut self, turn: usize, now_ns: u64) -> Result<bool, ()> {
        let Some(nth) = self.channel.nodes.get(turn).copied() else { return Ok(false) };
        let Some(node) = self.nodes.get(nth) else { return Ok(false) };
        let Some(frame) = node.sdo.frame() else { return Ok(false) };
        if !self.may_send_sdo() {
            self.statistics.waited += 1;
            return Err(());
        }
        let id = CobId::sdo_client(node.address.node);
        let sent = self.send(id, &frame, SendOptions::default());
        let Some(node) = self.nodes.get_mut(nth) else { return Ok(false) };
        match sent {
            Ok(()) => {
                self.statistics.sdo_sent += 1;
                node.sdo.sent(now_ns);
                Ok(true)
            }
            Err(error) if error.is_temporary() => Err(()),
            Err(error) => {
                node.sdo.drop_transfer(SdoFault::Rejected(error));
                Ok(false)
            }
        }
    }

    /// Sends the SYNC that is due, if any. After an unconfirmed image it would be sent back to back
    /// with the SYNC of the next image; so it waits.
    pub(super) fn send_sync(&mut self, sync: &SyncConfig) {
        if self.channel.is_paused || !self.channel.sync.is_due() {
            return;
        }
        if self.sink.is_unconfirmed(self.channel.slave) {
            self.statistics.syncs_late += 1;
            return;
        }
        let counter = self.channel.sync.counter(sync);
        let data = counter.as_slice();
        let options = SendOptions { schedule: sync.schedule, ..SendOptions::default() };
        match self.send(CobId::SYNC, data, options) {
            Ok(()) => {
                self.statistics.syncs_sent += 1;
                self.channel.sync.on_sent(sync);
            }
            Err(_) => self.statistics.syncs_late += 1,
        }
    }
}

pub(super) trait FrameSink {
    fn send(
        &mut self,
        slave: usize,
        channel: u8,
        frame: FrameRef<'_>,
        options: SendOptions,
    ) -> Result<SendTicket, SendError>;

    /// Frames that the gateway has not sent yet on a channel, by its status.
    fn pending(&self, slave: usize, channel: u8) -> u8;

    /// Bytes that a channel has left in the image of this cycle.
    fn room(&self, slave: usize, channel: u8) -> usize;

    fn is_ready(&self, slave: usize) -> bool;

    /// Returns whether the last image is unconfirmed, so that frames wait for the next one.
    fn is_unconfirmed(&self, slave: usize) -> bool;
}

impl FrameSink for Cycle<'_> {
    fn send(
        &mut self,
        slave: usize,
        channel: u8,
        frame: FrameRef<'_>,
        options: SendOptions,
    ) -> Result<SendTicket, SendError> {
        let to = self.channel(slave, channel)?;
        self.send_with(to, frame, options)
    }

    fn pending(&self, slave: usize, channel: u8) -> u8 {
        let channel = self.channel(slave, channel);
        channel.map_or(0, |channel| self.channel_status(channel).tx_pending())
    }

    fn room(&self, slave: usize, channel: u8) -> usize {
        // The send reports a channel that is not enabled.
        self.channel(slave, channel).map_or(usize::MAX, |channel| self.channel_room(channel))
    }

    fn is_ready(&self, slave: usize) -> bool {
        self.gateway(slave).is_ok_and(|gateway| self.gateway_is_ready(gateway))
    }

    fn is_unconfirmed(&self, slave: usize) -> bool {
        let gateway = self.gateway(slave);
        gateway.is_ok_and(|gateway| self.cycle_report(gateway).is_unconfirmed)
    }
}

/// Counters of a network; they only grow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ServiceStatistics {
    /// SDO frames sent to gateways.
    pub sdo_sent: u64,
    /// NMT commands sent to gateways.
    pub nmt_sent: u64,
    /// Heartbeats of the host sent to gateways.
    pub heartbeats_sent: u64,
    /// TIME messages sent to gateways.
    pub times_sent: u64,
    /// Guarding requests sent to gateways.
    pub guards_sent: u64,
    /// LSS frames sent to gateways.
    pub lss_sent: u64,
    /// SYNC messages sent to gateways.
    pub syncs_sent: u64,
    /// Times that a frame waited: it found no space, or its gateway was not ready.
    pub waited: u64,
    /// Cycles in which a SYNC was due on a channel and waited: it found no space, or the gateway's last
    /// image was unconfirmed.
    pub syncs_late: u64,
    /// Frames that the Port rejected for a permanent reason.
    pub rejected: u64,
    /// Reason of the last of those.
    pub last_rejection: Option<SendError>,
    /// SDO answers that matched no transfer.
    pub sdo_strays: u64,
    /// LSS responses that matched no command.
    pub lss_strays: u64,
    /// Messages of nodes that CiA 301 does not allow: a heartbeat without a valid state, an emergency
    /// message of another length, a remote frame with the COB-ID of a service that a node sends.
    pub malformed: u64,
}

impl ServiceStatistics {
    /// Counts a frame that was not sent.
    pub(super) fn note(&mut self, error: SendError) {
        if error.is_temporary() {
            self.waited += 1;
        } else {
            self.rejected += 1;
            self.last_rejection = Some(error);
        }
    }
}
