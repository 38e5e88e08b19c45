//! Comparison of returned frames with sent ones.

use std::collections::VecDeque;

use ecan_protocol::can::CanFrame;

/// Expects every frame back on its channel, unchanged and in order. Channels are numbered over all
/// gateways.
#[derive(Debug, Default)]
pub struct EchoCheck {
    pending: Vec<VecDeque<CanFrame>>,
    sent: u64,
    returned: u64,
    first_difference: Option<String>,
}

impl EchoCheck {
    pub fn new(channels: usize) -> Self {
        Self { pending: vec![VecDeque::new(); channels], ..Self::default() }
    }

    pub fn sent(&mut self, channel: usize, frame: CanFrame) {
        self.sent += 1;
        if let Some(queue) = self.pending.get_mut(channel) {
            queue.push_back(frame);
        }
    }

    /// Compares a returned frame with the oldest pending one of its channel.
    pub fn received(&mut self, channel: usize, frame: &CanFrame) {
        self.returned += 1;
        let expected = self.pending.get_mut(channel).and_then(VecDeque::pop_front);
        if expected.as_ref() != Some(frame) && self.first_difference.is_none() {
            let expected = expected.map_or_else(|| "none".into(), |f| format!("{f:?}"));
            self.first_difference = Some(format!(
                "frame {} on can{channel}: received {frame:?}, expected {expected}",
                self.returned
            ));
        }
    }

    pub fn pending(&self) -> usize {
        self.pending.iter().map(VecDeque::len).sum()
    }

    pub fn counts(&self) -> (u64, u64) {
        (self.sent, self.returned)
    }

    pub fn first_difference(&self) -> Option<&str> {
        self.first_difference.as_deref()
    }
}
