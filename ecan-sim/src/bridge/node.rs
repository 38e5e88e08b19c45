//! The bridge on its bus.

use std::collections::VecDeque;

use ecan_bridge::{BridgeConfig, BridgeInfo, BridgeServer, BusRates, ClientId, ServerError};
use ecan_protocol::can::CanFrame;

use crate::bus::StationConfig;
use crate::node::{Node, NodeOutput};

/// How often the node looks for frames of its clients, in simulated time.
const POLL_NS: u64 = 200_000;
/// The same while nobody is connected.
const IDLE_POLL_NS: u64 = 5_000_000;
/// Frames handed to the controller at a time: one on the wire and one behind it.
const AHEAD: usize = 2;

/// A station of the simulated bus behind which other programs sit, joined by TCP.
///
/// A client hears what the other stations send and what the other clients send, but not itself.
/// The node stops listening and ends its threads when it is dropped.
#[derive(Debug)]
pub struct BridgeNode {
    server: BridgeServer,
    due: Option<u64>,
    /// Frames given to the controller, with their senders.
    under_way: VecDeque<(ClientId, CanFrame)>,
}

impl BridgeNode {
    /// Starts to listen; clients may connect at once.
    ///
    /// # Errors
    /// The address cannot be had, or no thread.
    pub fn listen(settings: &BridgeConfig) -> Result<Self, ServerError> {
        let server = BridgeServer::listen(settings)?;
        Ok(Self { server, due: None, under_way: VecDeque::with_capacity(AHEAD) })
    }

    /// Where it listens and what it has done; stays valid after the node has gone.
    pub fn info(&self) -> &BridgeInfo {
        self.server.info()
    }

    fn fill(&mut self, out: &mut NodeOutput) {
        while out.len() < AHEAD
            && let Some((sender, frame)) = self.server.clients().next_for_bus()
        {
            out.send(frame);
            // A frame that the bus lost (the controller was configured anew, the node muted) is
            // never reported; it must not stay here for ever.
            while self.under_way.len() > 2 * AHEAD {
                self.under_way.pop_front();
            }
            self.under_way.push_back((sender, frame));
        }
    }

    /// Whose frame has been sent. Those before it will not be any more.
    fn sender_of(&mut self, sent: &CanFrame) -> Option<ClientId> {
        let at = self.under_way.iter().position(|(_, frame)| is_same(frame, sent))?;
        self.under_way.drain(..=at).next_back().map(|(sender, _)| sender)
    }
}

/// Whether a frame is on the wire what was given to the controller, which may set the error state
/// indicator and shortens CAN FD frames on a classic bus.
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
        self.fill(out);
    }

    fn transmitted(&mut self, now: u64, frame: &CanFrame, out: &mut NodeOutput) {
        let sender = self.sender_of(frame);
        self.server.clients().count_sent();
        self.server.clients().deliver(frame, now, sender);
        self.fill(out);
    }

    fn next_event(&self) -> Option<u64> {
        self.due
    }

    fn advance(&mut self, now: u64, out: &mut NodeOutput) {
        self.fill(out);
        let pause = if self.server.clients().are_there() { POLL_NS } else { IDLE_POLL_NS };
        self.due = Some(now.saturating_add(pause));
    }
}
