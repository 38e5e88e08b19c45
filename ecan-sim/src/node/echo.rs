use ecan_protocol::can::CanFrame;

use super::{Node, NodeOutput};

/// Answers every frame with one of the same identifier, format and data.
///
/// Two of them on one bus answer each other forever.
#[derive(Clone, Copy, Debug, Default)]
pub struct EchoNode {
    echoed: u64,
}

impl EchoNode {
    /// A node that has received nothing yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { echoed: 0 }
    }

    /// Number of answered frames.
    #[must_use]
    pub const fn echoed(&self) -> u64 {
        self.echoed
    }
}

impl Node for EchoNode {
    fn try_clone(&self) -> Option<Box<dyn Node>> {
        Some(Box::new(*self))
    }

    fn received(&mut self, _now: u64, frame: &CanFrame, out: &mut NodeOutput) {
        self.echoed += 1;
        out.send(*frame);
    }
}
