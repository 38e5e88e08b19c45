//! Inputs of a session.

use ecan_host::Delivery;
use ecan_protocol::can::CanFrame;
use ecan_protocol::image::{Header, Image, Packet, Timestamp, TxResult};

/// A received frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ReceivedFrame {
    pub(crate) channel: u8,
    pub(crate) frame: CanFrame,
    pub(crate) timestamp: Timestamp,
}

/// Inputs of one cycle.
#[derive(Clone, Debug)]
pub(crate) struct Inputs {
    /// Delivery of the last RxPDO image.
    pub(crate) outputs: Delivery,
    /// Time of the send of this cycle after its deadline, in ns.
    pub(crate) sent_ns: u64,
    /// Header of a new image.
    pub(crate) header: Option<Header>,
    pub(crate) frames: Vec<ReceivedFrame>,
    pub(crate) results: Vec<TxResult>,
}

impl Inputs {
    pub(crate) fn take_packets(&mut self, image: &Image<'_>) {
        self.header = Some(*image.header());
        for packet in image.packets().map_while(Result::ok) {
            match packet {
                Packet::Frame(packet) => self.frames.push(ReceivedFrame {
                    channel: packet.channel,
                    frame: packet.frame.to_owned(),
                    timestamp: packet.timestamp,
                }),
                Packet::TxResult(result) => self.results.push(result),
            }
        }
    }
}
