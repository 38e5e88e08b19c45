//! Queue between a node and its controller.

use std::collections::VecDeque;
use std::error::Error;
use std::net::IpAddr;

use ecan_protocol::can::CanFrame;
use serde::Deserialize;

use super::Node;
use crate::event_queue::take_first;

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
