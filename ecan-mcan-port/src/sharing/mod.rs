//! The Port's exchange with other threads: copies of its images, and queues of frames to send.

pub(crate) mod image_stream;
mod of_port;
pub(crate) mod transmit_queue;
mod word_ring;
