//! Queue between a node and its controller.

use std::collections::VecDeque;

use ecan_protocol::can::CanFrame;

use crate::queue::take_first;

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
