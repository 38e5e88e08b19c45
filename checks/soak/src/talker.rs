//! A node that sends numbered frames by itself.

use ecan_protocol::can::CanFrame;
use ecan_sim::{Node, NodeOutput};

use crate::frame_number::{FrameNumber, Kinds, Stream};

/// Sends a burst of numbered frames in each period.
#[derive(Debug)]
pub struct Talker {
    next: FrameNumber,
    kinds: Kinds,
    period_ns: u64,
    burst: u32,
    due: Option<u64>,
}

impl Talker {
    pub fn new(channel: u8, kinds: Kinds, period_ns: u64, burst: u32) -> Self {
        let next = FrameNumber { channel, stream: Stream::Node, number: 0 };
        Self { next, kinds, period_ns, burst, due: None }
    }
}

impl Node for Talker {
    fn started(&mut self, now: u64, _out: &mut NodeOutput) {
        self.due = Some(now + self.period_ns);
    }

    fn received(&mut self, _now: u64, _frame: &CanFrame, _out: &mut NodeOutput) {}

    fn next_event(&self) -> Option<u64> {
        self.due
    }

    fn advance(&mut self, now: u64, out: &mut NodeOutput) {
        let Some(due) = self.due.filter(|due| *due <= now) else { return };
        self.due = Some(due + self.period_ns);
        // A bus without a listener keeps the queue full: the numbers wait with the frames.
        if !out.is_empty() || self.next.number > FrameNumber::MAX - self.burst {
            return;
        }
        for _ in 0..self.burst {
            out.send(self.next.frame(self.kinds));
            self.next.number += 1;
        }
    }
}
