use std::collections::VecDeque;
use std::net::SocketAddr;

use ecan_bridge::{
    BridgeConfig, BridgeInfo, BridgeProtocol, BridgeServer, BusRates, ClientFrame, ServerError,
};
use ecan_protocol::can::CanFrame;
use ecan_sim::{BridgeSpec, Node, NodeOutput, StationConfig};

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
            ecan_sim::BridgeProtocol::Slcan => BridgeProtocol::Slcan,
            ecan_sim::BridgeProtocol::Socketcand => BridgeProtocol::Socketcand,
        },
        address: SocketAddr::new(ip, spec.port),
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
