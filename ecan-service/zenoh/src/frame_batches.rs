//! Frames that wait for their publication, by channel.

use std::collections::BTreeMap;

use ecan_service::client::FrameReport;

use crate::frame_account::BatchHead;

/// Bytes of a payload at which it is published at once.
const FULL_BYTES: usize = 32 << 10;

/// Gateway and channel.
pub(crate) type Address = (u16, u8);

/// A publication of frames: its channel, its attachment and its records.
pub(crate) type Batch = (Address, BatchHead, Vec<u8>);

/// Batches of one epoch, and their counters.
#[derive(Debug, Default)]
pub(crate) struct FrameBatches {
    epoch: u64,
    connections: u64,
    lost: u64,
    channels: BTreeMap<Address, Channel>,
}

#[derive(Debug, Default)]
struct Channel {
    /// Frames in published batches.
    published: u64,
    /// Frames in `records`.
    waiting: u64,
    records: Vec<u8>,
}

impl FrameBatches {
    pub(crate) fn new(epoch: u64) -> Self {
        Self { epoch, ..Self::default() }
    }

    pub(crate) fn epoch(&self) -> u64 {
        self.epoch
    }

    /// Counts a connection to the service.
    pub(crate) fn begin_connection(&mut self) {
        self.connections += 1;
    }

    /// Adds a frame; returns whether its batch is full.
    pub(crate) fn push(&mut self, report: &FrameReport) -> bool {
        let channel = self.channels.entry((report.gateway, report.channel)).or_default();
        report.encode(&mut channel.records);
        channel.waiting += 1;
        channel.records.len() >= FULL_BYTES
    }

    /// Counts frames that never arrived here.
    pub(crate) fn lose(&mut self, frames: u64) {
        self.lost += frames;
    }

    /// Takes the frames that wait; they count as published.
    pub(crate) fn take(&mut self) -> Vec<Batch> {
        let mut batches = Vec::new();
        for (address, channel) in &mut self.channels {
            if channel.waiting > 0 {
                let Self { epoch, connections, lost, .. } = *self;
                let frames = channel.published;
                let records = std::mem::take(&mut channel.records);
                batches.push((*address, BatchHead { epoch, connections, frames, lost }, records));
                channel.published += std::mem::take(&mut channel.waiting);
            }
        }
        batches
    }

    /// Counters after the last publication of a channel.
    pub(crate) fn head(&self, address: Address) -> BatchHead {
        let frames = self.channels.get(&address).map_or(0, |channel| channel.published);
        let Self { epoch, connections, lost, .. } = *self;
        BatchHead { epoch, connections, frames, lost }
    }
}

#[cfg(test)]
mod tests {
    use ecan_protocol::can::{CanFrame, CanId};
    use ecan_service::client::{FrameEvent, FrameRecord, FrameRecords};

    use super::*;

    fn report(gateway: u16, channel: u8) -> FrameReport {
        let frame = CanFrame::classic(CanId::standard(1).unwrap(), &[1, 2, 3]).unwrap();
        FrameReport { time_ns: 1, gateway, channel, tag: 0, event: FrameEvent::Received, frame }
    }

    fn records(payload: &[u8]) -> Vec<FrameRecord> {
        FrameRecords::new(payload).collect::<Result<_, _>>().unwrap()
    }

    #[test]
    fn batches_are_per_channel_and_counted() {
        let mut batches = FrameBatches::new(9);
        batches.begin_connection();
        let frames = [report(0, 1), report(1, 1), report(0, 1)];
        frames.iter().for_each(|report| assert!(!batches.push(report)));
        assert_eq!(batches.head((0, 1)).frames, 0, "waiting frames are not published");
        let taken = batches.take();
        let [(first, head, payload), (second, ..)] = &taken[..] else { panic!("{taken:?}") };
        assert_eq!((first, second), (&(0, 1), &(1, 1)));
        assert_eq!(*head, BatchHead { epoch: 9, connections: 1, frames: 0, lost: 0 });
        assert_eq!(records(payload), [FrameRecord::Frame(report(0, 1)); 2]);
        batches.lose(5);
        assert!(batches.take().is_empty());
        assert_eq!(batches.epoch(), 9);
        batches.push(&report(0, 1));
        assert_eq!(batches.take()[0].1, BatchHead { epoch: 9, connections: 1, frames: 2, lost: 5 });
        assert_eq!(
            batches.head((0, 1)),
            BatchHead { epoch: 9, connections: 1, frames: 3, lost: 5 }
        );
        assert_eq!(
            batches.head((3, 3)),
            BatchHead { epoch: 9, connections: 1, frames: 0, lost: 5 }
        );
    }

    #[test]
    fn full_batch_is_reported() {
        let mut batches = FrameBatches::new(0);
        let mut frames = 1;
        while !batches.push(&report(0, 0)) {
            frames += 1;
        }
        let taken = batches.take();
        assert!(taken[0].2.len() < FULL_BYTES + 100);
        assert_eq!(batches.head((0, 0)).frames, frames);
    }
}
