//! Frames and transmit results from a gateway.

use std::fmt;
use std::iter::{Enumerate, FusedIterator};
use std::slice::IterMut;

use ecan_host::Adapter;
use ecan_protocol::can::{CanFrame, FrameRef};
use ecan_protocol::image::{FramePacket, Packet, Packets, ResultCode, Timestamp, TxResult};

use crate::gateway::Gateway;
use crate::transmit::history::OpenFrame;
use crate::transmit::options::SendTicket;

ecan_protocol::open_enum! {
    /// Location in the CAN controller from which a frame was received (ID_AUX, manual 8.1).
    #[derive(Default)]
    pub enum ReceiveSource: u8 else Other;
    /// RX FIFO 0.
    #[default]
    Fifo0 = 0;
    /// RX FIFO 1.
    Fifo1 = 1;
    /// A dedicated RX buffer.
    RxBuffer = 2;
    /// Marked as a high priority message.
    HighPriority = 3;
}

/// A CAN frame from the bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReceivedFrame {
    /// Slave index.
    pub slave: usize,
    /// Channel of the gateway, 0..3.
    pub channel: u8,
    /// The frame.
    pub frame: CanFrame,
    /// Time of reception; present with profiles 1 and 5 (manual 8.4).
    pub timestamp: Timestamp,
    /// Location in the CAN controller.
    pub source: ReceiveSource,
}

/// Result of a sent frame (manual 10). Success means that the gateway passed the frame to its CAN
/// controller, not that a node received it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TransmitReport {
    /// Ticket of the frame; `None` if it is not known (any more).
    pub ticket: Option<SendTicket>,
    /// Slave index.
    pub slave: usize,
    /// Channel of the frame, 0 to 3.
    pub channel: u8,
    /// The result; a frame that is dropped as late has none, or a wrong one (docs/ASSUMPTIONS.md, H23).
    pub code: ResultCode,
    /// Tag of a scheduled frame; `None` for one that was sent at once, or that is not known.
    pub schedule_tag: Option<u16>,
}

impl TransmitReport {
    pub(crate) fn new(slave: usize, result: &TxResult, send: Option<OpenFrame>) -> Self {
        let sequence = result.sequence;
        Self {
            ticket: send.map(|send| SendTicket { slave, sequence, index: send.index }),
            slave,
            channel: result.channel,
            code: result.code,
            schedule_tag: send.and_then(|send| send.tag),
        }
    }
}

/// An item that arrived.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Received {
    /// A CAN frame from the bus.
    Frame(ReceivedFrame),
    /// The result of a sent frame.
    TransmitReport(TransmitReport),
}

impl Received {
    /// The frame, if it is one.
    pub fn frame(&self) -> Option<&ReceivedFrame> {
        match self {
            Self::Frame(frame) => Some(frame),
            Self::TransmitReport(_) => None,
        }
    }
}

/// An item that arrived, borrowed from the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReceivedView<'a> {
    /// A CAN frame from the bus.
    Frame {
        /// Slave index.
        slave: usize,
        /// The packet; its `id_aux` is the [`ReceiveSource`].
        packet: FramePacket<'a>,
    },
    /// The result of a sent frame.
    TransmitReport(TransmitReport),
}

impl fmt::Display for ReceivedFrame {
    /// As `candump`: address, CAN ID, length and data.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_frame(f, self.slave, self.channel, self.frame.as_ref())
    }
}

impl fmt::Display for TransmitReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "slave {} channel {}: transmit result {}", self.slave, self.channel, self.code)?;
        self.ticket.map_or(Ok(()), |ticket| {
            write!(f, " (image {} frame {})", ticket.sequence, ticket.index)
        })
    }
}

impl fmt::Display for Received {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Frame(frame) => frame.fmt(f),
            Self::TransmitReport(report) => report.fmt(f),
        }
    }
}

impl fmt::Display for ReceivedView<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Frame { slave, packet } => write_frame(f, *slave, packet.channel, packet.frame),
            Self::TransmitReport(report) => report.fmt(f),
        }
    }
}

fn write_frame(
    f: &mut fmt::Formatter<'_>,
    slave: usize,
    channel: u8,
    frame: FrameRef<'_>,
) -> fmt::Result {
    let digits = if frame.id().is_extended() { 8 } else { 3 };
    let id = frame.id().raw();
    write!(f, "slave {slave} channel {channel}: {id:0digits$X} [{}]", frame.len())?;
    if frame.is_remote() {
        return f.write_str(" remote request");
    }
    frame.data().iter().try_for_each(|byte| write!(f, " {byte:02X}"))
}

impl ReceivedView<'_> {
    /// A copy that owns its data.
    #[inline]
    pub fn to_owned(&self) -> Received {
        match self {
            Self::Frame { slave, packet } => Received::Frame(ReceivedFrame {
                slave: *slave,
                channel: packet.channel,
                frame: packet.frame.to_owned(),
                timestamp: packet.timestamp,
                source: ReceiveSource::from_raw(packet.id_aux),
            }),
            Self::TransmitReport(report) => Received::TransmitReport(*report),
        }
    }
}

/// The frames and transmit results of a cycle, from [`Cycle::received`](crate::Cycle::received).
#[derive(Debug)]
pub struct ReceivedItems<'c> {
    adapter: &'c Adapter,
    gateways: Enumerate<IterMut<'c, Gateway>>,
    current: Option<OpenImage<'c>>,
}

/// An image whose packets are being handed out.
#[derive(Debug)]
struct OpenImage<'c> {
    slave: usize,
    gateway: &'c mut Gateway,
    packets: Packets<'c>,
}

impl<'c> ReceivedItems<'c> {
    #[inline]
    pub(crate) fn new(adapter: &'c Adapter, gateways: &'c mut [Gateway]) -> Self {
        Self { adapter, gateways: gateways.iter_mut().enumerate(), current: None }
    }

    #[inline]
    fn next_image(&mut self) -> Option<OpenImage<'c>> {
        let adapter = self.adapter;
        self.gateways.find_map(|(slave, gateway)| {
            let packets = gateway.receiver.resume(adapter.tx_pdo(slave))?;
            Some(OpenImage { slave, gateway, packets })
        })
    }
}

impl<'c> OpenImage<'c> {
    #[inline(always)]
    fn next(&mut self) -> Option<ReceivedView<'c>> {
        loop {
            match self.packets.next()? {
                Ok(Packet::Frame(packet)) => {
                    self.gateway.statistics.channel(packet.channel).frames_received += 1;
                    return Some(ReceivedView::Frame { slave: self.slave, packet });
                }
                Ok(Packet::TxResult(result)) => {
                    let sent = self.gateway.take_result(&result);
                    if sent.is_none_or(|frame| !frame.is_queued) {
                        let report = TransmitReport::new(self.slave, &result, sent);
                        return Some(ReceivedView::TransmitReport(report));
                    }
                }
                Err(diagnosis) => {
                    self.gateway.receiver.fault(diagnosis, &mut self.gateway.statistics);
                    return None;
                }
            }
        }
    }
}

impl Gateway {
    /// Counts the frames and transmit results that nobody took out of the image of this cycle:
    /// whoever sent the frames can find by the counters that results are missing.
    #[inline]
    pub(crate) fn close_image(&mut self, adapter: &Adapter, slave: usize) {
        if self.receiver.pending.is_some() {
            self.count_items(adapter, slave);
        }
    }

    #[cold]
    fn count_items(&mut self, adapter: &Adapter, slave: usize) {
        let Some(packets) = self.receiver.resume(adapter.tx_pdo(slave)) else { return };
        for packet in packets {
            match packet {
                Ok(Packet::TxResult(result)) => {
                    self.take_result(&result);
                }
                Ok(Packet::Frame(packet)) => {
                    self.statistics.channel(packet.channel).frames_not_taken += 1;
                }
                Err(diagnosis) => {
                    self.receiver.fault(diagnosis, &mut self.statistics);
                    break;
                }
            }
        }
    }

    /// Assigns a transmit result to its frame, and counts it.
    fn take_result(&mut self, result: &TxResult) -> Option<OpenFrame> {
        let Self { transmitter, statistics, .. } = self;
        let send = transmitter.take_result(result, statistics);
        if send.is_none() {
            statistics.unmatched_results += 1;
        } else if result.code.is_success() {
            statistics.channel(result.channel).results_ok += 1;
        } else {
            statistics.channel(result.channel).results_failed += 1;
        }
        send
    }
}

impl<'c> Iterator for ReceivedItems<'c> {
    type Item = ReceivedView<'c>;

    // Always inlined, as the frame otherwise passes through memory twice.
    #[inline(always)]
    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(image) = &mut self.current {
                if let Some(item) = image.next() {
                    return Some(item);
                }
                self.current = None;
            }
            self.current = Some(self.next_image()?);
        }
    }
}

impl FusedIterator for ReceivedItems<'_> {}

impl Drop for ReceivedItems<'_> {
    #[inline]
    fn drop(&mut self) {
        if let Some(OpenImage { gateway, packets, .. }) = &mut self.current {
            gateway.receiver.pending = Some(packets.cursor());
        }
    }
}
