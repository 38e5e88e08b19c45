//! Copies of the images of all cycles for another thread.

use std::fmt;

use ecan_protocol::image::{Header, PdoProfile};
use ecan_protocol::mapping::{CHANNELS, CHUNK_BYTES, HEADER_BYTES, MAX_MULTIPLIER};

use crate::word_ring::{RingReader, RingWriter, ring};

/// Words of a record before the image: kind and address, cycle, time, lost records, profile, and the
/// frames taken from the queues.
const HEAD_WORDS: usize = 5 + CHANNELS;
const MAX_IMAGE_BYTES: usize = MAX_MULTIPLIER as usize * CHUNK_BYTES;
const RECORD_WORDS: usize = HEAD_WORDS + MAX_IMAGE_BYTES / 8;

const RECEIVED: u8 = 0;
const PUBLISHED: u8 = 1;
const REJECTED: u8 = 2;

/// Images of all gateways in the order of the cycles, for one other thread:
/// [`Port::image_stream`](crate::Port::image_stream).
///
/// The cycle copies each image that it receives or publishes for the first time into a bounded ring. If
/// the ring is full it drops the record and counts it, and waits for nobody.
pub struct ImageStream {
    reader: RingReader,
    record: Box<[u64; RECORD_WORDS]>,
    image: Box<[u8; MAX_IMAGE_BYTES]>,
    lost: u64,
}

impl fmt::Debug for ImageStream {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ImageStream").field("lost", &self.lost).finish_non_exhaustive()
    }
}

/// One event of an [`ImageStream`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageRecord<'a> {
    /// Number of the cycle, from 1.
    pub cycle: u64,
    /// Time of the cycle, on the Adapter's clock, in nanoseconds: its deadline if the application waits
    /// for the cycle with the SDK.
    pub time_ns: u64,
    /// Records directly before this one that found the ring full.
    pub lost_before: u32,
    /// Packets of the images of these records: frames, and transmit results of TxPDO images.
    pub lost_packets: u32,
    /// The event.
    pub event: ImageEvent<'a>,
}

/// Content of an [`ImageRecord`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ImageEvent<'a> {
    /// A new TxPDO image of a ready gateway, checked by the Port.
    Received {
        /// Slave index.
        slave: usize,
        /// Profile of the image.
        profile: PdoProfile,
        /// The image; zeros after its payload.
        image: &'a [u8],
    },
    /// A new RxPDO image. Repetitions of an unconfirmed image are not recorded.
    Published {
        /// Slave index.
        slave: usize,
        /// Profile of the image.
        profile: PdoProfile,
        /// The image; zeros after its payload.
        image: &'a [u8],
        /// Packets of each channel that came from the [`TransmitQueues`](crate::TransmitQueues).
        queued: QueuedFrames,
    },
    /// Frames in a row that the cycle took from a queue and did not send, since they expired, the gateway
    /// is not ready, or the channel was reconfigured.
    Rejected {
        /// Slave index.
        slave: usize,
        /// Channel of the gateway, 0 to 3.
        channel: u8,
        /// Number of frames.
        frames: u32,
        /// Frames that the cycle took from the queue since the start, up to the last of these.
        taken: u64,
        /// The frames expired in the queue; otherwise the gateway or the channel did not accept them.
        is_expired: bool,
    },
}

/// Frames of each channel that the cycle took from [`TransmitQueues`](crate::TransmitQueues).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct QueuedFrames {
    /// Frames in this image: the last packets of the channel, in the order of the queue.
    pub sent: [u8; CHANNELS],
    /// Frames since the start, these included, whether they were sent or rejected.
    pub taken: [u64; CHANNELS],
}

/// The two ends of a ring of at least `capacity_bytes`.
pub(crate) fn image_stream(capacity_bytes: usize) -> (ImageRecorder, ImageStream) {
    let (writer, reader) = ring(capacity_bytes.div_ceil(8).max(2 * (RECORD_WORDS + 1)));
    let stream = ImageStream {
        reader,
        record: Box::new([0; RECORD_WORDS]),
        image: Box::new([0; MAX_IMAGE_BYTES]),
        lost: 0,
    };
    (ImageRecorder { writer, lost: 0, lost_packets: 0 }, stream)
}

impl ImageStream {
    /// Takes the next record; `None` if the cycle has written no other. Takes neither lock nor memory.
    // Not an iterator: a record borrows the stream.
    #[allow(clippy::should_implement_trait)]
    pub fn next(&mut self) -> Option<ImageRecord<'_>> {
        let words = self.reader.peek(&mut self.record[..]);
        self.reader.remove();
        let (head, image) = self.record.get(..words)?.split_first_chunk::<HEAD_WORDS>()?;
        let [address, cycle, time_ns, lost, profile, taken @ ..] = *head;
        let (lost_before, lost_packets) = (lost as u32, (lost >> 32) as u32);
        let [kind, channel, slave, is_expired, frames @ ..] = address.to_le_bytes();
        let slave = usize::from(slave);
        self.lost += u64::from(lost_before);
        let event = match kind {
            REJECTED => {
                let (frames, [taken, ..]) = (u32::from_le_bytes(frames), taken);
                let is_expired = is_expired != 0;
                ImageEvent::Rejected { slave, channel, frames, taken, is_expired }
            }
            _ => {
                let profile = PdoProfile::from_word(profile as u32)?;
                let (to, rest) = self.image.split_at_mut_checked(image.len() * 8)?;
                for (to, word) in to.as_chunks_mut::<8>().0.iter_mut().zip(image) {
                    *to = word.to_le_bytes();
                }
                rest.fill(0);
                let image = self.image.get(..profile.pdo_bytes())?;
                match kind {
                    RECEIVED => ImageEvent::Received { slave, profile, image },
                    _ => {
                        let queued = QueuedFrames { sent: frames, taken };
                        ImageEvent::Published { slave, profile, image, queued }
                    }
                }
            }
        };
        Some(ImageRecord { cycle, time_ns, lost_before, lost_packets, event })
    }

    /// Pauses the stream or continues it: a paused one costs the cycle nothing, and its images are not
    /// lost records. Records that were written before stay.
    pub fn set_paused(&mut self, is_paused: bool) {
        self.reader.set_paused(is_paused);
    }

    /// Discards all records that were written so far, without counting them.
    pub fn clear(&mut self) {
        self.reader.clear();
    }

    /// Records that found the ring full, up to the last one that was taken.
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Returns whether there will be no further records, apart from those in the ring: the Port is gone,
    /// or has another stream.
    pub fn is_closed(&self) -> bool {
        self.reader.is_closed()
    }
}

/// The cycle's end of an [`ImageStream`].
#[derive(Debug)]
pub(crate) struct ImageRecorder {
    writer: RingWriter,
    /// Records lost since the last one that was written, and the packets of their images.
    lost: u32,
    lost_packets: u32,
}

/// Cycle number and time of a record.
pub(crate) type CycleStamp = (u64, u64);

impl ImageRecorder {
    pub(crate) fn record_received(
        &mut self,
        stamp: CycleStamp,
        slave: usize,
        profile: &PdoProfile,
        image: &[u8],
    ) {
        let address = [RECEIVED, 0, slave as u8, 0, 0, 0, 0, 0];
        self.write(stamp, address, profile.word(), [0; CHANNELS], used(image));
    }

    pub(crate) fn record_published(
        &mut self,
        stamp: CycleStamp,
        slave: usize,
        profile: &PdoProfile,
        image: &[u8],
        QueuedFrames { sent: [a, b, c, d], taken }: QueuedFrames,
    ) {
        let address = [PUBLISHED, 0, slave as u8, 0, a, b, c, d];
        self.write(stamp, address, profile.word(), taken, used(image));
    }

    pub(crate) fn record_rejected(
        &mut self,
        stamp: CycleStamp,
        slave: usize,
        RejectedFrames { channel, frames, taken, is_expired }: RejectedFrames,
    ) {
        let [a, b, c, d] = frames.to_le_bytes();
        let address = [REJECTED, channel, slave as u8, is_expired.into(), a, b, c, d];
        self.write(stamp, address, 0, [taken, 0, 0, 0], &[]);
    }

    fn write(
        &mut self,
        (cycle, time_ns): CycleStamp,
        address: [u8; 8],
        profile: u32,
        [a, b, c, d]: [u64; CHANNELS],
        image: &[u8],
    ) {
        if !self.writer.is_wanted() {
            return;
        }
        let (address, profile) = (u64::from_le_bytes(address), profile.into());
        let lost = u64::from(self.lost) | u64::from(self.lost_packets) << 32;
        let head = [address, cycle, time_ns, lost, profile, a, b, c, d];
        if self.writer.write(&head, image) {
            (self.lost, self.lost_packets) = (0, 0);
        } else {
            self.lost = self.lost.saturating_add(1);
            self.lost_packets = self.lost_packets.saturating_add(packets(image));
        }
    }
}

fn header(image: &[u8]) -> Option<Header> {
    image.first_chunk::<HEADER_BYTES>().map(Header::parse)
}

fn packets(image: &[u8]) -> u32 {
    header(image).map_or(0, |header| header.frame_count.into())
}

/// Header and payload of an image.
fn used(image: &[u8]) -> &[u8] {
    let payload = header(image).map_or(0, |header| usize::from(header.payload_len));
    image.get(..HEADER_BYTES + payload).unwrap_or(image)
}

/// Frames in a row that the cycle took from the queue of a channel and did not send.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RejectedFrames {
    pub(crate) channel: u8,
    pub(crate) frames: u32,
    /// Frames that were taken from the queue since the start, up to the last of these.
    pub(crate) taken: u64,
    /// The frames expired; otherwise the gateway is not ready, or the channel was reconfigured.
    pub(crate) is_expired: bool,
}
