//! Nodes on the CAN buses.
//!
//! A node decides what to send and when; its controller (a [`StationConfig`](crate::StationConfig))
//! and its queue belong to the world.

mod builtin;
mod output;

use std::any::Any;

use ecan_protocol::can::CanFrame;

use crate::bus::StationConfig;

pub use builtin::EchoNode;
pub use builtin::SilentNode;
pub use builtin::{FaultyConfig, FaultyNode};
pub use builtin::{ReplayNode, ReplayRecord};
pub use output::NodeOutput;
pub use output::{BridgeFactory, BridgeProtocol, BridgeSpec};

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
