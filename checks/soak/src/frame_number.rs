//! Numbered frames: the content follows from the number, so that each frame names itself on the bus and is
//! compared without a memory of what was sent.

use ecan_protocol::can::{CanFrame, CanId, Dlc, FrameKind};

/// Bits of a number.
const NUMBER_BITS: u32 = 20;
const STREAM_BITS: u32 = 3;
/// Bits of the channel, the stream and the number.
const WORD_BITS: u32 = 5 + STREAM_BITS + NUMBER_BITS;
const NUMBER_MASK: u32 = (1 << NUMBER_BITS) - 1;
/// Marks an extended CAN ID that holds the whole number; the data is arbitrary.
const IN_ID: u32 = 1 << 28;
/// Bytes that hold the number in the data.
const DATA_BYTES: usize = 4;

/// Way on which frames of one sender keep their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Stream {
    /// Sent by the host at once.
    Immediate,
    /// Sent by the host at a phase of Sync0.
    Scheduled,
    /// Sent by the host with a hint for another path in the gateway.
    Hinted,
    /// Sent by a node.
    Node,
    /// Sent by a client of the service.
    FirstClient,
    SecondClient,
    ThirdClient,
}

/// Frames that a channel carries.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Kinds {
    /// CAN FD frames, too.
    pub is_fd: bool,
    /// Extended CAN IDs only: the standard ones belong to CANopen.
    pub is_shared: bool,
}

impl Stream {
    pub const COUNT: usize = 7;
    pub const ALL: [Self; Self::COUNT] = [
        Self::Immediate,
        Self::Scheduled,
        Self::Hinted,
        Self::Node,
        Self::FirstClient,
        Self::SecondClient,
        Self::ThirdClient,
    ];
    /// Sent by the application itself.
    pub const OF_APPLICATION: [Self; 3] = [Self::Immediate, Self::Scheduled, Self::Hinted];
    pub const OF_CLIENTS: [Self; 3] = [Self::FirstClient, Self::SecondClient, Self::ThirdClient];

    /// Returns whether the frames of one sender keep their order.
    pub fn is_ordered(self) -> bool {
        !matches!(self, Self::Scheduled | Self::Hinted)
    }
}

/// Number of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct FrameNumber {
    /// Index of the channel: of the sender, or on whose bus the node is.
    pub channel: u8,
    pub stream: Stream,
    /// From 0; the lower 20 bits.
    pub number: u32,
}

impl FrameNumber {
    /// Largest number; a longer run needs more bits.
    pub const MAX: u32 = NUMBER_MASK;

    fn word(self) -> u32 {
        (u32::from(self.channel) << STREAM_BITS | self.stream as u32) << NUMBER_BITS
            | self.number & NUMBER_MASK
    }

    fn from_word(word: u32) -> Option<Self> {
        let stream = (word >> NUMBER_BITS) as usize & ((1 << STREAM_BITS) - 1);
        Some(Self {
            channel: (word >> (NUMBER_BITS + STREAM_BITS)) as u8,
            stream: *Stream::ALL.get(stream)?,
            number: word & NUMBER_MASK,
        })
    }

    /// The frame of this number on a channel.
    pub fn frame(self, kinds: Kinds) -> CanFrame {
        let Kinds { is_fd, is_shared } = kinds;
        let word = self.word();
        let mut content = fastrand::Rng::with_seed(u64::from(word) ^ u64::from(is_fd) << 32);
        let mut data = [0; 64];
        content.fill(&mut data);
        if content.u8(..16) == 0 {
            let id = CanId::extended(IN_ID | word).expect("28 bits");
            return match content.u8(..4) {
                0 => CanFrame::remote(id, Dlc::new(content.u8(..9)).expect("at most 8")),
                1 if is_fd => CanFrame::fd(id, &data[..3], content.bool(), false),
                _ => CanFrame::classic(id, &data[..usize::from(content.u8(..9))]),
            }
            .expect("valid");
        }
        data[..DATA_BYTES].copy_from_slice(&word.to_le_bytes());
        let id = match content.u8(..4) {
            0 => CanId::extended(content.u32(..IN_ID)),
            _ if is_shared => CanId::extended(content.u32(..IN_ID)),
            _ => CanId::standard(content.u16(..0x800)),
        };
        let id = id.expect("in range");
        let frame = if is_fd && content.u8(..3) > 0 {
            let length = [4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64][content.usize(..12)];
            CanFrame::fd(id, &data[..length], content.bool(), false)
        } else {
            CanFrame::classic(id, &data[..content.usize(DATA_BYTES..=8)])
        };
        frame.expect("valid")
    }

    /// The number of a frame, if it has the content that belongs to it. A sender that is error passive
    /// sets the ESI of its FD frames.
    pub fn of(frame: &CanFrame, kinds: Kinds) -> Option<Self> {
        let id = frame.id();
        let word = if id.is_extended() && id.raw() & IN_ID != 0 {
            id.raw() & (IN_ID - 1)
        } else {
            u32::from_le_bytes(frame.data().get(..DATA_BYTES)?.try_into().ok()?)
        };
        let number = Self::from_word(word)?;
        let sent = match frame.kind() {
            FrameKind::Fd { brs, esi: true } => {
                &CanFrame::fd(id, frame.data(), brs, false).expect("valid")
            }
            _ => frame,
        };
        (word >> WORD_BITS == 0 && *sent == number.frame(kinds)).then_some(number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_name_themselves() {
        let mut counts = [0; 3];
        for (is_fd, is_shared) in [(false, false), (true, false), (false, true)] {
            let kinds = Kinds { is_fd, is_shared };
            for number in 0..5_000 {
                let number = FrameNumber { channel: 31, stream: Stream::Scheduled, number };
                let frame = number.frame(kinds);
                assert_eq!(FrameNumber::of(&frame, kinds), Some(number));
                assert!(frame.id().is_extended() || !is_shared);
                counts[usize::from(frame.is_fd()) + 2 * usize::from(frame.is_remote())] += 1;
            }
        }
        assert!(counts.iter().all(|count| *count > 50), "{counts:?}");
    }

    #[test]
    fn other_content_has_no_number() {
        let number = FrameNumber { channel: 3, stream: Stream::Immediate, number: 17 };
        let kinds = Kinds::default();
        let frame = number.frame(kinds);
        let mut data = frame.data().to_vec();
        data[3] ^= 0x40;
        let changed = CanFrame::classic(frame.id(), &data).unwrap();
        assert_eq!(FrameNumber::of(&changed, kinds), None);
    }
}
