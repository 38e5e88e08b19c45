//! Batches, for bring-up, test scripts and code that thinks in lists (manual 15.4).

use ecan_host::CycleError;

use crate::port::Port;
use crate::received::Received;
use crate::send::{SendError, TransmitFrame};

/// What became of a batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Batch {
    /// Frames taken, from the front of the batch.
    pub sent: usize,
    /// Why the next one was not taken; `None` when all were.
    pub stopped: Option<SendError>,
}

/// What became of an [`exchange`](Port::exchange).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Exchange {
    /// The frames to send.
    pub batch: Batch,
    /// Items received.
    pub received: usize,
    /// An error of the library; frames were taken and received all the same.
    pub error: Option<CycleError>,
}

impl Port {
    /// Sends frames in order and stops at the first that is not taken, whatever its channel, so
    /// that the order holds when the rest is sent in a later cycle. Real-time safe, between `cycle_begin` and
    /// `cycle_end`.
    pub fn send_batch(&mut self, frames: &[TransmitFrame]) -> Batch {
        for (sent, frame) in frames.iter().enumerate() {
            let one = frame.frame.as_ref();
            if let Err(error) = self.send_with(frame.slave, frame.channel, one, frame.options) {
                return Batch { sent, stopped: Some(error) };
            }
        }
        Batch { sent: frames.len(), stopped: None }
    }

    /// One whole cycle: begin, receive, send the batch, end. Real-time safe. Keeping the period
    /// is up to the caller.
    pub fn exchange(&mut self, frames: &[TransmitFrame], received: &mut [Received]) -> Exchange {
        let begun = self.cycle_begin();
        let received = self.receive(received);
        let batch = self.send_batch(frames);
        let ended = self.cycle_end();
        Exchange { batch, received, error: begun.and(ended).err() }
    }
}
