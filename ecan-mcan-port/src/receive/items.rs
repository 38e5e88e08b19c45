//! Iterator over the items that arrived in a cycle.

use std::iter::{Enumerate, FusedIterator};
use std::slice::IterMut;

use ecan_host::Adapter;
use ecan_protocol::image::{Packet, Packets, TxResult};

use crate::gateway::Gateway;
use crate::receive::received::{ReceivedView, TransmitReport};
use crate::transmit::history::OpenFrame;

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
