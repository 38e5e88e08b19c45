//! Frames that wait for their publication: of a channel, and of a channel in a subscription.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use ecan_service::client::{BUSY, FrameReport, NOT_AVAILABLE, RpcError, Subscription};

use crate::frame_account::BatchHead;

/// Bytes of a payload at which it is published at once.
const FULL_BYTES: usize = 32 << 10;
/// Subscriptions of all clients.
const MAX_SUBSCRIPTIONS: usize = 64;
/// Time after which a subscription ends unless it is renewed.
pub(crate) const LEASE: Duration = Duration::from_secs(10);

/// What a publication belongs to.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Stream {
    /// Name of the subscription; `None` for all frames of the channel.
    pub(crate) subscription: Option<String>,
    pub(crate) gateway: u16,
    pub(crate) channel: u8,
}

/// A publication of frames: its stream, its attachment and its records.
pub(crate) type Batch = (Stream, BatchHead, Vec<u8>);

/// Batches of one epoch, and their counters.
#[derive(Debug, Default)]
pub(crate) struct FrameBatches {
    epoch: u64,
    connections: u64,
    lost: u64,
    streams: BTreeMap<Stream, Waiting>,
    subscriptions: BTreeMap<String, Leased>,
}

#[derive(Debug, Default)]
struct Waiting {
    /// Frames in published batches.
    published: u64,
    /// Frames in `records`.
    waiting: u64,
    records: Vec<u8>,
}

/// A subscription of a remote client.
#[derive(Debug)]
struct Leased {
    client: String,
    selection: Subscription,
    end: Instant,
}

impl FrameBatches {
    pub(crate) fn new(epoch: u64) -> Self {
        Self { epoch, ..Self::default() }
    }

    pub(crate) fn epoch(&self) -> u64 {
        self.epoch
    }

    /// Counts a connection to the service. Subscriptions belong to the former one.
    pub(crate) fn begin_connection(&mut self) {
        self.connections += 1;
        self.subscriptions.clear();
        self.streams.retain(|stream, _| stream.subscription.is_none());
    }

    /// Begins a subscription, or replaces the one with its name. Its frames count from 0.
    pub(crate) fn subscribe(
        &mut self,
        (client, name): (&str, &str),
        selection: Subscription,
        now: Instant,
    ) -> Result<BatchHead, RpcError> {
        self.end_expired(now);
        self.unsubscribe(name);
        if self.subscriptions.len() == MAX_SUBSCRIPTIONS {
            let text = format!(
                "the publisher has {MAX_SUBSCRIPTIONS} subscriptions, which is all that it serves; \
                 nothing was done"
            );
            return Err(RpcError::new(BUSY, text));
        }
        let leased = Leased { client: client.to_owned(), selection, end: now + LEASE };
        self.subscriptions.insert(name.to_owned(), leased);
        Ok(self.head_of(0))
    }

    /// Extends a subscription by another lease.
    pub(crate) fn renew(&mut self, name: &str, now: Instant) -> Result<BatchHead, RpcError> {
        self.end_expired(now);
        let leased = self.subscriptions.get_mut(name).ok_or_else(|| {
            let text = format!(
                "subscription {name} does not exist any more: it was not renewed for {} s, or the \
                 publisher has connected again; subscribe again",
                LEASE.as_secs()
            );
            RpcError::new(NOT_AVAILABLE, text)
        })?;
        leased.end = now + LEASE;
        Ok(self.head_of(0))
    }

    /// Gateway, channel and published frames of each stream of a subscription.
    #[cfg(feature = "engine")]
    pub(crate) fn published(&self, name: &str) -> Vec<(u16, u8, u64)> {
        let of_name =
            |(stream, _): &(&Stream, &Waiting)| stream.subscription.as_deref() == Some(name);
        let counts = self.streams.iter().filter(of_name);
        counts
            .map(|(stream, waiting)| (stream.gateway, stream.channel, waiting.published))
            .collect()
    }

    pub(crate) fn unsubscribe(&mut self, name: &str) {
        self.subscriptions.remove(name);
        self.streams.retain(|stream, _| stream.subscription.as_deref() != Some(name));
    }

    /// Ends what was not renewed.
    pub(crate) fn end_expired(&mut self, now: Instant) {
        let expired = self.subscriptions.iter().filter(|(_, leased)| leased.end <= now);
        let expired: Vec<_> = expired.map(|(name, _)| name.clone()).collect();
        expired.iter().for_each(|name| self.unsubscribe(name));
    }

    /// Published frames of all channels, lost frames and connections.
    #[cfg(feature = "engine")]
    pub(crate) fn totals(&self) -> (u64, u64, u64) {
        let all = self.streams.iter().filter(|(stream, _)| stream.subscription.is_none());
        (all.map(|(_, waiting)| waiting.published).sum(), self.lost, self.connections)
    }

    /// Number of subscriptions of a client.
    pub(crate) fn subscriptions_of(&self, client: &str) -> usize {
        self.subscriptions.values().filter(|leased| leased.client == client).count()
    }

    /// Adds a frame to its channel and to the subscriptions that select it; returns whether a batch is
    /// full.
    pub(crate) fn push(&mut self, report: &FrameReport) -> bool {
        let FrameReport { gateway, channel, event, ref frame, .. } = *report;
        let selecting = self
            .subscriptions
            .iter()
            .filter(|(_, leased)| leased.selection.selects(gateway, channel, event, frame));
        let names = selecting.map(|(name, _)| Some(name.clone()));
        let mut is_full = false;
        for subscription in names.chain([None]) {
            let stream = Stream { subscription, gateway, channel };
            let waiting = self.streams.entry(stream).or_default();
            report.encode(&mut waiting.records);
            waiting.waiting += 1;
            is_full |= waiting.records.len() >= FULL_BYTES;
        }
        is_full
    }

    /// Counts frames that never arrived here.
    pub(crate) fn lose(&mut self, frames: u64) {
        self.lost += frames;
    }

    /// Takes the frames that wait; they count as published.
    pub(crate) fn take(&mut self) -> Vec<Batch> {
        let Self { epoch, connections, lost, .. } = *self;
        let mut batches = Vec::new();
        for (stream, waiting) in &mut self.streams {
            if waiting.waiting > 0 {
                let frames = waiting.published;
                let records = std::mem::take(&mut waiting.records);
                let head = BatchHead { epoch, connections, frames, lost };
                batches.push((stream.clone(), head, records));
                waiting.published += std::mem::take(&mut waiting.waiting);
            }
        }
        batches
    }

    /// Counters after the last publication of a stream.
    pub(crate) fn head(&self, stream: &Stream) -> BatchHead {
        self.head_of(self.streams.get(stream).map_or(0, |waiting| waiting.published))
    }

    fn head_of(&self, frames: u64) -> BatchHead {
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

    fn all_of(gateway: u16, channel: u8) -> Stream {
        Stream { subscription: None, gateway, channel }
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
        assert_eq!(batches.head(&all_of(0, 1)).frames, 0, "waiting frames are not published");
        let taken = batches.take();
        let [(first, head, payload), (second, ..)] = &taken[..] else { panic!("{taken:?}") };
        assert_eq!((first, second), (&all_of(0, 1), &all_of(1, 1)));
        assert_eq!(*head, BatchHead { epoch: 9, connections: 1, frames: 0, lost: 0 });
        assert_eq!(records(payload), [FrameRecord::Frame(report(0, 1)); 2]);
        batches.lose(5);
        assert!(batches.take().is_empty());
        assert_eq!(batches.epoch(), 9);
        batches.push(&report(0, 1));
        assert_eq!(batches.take()[0].1, BatchHead { epoch: 9, connections: 1, frames: 2, lost: 5 });
        assert_eq!(
            batches.head(&all_of(0, 1)),
            BatchHead { epoch: 9, connections: 1, frames: 3, lost: 5 }
        );
        assert_eq!(
            batches.head(&all_of(3, 3)),
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
        assert_eq!(batches.head(&all_of(0, 0)).frames, frames);
    }

    #[test]
    fn subscription_has_its_frames_and_its_own_counters_until_its_lease_ends() {
        let mut batches = FrameBatches::new(9);
        batches.push(&report(0, 1));
        batches.lose(2);
        let now = Instant::now();
        let selection = Subscription { channels: vec![1], ..Subscription::default() };
        let first = batches.subscribe(("hmi", "s"), selection, now).unwrap();
        assert_eq!(first, BatchHead { epoch: 9, connections: 0, frames: 0, lost: 2 });
        [(0, 1), (0, 2), (1, 1)].iter().for_each(|(gateway, channel)| {
            batches.push(&report(*gateway, *channel));
        });
        let of_subscription: Vec<_> = batches
            .take()
            .into_iter()
            .filter(|(stream, ..)| stream.subscription.is_some())
            .collect();
        let channels = of_subscription
            .iter()
            .map(|(stream, head, _)| (stream.gateway, stream.channel, head.frames));
        assert_eq!(channels.collect::<Vec<_>>(), [(0, 1, 0), (1, 1, 0)]);
        assert_eq!((batches.subscriptions_of("hmi"), batches.subscriptions_of("x")), (1, 0));
        batches.renew("s", now + LEASE / 2).unwrap();
        batches.renew("s", now + LEASE).unwrap();
        let error = batches.renew("s", now + LEASE * 2).unwrap_err();
        assert!(
            error.code == NOT_AVAILABLE && error.message.contains("subscribe again"),
            "{error}"
        );
        assert!(!batches.push(&report(0, 1)) && batches.take().len() == 1);
    }

    #[test]
    fn subscriptions_are_limited_and_end_with_the_connection() {
        let (mut batches, now) = (FrameBatches::new(9), Instant::now());
        let subscribe = |batches: &mut FrameBatches, number: usize| {
            batches.subscribe(("hmi", &number.to_string()), Subscription::default(), now)
        };
        for number in 0..MAX_SUBSCRIPTIONS {
            subscribe(&mut batches, number).unwrap();
        }
        assert_eq!(subscribe(&mut batches, MAX_SUBSCRIPTIONS).unwrap_err().code, BUSY);
        subscribe(&mut batches, 0).unwrap();
        batches.begin_connection();
        assert_eq!(batches.subscriptions_of("hmi"), 0);
        subscribe(&mut batches, MAX_SUBSCRIPTIONS).unwrap();
    }
}
