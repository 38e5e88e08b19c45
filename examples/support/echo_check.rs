//! Comparing what comes back with what was sent.

use std::collections::VecDeque;

use ecan_protocol::can::CanFrame;

/// Expects every frame back on its channel, unchanged and in order.
///
/// Channels are counted over all gateways.
#[derive(Debug, Default)]
pub struct Check {
    under_way: Vec<VecDeque<CanFrame>>,
    sent: u64,
    returned: u64,
    first_difference: Option<String>,
}

impl Check {
    /// For this many channels.
    pub fn new(channels: usize) -> Self {
        Self { under_way: vec![VecDeque::new(); channels], ..Self::default() }
    }

    /// A frame was sent.
    pub fn sent(&mut self, channel: usize, frame: CanFrame) {
        self.sent += 1;
        if let Some(queue) = self.under_way.get_mut(channel) {
            queue.push_back(frame);
        }
    }

    /// A frame came back.
    pub fn received(&mut self, channel: usize, frame: &CanFrame) {
        self.returned += 1;
        let due = self.under_way.get_mut(channel).and_then(VecDeque::pop_front);
        if due.as_ref() != Some(frame) && self.first_difference.is_none() {
            let due = due.map_or_else(|| "nothing".into(), |f| format!("{f:?}"));
            self.first_difference = Some(format!(
                "frame {} on can{channel}: {frame:?} came back, {due} was due",
                self.returned
            ));
        }
    }

    /// Frames still under way.
    pub fn under_way(&self) -> usize {
        self.under_way.iter().map(VecDeque::len).sum()
    }

    /// Frames sent and returned so far.
    pub fn counts(&self) -> (u64, u64) {
        (self.sent, self.returned)
    }

    /// The first frame that came back otherwise than it should.
    pub fn first_difference(&self) -> Option<&str> {
        self.first_difference.as_deref()
    }
}
