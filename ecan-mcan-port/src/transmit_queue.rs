//! Queues of frames that other threads give to the cycle.

use std::sync::Arc;
use std::sync::atomic::Ordering;
#[cfg(not(loom))]
use std::sync::atomic::{AtomicU32, AtomicU64};

use ecan_protocol::can::{CanFrame, CanId, Dlc, FrameKind, FrameRef};
use ecan_protocol::mapping::CHANNELS;
#[cfg(loom)]
use loom::sync::atomic::{AtomicU32, AtomicU64};
use thiserror::Error;

use crate::address::AddressError;
use crate::gateway::Gateway;
use crate::image_stream::{QueuedFrames, RejectedFrames};
use crate::word_ring::{RingReader, RingWriter, ring};

/// Words of a frame in a ring: its CAN ID, kind and DLC, its expiry, and the data.
const FRAME_WORDS: usize = 2 + 8;
/// Expiry of a frame that never expires.
const NEVER: u64 = u64::MAX;

/// Error of [`TransmitQueues::push`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum QueueError {
    /// The queue of the channel is full.
    #[error("transmit queue of slave {slave} channel {channel} is full; retry in a later cycle")]
    Full {
        /// Slave index.
        slave: usize,
        /// Channel of the gateway, 0 to 3.
        channel: u8,
    },
    /// No such channel, or it is not enabled.
    #[error(transparent)]
    Address(#[from] AddressError),
    /// A CAN FD frame for a classic channel.
    #[error(
        "slave {slave} channel {channel}: CAN FD frame on a classic channel; configure a data bit rate"
    )]
    NotFd {
        /// Slave index.
        slave: usize,
        /// Channel of the gateway, 0 to 3.
        channel: u8,
    },
    /// The channel only receives.
    #[error("slave {slave} channel {channel} only receives; enable it in the RxPDO")]
    ReceiveOnly {
        /// Slave index.
        slave: usize,
        /// Channel of the gateway, 0 to 3.
        channel: u8,
    },
    /// The Port is gone.
    #[error("the Port is closed; no frame is sent any more")]
    Closed,
}

/// State that both ends share.
#[derive(Debug)]
struct Shared {
    /// Frames that were queued since the start, in all queues.
    pushed: AtomicU64,
    gateways: Box<[SharedGateway]>,
}

#[derive(Debug, Default)]
struct SharedGateway {
    /// The [`accepted_word`].
    accepted: AtomicU32,
    /// Frames that the cycle took from each queue.
    taken: [AtomicU64; CHANNELS],
}

/// Queues of frames for the cycle, one per channel of every gateway, filled by one other thread:
/// [`Port::transmit_queues`](crate::Port::transmit_queues).
///
/// The cycle sends them after the frames of the application, if the image and the back pressure of the
/// channel allow it, and never waits. Frames stay in their queue while an image is unconfirmed. If the
/// gateway is not ready the cycle rejects them, and it withdraws those that have
/// [expired](Self::push_until). The [`ImageStream`](crate::ImageStream) reports what
/// was sent and rejected. The application does not receive their transmit results; the statistics
/// count them as all other frames.
#[derive(Debug)]
pub struct TransmitQueues {
    shared: Arc<Shared>,
    writers: Vec<RingWriter>,
}

/// The cycle's ends of the queues.
#[derive(Debug)]
pub(crate) struct CycleQueues {
    shared: Arc<Shared>,
    readers: Vec<RingReader>,
    /// Frames that were taken since the start, from all queues.
    removed: u64,
    /// Frames of each channel that were added to the image of this cycle.
    sent: Vec<[u8; CHANNELS]>,
    has_sent: bool,
}

/// The two ends of queues of at least `depth` frames for each channel.
pub(crate) fn transmit_queues(gateways: &[Gateway], depth: usize) -> (CycleQueues, TransmitQueues) {
    let count = gateways.len();
    let words = depth.max(1) * (1 + FRAME_WORDS);
    let (writers, readers) = (0..count * CHANNELS).map(|_| ring(words)).unzip();
    let of_gateways = (0..count).map(|_| SharedGateway::default()).collect();
    let shared = Arc::new(Shared { pushed: AtomicU64::new(0), gateways: of_gateways });
    let queues = CycleQueues {
        shared: shared.clone(),
        readers,
        removed: 0,
        sent: vec![[0; CHANNELS]; count],
        has_sent: false,
    };
    queues.set_accepted(gateways);
    (queues, TransmitQueues { shared, writers })
}

impl TransmitQueues {
    /// Gives a frame to the cycle. Takes neither lock nor memory.
    ///
    /// # Errors
    /// A [`QueueError`]; the frame is not in the queue.
    pub fn push(&mut self, slave: usize, channel: u8, frame: &CanFrame) -> Result<(), QueueError> {
        self.push_until(slave, channel, frame, NEVER)
    }

    /// As [`push`](Self::push). The cycle withdraws the frame if it still waits in the queue at
    /// `expires_ns` on the clock of the Adapter.
    ///
    /// # Errors
    /// As [`push`](Self::push).
    pub fn push_until(
        &mut self,
        slave: usize,
        channel: u8,
        frame: &CanFrame,
        expires_ns: u64,
    ) -> Result<(), QueueError> {
        let count = self.shared.gateways.len();
        let Some(shared) = self.shared.gateways.get(slave) else {
            return Err(AddressError::Slave { slave, count }.into());
        };
        if usize::from(channel) >= CHANNELS {
            return Err(AddressError::Channel { slave, channel }.into());
        }
        let [enabled, sending, fd, _] = shared.accepted.load(Ordering::Acquire).to_le_bytes();
        let is_in = |mask: u8| mask >> channel & 1 == 1;
        if !is_in(enabled) {
            return Err(AddressError::Disabled { slave, channel }.into());
        }
        if !is_in(sending) {
            return Err(QueueError::ReceiveOnly { slave, channel });
        }
        if frame.is_fd() && !is_in(fd) {
            return Err(QueueError::NotFd { slave, channel });
        }
        let Some(writer) = self.writers.get_mut(slave * CHANNELS + usize::from(channel)) else {
            return Err(AddressError::Slave { slave, count }.into());
        };
        if writer.is_closed() {
            return Err(QueueError::Closed);
        }
        match writer.write(&[frame_word(frame), expires_ns], frame.data()) {
            true => {
                self.shared.pushed.fetch_add(1, Ordering::Release);
                Ok(())
            }
            false => Err(QueueError::Full { slave, channel }),
        }
    }

    /// Frames of a channel that the cycle took from its queue since the start, to send or to reject
    /// them; 0 for a wrong address.
    pub fn taken(&self, slave: usize, channel: u8) -> u64 {
        let shared = self.shared.gateways.get(slave);
        let taken = shared.and_then(|slave| slave.taken.get(usize::from(channel)));
        taken.map_or(0, |taken| taken.load(Ordering::Acquire))
    }
}

impl CycleQueues {
    /// Sets what [`TransmitQueues::push`] accepts.
    pub(crate) fn set_accepted(&self, gateways: &[Gateway]) {
        for (at, shared) in self.shared.gateways.iter().enumerate() {
            let word = gateways.get(at).map_or(0, accepted_word);
            shared.accepted.store(word, Ordering::Release);
        }
    }

    /// Frames of each channel that [`send`](Self::send) added to the image of this cycle, and those that
    /// it took from the queue since the start.
    pub(crate) fn sent(&self, slave: usize) -> QueuedFrames {
        let counts = self.sent.get(slave).zip(self.shared.gateways.get(slave));
        counts.map_or_else(QueuedFrames::default, |(sent, shared)| QueuedFrames {
            sent: *sent,
            taken: shared.taken.each_ref().map(|taken| taken.load(Ordering::Relaxed)),
        })
    }

    /// Begins a cycle; returns whether frames wait. Real-time safe.
    pub(crate) fn begin(&mut self) -> bool {
        if std::mem::take(&mut self.has_sent) {
            self.sent.fill([0; CHANNELS]);
        }
        // Counts a frame shortly after it is in its queue.
        self.shared.pushed.load(Ordering::Acquire) != self.removed
    }

    /// Adds the waiting frames of a gateway to its image; `reject` gets those that are not sent. A frame
    /// after sent ones is rejected in a later cycle, so that the rejected frames of a cycle are the first
    /// that it takes. The channels take turns, beginning with `first`. Once per cycle, after
    /// [`begin`](Self::begin). Real-time safe.
    pub(crate) fn send(
        &mut self,
        slave: usize,
        gateway: &mut Gateway,
        image: &mut [u8],
        (first, now_ns): (u8, u64),
        mut reject: impl FnMut(RejectedFrames),
    ) {
        let start = slave * CHANNELS;
        let Self { shared, readers, removed, sent, has_sent } = self;
        let readers = readers.get_mut(start..start + CHANNELS);
        let (Some(readers), Some(shared), Some(sent)) =
            (readers, shared.gateways.get(slave), sent.get_mut(slave))
        else {
            return;
        };
        *has_sent = true;
        for turn in 0..CHANNELS as u8 {
            let channel = first.wrapping_add(turn) % CHANNELS as u8;
            let at = usize::from(channel);
            let (Some(reader), Some(taken), Some(sent)) =
                (readers.get_mut(at), shared.taken.get(at), sent.get_mut(at))
            else {
                continue;
            };
            let mut run = RejectedFrames { channel, frames: 0, taken: 0, is_expired: false };
            while let Some(verdict) = send_next(reader, gateway, image, channel, now_ns) {
                match verdict {
                    Verdict::Wait => break,
                    Verdict::Rejected { .. } if *sent > 0 => break,
                    Verdict::Sent => *sent = sent.saturating_add(1),
                    Verdict::Rejected { is_expired } => {
                        if run.frames > 0 && run.is_expired != is_expired {
                            reject(run);
                            run.frames = 0;
                        }
                        run.is_expired = is_expired;
                        run.frames += 1;
                    }
                }
                reader.remove();
                *removed = removed.wrapping_add(1);
                let before = taken.fetch_add(1, Ordering::Release);
                if let Verdict::Rejected { .. } = verdict {
                    run.taken = before + 1;
                }
            }
            if run.frames > 0 {
                reject(run);
            }
        }
    }
}

/// Result of a waiting frame in this cycle.
enum Verdict {
    Sent,
    Rejected { is_expired: bool },
    Wait,
}

fn send_next(
    reader: &mut RingReader,
    gateway: &mut Gateway,
    image: &mut [u8],
    channel: u8,
    now_ns: u64,
) -> Option<Verdict> {
    let mut record = [0; FRAME_WORDS];
    let words = reader.peek(&mut record);
    let ([word, expires_ns], data) = record.get(..words)?.split_first_chunk()?;
    let mut bytes = [0; 64];
    for (to, word) in bytes.as_chunks_mut::<8>().0.iter_mut().zip(data) {
        *to = word.to_le_bytes();
    }
    let Some(frame) = frame_of(*word, &bytes) else {
        return Some(Verdict::Rejected { is_expired: false });
    };
    if *expires_ns <= now_ns {
        return Some(Verdict::Rejected { is_expired: true });
    }
    Some(gateway.send_queued(image, channel, frame))
}

impl Gateway {
    fn send_queued(&mut self, image: &mut [u8], channel: u8, frame: FrameRef<'_>) -> Verdict {
        if !self.accepts(channel, frame) {
            return Verdict::Rejected { is_expired: false };
        }
        // An unconfirmed image is published again; the frames of this cycle follow in a later one.
        let must_wait = self.transmitter.is_unconfirmed()
            || self.is_paced && !self.transmitter.window(channel).accepts_frames();
        if must_wait {
            return Verdict::Wait;
        }
        match self.transmitter.push_queued(image, channel, frame) {
            Ok(()) => {
                self.statistics.channel(channel).frames_accepted += 1;
                Verdict::Sent
            }
            Err(fault) if fault.is_temporary() => Verdict::Wait,
            Err(_) => Verdict::Rejected { is_expired: false },
        }
    }
}

/// Masks of the channels that a gateway has, that can send, and that have CAN FD.
fn accepted_word(gateway: &Gateway) -> u32 {
    let mask = |has: fn(&Gateway, u8) -> bool| {
        (0..CHANNELS as u8).fold(0, |mask, at| mask | u8::from(has(gateway, at)) << at)
    };
    let masks = [mask(Gateway::has_channel), mask(Gateway::can_send), mask(Gateway::is_fd)];
    u32::from_le_bytes([masks[0], masks[1], masks[2], 0])
}

const EXTENDED: u64 = 1 << 29;
const REMOTE: u64 = 1 << 30;
const FD: u64 = 1 << 31;
const BRS: u64 = 1 << 32;
const ESI: u64 = 1 << 33;
const DLC_SHIFT: u32 = 40;

/// CAN ID, kind and DLC of a frame in a ring.
fn frame_word(frame: &CanFrame) -> u64 {
    let flag = |is_set: bool, bit: u64| if is_set { bit } else { 0 };
    let kind = match frame.kind() {
        FrameKind::Data => 0,
        FrameKind::Remote => REMOTE,
        FrameKind::Fd { brs, esi } => FD | flag(brs, BRS) | flag(esi, ESI),
    };
    let id = u64::from(frame.id().raw()) | flag(frame.id().is_extended(), EXTENDED);
    id | kind | u64::from(frame.dlc().value()) << DLC_SHIFT
}

fn frame_of(word: u64, data: &[u8; 64]) -> Option<FrameRef<'_>> {
    let id = CanId::new(word as u32 & (EXTENDED as u32 - 1), word & EXTENDED != 0).ok()?;
    let dlc = Dlc::from_raw((word >> DLC_SHIFT) as u8)?;
    if word & REMOTE != 0 {
        return FrameRef::remote(id, dlc).ok();
    }
    if word & FD != 0 {
        let data = data.get(..dlc.fd_len())?;
        return FrameRef::fd(id, data, word & BRS != 0, word & ESI != 0).ok();
    }
    FrameRef::classic(id, data.get(..dlc.classic_len())?).ok()
}

#[cfg(all(test, loom))]
mod interleaving_tests;
