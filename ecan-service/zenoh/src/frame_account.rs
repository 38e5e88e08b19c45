//! Account of a subscriber: what arrived, what was lost, and the echoes of own frames.

#[cfg(feature = "engine")]
use std::collections::{BTreeMap, VecDeque};
#[cfg(feature = "engine")]
use std::time::{Duration, Instant};

#[cfg(feature = "engine")]
use ecan_protocol::can::CanFrame;
#[cfg(feature = "engine")]
use ecan_service::client::{FrameEvent, FrameReport, TransmitRecord};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Account of the frames of one key: what arrived and what was lost.
///
/// After each sample `received() + lost_on_network()` is the number of frames that the publisher
/// published since the first sample. A `get` of the key returns the present counters without frames:
/// after it the account includes a loss at the end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FrameAccount {
    current: Option<Epoch>,
    /// Sums of earlier epochs.
    received: u64,
    lost_on_network: u64,
    lost_in_service: u64,
    reconnections: u64,
    restarts: u64,
}

/// Counters since the start of one epoch of the publisher.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Epoch {
    epoch: u64,
    /// Counters before the first sample.
    first: BatchHead,
    /// Highest counters.
    frames: u64,
    lost: u64,
    connections: u64,
    received: u64,
}

impl Epoch {
    fn lost_on_network(&self) -> u64 {
        (self.frames - self.first.frames).saturating_sub(self.received)
    }
}

impl FrameAccount {
    /// Takes a sample: its head and the number of its frame records.
    pub fn take(&mut self, head: BatchHead, frames: u64) {
        match &self.current {
            None => self.begin(head, head),
            Some(epoch) if epoch.epoch == head.epoch => {}
            // It started without frames, after the samples of the former one.
            Some(_) => {
                self.end_epoch();
                let first = BatchHead { epoch: head.epoch, connections: 1, frames: 0, lost: 0 };
                self.begin(head, first);
            }
        }
        if let Some(epoch) = &mut self.current {
            epoch.received += frames;
            epoch.frames = epoch.frames.max(head.frames + frames);
            epoch.lost = epoch.lost.max(head.lost);
            epoch.connections = epoch.connections.max(head.connections);
        }
    }

    fn begin(&mut self, head: BatchHead, first: BatchHead) {
        let BatchHead { connections, frames, lost, .. } = first;
        let epoch = head.epoch;
        self.current = Some(Epoch { epoch, first, frames, lost, connections, received: 0 });
    }

    fn end_epoch(&mut self) {
        self.received = self.received();
        self.lost_on_network = self.lost_on_network();
        self.lost_in_service = self.lost_in_service();
        self.reconnections = self.reconnections();
        self.restarts += 1;
        self.current = None;
    }

    /// Frames that arrived.
    pub fn received(&self) -> u64 {
        self.received + self.current.map_or(0, |epoch| epoch.received)
    }

    /// Frames that were published and did not arrive: lost by Zenoh or by the network.
    pub fn lost_on_network(&self) -> u64 {
        self.lost_on_network + self.current.map_or(0, |epoch| epoch.lost_on_network())
    }

    /// Frames of all channels that the publisher itself lost.
    pub fn lost_in_service(&self) -> u64 {
        self.lost_in_service + self.current.map_or(0, |epoch| epoch.lost - epoch.first.lost)
    }

    /// Number of times that the publisher connected to the service again. Frames of the bus between
    /// its connections are not counted as lost.
    pub fn reconnections(&self) -> u64 {
        let of_epoch = |epoch: Epoch| epoch.connections - epoch.first.connections;
        self.reconnections + self.current.map_or(0, of_epoch)
    }

    /// Number of times that the publisher was started again. Frames of the bus while it was away, and
    /// a loss at its end, are not counted. A number that grows with each sample means that two
    /// publishers use the key.
    pub fn restarts(&self) -> u64 {
        self.restarts
    }
}

/// Bytes of the head.
pub const BATCH_HEAD_BYTES: usize = 32;

/// Counters of a publication: four little-endian numbers of 64 bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BatchHead {
    /// Start of the publisher, in nanoseconds since 1970. The counters start at 0 with each epoch.
    pub epoch: u64,
    /// Connections of the publisher to the service in this epoch, this one included. Frames of the
    /// bus between two connections are not counted.
    pub connections: u64,
    /// Frames of this key that were published before this payload.
    pub frames: u64,
    /// Frames of all keys that the publisher lost: records of kind 3 of the service, and losses in
    /// the publisher.
    pub lost: u64,
}

/// The attachment is not a head.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("attachment of frames has {0} bytes; allowed: {BATCH_HEAD_BYTES}")]
pub struct HeadError(pub usize);

impl BatchHead {
    /// Bytes of the attachment.
    pub fn encode(&self) -> Vec<u8> {
        [self.epoch, self.connections, self.frames, self.lost]
            .iter()
            .flat_map(|number| number.to_le_bytes())
            .collect()
    }

    /// Reads an attachment.
    ///
    /// # Errors
    /// Another length.
    pub fn decode(bytes: &[u8]) -> Result<Self, HeadError> {
        let (numbers, []) = bytes.as_chunks::<8>() else { return Err(HeadError(bytes.len())) };
        match numbers.iter().map(|bytes| u64::from_le_bytes(*bytes)).collect::<Vec<_>>()[..] {
            [epoch, connections, frames, lost] => Ok(Self { epoch, connections, frames, lost }),
            _ => Err(HeadError(bytes.len())),
        }
    }
}

/// Answer of a publisher to `frames.subscribe` and `frames.renew`: the counters of the subscription.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SubscriptionInfo {
    /// Time within which the subscription must be renewed, in milliseconds.
    pub lease_ms: u64,
    /// As in [`BatchHead::epoch`].
    pub epoch: u64,
    /// As in [`BatchHead::connections`].
    pub connections: u64,
    /// As in [`BatchHead::lost`].
    pub lost: u64,
    /// Gateway, channel and published frames; none of a channel without frames.
    pub published: Vec<(u16, u8, u64)>,
}

#[cfg(feature = "engine")]
impl SubscriptionInfo {
    pub(crate) fn new(head: BatchHead, published: Vec<(u16, u8, u64)>, lease: Duration) -> Self {
        let BatchHead { epoch, connections, lost, .. } = head;
        Self { lease_ms: lease.as_millis() as u64, epoch, connections, lost, published }
    }

    /// Counters of a channel with this number of published frames.
    pub(crate) fn head(&self, frames: u64) -> BatchHead {
        BatchHead { epoch: self.epoch, connections: self.connections, frames, lost: self.lost }
    }
}

/// Accounts of the channels of a subscription.
#[cfg(feature = "engine")]
#[derive(Debug, Default)]
pub(crate) struct Accounts {
    channels: BTreeMap<(u16, u8), FrameAccount>,
    /// Answer of the publisher before the last one: all that it had published then has arrived or is lost.
    before: Option<SubscriptionInfo>,
    reported: u64,
}

#[cfg(feature = "engine")]
impl Accounts {
    /// Takes a publication of a channel; returns the frames whose loss is new.
    pub(crate) fn take(&mut self, address: (u16, u8), head: BatchHead, frames: u64) -> u64 {
        let account = self.channels.entry(address).or_insert_with(|| {
            // The subscription began without frames.
            let mut account = FrameAccount::default();
            account.take(BatchHead { frames: 0, ..head }, 0);
            account
        });
        account.take(head, frames);
        self.take_lost()
    }

    /// Takes what the publisher has published; returns the frames whose loss is new.
    pub(crate) fn take_published(&mut self, info: SubscriptionInfo) -> u64 {
        let Some(before) = self.before.replace(info) else { return 0 };
        let lost = before.published.iter().map(|(gateway, channel, frames)| {
            self.take((*gateway, *channel), before.head(*frames), 0)
        });
        lost.sum()
    }

    fn take_lost(&mut self) -> u64 {
        let on_network = self.channels.values().map(FrameAccount::lost_on_network).sum::<u64>();
        // Each channel has the number of all.
        let in_service = self.channels.values().map(FrameAccount::lost_in_service).max();
        let lost = on_network + in_service.unwrap_or_default();
        let new = lost.saturating_sub(self.reported);
        self.reported += new;
        new
    }
}

/// Time after which an echo is not expected any more.
#[cfg(feature = "engine")]
const ECHO: Duration = Duration::from_secs(30);
/// Echoes that are expected at once.
#[cfg(feature = "engine")]
const MAX_ECHOES: usize = 4096;

/// Own frames whose event is expected in a subscription. The client has it as the result of its frame: the
/// service reports an own frame once.
#[cfg(feature = "engine")]
#[derive(Debug, Default)]
pub(crate) struct OwnFrames {
    expected: VecDeque<(Instant, u16, u8, CanFrame)>,
}

#[cfg(feature = "engine")]
impl OwnFrames {
    pub(crate) fn expect(&mut self, records: &[TransmitRecord]) {
        let now = Instant::now();
        self.expected.retain(|(sent, ..)| now.duration_since(*sent) < ECHO);
        for TransmitRecord { gateway, channel, frame, .. } in records {
            self.expected.push_back((now, *gateway, *channel, *frame));
        }
        let surplus = self.expected.len().saturating_sub(MAX_ECHOES);
        self.expected.drain(..surplus);
    }

    /// Forgets frames that were not sent.
    pub(crate) fn withdraw<'a>(&mut self, reports: impl Iterator<Item = &'a FrameReport>) {
        for report in reports {
            self.take(report);
        }
    }

    /// Returns whether a report is the echo of an own frame.
    pub(crate) fn take_echo(&mut self, report: &FrameReport) -> bool {
        report.event != FrameEvent::Received && self.take(report)
    }

    fn take(&mut self, report: &FrameReport) -> bool {
        let is_same = |(_, gateway, channel, frame): &(Instant, u16, u8, CanFrame)| {
            (*gateway, *channel, *frame) == (report.gateway, report.channel, report.frame)
        };
        let found = self.expected.iter().position(is_same);
        found.is_some_and(|at| self.expected.remove(at).is_some())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn counts(account: &FrameAccount) -> (u64, u64, u64, u64) {
        let (received, lost) = (account.received(), account.lost_on_network());
        (received, lost, account.lost_in_service(), account.restarts())
    }

    fn head(epoch: u64, frames: u64, lost: u64) -> BatchHead {
        BatchHead { epoch, connections: 1, frames, lost }
    }

    #[test]
    fn counters_continue_over_a_new_connection() {
        let mut account = FrameAccount::default();
        account.take(BatchHead { connections: 2, ..head(5, 1000, 0) }, 10);
        account.take(BatchHead { connections: 4, ..head(5, 1030, 0) }, 10);
        assert_eq!((counts(&account), account.reconnections()), ((20, 20, 0, 0), 2));
        account.take(BatchHead { connections: 2, ..head(6, 4, 0) }, 1);
        assert_eq!((counts(&account), account.reconnections()), ((21, 24, 0, 1), 3));
    }

    #[test]
    fn new_epoch_counts_from_its_start() {
        let mut account = FrameAccount::default();
        account.take(head(5, 1000, 7), 10);
        assert_eq!(counts(&account), (10, 0, 0, 0));
        account.take(head(5, 1020, 9), 5);
        assert_eq!(counts(&account), (15, 10, 2, 0));
        account.take(head(6, 3, 1), 2);
        assert_eq!(counts(&account), (17, 13, 3, 1));
    }

    proptest! {
        #[test]
        fn received_and_lost_are_all_published(
            batches in prop::collection::vec((1u64..50, any::<bool>(), 0u64..3), 1..100),
            swaps in prop::collection::vec(0usize..100, 0..5),
        ) {
            let (mut frames, mut lost, mut arrived) = (17, 4, Vec::new());
            for (count, is_lost, lost_before) in &batches {
                lost += lost_before;
                if !is_lost {
                    arrived.push((head(1, frames, lost), *count));
                }
                frames += count;
            }
            // Order does not matter after the first sample.
            for at in swaps {
                if at > 0 && at + 1 < arrived.len() {
                    arrived.swap(at, at + 1);
                }
            }
            let mut account = FrameAccount::default();
            let mut received = 0;
            for (head, count) in &arrived {
                account.take(*head, *count);
                received += count;
            }
            // The reply of a `get`.
            account.take(head(1, frames, lost), 0);
            let first = arrived.first().map_or(head(1, frames, lost), |first| first.0);
            let all = frames - first.frames;
            prop_assert_eq!(counts(&account), (received, all - received, lost - first.lost, 0));
        }
    }

    #[test]
    fn head_is_four_little_endian_numbers() {
        let head = BatchHead { epoch: 1, connections: 5, frames: 0x0203, lost: 4 };
        let bytes = head.encode();
        let starts = [(0, 1), (8, 5), (16, 3), (17, 2), (24, 4)];
        let expected =
            |at| starts.iter().find(|(start, _)| *start == at).map_or(0, |found| found.1);
        assert_eq!(bytes, (0..32).map(expected).collect::<Vec<_>>());
        assert_eq!(BatchHead::decode(&bytes), Ok(head));
        for length in [0, 8, 24, 31, 33, 40] {
            assert_eq!(BatchHead::decode(&vec![0; length]), Err(HeadError(length)));
        }
    }

    #[cfg(feature = "engine")]
    #[test]
    fn each_loss_is_returned_once() {
        let mut accounts = Accounts::default();
        assert_eq!(accounts.take((0, 0), head(1, 5, 0), 3), 5, "before the first arrival");
        assert_eq!(accounts.take((0, 0), head(1, 8, 0), 1), 0);
        assert_eq!(accounts.take((0, 1), head(1, 0, 0), 2), 0);
        assert_eq!(accounts.take((0, 0), head(1, 9, 4), 1), 4, "in the service");
        assert_eq!(accounts.take((0, 1), head(1, 2, 4), 1), 0, "the same ones");
        assert_eq!(accounts.take((0, 1), head(1, 5, 4), 1), 2);
    }

    #[cfg(feature = "engine")]
    #[test]
    fn loss_at_the_end_is_known_with_the_second_answer() {
        let info = |published| SubscriptionInfo {
            lease_ms: 1,
            epoch: 1,
            connections: 1,
            lost: 0,
            published,
        };
        let mut accounts = Accounts::default();
        accounts.take((0, 0), head(1, 0, 0), 2);
        assert_eq!(accounts.take_published(info(vec![(0, 0, 7), (0, 3, 1)])), 0, "on their way");
        assert_eq!(accounts.take((0, 0), head(1, 2, 0), 4), 0);
        assert_eq!(accounts.take_published(info(vec![(0, 0, 7)])), 2);
    }

    #[cfg(feature = "engine")]
    #[test]
    fn echo_of_an_own_frame_is_taken_once() {
        let frame =
            CanFrame::classic(ecan_protocol::can::CanId::standard(1).unwrap(), &[7]).unwrap();
        let record = |channel| TransmitRecord { gateway: 0, channel, tag: 1, max_age_ms: 0, frame };
        let report =
            |channel, event| FrameReport { time_ns: 1, gateway: 0, channel, tag: 0, event, frame };
        let mut own = OwnFrames::default();
        own.expect(&[record(0), record(1), record(0)]);
        assert!(!own.take_echo(&report(0, FrameEvent::Received)));
        assert!(own.take_echo(&report(0, FrameEvent::Transmitted)));
        own.withdraw([report(0, FrameEvent::Unknown)].iter());
        assert!(!own.take_echo(&report(0, FrameEvent::Transmitted)));
        assert!(own.take_echo(&report(1, FrameEvent::Published)));
    }
}
