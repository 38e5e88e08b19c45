//! The queue between a node and its controller.

use std::collections::VecDeque;

use ecan_protocol::can::CanFrame;

/// Frames that a node wants to send, first in, first out.
///
/// It grows to the largest number of frames ever waiting and allocates no more after that.
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

    /// Queues a frame behind those already waiting.
    pub fn send(&mut self, frame: CanFrame) {
        self.waiting.push_back(frame);
    }

    /// The frame whose turn it is, left in the queue.
    #[must_use]
    pub fn front(&self) -> Option<&CanFrame> {
        self.waiting.front()
    }

    /// Takes the frame whose turn it is.
    pub fn pop(&mut self) -> Option<CanFrame> {
        self.waiting.pop_front()
    }

    /// Number of frames waiting.
    #[must_use]
    pub fn len(&self) -> usize {
        self.waiting.len()
    }

    /// Whether nothing waits.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Forgets every waiting frame, as when the node is switched off.
    pub fn clear(&mut self) {
        self.waiting.clear();
    }
}
