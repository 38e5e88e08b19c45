//! slcan and socketcand bridges as nodes of simulated CAN buses.
//!
//! The simulator reads nodes of kind `bridge` from scenario files, but opens no TCP port itself. A
//! program that supports them sets [`SimOptions::bridges`](crate::SimOptions::bridges) to
//! [`make`].
//!
//! Frames of the clients wait until simulated time advances, and it advances only while a master's
//! cycle or a [`RealTimeRunner`](crate::RealTimeRunner) drives the simulation.

use std::any::Any;
use std::collections::VecDeque;
use std::error::Error;
use std::net::SocketAddr;

use ecan_can_io::bridge::{BridgeConfig, BridgeServer, BusRates, ClientFrame, ServerError};
use ecan_protocol::can::CanFrame;

pub use ecan_can_io::bridge::BridgeInfo;

use crate::{AttachedNode, BridgeSpec, Node, NodeOutput, Simulation, StationConfig, UnknownBus};

/// Makes the bridge of a scenario; it listens at once.
///
/// # Errors
/// A [`ServerError`].
pub fn make(spec: &BridgeSpec) -> Result<Box<dyn Node>, Box<dyn Error + Send + Sync>> {
    Ok(Box::new(BridgeNode::listen(spec)?))
}

/// The bridges of a simulation with the names of their buses, those of the scenario first.
#[must_use]
pub fn bridges(simulation: &Simulation) -> Vec<(String, BridgeInfo)> {
    simulation.with_world(|world| {
        let bridges = world.nodes().filter_map(|(bus, node)| {
            let node = (node as &dyn Any).downcast_ref::<BridgeNode>()?;
            Some((bus.to_owned(), node.info().clone()))
        });
        bridges.collect()
    })
}

/// Reason why a bridge cannot be attached.
#[derive(Debug, thiserror::Error)]
pub enum BridgeError {
    /// No bus has this name.
    #[error(transparent)]
    UnknownBus(#[from] UnknownBus),
    /// The bridge cannot listen.
    #[error(transparent)]
    Server(#[from] ServerError),
}

/// A bridge that [`attach`] put on a bus. Dropping it removes the bridge from its bus, closes its
/// connections and ends its threads.
#[derive(Debug)]
pub struct Bridge {
    /// Address, with the actual port, and counters; a clone may outlive the bridge.
    pub info: BridgeInfo,
    _node: AttachedNode,
}

/// Puts a bridge on a bus, with the bit rates of the gateway channel there.
///
/// A bridge in a scenario (`kind = "bridge"`) may have its own bit rates and needs no running
/// gateway channel.
///
/// # Errors
/// The bus does not exist, or the bridge cannot listen.
pub fn attach(
    simulation: &Simulation,
    bus: &str,
    spec: &BridgeSpec,
) -> Result<Bridge, BridgeError> {
    let node = BridgeNode::listen(spec)?;
    let info = node.info().clone();
    let name = format!("bridge {}", info.address().port());
    let node = simulation.attach_node(bus, &name, Box::new(node))?;
    Ok(Bridge { info, _node: node })
}

/// Interval at which the node polls its clients for frames, in simulated time.
const POLL_NS: u64 = 200_000;
/// The same while no client is connected.
const IDLE_POLL_NS: u64 = 5_000_000;
/// Frames handed to the controller at a time: one on the wire and the next one.
const CONTROLLER_DEPTH: usize = 2;

/// A station of a simulated bus that connects clients over TCP.
///
/// A client receives what the other stations and the other clients send, but not its own frames.
/// Dropping the node closes the connections and ends its threads.
#[derive(Debug)]
pub struct BridgeNode {
    server: BridgeServer,
    due: Option<u64>,
    in_flight: VecDeque<ClientFrame>,
}

impl BridgeNode {
    /// Starts to listen; clients may connect at once. What the specification leaves open is as in
    /// [`BridgeConfig::default`].
    ///
    /// # Errors
    /// The address is not available, or no thread can be started.
    pub fn listen(spec: &BridgeSpec) -> Result<Self, ServerError> {
        let server = BridgeServer::listen(&config(spec))?;
        Ok(Self { server, due: None, in_flight: VecDeque::with_capacity(CONTROLLER_DEPTH) })
    }

    /// Address and counters; remains valid after the node is dropped.
    pub fn info(&self) -> &BridgeInfo {
        self.server.info()
    }

    fn fill(&mut self, now: u64, out: &mut NodeOutput) {
        while out.len() < CONTROLLER_DEPTH
            && let Some(next) = self.server.clients().next_for_bus()
        {
            out.send(next.frame);
            // A frame that the bus lost (the controller was reconfigured, the node muted) is never
            // reported as sent and must not stay here forever.
            while self.in_flight.len() > 2 * CONTROLLER_DEPTH
                && let Some(lost) = self.in_flight.pop_front()
            {
                self.server.clients().fail(&lost, now);
            }
            self.in_flight.push_back(next);
        }
    }

    /// Removes a sent frame of a client. Frames before it were lost.
    fn take_sent(&mut self, now: u64, sent: &CanFrame) -> Option<ClientFrame> {
        let at = self.in_flight.iter().position(|held| is_same(&held.frame, sent))?;
        for lost in self.in_flight.drain(..at) {
            self.server.clients().fail(&lost, now);
        }
        self.in_flight.pop_front()
    }
}

fn config(spec: &BridgeSpec) -> BridgeConfig {
    let default = BridgeConfig::default();
    let ip = spec.address.unwrap_or(default.address.ip());
    BridgeConfig {
        protocol: match spec.protocol {
            crate::BridgeProtocol::Slcan => ecan_can_io::bridge::BridgeProtocol::Slcan,
            crate::BridgeProtocol::Socketcand => ecan_can_io::bridge::BridgeProtocol::Socketcand,
        },
        address: SocketAddr::new(ip, spec.port),
        bus: None,
        max_clients: spec.max_clients.unwrap_or(default.max_clients),
        queue: spec.queue.unwrap_or(default.queue),
        handshake: default.handshake,
    }
}

/// Returns whether a sent frame is the given one. The controller may set the error state indicator
/// and shortens CAN FD frames on a classic bus.
fn is_same(given: &CanFrame, sent: &CanFrame) -> bool {
    given.id() == sent.id()
        && given.is_remote() == sent.is_remote()
        && given.data().starts_with(sent.data())
}

impl Node for BridgeNode {
    fn configured(&mut self, _now: u64, config: &StationConfig) {
        self.server.clients().set_bus(BusRates {
            nominal_bitrate: config.nominal_bitrate,
            data_bitrate: config.data_bitrate,
            fd: config.fd,
        });
    }

    fn started(&mut self, now: u64, _out: &mut NodeOutput) {
        self.due = Some(now);
    }

    fn received(&mut self, now: u64, frame: &CanFrame, out: &mut NodeOutput) {
        self.server.clients().deliver(frame, now, None);
        self.fill(now, out);
    }

    fn transmitted(&mut self, now: u64, frame: &CanFrame, out: &mut NodeOutput) {
        let sender = self.take_sent(now, frame).map(|sent| sent.client);
        self.server.clients().count_sent();
        self.server.clients().deliver(frame, now, sender);
        self.fill(now, out);
    }

    fn next_event(&self) -> Option<u64> {
        self.due
    }

    fn advance(&mut self, now: u64, out: &mut NodeOutput) {
        self.fill(now, out);
        let pause = if self.server.clients().is_any_connected() { POLL_NS } else { IDLE_POLL_NS };
        self.due = Some(now.saturating_add(pause));
    }

    fn description(&self) -> Option<String> {
        Some(self.info().to_string())
    }
}
