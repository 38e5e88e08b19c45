//! What else is on the bus: peers of the gateway's CAN channels.
//!
//! A node decides what to send and when; the controller below it (a
//! [`StationConfig`](crate::StationConfig)) and the queue in front of it belong to the world
//! that runs it.

mod bridge;
mod echo;
mod faulty;
mod output;
mod replay;
mod silent;

use std::any::Any;

use ecan_protocol::can::CanFrame;

use crate::bus::StationConfig;

pub use bridge::{BridgeFactory, BridgeProtocol, BridgeSpec};
pub use echo::EchoNode;
pub use faulty::{FaultyConfig, FaultyNode};
pub use output::NodeOutput;
pub use replay::{ReplayError, ReplayNode, ReplayRecord};
pub use silent::SilentNode;

/// A participant of a CAN bus. All times are nanoseconds of the simulation.
///
/// Calls come in the order of time. A node answers by putting frames into `out`; they are sent
/// in that order as the bus allows.
pub trait Node: Any + Send {
    /// The node's controller runs with this configuration from now on. The first time,
    /// [`started`](Self::started) follows.
    fn configured(&mut self, now: u64, config: &StationConfig) {
        let _ = (now, config);
    }

    /// The node's controller has been configured and the node starts, at `now`.
    fn started(&mut self, now: u64, out: &mut NodeOutput) {
        let _ = (now, out);
    }

    /// A frame of another station has been received.
    fn received(&mut self, now: u64, frame: &CanFrame, out: &mut NodeOutput) {
        let _ = (now, frame, out);
    }

    /// One of the node's own frames has been sent.
    fn transmitted(&mut self, now: u64, frame: &CanFrame, out: &mut NodeOutput) {
        let _ = (now, frame, out);
    }

    /// When the node wants to act by itself, if ever.
    fn next_event(&self) -> Option<u64> {
        None
    }

    /// Whether the node's controller takes part in the bus: it then acknowledges frames and hears
    /// them. Asked again after every call.
    fn is_on_bus(&self) -> bool {
        true
    }

    /// The time that [`next_event`](Self::next_event) asked for has come. Afterwards it names a
    /// later one, or none.
    fn advance(&mut self, now: u64, out: &mut NodeOutput) {
        let _ = (now, out);
    }

    /// Text for the banner if it has to name the node, for example "slcan bridge at 127.0.0.1:29536".
    fn description(&self) -> Option<String> {
        None
    }
}
