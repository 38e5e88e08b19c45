//! What a Port shares with other threads.

use super::image_stream::{ImageStream, image_stream};
use super::transmit_queue::{TransmitQueues, transmit_queues};
use crate::port::Port;

impl Port {
    /// Starts to copy the images of all gateways into a ring of at least `capacity_bytes`, and returns
    /// its reading end, for one other thread. Allocates; not for the cycle.
    ///
    /// An earlier stream is closed. The stream continues over [`reconfigure`](Self::reconfigure).
    pub fn image_stream(&mut self, capacity_bytes: usize) -> ImageStream {
        let (recorder, stream) = image_stream(capacity_bytes);
        self.recorder = Some(recorder);
        stream
    }

    /// Creates queues of at least `depth` frames for each channel of every gateway, filled by one other
    /// thread. Allocates; not for the cycle.
    ///
    /// Earlier queues are closed. The queues remain over [`reconfigure`](Self::reconfigure), for the
    /// gateways that existed when they were created.
    pub fn transmit_queues(&mut self, depth: usize) -> TransmitQueues {
        let (of_cycle, queues) = transmit_queues(&self.gateways, depth);
        self.queues = Some(Box::new(of_cycle));
        queues
    }
}
