//! Writing PDO images (manual 5.4.4.1, 8).

use super::crc::crc16;
use super::header::{
    CRC_ALG_CCITT_FALSE, CRC_ALG_NONE, ChannelStatus, Header, HeaderFlags, VER_IHL,
};
use super::packet::{
    EXTENDED_AUX_SHIFT, STANDARD_AUX_SHIFT, Schedule, TX_RESULT_BYTES, Timestamp, TxResult,
    WINDOW_BYTES, allowed_formats,
};
use crate::can::FrameRef;
use crate::can::control::ControlWord;
use crate::copy::{copy_data, copy_over, put};
use crate::mapping::{CHANNELS, Direction, HEADER_BYTES, MAX_PACKETS};
use crate::object::pdo_profile::{OptionFlags, PdoProfile};

/// Bytes of the largest packet without timestamp and window, padding included.
const MAX_PLAIN_BYTES: usize = 72;

/// Writes images of one direction into a buffer of the caller.
///
/// One writer serves one buffer: it stores the length of earlier images, to clear no more than that.
/// Nothing here allocates, blocks or panics; all of it is real-time safe. Packets are written directly
/// to their location in the buffer; [`commit`](Self::commit) makes them an image.
#[derive(Clone, Debug)]
pub struct ImageWriter {
    direction: Direction,
    profile: PdoProfile,
    layout_id: u16,
    // Existing channels of the mask. As wide as the load that tests a bit: a wider load would wait for
    // the counters next to it, which each packet changes.
    channels: u32,
    crc: bool,
    payload_only: bool,
    d64: bool,
    formats: u8,
    align_mask: usize,
    // Offsets in the image.
    area_end: usize,
    // Of the area in which writing a packet may clear bytes after it.
    wide_end: usize,
    position: usize,
    dirty_end: usize,
    // Packets of both kinds, as in the header.
    frame_count: u8,
    // TX_RESULT packets among them.
    tx_results: u8,
    next_sequence: u16,
    wrapped: bool,
}

impl ImageWriter {
    /// Creates a writer for this direction and profile. CRC and clearing follow the options of the
    /// profile. The first image gets sequence number 1 and clears the whole buffer.
    pub const fn new(direction: Direction, profile: PdoProfile) -> Self {
        let area_end = profile.pdo_bytes();
        let writer = Self {
            direction,
            profile,
            layout_id: profile.layout_id(),
            channels: profile.channel_mask as u32 & 0x0F,
            crc: !profile.options.contains(OptionFlags::NO_CRC16),
            payload_only: false,
            d64: false,
            formats: allowed_formats(direction, profile.profile),
            align_mask: if profile.options.contains(OptionFlags::ALIGN4) { 3 } else { 0 },
            area_end,
            wide_end: area_end,
            position: HEADER_BYTES,
            dirty_end: area_end,
            frame_count: 0,
            tx_results: 0,
            next_sequence: 1,
            wrapped: false,
        };
        writer.with_payload_only(profile.options.contains(OptionFlags::PAYLOAD_ONLY))
    }

    /// Writes a CRC or not, regardless of the option (0x8030:04, manual 13.2.3).
    #[must_use]
    pub const fn with_crc(mut self, crc: bool) -> Self {
        self.crc = crc;
        self
    }

    /// Keeps or clears stale bytes after the payload, regardless of the option (0x8030:05, manual
    /// 13.2.3).
    #[must_use]
    pub const fn with_payload_only(mut self, payload_only: bool) -> Self {
        self.payload_only = payload_only;
        // Stale bytes are kept.
        self.wide_end = if payload_only { 0 } else { self.area_end };
        self
    }

    /// Writes the data of CAN FD frames into windows of 64 bytes. No effect if the profile does not
    /// allow it.
    pub const fn use_d64(&mut self, on: bool) {
        self.d64 = on && self.profile.profile.allows_d64();
    }

    /// The direction.
    pub const fn direction(&self) -> Direction {
        self.direction
    }

    /// The profile.
    pub const fn profile(&self) -> &PdoProfile {
        &self.profile
    }

    /// Starts the next image empty. Packets since the last commit are discarded. A commit does the
    /// same.
    pub const fn begin(&mut self) {
        if self.position > self.dirty_end {
            self.dirty_end = self.position;
        }
        self.position = HEADER_BYTES;
        self.frame_count = 0;
        self.tx_results = 0;
    }

    /// The sequence number that the next commit publishes.
    pub const fn next_sequence(&self) -> u16 {
        self.next_sequence
    }

    /// Sets the sequence number of the next image, as a sender does after a restart.
    pub const fn set_next_sequence(&mut self, sequence: u16) {
        self.next_sequence = sequence;
        self.wrapped = false;
    }

    /// Payload bytes of the image so far, padding included.
    #[inline]
    pub const fn used(&self) -> usize {
        self.position - HEADER_BYTES
    }

    /// Bytes left in the frame area.
    #[inline]
    pub const fn room(&self) -> usize {
        self.area_end - self.position
    }

    /// Packets in the image so far, TX_RESULT included.
    #[inline]
    pub const fn frames(&self) -> u8 {
        self.frame_count
    }

    /// True if the image has no packet.
    #[inline]
    pub const fn is_empty(&self) -> bool {
        self.frame_count == 0
    }

    /// Bytes of a frame in the image, padding included.
    #[inline]
    pub fn packet_bytes(&self, frame: FrameRef<'_>, timestamp: Timestamp) -> usize {
        let id = if frame.id().is_extended() { 4 } else { 2 };
        let data = if self.d64 && frame.is_fd() { WINDOW_BYTES } else { frame.data().len() };
        self.padded(2 + id + timestamp.size() + data)
    }

    #[inline]
    const fn padded(&self, raw: usize) -> usize {
        (raw + self.align_mask) & !self.align_mask
    }

    /// True for a channel of the mask and an ID_AUX of three bits.
    #[inline(always)]
    const fn has_place(&self, channel: u8, id_aux: u8) -> bool {
        // One comparison for both.
        channel | id_aux < 8 && self.channels >> channel & 1 != 0
    }

    /// The bytes of the next packet; nothing changes if there are none.
    #[inline(always)]
    fn claim<'b>(&self, image: &'b mut [u8], size: usize) -> Option<&'b mut [u8]> {
        let area = image.get_mut(..self.area_end)?.get_mut(self.position..)?;
        if usize::from(self.frame_count) < MAX_PACKETS { area.get_mut(..size) } else { None }
    }

    /// The reason if [`claim`](Self::claim) returns nothing.
    #[cold]
    #[inline(never)]
    const fn no_claim(&self, length: usize, size: usize) -> PushError {
        if self.position + size > self.area_end {
            PushError::NoRoom { needed: size as u16, left: self.room() as u16 }
        } else if self.frame_count as usize >= MAX_PACKETS {
            PushError::TooManyPackets
        } else {
            PushError::Buffer { length, needed: self.area_end as u16 }
        }
    }

    /// Appends a CAN frame. `id_aux` (0 to 7) is the transmit hint in RxPDO, the receive source in
    /// TxPDO. Returns the index of the frame among the CAN_FRAME packets of this image, which TX_RESULT
    /// refers to.
    ///
    /// # Errors
    /// [`PushError`]; the image is unchanged.
    // Always inlined: its result then stays in registers.
    #[inline(always)]
    pub fn push(
        &mut self,
        image: &mut [u8],
        channel: u8,
        id_aux: u8,
        frame: FrameRef<'_>,
        timestamp: Timestamp,
    ) -> Result<u8, PushError> {
        if matches!(timestamp, Timestamp::None) {
            let index = if ControlWord(frame.control_bits()).is_standard_of_eight() {
                self.push_standard_of_eight(image, channel, id_aux, frame)
            } else {
                self.push_plain(image, channel, id_aux, frame)
            };
            if let Some(index) = index {
                return Ok(index);
            }
            let (head, data) = frame.into_parts();
            return self.push_rest(image, channel, id_aux, head, data);
        }
        self.push_other(image, channel, id_aux, frame, timestamp)
    }

    /// As [`push_other`](Self::push_other), without timestamp, for the parts of a frame: only then the
    /// caller need not store the frame for the case that this is called.
    #[inline(never)]
    fn push_rest(
        &mut self,
        image: &mut [u8],
        channel: u8,
        id_aux: u8,
        head: u64,
        data: &[u8],
    ) -> Result<u8, PushError> {
        let frame = FrameRef::from_parts(head, data);
        self.push_other(image, channel, id_aux, frame, Timestamp::None)
    }

    /// Appends a frame of 8 bytes with a standard CAN ID: most frames. Their packets have one size, which
    /// needs no padding.
    #[inline(always)]
    fn push_standard_of_eight(
        &mut self,
        image: &mut [u8],
        channel: u8,
        id_aux: u8,
        frame: FrameRef<'_>,
    ) -> Option<u8> {
        if !self.has_place(channel, id_aux) {
            return None;
        }
        let data = frame.data().first_chunk::<8>()?;
        let packet = self.claim(image, 12)?;
        let control = frame.control_bits() | u16::from(channel);
        let field = frame.id().raw() | u32::from(id_aux) << STANDARD_AUX_SHIFT;
        let rest = put(packet, (u32::from(control) | field << 16).to_le_bytes());
        put(rest, *data);
        Some(self.pushed(12))
    }

    /// Appends a frame without timestamp and window, if the frame area has room for the largest packet.
    #[inline(always)]
    fn push_plain(
        &mut self,
        image: &mut [u8],
        channel: u8,
        id_aux: u8,
        frame: FrameRef<'_>,
    ) -> Option<u8> {
        if !self.has_place(channel, id_aux) {
            return None;
        }
        let control = frame.control_bits() | u16::from(channel);
        let id = u64::from(frame.id().raw()) << 32;
        let fields = id | u64::from(id_aux) << 16 | u64::from(control);
        self.push_fields(image, fields, frame.data())
    }

    /// Appends a packet with this control word, ID_AUX (from bit 16) and CAN ID (from bit 32): one
    /// argument for one register.
    ///
    /// With few branches on format and length, which cannot be predicted: blocks of fixed size overlap
    /// each other, and clear bytes after the packet. Not inlined: in a loop of the caller the compiler
    /// would turn the selections into branches.
    #[inline(never)]
    fn push_fields(&mut self, image: &mut [u8], fields: u64, data: &[u8]) -> Option<u8> {
        let area = image.get_mut(..self.wide_end)?.get_mut(self.position..)?;
        let packet = area.first_chunk_mut::<MAX_PLAIN_BYTES>()?;
        let control = ControlWord(fields as u16);
        let is_window = self.d64 && control.has(ControlWord::FDF);
        if is_window || usize::from(self.frame_count) >= MAX_PACKETS {
            return None;
        }
        let (id, id_aux) = (fields >> 32, fields >> 16 & 7);
        let is_extended = control.has(ControlWord::IDE);
        let aux_shift = if is_extended { EXTENDED_AUX_SHIFT } else { STANDARD_AUX_SHIFT };
        let head = u64::from(control.0) | (id | id_aux << aux_shift) << 16;
        let start = if is_extended { 6 } else { 4 };
        let size = self.padded(start + data.len());
        if self.align_mask != 0 {
            // The padding, and bytes that are overwritten next.
            *packet.get_mut(size.checked_sub(4)?..)?.first_chunk_mut()? = [0; 4];
        }
        *packet.first_chunk_mut()? = head.to_le_bytes();
        copy_over(packet.get_mut(start..)?, data);
        Some(self.pushed(size))
    }

    /// Appends any frame, or returns the error.
    #[inline(never)]
    fn push_other(
        &mut self,
        image: &mut [u8],
        channel: u8,
        id_aux: u8,
        frame: FrameRef<'_>,
        timestamp: Timestamp,
    ) -> Result<u8, PushError> {
        if !self.profile.has_channel(channel) {
            return Err(PushError::Channel { channel, mask: self.profile.channel_mask });
        }
        if id_aux > 7 {
            return Err(PushError::IdAux(id_aux));
        }
        if !matches!(timestamp, Timestamp::None) {
            self.check_timestamp(timestamp)?;
        }
        let window = self.d64 && frame.is_fd();
        let size = self.packet_bytes(frame, timestamp);
        let length = image.len();
        let Some(packet) = self.claim(image, size) else {
            return Err(self.no_claim(length, size));
        };

        let control = frame.control_bits()
            | u16::from(channel)
            | u16::from(timestamp.format()) << 11
            | if window { ControlWord::D64 } else { 0 };
        let id = frame.id();
        let rest = if id.is_extended() {
            let field = id.raw() | u32::from(id_aux) << EXTENDED_AUX_SHIFT;
            let rest = put(packet, control.to_le_bytes());
            put(rest, field.to_le_bytes())
        } else {
            let field = id.raw() | u32::from(id_aux) << STANDARD_AUX_SHIFT;
            put(packet, (u32::from(control) | field << 16).to_le_bytes())
        };
        let rest = match timestamp {
            Timestamp::None => rest,
            Timestamp::Delta16(value) => put(rest, value.to_le_bytes()),
            Timestamp::Delta32(value) => put(rest, value.to_le_bytes()),
            Timestamp::Full64(value) => put(rest, value.to_le_bytes()),
        };
        let data = frame.data();
        copy_data(rest, data);
        if rest.len() > data.len() {
            // The end of a window, and padding.
            clear(rest.get_mut(data.len()..).unwrap_or_default());
        }

        Ok(self.pushed(size))
    }

    /// Counts a frame whose packet of `size` bytes was written; returns its index among the frames.
    #[inline(always)]
    const fn pushed(&mut self, size: usize) -> u8 {
        let index = self.frame_count - self.tx_results;
        self.position += size;
        self.frame_count += 1;
        index
    }

    /// Appends a frame that the gateway sends at a phase of Sync0. RxPDO only.
    ///
    /// # Errors
    /// [`PushError`]; the image is unchanged.
    #[inline]
    pub fn push_scheduled(
        &mut self,
        image: &mut [u8],
        channel: u8,
        id_aux: u8,
        frame: FrameRef<'_>,
        schedule: Schedule,
    ) -> Result<u8, PushError> {
        let timestamp = schedule.to_timestamp();
        if self.direction != Direction::RxPdo {
            return Err(PushError::Timestamp { format: timestamp.format() });
        }
        self.push(image, channel, id_aux, frame, timestamp)
    }

    fn check_timestamp(&self, timestamp: Timestamp) -> Result<(), PushError> {
        let format = timestamp.format();
        let allowed = self.formats & 1 << format != 0;
        let valid = match (self.direction, timestamp) {
            (Direction::RxPdo, Timestamp::Full64(bits)) => {
                Schedule::from_bytes(bits.to_le_bytes()).is_ok()
            }
            _ => true,
        };
        if allowed && valid { Ok(()) } else { Err(PushError::Timestamp { format }) }
    }

    /// Appends a TX_RESULT packet. TxPDO with option TX_RESULT only. The channel is that of the reported
    /// frame, 0 to 7, in the mask or not.
    ///
    /// # Errors
    /// [`PushError`]; the image is unchanged.
    pub fn push_tx_result(&mut self, image: &mut [u8], result: &TxResult) -> Result<(), PushError> {
        if self.direction != Direction::TxPdo
            || !self.profile.options.contains(OptionFlags::TX_RESULT)
        {
            return Err(PushError::TxResult);
        }
        if result.channel > 7 {
            return Err(PushError::Channel {
                channel: result.channel,
                mask: self.profile.channel_mask,
            });
        }
        let size = self.padded(TX_RESULT_BYTES);
        let length = image.len();
        let Some(packet) = self.claim(image, size) else {
            return Err(self.no_claim(length, size));
        };
        let rest = put(packet, ControlWord::tx_result(result.channel).0.to_le_bytes());
        let rest = put(rest, result.sequence.to_le_bytes());
        let rest = put(rest, [result.frame_index, result.code.raw()]);
        clear(rest);
        self.position += size;
        self.frame_count += 1;
        self.tx_results += 1;
        Ok(())
    }

    /// Publishes the packets as one image and returns its sequence number: clears the bytes of earlier
    /// images after the payload, computes the CRC, writes the header, and `seq_end` last after a
    /// release fence. The next image starts empty.
    ///
    /// Does nothing if `image` is smaller than [`PdoProfile::pdo_bytes`]; the sequence does not advance.
    pub fn commit(&mut self, image: &mut [u8], fields: CommitFields) -> u16 {
        let sequence = self.next_sequence;
        let payload_end = self.position;
        let Some((head, area)) =
            image.get_mut(..self.area_end).and_then(<[u8]>::split_first_chunk_mut::<HEADER_BYTES>)
        else {
            return sequence;
        };

        let payload_len = payload_end - HEADER_BYTES;
        if self.payload_only {
            self.dirty_end = self.dirty_end.max(payload_end);
        } else {
            let dirty_len = self.dirty_end - HEADER_BYTES;
            if dirty_len > payload_len {
                area.get_mut(payload_len..dirty_len).unwrap_or_default().fill(0);
            }
            self.dirty_end = payload_end;
        }
        let (payload_crc16, crc_alg) = if self.crc {
            let payload = area.get(..payload_len).unwrap_or_default();
            (crc16(payload), CRC_ALG_CCITT_FALSE)
        } else {
            (0, CRC_ALG_NONE)
        };

        let flags = HeaderFlags::from_bits(fields.flags.bits() & HeaderFlags::ALL.bits())
            .with_if(HeaderFlags::SEQ_WRAP, self.wrapped)
            .with_if(HeaderFlags::TX_RESULT_PRESENT, self.tx_results != 0)
            .with_if(HeaderFlags::OVERFLOW_SAT_VALID, fields.overflow != 0);
        let header = Header {
            ver_ihl: VER_IHL,
            flags,
            seq_begin: sequence,
            seq_end: sequence,
            payload_len: payload_len as u16,
            payload_crc16,
            layout_id: self.layout_id,
            channel_mask: self.profile.channel_mask,
            frame_count: self.frame_count,
            overflow_sat: fields.overflow,
            crc_alg,
            channel_status: fields.channel_status,
        };
        header.publish(head);

        self.next_sequence = sequence.wrapping_add(1);
        self.wrapped = self.next_sequence == 0;
        self.begin();
        sequence
    }

    /// Must be called if the buffer changed, or others changed its contents: the next commit clears
    /// everything that it does not fill. Packets of the current image are kept.
    pub const fn assume_dirty(&mut self) {
        self.dirty_end = self.area_end;
    }

    /// Starts the next image empty in a buffer with unknown contents.
    pub const fn reset(&mut self) {
        self.assume_dirty();
        self.begin();
    }
}

#[inline]
fn clear(bytes: &mut [u8]) {
    for byte in bytes {
        *byte = 0;
    }
}

/// Error: a packet was not added to the image. The image is unchanged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PushError {
    /// The rest of the frame area is too small; packets are never split (manual 12).
    #[error("no room: the packet needs {needed} bytes, {left} are left")]
    NoRoom {
        /// Bytes of the packet, padding included.
        needed: u16,
        /// Bytes left in the frame area.
        left: u16,
    },
    /// The image already has 255 packets, the limit of its header.
    #[error("no room: the image holds 255 packets already")]
    TooManyPackets,
    /// The channel does not exist or is not in the channel mask.
    #[error("channel {channel} is not in the channel mask {mask:#04x}")]
    Channel {
        /// The channel.
        channel: u8,
        /// Channel mask of the profile.
        mask: u8,
    },
    /// ID_AUX has three bits.
    #[error("ID_AUX {0}, at most 7 is possible")]
    IdAux(u8),
    /// The timestamp does not belong to the profile or direction, or is not a valid schedule record.
    #[error("timestamp format {format} not allowed by profile or direction, or no schedule record")]
    Timestamp {
        /// TSF code of the timestamp.
        format: u8,
    },
    /// TX_RESULT in RxPDO, or without its option.
    #[error("TX_RESULT needs TxPDO and its option")]
    TxResult,
    /// The buffer is smaller than the profile's image.
    #[error("the buffer has {length} bytes, the image {needed}")]
    Buffer {
        /// Bytes of the buffer.
        length: usize,
        /// Bytes of the image.
        needed: u16,
    },
}

/// Header fields that the caller provides.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CommitFields {
    /// Flags to set. SEQ_WRAP, TX_RESULT_PRESENT and, with an overflow, OVERFLOW_SAT_VALID are
    /// added if they apply; reserved bits are cleared.
    pub flags: HeaderFlags,
    /// `overflow_sat`.
    pub overflow: u8,
    /// Status of each channel; 0 in RxPDO.
    pub channel_status: [ChannelStatus; CHANNELS],
}
