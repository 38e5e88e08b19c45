//! The network in the cycle: received and sent frames.

use crate::{CobId, Emcy, GuardResponse, NmtState, Service};
use ecan_mcan_port::{Cycle, Received, ReceivedFrame};
use ecan_protocol::can::FrameKind;

use super::frame_sink::FrameSink;
use super::guarding::GuardResult;
use super::network::Network;
use super::node::Node;
use super::sdo_error::SdoFault;
use super::service_sender::ServiceSender;

impl Network {
    /// Takes the received frames of the cycle: boot-up messages, heartbeats, guarding responses, emergency messages
    /// and SDO answers of its nodes, and the responses to LSS commands. Passes everything else to `other`, in order: the nodes' TPDOs with slave,
    /// channel and CAN ID, frames of unknown nodes, and transmit reports. Then checks timeouts and the
    /// sessions of the gateways, and executes the boot-up of its nodes.
    ///
    /// Call once per cycle, before anything is sent. A further call in a cycle only takes the frames that are left: a
    /// SYNC period begins once. Real-time safe if `other` is.
    /// [`Port::cycle_report`](ecan_mcan_port::Port::cycle_report) shows whether the cycle was complete.
    pub fn receive(&mut self, cycle: &mut Cycle<'_>, now_ns: u64, mut other: impl FnMut(Received)) {
        self.watch_gateways(cycle);
        for item in cycle.received() {
            match item.to_owned() {
                Received::Frame(frame) if self.take(&frame, now_ns) => {}
                item => other(item),
            }
        }
        let number = cycle.adapter().cycle_number();
        if std::mem::replace(&mut self.last_cycle, number) != number {
            self.tick(now_ns);
            self.step_boot(now_ns);
        }
    }

    /// Sends NMT commands, the host's heartbeat, TIME, guarding requests, LSS and SDO frames that are due, in this
    /// order on each channel.
    ///
    /// Call once per cycle, after the cycle's process data. A frame that finds no space waits for the next
    /// cycle and is not duplicated. Real-time safe.
    pub fn send(&mut self, cycle: &mut Cycle<'_>, now_ns: u64) {
        self.send_to(cycle, now_ns);
    }

    /// Drops the transfers and commands of a gateway that is no longer ready.
    pub(super) fn watch_gateways(&mut self, sink: &impl FrameSink) {
        let Self { channels, nodes, .. } = self;
        for channel in channels {
            let is_ready = sink.is_ready(channel.slave);
            if channel.is_ready && !is_ready {
                channel.gateway_lost();
                for nth in &channel.nodes {
                    if let Some(node) = nodes.get_mut(*nth) {
                        node.sdo.drop_transfer(SdoFault::GatewayLost);
                    }
                }
            }
            channel.is_ready = is_ready;
        }
    }

    /// Takes one frame; returns whether it belongs to the network.
    pub(super) fn take(&mut self, received: &ReceivedFrame, now_ns: u64) -> bool {
        let frame = &received.frame;
        if frame.kind() != FrameKind::Data {
            return false;
        }
        let service = CobId::classify(frame.id());
        if service == Some(Service::LssResponse) {
            let channel = self.channel_mut(received.slave, received.channel);
            let Some(channel) = channel else { return false };
            channel.lss.receive(frame.data());
            return true;
        }
        let Some(Service::Emcy(node) | Service::SdoServer(node) | Service::Heartbeat(node)) =
            service
        else {
            return false;
        };
        let Some(handle) = self.find_node(received.slave, received.channel, node) else {
            return false;
        };
        let Self { nodes, statistics, .. } = self;
        let Some(node) = nodes.get_mut(handle.0) else { return false };
        let data = frame.data();
        let is_valid = match service {
            Some(Service::Emcy(_)) => emcy(node, data, now_ns),
            Some(Service::Heartbeat(_)) => error_control(node, data, now_ns),
            _ => {
                node.sdo.receive(&padded(data), now_ns);
                true
            }
        };
        statistics.malformed += u64::from(!is_valid);
        true
    }

    pub(super) fn tick(&mut self, now_ns: u64) {
        for node in &mut self.nodes {
            if node.heartbeat.tick(now_ns) {
                tracing::warn!("{}: heartbeat lost", node.address);
            }
            if node.guard.as_mut().is_some_and(|guard| guard.tick(now_ns)) {
                tracing::warn!("{}: no response to guarding", node.address);
            }
            node.sdo.tick(now_ns);
        }
        for channel in &mut self.channels {
            channel.lss.tick(now_ns);
        }
        if let Some(sync) = &self.sync {
            for channel in &mut self.channels {
                channel.sync.tick(sync);
            }
        }
    }

    pub(super) fn send_to(&mut self, sink: &mut impl FrameSink, now_ns: u64) {
        let Self { config, nodes, channels, time, statistics, .. } = self;
        for channel in channels {
            let mut sender = ServiceSender { sink, channel, nodes, config, statistics };
            sender.deliver(time.as_ref(), now_ns);
        }
    }
}

/// Fills an SDO frame to eight bytes: a server that sends fewer means zeros.
fn padded(data: &[u8]) -> [u8; 8] {
    let mut bytes = [0; 8];
    for (to, from) in bytes.iter_mut().zip(data) {
        *to = *from;
    }
    bytes
}

fn emcy(node: &mut Node, data: &[u8], now_ns: u64) -> bool {
    let Some(emcy) = Emcy::parse(data) else { return false };
    node.emcy.push(now_ns, emcy);
    true
}

fn error_control(node: &mut Node, data: &[u8], now_ns: u64) -> bool {
    // A heartbeat has the same form; its toggle bit is 0.
    let Some(response) = GuardResponse::parse(data) else { return false };
    let address = node.address;
    if response.state == NmtState::Initialising {
        tracing::info!("{address}: boot-up");
        node.nmt.booted();
        node.heartbeat.booted();
        if let Some(guard) = &mut node.guard {
            guard.booted();
        }
        if node.sdo.is_known_to_node() {
            node.sdo.drop_transfer(SdoFault::NodeRestarted);
        }
        return true;
    }
    let was_overdue = match &mut node.guard {
        None => node.heartbeat.received(now_ns),
        Some(guard) => {
            let result = guard.received(response, now_ns);
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
    node.nmt.reported_by_node(response.state);
    if was_overdue {
        tracing::info!("{address}: life sign received again");
    }
    true
}
