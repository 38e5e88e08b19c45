//! Reading the packets of an image one by one (manual 8).

use core::iter::FusedIterator;

use super::diagnosis::{HeaderExcerpt, ImageFault, ParseDiagnosis, PdoError};
use super::header::Header;
use super::packet::{
    CONTROL_BYTES, EXTENDED_AUX_SHIFT, FramePacket, Packet, ResultCode, STANDARD_AUX_SHIFT,
    STANDARD_FIELD_BITS, TX_RESULT_BYTES, Timestamp, TxResult, WINDOW_BYTES, format_size,
};
use crate::can::control::{ControlWord, KIND_CAN_FRAME, KIND_TX_RESULT};
use crate::can::{CanId, FrameRef};
use crate::mapping::{Direction, HEADER_BYTES};

/// Format rules of packets for a profile and direction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rules {
    pub direction: Direction,
    // As wide as the test of a bit.
    pub channel_mask: u32,
    pub formats: u8,
    pub d64: bool,
    pub align_mask: usize,
}

/// Packets of an image, in order. Ends after the first error: the packets before it are valid, the
/// location of the next one is unknown.
#[derive(Clone, Debug)]
pub struct Packets<'a> {
    header: HeaderExcerpt,
    frame_count: u8,
    rules: Rules,
    position: Position<'a>,
}

/// Position of reading. Passed by value to functions that are not inlined, so that it stays in
/// registers.
#[derive(Clone, Copy, Debug)]
struct Position<'a> {
    rest: &'a [u8],
    counts: Counts,
}

/// Packets left according to the header (bits 0 to 7), index of the next frame (8 to 15) and offset of
/// the rest in the image (16 to 31): one register, and one addition per packet.
#[derive(Clone, Copy, Debug)]
struct Counts(u32);

impl Counts {
    const fn new(left: u8, next_index: u8, offset: u16) -> Self {
        Self(left as u32 | (next_index as u32) << 8 | (offset as u32) << 16)
    }

    #[inline(always)]
    const fn left(self) -> u8 {
        self.0 as u8
    }

    #[inline(always)]
    const fn next_index(self) -> u8 {
        (self.0 >> 8) as u8
    }

    #[inline(always)]
    const fn offset(self) -> u16 {
        (self.0 >> 16) as u16
    }

    /// The cursor after a packet of `size` bytes. At least one packet was left.
    #[inline(always)]
    const fn after(self, size: usize) -> Self {
        Self(self.0.wrapping_add((size as u32) << 16).wrapping_sub(1))
    }

    /// The cursor without packets left.
    const fn at_end(self) -> Self {
        Self::new(0, self.next_index(), self.offset())
    }

    /// The cursor after a frame of `size` bytes.
    #[inline(always)]
    const fn after_frame(self, size: usize) -> Self {
        Self(self.after(size).0.wrapping_add(1 << 8))
    }
}

/// A position among the packets of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PacketCursor {
    // Payload bytes, packets and CAN_FRAME packets before this position.
    consumed: u16,
    packets: u8,
    frames: u8,
}

impl<'a> Packets<'a> {
    #[inline]
    pub(crate) const fn from_start(rules: Rules, header: &Header, payload: &'a [u8]) -> Self {
        let counts = Counts::new(header.frame_count, 0, HEADER_BYTES as u16);
        let position = Position { rest: payload, counts };
        Self { header: HeaderExcerpt::of(header), frame_count: header.frame_count, rules, position }
    }

    #[inline]
    pub(crate) fn from_cursor(
        rules: Rules,
        header: &Header,
        payload: &'a [u8],
        cursor: PacketCursor,
    ) -> Self {
        let position = Position {
            rest: payload.get(usize::from(cursor.consumed)..).unwrap_or_default(),
            counts: Counts::new(
                header.frame_count.saturating_sub(cursor.packets),
                cursor.frames,
                cursor.consumed.saturating_add(HEADER_BYTES as u16),
            ),
        };
        Self { header: HeaderExcerpt::of(header), frame_count: header.frame_count, rules, position }
    }

    /// Position of the next packet, for [`ImageReader::resume`](crate::image::ImageReader::resume).
    #[inline]
    pub const fn cursor(&self) -> PacketCursor {
        let counts = self.position.counts;
        PacketCursor {
            consumed: counts.offset().saturating_sub(HEADER_BYTES as u16),
            packets: self.frame_count.saturating_sub(counts.left()),
            frames: counts.next_index(),
        }
    }
}

impl<'a> Iterator for Packets<'a> {
    type Item = Result<Packet<'a>, ParseDiagnosis>;

    #[inline(always)]
    fn next(&mut self) -> Option<Self::Item> {
        let position = self.position;
        let rules = &self.rules;
        let taken = rules
            .standard_of_eight(position)
            .or_else(|| rules.standard_of_64(position))
            .or_else(|| rules.plain(position));
        if let Some((packet, after)) = taken {
            self.position = after;
            return Some(Ok(Packet::Frame(packet)));
        }
        if position.is_end() {
            return None;
        }
        // A copy, so that the compiler does not keep all of `self` in memory.
        let rules = self.rules;
        let (item, after) = other(self.header, &rules, position);
        self.position = after;
        Some(item)
    }
}

impl FusedIterator for Packets<'_> {}

impl<'a> Position<'a> {
    #[inline(always)]
    const fn after(self, size: usize, rest: &'a [u8]) -> Self {
        Self { rest, counts: self.counts.after(size) }
    }

    #[inline(always)]
    const fn after_frame(self, size: usize, rest: &'a [u8]) -> Self {
        Self { rest, counts: self.counts.after_frame(size) }
    }

    /// True if all packets of the header were read and no bytes are left.
    #[inline(always)]
    const fn is_end(self) -> bool {
        self.counts.left() == 0 && self.rest.is_empty()
    }

    #[inline(always)]
    fn control(self) -> Option<ControlWord> {
        self.rest.first_chunk().map(|bytes| ControlWord(u16::from_le_bytes(*bytes)))
    }
}

impl Rules {
    #[inline(always)]
    const fn padded(&self, raw: usize) -> usize {
        (raw + self.align_mask) & !self.align_mask
    }

    #[inline(always)]
    const fn has_channel(&self, control: ControlWord) -> bool {
        self.channel_mask >> (control.0 & 7) & 1 != 0
    }

    /// Bytes of a CAN_FRAME packet (manual 8.3).
    #[inline(always)]
    fn frame_size(&self, control: ControlWord) -> usize {
        let id = if control.has(ControlWord::IDE) { 4 } else { 2 };
        let data = if control.is_remote() {
            0
        } else if control.has(ControlWord::D64) {
            WINDOW_BYTES
        } else {
            control.dlc().fd_len()
        };
        self.padded(CONTROL_BYTES + id + format_size(control.tsf()) + data)
    }

    /// Rules of the control word (manual 8.2, 8.4).
    fn check(&self, control: ControlWord) -> Result<(), PdoError> {
        if !self.has_channel(control) {
            return Err(PdoError::InvalidChannel);
        }
        if self.formats >> control.tsf() & 1 == 0 {
            return Err(PdoError::InvalidTsf);
        }
        if !control.has(ControlWord::FDF) {
            if control.dlc().value() > 8 {
                return Err(PdoError::InvalidDlc);
            }
            if control.has(ControlWord::BRS) {
                return Err(PdoError::ReservedBit);
            }
            if control.has(ControlWord::D64) {
                return Err(PdoError::InvalidDlc);
            }
        }
        if control.has(ControlWord::D64) && !self.d64 {
            return Err(PdoError::FrameOverrun);
        }
        Ok(())
    }

    /// Reads a classic frame of 8 bytes with a standard CAN ID, if that is next: most frames.
    #[inline(always)]
    fn standard_of_eight<'a>(
        &self,
        position: Position<'a>,
    ) -> Option<(FramePacket<'a>, Position<'a>)> {
        self.standard_of_size::<12>(position, ControlWord::is_standard_of_eight)
    }

    /// Reads a CAN FD frame of 64 bytes with a standard CAN ID, if that is next.
    #[inline(always)]
    fn standard_of_64<'a>(
        &self,
        position: Position<'a>,
    ) -> Option<(FramePacket<'a>, Position<'a>)> {
        self.standard_of_size::<68>(position, ControlWord::is_standard_of_64)
    }

    /// Reads a packet of `SIZE` bytes with a standard CAN ID, if its control word is `known`. With a
    /// known size the next packet need not wait for the DLC of this one; `SIZE` is a multiple of 4, so
    /// there is no padding.
    #[inline(always)]
    fn standard_of_size<'a, const SIZE: usize>(
        &self,
        position: Position<'a>,
        known: impl Fn(ControlWord) -> bool,
    ) -> Option<(FramePacket<'a>, Position<'a>)> {
        let (packet, rest) = position.rest.split_first_chunk::<SIZE>()?;
        let (head, data) = packet.split_first_chunk::<4>()?;
        // One load.
        let head = u32::from_le_bytes(*head);
        let (control, field) = (ControlWord(head as u16), (head >> 16) as u16);
        let is_reserved = field >> STANDARD_FIELD_BITS != 0;
        if !known(control) | is_reserved
            || position.counts.left() == 0
            || !self.has_channel(control)
        {
            return None;
        }
        let packet = FramePacket {
            direction: self.direction,
            channel: control.channel(),
            id_aux: (field >> STANDARD_AUX_SHIFT) as u8,
            frame: FrameRef::from_checked(CanId::standard_bits(field), control, data),
            timestamp: Timestamp::None,
            index: position.counts.next_index(),
            offset: position.counts.offset(),
        };
        Some((packet, position.after_frame(SIZE, rest)))
    }

    /// Reads a frame without timestamp and window, if that is next.
    #[inline(always)]
    fn plain<'a>(&self, position: Position<'a>) -> Option<(FramePacket<'a>, Position<'a>)> {
        // All formats at once, without branches: the next format cannot be predicted. The last
        // packets may be shorter.
        let (control, id) = position.rest.first_chunk::<6>()?.split_first_chunk()?;
        let control = ControlWord(u16::from_le_bytes(*control));
        let field = u32::from_le_bytes(*id.first_chunk()?);
        let size = control.plain_size();
        let is_extended = control.has(ControlWord::IDE);
        let is_reserved = !is_extended & (field as u16 >> STANDARD_FIELD_BITS != 0);
        if position.counts.left() == 0 || (size == 0) | is_reserved | !self.has_channel(control) {
            return None;
        }
        let start = CONTROL_BYTES + if is_extended { 4 } else { 2 };
        let (packet, rest) = position.rest.split_at_checked(self.padded(size))?;
        let (id, id_aux) = if is_extended {
            (CanId::extended_bits(field), field >> EXTENDED_AUX_SHIFT)
        } else {
            (CanId::standard_bits(field as u16), (field as u16 >> STANDARD_AUX_SHIFT).into())
        };
        let packet = FramePacket {
            direction: self.direction,
            channel: control.channel(),
            id_aux: id_aux as u8,
            frame: FrameRef::from_checked(id, control, packet.get(start..size)?),
            timestamp: Timestamp::None,
            index: position.counts.next_index(),
            offset: position.counts.offset(),
        };
        Some((packet, position.after_frame(self.padded(size), rest)))
    }

    fn take_frame<'a>(
        &self,
        position: Position<'a>,
        control: ControlWord,
    ) -> Result<(FramePacket<'a>, Position<'a>), PdoError> {
        let extended = control.has(ControlWord::IDE);
        let length = if control.is_remote() { 0 } else { control.dlc().fd_len() };
        let size = self.frame_size(control);
        let Some((packet, after)) = position.rest.split_at_checked(size) else {
            return Err(PdoError::Truncated);
        };
        let (id, id_aux, rest) = if extended {
            let ([_, _, b0, b1, b2, b3], rest) = split(packet);
            let field = u32::from_le_bytes([b0, b1, b2, b3]);
            let id_aux = (field >> EXTENDED_AUX_SHIFT) as u8;
            (CanId::extended_bits(field), id_aux, rest)
        } else {
            let ([_, _, b0, b1], rest) = split(packet);
            let field = u16::from_le_bytes([b0, b1]);
            if field >> STANDARD_FIELD_BITS != 0 {
                return Err(PdoError::ReservedBit);
            }
            let id_aux = (field >> STANDARD_AUX_SHIFT) as u8;
            (CanId::standard_bits(field), id_aux, rest)
        };
        let (timestamp, rest) = take_timestamp(control.tsf(), rest);
        // infallible: the packet's size was computed from these fields
        let data = rest.get(..length).unwrap_or_default();
        let packet = FramePacket {
            direction: self.direction,
            channel: control.channel(),
            id_aux,
            frame: FrameRef::from_checked(id, control, data),
            timestamp,
            index: position.counts.next_index(),
            offset: position.counts.offset(),
        };
        Ok((packet, position.after_frame(size, after)))
    }

    fn tx_result<'a>(
        &self,
        position: Position<'a>,
        control: ControlWord,
    ) -> Result<(TxResult, Position<'a>), PdoError> {
        if self.direction != Direction::TxPdo {
            return Err(PdoError::UnknownKind);
        }
        let size = self.padded(TX_RESULT_BYTES);
        let Some((packet, after)) = position.rest.split_at_checked(size) else {
            return Err(PdoError::Truncated);
        };
        let ([_, _, sequence0, sequence1, frame_index, code], _) = split(packet);
        let result = TxResult {
            channel: control.channel(),
            sequence: u16::from_le_bytes([sequence0, sequence1]),
            frame_index,
            code: ResultCode::from_raw(code),
        };
        Ok((result, position.after(size, after)))
    }
}

/// Everything except a valid plain frame: other frames and kinds, and errors.
#[inline(never)]
fn other<'a>(
    header: HeaderExcerpt,
    rules: &Rules,
    position: Position<'a>,
) -> (Result<Packet<'a>, ParseDiagnosis>, Position<'a>) {
    let Some(control) = position.control() else {
        let error =
            if position.rest.is_empty() { PdoError::BadHeader } else { PdoError::Truncated };
        return fault(header, rules, position, error, ControlWord(0));
    };
    let taken = match control.kind() {
        _ if position.counts.left() == 0 => Err(PdoError::BadHeader),
        KIND_CAN_FRAME => match rules.check(control) {
            Ok(()) => rules
                .take_frame(position, control)
                .map(|(packet, after)| (Packet::Frame(packet), after)),
            Err(error) => Err(error),
        },
        KIND_TX_RESULT => rules
            .tx_result(position, control)
            .map(|(result, after)| (Packet::TxResult(result), after)),
        _ => Err(PdoError::UnknownKind),
    };
    match taken {
        Ok((packet, after)) => (Ok(packet), after),
        Err(error) => fault(header, rules, position, error, control),
    }
}

/// Ends the iteration with the diagnosis of the packet at this position.
#[cold]
#[inline(never)]
fn fault<'a>(
    header: HeaderExcerpt,
    rules: &Rules,
    position: Position<'a>,
    error: PdoError,
    control: ControlWord,
) -> (Result<Packet<'a>, ParseDiagnosis>, Position<'a>) {
    let size = match control.kind() {
        KIND_CAN_FRAME => rules.frame_size(control),
        KIND_TX_RESULT => rules.padded(TX_RESULT_BYTES),
        _ => CONTROL_BYTES,
    };
    let diagnosis = ParseDiagnosis {
        offset: position.counts.offset(),
        packet_end: position.counts.offset().wrapping_add(size as u16),
        ctrl: control.0,
        channel: control.channel(),
        dlc: control.dlc().value(),
        tsf: control.tsf(),
        kind: control.kind(),
        ..ParseDiagnosis::of_excerpt(header, ImageFault::Pdo(error), 0)
    };
    (Err(diagnosis), Position { rest: &[], counts: position.counts.at_end() })
}

/// The timestamp field of this format, and the rest.
fn take_timestamp(tsf: u8, bytes: &[u8]) -> (Timestamp, &[u8]) {
    match tsf {
        0 => (Timestamp::None, bytes),
        1 => {
            let (value, rest) = split(bytes);
            (Timestamp::Delta16(u16::from_le_bytes(value)), rest)
        }
        2 => {
            let (value, rest) = split(bytes);
            (Timestamp::Delta32(u32::from_le_bytes(value)), rest)
        }
        _ => {
            let (value, rest) = split(bytes);
            (Timestamp::Full64(u64::from_le_bytes(value)), rest)
        }
    }
}

/// The first `N` bytes and the rest.
#[inline(always)]
fn split<const N: usize>(bytes: &[u8]) -> ([u8; N], &[u8]) {
    match bytes.split_first_chunk::<N>() {
        Some((first, rest)) => (*first, rest),
        // infallible: the packet's size was computed from these fields
        None => ([0; N], &[]),
    }
}
