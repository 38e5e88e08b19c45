//! Interface of a node: its calls, its queue, and the description of a node that the program makes.

use std::any::Any;
use std::collections::VecDeque;
use std::error::Error;
use std::net::IpAddr;

use ecan_protocol::can::CanFrame;
use serde::Deserialize;

use crate::bus::StationConfig;
use crate::event_queue::take_first;

/// A participant of a CAN bus. All times are simulated nanoseconds.
///
/// Calls come in order of time. A node sends frames by putting them into `out`; the bus sends them
/// in that order.
pub trait Node: Any + Send {
    /// The controller has this configuration from now on. After the first call,
    /// [`started`](Self::started) follows.
    fn configured(&mut self, now: u64, config: &StationConfig) {
        let _ = (now, config);
    }

    /// The node starts, after its controller was configured.
    fn started(&mut self, now: u64, out: &mut NodeOutput) {
        let _ = (now, out);
    }

    /// The node received a frame of another station.
    fn received(&mut self, now: u64, frame: &CanFrame, out: &mut NodeOutput) {
        let _ = (now, frame, out);
    }

    /// The bus has sent a frame of the node.
    fn transmitted(&mut self, now: u64, frame: &CanFrame, out: &mut NodeOutput) {
        let _ = (now, frame, out);
    }

    /// Time of the node's next own event.
    fn next_event(&self) -> Option<u64> {
        None
    }

    /// Returns whether the node's controller takes part in the bus: it then acknowledges and
    /// receives frames. Read after every call.
    fn is_on_bus(&self) -> bool {
        true
    }

    /// Own nominal bit rate in bit/s, for example configured by LSS; `None` uses that of the scenario or the gateway.
    /// Read after every call.
    fn bit_rate(&self) -> Option<u32> {
        None
    }

    /// The time of [`next_event`](Self::next_event) has come. Afterwards it returns a later time,
    /// or `None`.
    fn advance(&mut self, now: u64, out: &mut NodeOutput) {
        let _ = (now, out);
    }

    /// A copy of the node in its present state; `None` if the node cannot be copied, for example
    /// because it has a connection.
    fn try_clone(&self) -> Option<Box<dyn Node>> {
        None
    }

    /// Description of the node in the banner, for example "slcan bridge at 127.0.0.1:29536"; `None`
    /// omits it.
    fn description(&self) -> Option<String> {
        None
    }
}

/// Frames to send, first in, first out.
///
/// Grows to the largest number of waiting frames and then allocates no more.
#[derive(Clone, Debug, Default)]
pub struct NodeOutput {
    waiting: VecDeque<CanFrame>,
}

impl NodeOutput {
    /// An empty queue.
    #[must_use]
    pub const fn new() -> Self {
        Self { waiting: VecDeque::new() }
    }

    /// Appends a frame.
    pub fn send(&mut self, frame: CanFrame) {
        self.waiting.push_back(frame);
    }

    /// The next frame, left in the queue.
    #[must_use]
    pub fn front(&self) -> Option<&CanFrame> {
        self.waiting.front()
    }

    /// Takes the next frame.
    pub fn pop(&mut self) -> Option<CanFrame> {
        take_first(&mut self.waiting)
    }

    /// Number of waiting frames.
    #[must_use]
    pub fn len(&self) -> usize {
        self.waiting.len()
    }

    /// Returns whether the queue is empty.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Discards all frames.
    pub fn clear(&mut self) {
        self.waiting.clear();
    }
}

/// Protocol between a bridge and its clients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BridgeProtocol {
    /// ASCII protocol of Lawicel's serial adapters, over TCP.
    #[default]
    Slcan,
    /// Raw mode of socketcand; classic CAN only.
    Socketcand,
}

/// A node that connects other programs to its bus over TCP. `None` leaves a value to the
/// [`BridgeFactory`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BridgeSpec {
    /// Protocol.
    pub protocol: BridgeProtocol,
    /// Address on which it listens; `None` is the loopback interface.
    pub address: Option<IpAddr>,
    /// TCP port; 0 takes any free one.
    pub port: u16,
    /// Maximum number of clients.
    pub max_clients: Option<usize>,
    /// Capacity in frames of the queue to the bus, and of the queue to each client.
    pub queue: Option<usize>,
}

/// Makes the bridge of a scenario; `ecan-sim-bridge` contains one.
pub type BridgeFactory = fn(&BridgeSpec) -> Result<Box<dyn Node>, Box<dyn Error + Send + Sync>>;
