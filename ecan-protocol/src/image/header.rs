//! Fixed header of a PDO image (manual 6), with the status words of the channels (manual 7).

use core::fmt;
use core::sync::atomic::{Ordering, fence};

use crate::mapping::{CHANNELS, HEADER_BYTES};

/// Version 1 and a header length of six words.
pub const VER_IHL: u8 = 0x16;
/// `crc_alg` of an image without CRC.
pub const CRC_ALG_NONE: u8 = 0;
/// `crc_alg` of an image with CRC-16/CCITT-FALSE.
pub const CRC_ALG_CCITT_FALSE: u8 = 1;

/// Flags of the image header (manual 6.1).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct HeaderFlags(u8);

impl HeaderFlags {
    /// No flag.
    pub const NONE: Self = Self(0);
    /// Frames were omitted because the frame area was full.
    pub const STREAM_TRUNCATED: Self = Self(1 << 0);
    /// A channel is in error, off the bus or congested.
    pub const ANY_CHANNEL_ERROR: Self = Self(1 << 1);
    /// The image holds TX_RESULT packets.
    pub const TX_RESULT_PRESENT: Self = Self(1 << 2);
    /// A channel status differs from the previous image.
    pub const STATUS_CHANGED: Self = Self(1 << 3);
    /// The sequence stepped from 0xFFFF to 0 with this image.
    pub const SEQ_WRAP: Self = Self(1 << 4);
    /// `overflow_sat` is valid.
    pub const OVERFLOW_SAT_VALID: Self = Self(1 << 5);
    /// All flags of the manual; the other bits are sent as 0 and ignored on reception.
    pub const ALL: Self = Self(0x3F);

    /// From the byte as transmitted, reserved bits included.
    #[inline]
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits)
    }

    /// The byte.
    #[inline]
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// True if all flags of `other` are set.
    #[inline]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// These flags and those of `other`.
    #[inline]
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// `with` if `on` is set.
    #[inline]
    #[must_use]
    pub const fn with_if(self, other: Self, on: bool) -> Self {
        if on { self.with(other) } else { self }
    }

    /// True if no flag is set.
    #[inline]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }
}

/// The fixed header of an image, all fields as transmitted (manual 6).
// In the order of transmission, so that it is copied as three words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub struct Header {
    /// Header version (high four bits) and length in words of 4 bytes: [`VER_IHL`].
    pub ver_ihl: u8,
    /// Flags.
    pub flags: HeaderFlags,
    /// Sequence number of the image.
    pub seq_begin: u16,
    /// Sequence number again, written last: an image is complete if both numbers are equal.
    pub seq_end: u16,
    /// Valid bytes of the frame area.
    pub payload_len: u16,
    /// CRC over the valid bytes of the frame area; 0 without CRC.
    pub payload_crc16: u16,
    /// Short identifier of the layout.
    pub layout_id: u16,
    /// Enabled channels.
    pub channel_mask: u8,
    /// Packets in the frame area.
    pub frame_count: u8,
    /// Overflows and truncations of this image, 255 for more.
    pub overflow_sat: u8,
    /// [`CRC_ALG_CCITT_FALSE`] or [`CRC_ALG_NONE`].
    pub crc_alg: u8,
    /// Status of each channel; filled by the gateway, 0 in RxPDO.
    pub channel_status: [ChannelStatus; CHANNELS],
}

impl Header {
    /// Decodes the bytes without checks.
    #[inline]
    pub const fn parse(bytes: &[u8; HEADER_BYTES]) -> Self {
        Self::from_words(words_of(bytes))
    }

    /// From the bytes as little-endian words.
    #[inline]
    pub(crate) const fn from_words([first, second, third]: [u64; 3]) -> Self {
        Self {
            ver_ihl: first as u8,
            flags: HeaderFlags::from_bits((first >> 8) as u8),
            seq_begin: (first >> 16) as u16,
            seq_end: (first >> 32) as u16,
            payload_len: (first >> 48) as u16,
            payload_crc16: second as u16,
            layout_id: (second >> 16) as u16,
            channel_mask: (second >> 32) as u8,
            frame_count: (second >> 40) as u8,
            overflow_sat: (second >> 48) as u8,
            crc_alg: (second >> 56) as u8,
            channel_status: [
                ChannelStatus::from_raw(third as u16),
                ChannelStatus::from_raw((third >> 16) as u16),
                ChannelStatus::from_raw((third >> 32) as u16),
                ChannelStatus::from_raw((third >> 48) as u16),
            ],
        }
    }

    #[inline]
    const fn words(&self) -> [u64; 3] {
        let [status0, status1, status2, status3] = self.channel_status;
        [
            self.ver_ihl as u64
                | (self.flags.bits() as u64) << 8
                | (self.seq_begin as u64) << 16
                | (self.seq_end as u64) << 32
                | (self.payload_len as u64) << 48,
            self.payload_crc16 as u64
                | (self.layout_id as u64) << 16
                | (self.channel_mask as u64) << 32
                | (self.frame_count as u64) << 40
                | (self.overflow_sat as u64) << 48
                | (self.crc_alg as u64) << 56,
            status0.raw() as u64
                | (status1.raw() as u64) << 16
                | (status2.raw() as u64) << 32
                | (status3.raw() as u64) << 48,
        ]
    }

    /// Writes all 24 bytes, in no particular order.
    #[inline]
    pub const fn write(&self, bytes: &mut [u8; HEADER_BYTES]) {
        let (places, _) = bytes.as_chunks_mut::<8>();
        let [first, second, third] = self.words();
        if let [place0, place1, place2] = places {
            *place0 = first.to_le_bytes();
            *place1 = second.to_le_bytes();
            *place2 = third.to_le_bytes();
        }
    }

    /// Writes all 24 bytes, `seq_end` last after a release fence: it keeps its old value until
    /// everything else is written.
    #[inline]
    pub(crate) fn publish(&self, bytes: &mut [u8; HEADER_BYTES]) {
        let [first, second, third] = self.words();
        let [b0, b1, b2, b3, e0, e1, l0, l1] = first.to_le_bytes();
        bytes[..4].copy_from_slice(&[b0, b1, b2, b3]);
        bytes[6..8].copy_from_slice(&[l0, l1]);
        bytes[8..16].copy_from_slice(&second.to_le_bytes());
        bytes[16..].copy_from_slice(&third.to_le_bytes());
        fence(Ordering::Release);
        bytes[4..6].copy_from_slice(&[e0, e1]);
    }

    /// True if both sequence numbers are equal.
    #[inline]
    pub const fn is_settled(&self) -> bool {
        self.seq_begin == self.seq_end
    }

    /// True if the sender omitted packets.
    #[inline]
    pub const fn is_incomplete(&self) -> bool {
        self.overflow_sat != 0 || self.flags.contains(HeaderFlags::STREAM_TRUNCATED)
    }
}

/// The bytes of a header as little-endian words.
#[inline]
pub(crate) const fn words_of(bytes: &[u8; HEADER_BYTES]) -> [u64; 3] {
    let (places, _) = bytes.as_chunks::<8>();
    match *places {
        [first, second, third] => {
            [u64::from_le_bytes(first), u64::from_le_bytes(second), u64::from_le_bytes(third)]
        }
        // infallible: a header has three words
        _ => [0; 3],
    }
}

crate::open_enum! {
    /// State of a CAN channel, three bits of the status word (manual 7).
    #[derive(Default)]
    pub enum ChannelState: u8 else Unknown, "state";
    /// The channel is not enabled.
    #[default]
    Disabled = 0, "disabled";
    Init = 1, "init";
    /// Active on the bus.
    Run = 2, "run";
    /// Off the bus after too many errors.
    BusOff = 3, "bus-off";
    Error = 4, "error";
    /// Listens without sending or acknowledging.
    Listen = 5, "listen";
}

const STATE: u16 = 7;
const RX_PENDING_SHIFT: u32 = 10;
const TX_PENDING_SHIFT: u32 = 13;

/// Declares the flags of the status once: bit, text, getter and setter.
macro_rules! flags {
    ($( $(#[$meta:meta])* $get:ident, $with:ident = $bit:literal, $text:literal; )+) => {
        impl ChannelStatus {
            const FLAGS: &[(u16, &str)] = &[$( (1 << $bit, $text), )+];

            $(
                $(#[$meta])*
                pub const fn $get(self) -> bool {
                    self.0 & 1 << $bit != 0
                }

                #[doc = concat!("Returns the status with [`", stringify!($get), "`](Self::",
                    stringify!($get), ") set or cleared.")]
                #[must_use]
                pub const fn $with(self, on: bool) -> Self {
                    Self(if on { self.0 | 1 << $bit } else { self.0 & !(1 << $bit) })
                }
            )+
        }
    };
}

flags! {
    /// CAN FD is enabled.
    fd_enabled, with_fd_enabled = 3, "CAN FD";
    /// Error warning, error passive or degraded bus.
    warn, with_warn = 4, "warning";
    /// Off the bus.
    bus_off, with_bus_off = 5, "bus-off";
    /// The receive FIFO is nearly full or has overflowed.
    rx_pressure, with_rx_pressure = 6, "receive pressure";
    /// The transmit FIFO or queue is congested.
    tx_pressure, with_tx_pressure = 7, "transmit pressure";
    /// A new detailed snapshot can be read by SDO from 0x9000 + channel.
    detail_pending, with_detail_pending = 8, "detail pending";
    /// A pending count is saturated.
    counter_sat, with_counter_sat = 9, "counts saturated";
}

/// The 16 bit status of one channel, as the TxPDO header carries it (manual 7).
#[derive(Clone, Copy, Default, PartialEq, Eq, Hash)]
pub struct ChannelStatus(u16);

impl ChannelStatus {
    /// From the word as transmitted.
    #[inline]
    pub const fn from_raw(raw: u16) -> Self {
        Self(raw)
    }

    /// The word as transmitted.
    #[inline]
    pub const fn raw(self) -> u16 {
        self.0
    }

    /// State of the channel.
    pub const fn state(self) -> ChannelState {
        ChannelState::from_raw((self.0 & STATE) as u8)
    }

    /// Number of pending received frames, 0 to 7, saturated.
    pub const fn rx_pending(self) -> u8 {
        (self.0 >> RX_PENDING_SHIFT) as u8 & 7
    }

    /// Number of frames pending to be sent, 0 to 7, saturated.
    pub const fn tx_pending(self) -> u8 {
        (self.0 >> TX_PENDING_SHIFT) as u8 & 7
    }

    const fn with_count(self, shift: u32, count: u8) -> Self {
        let count = if count > 7 { 7 } else { count };
        Self(self.0 & !(7 << shift) | (count as u16) << shift)
    }

    /// Returns the status with this state.
    #[must_use]
    pub const fn with_state(self, state: ChannelState) -> Self {
        Self(self.0 & !STATE | state.raw() as u16 & STATE)
    }

    /// Returns the status with this number of pending received frames; at most 7.
    #[must_use]
    pub const fn with_rx_pending(self, count: u8) -> Self {
        self.with_count(RX_PENDING_SHIFT, count)
    }

    /// Returns the status with this number of frames pending to be sent; at most 7.
    #[must_use]
    pub const fn with_tx_pending(self, count: u8) -> Self {
        self.with_count(TX_PENDING_SHIFT, count)
    }
}

impl fmt::Display for ChannelStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.state())?;
        for (bit, text) in Self::FLAGS {
            if self.0 & bit != 0 {
                write!(f, ", {text}")?;
            }
        }
        write!(f, ", {} received and {} to send pending", self.rx_pending(), self.tx_pending())
    }
}

impl fmt::Debug for ChannelStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ChannelStatus({:#06x}: {self})", self.0)
    }
}

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::{ChannelState, ChannelStatus, Header};

    #[test]
    fn header_bytes_round_trip() {
        let bytes: [u8; 24] = core::array::from_fn(|i| i as u8);
        let header = Header::parse(&bytes);
        assert_eq!(header.ver_ihl, 0);
        assert_eq!(header.flags.bits(), 1);
        assert_eq!(header.seq_begin, 0x0302);
        assert_eq!(header.seq_end, 0x0504);
        assert_eq!(header.payload_len, 0x0706);
        assert_eq!(header.payload_crc16, 0x0908);
        assert_eq!(header.layout_id, 0x0B0A);
        assert_eq!(header.channel_mask, 12);
        assert_eq!(header.frame_count, 13);
        assert_eq!(header.overflow_sat, 14);
        assert_eq!(header.crc_alg, 15);
        assert_eq!(header.channel_status[3].raw(), 0x1716);
        let mut again = [0xFF; 24];
        header.write(&mut again);
        assert_eq!(again, bytes);
    }

    extern crate std;

    #[test]
    fn fields_have_the_bits_of_the_manual() {
        let none = ChannelStatus::default();
        assert_eq!(none.with_state(ChannelState::Listen).raw(), 5);
        assert_eq!(none.with_fd_enabled(true).raw(), 0x0008);
        assert_eq!(none.with_warn(true).raw(), 0x0010);
        assert_eq!(none.with_bus_off(true).raw(), 0x0020);
        assert_eq!(none.with_rx_pressure(true).raw(), 0x0040);
        assert_eq!(none.with_tx_pressure(true).raw(), 0x0080);
        assert_eq!(none.with_detail_pending(true).raw(), 0x0100);
        assert_eq!(none.with_counter_sat(true).raw(), 0x0200);
        assert_eq!(none.with_rx_pending(5).raw(), 5 << 10);
        assert_eq!(none.with_tx_pending(200).raw(), 7 << 13);
    }

    #[test]
    fn status_word_round_trip() {
        for raw in 0..=u16::MAX {
            let status = ChannelStatus::from_raw(raw);
            let built = ChannelStatus::default()
                .with_state(status.state())
                .with_fd_enabled(status.fd_enabled())
                .with_warn(status.warn())
                .with_bus_off(status.bus_off())
                .with_rx_pressure(status.rx_pressure())
                .with_tx_pressure(status.tx_pressure())
                .with_detail_pending(status.detail_pending())
                .with_counter_sat(status.counter_sat())
                .with_rx_pending(status.rx_pending())
                .with_tx_pending(status.tx_pending());
            assert_eq!(built, status);
        }
    }

    #[test]
    fn status_display_names_the_set_flags() {
        let status = ChannelStatus::default()
            .with_state(ChannelState::Run)
            .with_warn(true)
            .with_tx_pending(3);
        assert_eq!(status.to_string(), "run, warning, 0 received and 3 to send pending");
    }
}
