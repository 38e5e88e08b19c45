//! Frames of CANopen nodes through the gateways of a command.

use std::collections::{HashMap, HashSet};
use std::time::Duration;

use ecan_canopen::{
    CobId, LssMaster, NmtRequest, NmtState, NodeAddress, NodeId, SdoClient, SdoConfig,
    SdoDirection, SdoFailure, SdoFault, Service as CanopenService, parse_heartbeat,
};
use ecan_protocol::can::{CanFrame, CanId, Dlc};
use ecan_protocol::mapping::CHANNELS;
use ecan_tool_support::diagnosis::registers::TransmitQueueStatus;

use super::node_target::{JsonTarget, NodeTarget};
use crate::context::{Failure, Result};
use crate::frames::{BusFrame, Event, Service, Ticket};

/// Most SDO frames per cycle and channel, as much as a gateway sends per cycle in its default policy.
const FRAMES_PER_CYCLE: usize = 2;
/// Observed time without space for a frame after which a channel is stalled.
const STALL_NS: u64 = 1_000_000_000;
/// Longest observed time for which a gateway may be not ready.
const LOST_NS: u64 = 2_000_000_000;

/// Gateway (index in the command) and channel.
pub type Place = (usize, u8);

/// SDO transfer with a node of a gateway (index in the command).
#[derive(Debug)]
pub struct SdoRequest {
    pub gateway: usize,
    pub target: NodeTarget,
    pub client: SdoClient,
    /// A frame of this transfer was not sent, or its result is unknown.
    pub has_lost_frame: bool,
}

/// A received frame.
#[derive(Clone, Copy, Debug)]
pub struct Observed {
    /// Time of the cycle clock.
    pub time_ns: u64,
    pub frame: BusFrame,
}

impl Observed {
    /// The service of the predefined connection set that the frame belongs to.
    pub fn service(&self) -> Option<CanopenService> {
        CobId::classify(self.frame.frame.as_ref().id())
    }

    /// The state that a heartbeat, a boot-up message or a guarding response reports.
    pub fn state(&self) -> Option<(NodeId, NmtState)> {
        let Some(CanopenService::Heartbeat(node)) = self.service() else { return None };
        parse_heartbeat(self.frame.frame.data()).map(|state| (node, state))
    }

    /// Returns whether the frame was received from a channel of a gateway.
    pub fn is_from(&self, gateway: usize, channel: u8) -> bool {
        self.frame.gateway == gateway && self.frame.channel == channel && !self.frame.is_sent
    }
}

/// Running gateways, for CANopen.
#[derive(Debug)]
pub struct NodeLink {
    pub service: Service,
    /// Channel of each frame that has no result yet, and the node of an SDO frame.
    pending: HashMap<Ticket, (Place, Option<NodeId>)>,
    /// Channels of which the gateway has accepted frames.
    sent_to: HashSet<Place>,
    /// Channels with a node: it has sent or acknowledged a frame.
    alive: HashSet<Place>,
    /// Channels that accept no frame, since this observed time.
    stalled: HashMap<Place, u64>,
    /// Observed time at which a gateway was lost.
    lost_since_ns: Option<u64>,
}

impl NodeLink {
    pub fn new(service: Service) -> Self {
        Self {
            service,
            pending: HashMap::new(),
            sent_to: HashSet::new(),
            alive: HashSet::new(),
            stalled: HashMap::new(),
            lost_since_ns: None,
        }
    }

    /// Returns whether a node of a channel has sent a frame, or acknowledged those of this command.
    pub fn is_alive(&self, place: Place) -> bool {
        self.alive.contains(&place)
    }

    /// As [`is_alive`](Self::is_alive), after reading the transmit FIFO of the channel: a transmit
    /// result reports the transfer to the CAN controller, not the acknowledgement.
    pub fn check_alive(&mut self, place: Place) -> bool {
        let (gateway, channel) = place;
        if self.is_alive(place) || !self.sent_to.contains(&place) {
            return self.is_alive(place);
        }
        let status = self.service.channel_status(gateway, channel);
        if status.warn() || status.bus_off() || status.tx_pending() > 0 {
            return false;
        }
        let size = self.service.can(gateway, channel).map_or(0, |can| can.ram.tx_fifo_size);
        // What cannot be read counts as empty.
        let queue = self.service.upload(gateway, 0x9000 + u16::from(channel), 6);
        let free = queue.map_or(size, |raw| TransmitQueueStatus::from_raw(raw).free);
        if free >= size {
            self.alive.insert(place);
        }
        self.is_alive(place)
    }

    /// Returns whether a channel has accepted no frame for a second.
    pub fn is_stalled(&self, place: Place) -> bool {
        let now_ns = self.service.response_ns();
        self.stalled.get(&place).is_some_and(|at| now_ns.saturating_sub(*at) > STALL_NS)
    }

    /// Runs a cycle: passes the received frames to the transfers and to `observe`, and sends the
    /// frames of the transfers. Returns its [observed time](Service::response_ns), in which all limits
    /// of a command are measured.
    ///
    /// # Errors
    /// The user stopped the command, or a gateway was lost.
    pub fn cycle(
        &mut self,
        requests: &mut [SdoRequest],
        observe: impl FnMut(&Observed),
    ) -> Result<u64> {
        self.cycle_with(requests, None, observe).map(|cycle| cycle.0)
    }

    /// As [`cycle`](Self::cycle), with a further frame for a channel of the only gateway. Returns the
    /// time and whether the frame was sent.
    fn cycle_with(
        &mut self,
        requests: &mut [SdoRequest],
        further: Option<(u8, CanFrame)>,
        mut observe: impl FnMut(&Observed),
    ) -> Result<(u64, bool)> {
        let cycle = self.service.begin();
        let now_ns = self.service.response_ns();
        for arrival in &cycle.arrivals {
            match arrival.event {
                Event::Result { ticket: Some(ticket), outcome } => {
                    match self.pending.remove(&ticket) {
                        Some((place, _)) if outcome.is_success() => {
                            self.sent_to.insert(place);
                        }
                        Some((place, Some(node))) => {
                            let lost = find_request(requests, place, node);
                            lost.into_iter().for_each(|request| request.has_lost_frame = true);
                        }
                        _ => {}
                    }
                }
                Event::Result { ticket: None, .. } => {}
                Event::Frame(frame) => {
                    let observed = Observed { time_ns: arrival.time_ns, frame };
                    if !frame.is_sent {
                        self.alive.insert((frame.gateway, frame.channel));
                    }
                    deliver(&observed, requests, now_ns);
                    observe(&observed);
                }
            }
        }
        let mut sent = [0; CHANNELS];
        for request in requests {
            request.client.tick(now_ns);
            let count = sent.get_mut(usize::from(request.target.channel));
            let Some(count) = count.filter(|count| **count < FRAMES_PER_CYCLE) else { continue };
            let NodeTarget { channel, node } = request.target;
            if let Some(data) = request.client.frame()
                && self.send(request.gateway, channel, &sdo_frame(request, &data), Some(node))?
            {
                request.client.sent(now_ns);
                *count += 1;
            }
        }
        let is_sent = match further {
            Some((channel, frame)) => self.send(0, channel, &frame, None)?,
            None => false,
        };
        self.service.end(cycle)?;
        self.check()?;
        Ok((now_ns, is_sent))
    }

    /// Fails if the user stops the command, or if a gateway is not ready for too long.
    fn check(&mut self) -> Result {
        let now_ns = self.service.response_ns();
        if self.service.is_interrupted() {
            return Err(Failure::Incomplete("stopped by the user".to_owned()));
        }
        let Some(gateway) = self.service.lost_gateway() else {
            self.lost_since_ns = None;
            return Ok(());
        };
        let since_ns = *self.lost_since_ns.get_or_insert(now_ns);
        match now_ns.saturating_sub(since_ns) > LOST_NS {
            true => Err(self.service.not_ready(gateway, "the nodes cannot be reached")),
            false => Ok(()),
        }
    }

    /// Sends a frame in this cycle, of an SDO transfer with a node if it is given; false without space,
    /// or while the gateway is not ready.
    fn send(
        &mut self,
        gateway: usize,
        channel: u8,
        frame: &CanFrame,
        node: Option<NodeId>,
    ) -> Result<bool> {
        let place = (gateway, channel);
        if !self.service.is_ready(gateway) {
            return Ok(false);
        }
        let Some(ticket) = self.service.send(gateway, channel, frame)? else {
            let now_ns = self.service.response_ns();
            self.stalled.entry(place).or_insert(now_ns);
            return Ok(false);
        };
        self.stalled.remove(&place);
        self.pending.insert(ticket, (place, node));
        Ok(true)
    }

    /// Runs a cycle of the LSS master of a channel of the only gateway: passes the responses to it, and
    /// sends its frame. Returns the time.
    ///
    /// # Errors
    /// As [`cycle`](Self::cycle).
    pub fn cycle_lss(&mut self, channel: u8, master: &mut LssMaster) -> Result<u64> {
        let frame = master.frame().map(|data| classic(CobId::LSS_REQUEST.can_id(), &data));
        let mut responses = Vec::new();
        let now_ns = self.cycle_with(&mut [], frame.map(|frame| (channel, frame)), |observed| {
            if observed.is_from(0, channel)
                && observed.service() == Some(CanopenService::LssResponse)
            {
                responses.push(observed.frame.frame);
            }
        })?;
        let (now_ns, is_sent) = now_ns;
        responses.iter().for_each(|frame| master.receive(frame.data()));
        if is_sent {
            master.sent(now_ns);
        }
        master.tick(now_ns);
        Ok(now_ns)
    }

    /// Sends a frame, in a later cycle if there is no space, within a second.
    ///
    /// # Errors
    /// As [`cycle`](Self::cycle); no space.
    fn send_now(
        &mut self,
        channel: u8,
        frame: &CanFrame,
        mut observe: impl FnMut(&Observed),
    ) -> Result {
        let end_ns = self.service.response_ns() + STALL_NS;
        loop {
            let cycle = self.service.begin();
            let sent = self.send(0, channel, frame, None);
            for arrival in &cycle.arrivals {
                if let Event::Frame(frame) = arrival.event {
                    observe(&Observed { time_ns: arrival.time_ns, frame });
                }
            }
            self.service.end(cycle)?;
            if sent? {
                return Ok(());
            }
            self.check()?;
            if self.service.response_ns() > end_ns {
                let message =
                    format!("the gateway accepts no frame for can{channel}; see `ecan diag`");
                return Err(Failure::Rejected(message));
            }
        }
    }

    /// Sends an NMT command on a channel of the only gateway.
    ///
    /// # Errors
    /// As [`cycle`](Self::cycle).
    pub fn send_nmt(
        &mut self,
        channel: u8,
        request: NmtRequest,
        observe: impl FnMut(&Observed),
    ) -> Result {
        let frame = classic(CobId::NMT.can_id(), &request.to_bytes());
        self.send_now(channel, &frame, observe)
    }

    /// Asks a node for its state by node guarding (CiA 301, 7.2.8.3.2.1): a remote frame.
    ///
    /// # Errors
    /// As [`cycle`](Self::cycle).
    pub fn send_guarding(&mut self, target: NodeTarget, observe: impl FnMut(&Observed)) -> Result {
        let id = CobId::heartbeat(target.node).can_id();
        let frame = Dlc::from_raw(1).and_then(|dlc| CanFrame::remote(id, dlc).ok());
        frame.map_or(Ok(()), |frame| self.send_now(target.channel, &frame, observe))
    }

    /// Address of a node of a gateway in messages and JSON.
    pub fn json(&self, gateway: usize, target: NodeTarget) -> JsonTarget {
        let NodeTarget { channel, node } = target;
        JsonTarget { slave: self.service.position(gateway), channel, node: node.get() }
    }

    /// Error of a channel that accepts no frame.
    pub fn stall_failure(&self, (gateway, channel): Place) -> Failure {
        let position = self.service.position(gateway);
        Failure::Rejected(format!(
            "slave {position} accepts no more frames for can{channel}: no node acknowledges them; \
             check bit rate, wiring and termination"
        ))
    }

    /// Error of a transfer, with what to do.
    pub fn failure(
        &mut self,
        request: &SdoRequest,
        (direction, index, subindex): (SdoDirection, u16, u8),
        fault: SdoFault,
    ) -> Failure {
        let NodeTarget { channel, node } = request.target;
        let slave = self.service.position(request.gateway);
        let address = NodeAddress { slave, channel, node };
        let failure = SdoFailure { address, direction, index, subindex, fault };
        let remedy = match fault {
            SdoFault::TimedOut { .. } if !self.check_alive((request.gateway, channel)) => {
                "; no node acknowledges frames of this channel: check bit rate, wiring and \
                 termination"
            }
            SdoFault::TimedOut { .. } => {
                "; check the node-ID, and that the node is not in the state stopped; `ecan node \
                 scan` lists the nodes"
            }
            _ => "",
        };
        Failure::Rejected(format!("{failure}{remedy}"))
    }
}

impl SdoRequest {
    pub fn new(gateway: usize, target: NodeTarget, timeout: Duration, retries: u8) -> Self {
        let config =
            SdoConfig { timeout, retries, buffer_bytes: 64 * 1024, ..SdoConfig::default() };
        Self { gateway, target, client: SdoClient::new(config), has_lost_frame: false }
    }
}

/// Passes a frame to the transfers.
fn deliver(observed: &Observed, requests: &mut [SdoRequest], now_ns: u64) {
    let (node, is_boot_up) = match observed.service() {
        Some(CanopenService::SdoServer(node)) => (node, false),
        Some(CanopenService::Heartbeat(node)) => {
            (node, observed.state() == Some((node, NmtState::Initialising)))
        }
        _ => return,
    };
    if observed.frame.is_sent {
        return;
    }
    let place = (observed.frame.gateway, observed.frame.channel);
    let Some(request) = find_request(requests, place, node) else { return };
    if is_boot_up {
        request.client.drop_transfer(SdoFault::NodeRestarted);
    } else if matches!(observed.service(), Some(CanopenService::SdoServer(_))) {
        request.client.receive(observed.frame.frame.data(), now_ns);
    }
}

fn find_request(
    requests: &mut [SdoRequest],
    (gateway, channel): Place,
    node: NodeId,
) -> Option<&mut SdoRequest> {
    let target = NodeTarget { channel, node };
    requests.iter_mut().find(|request| request.gateway == gateway && request.target == target)
}

fn sdo_frame(request: &SdoRequest, data: &[u8]) -> CanFrame {
    classic(CobId::sdo_client(request.target.node).can_id(), data)
}

fn classic(id: CanId, data: &[u8]) -> CanFrame {
    CanFrame::classic(id, data).unwrap_or_else(|_| {
        // infallible: at most 8 bytes
        unreachable!()
    })
}
