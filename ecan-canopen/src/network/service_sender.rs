//! Sends the service frames of one channel, within the limits of a cycle.

use crate::{CobId, GuardResponse, NmtState, heartbeat_data};
use ecan_mcan_port::{SendError, SendOptions};
use ecan_protocol::can::{Dlc, FrameRef};

use super::channel::Channel;
use super::config::{NetworkConfig, SyncConfig};
use super::frame_sink::FrameSink;
use super::lss::LssFault;
use super::node::Node;
use super::sdo_error::SdoFault;
use super::statistics::ServiceStatistics;
use super::time_producer::TimeConfig;

/// Bytes that an SDO frame takes in the RxPDO image: control word, 11-bit identifier and eight
/// bytes of data (manual 8.3).
const SDO_PACKET_BYTES: usize = 12;

/// A guarding request asks for one byte.
const GUARD_DLC: Dlc = Dlc::new(GuardResponse::LENGTH).unwrap();

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
                            node.nmt.commanded(request.command);
                            if let Some(guard) = &mut node.guard {
                                guard.commanded();
                            }
                        }
                    }
                }
                // Later SDO frames must not overtake a command.
                Err(error) if error.is_temporary() => return 0,
                Err(_) => {}
            }
            self.channel.nmt_sent();
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
            self.channel.heartbeat.sent(now_ns, host.period);
        }
    }

    fn send_time(&mut self, time: Option<&TimeConfig>, now_ns: u64) {
        let Some(time) = time.filter(|_| self.channel.time.is_due(now_ns)) else { return };
        let Some(message) = time.message(now_ns) else { return };
        if self.send(CobId::TIME, &message, SendOptions::default()).is_ok() {
            self.statistics.times_sent += 1;
            self.channel.time.sent(now_ns, time.period);
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
                guard.sent(now_ns, expected);
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
            && self.sink.room(slave) >= needed
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
                self.channel.sync.sent(sync);
            }
            Err(_) => self.statistics.syncs_late += 1,
        }
    }
}
