//! Account of a subscriber.

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
}
