//! Reading the packets of an image one by one (manual 8).

use core::iter::FusedIterator;

use crate::can_id::CanId;
use crate::control::{ControlWord, KIND_CAN_FRAME, KIND_TX_RESULT};
use crate::diagnosis::{ImageFault, ParseDiagnosis, PdoError};
use crate::frame::FrameRef;
use crate::header::Header;
use crate::mapping::{Direction, HEADER_BYTES};
use crate::packet::{
    CONTROL_BYTES, EXTENDED_AUX_SHIFT, FramePacket, Packet, STANDARD_AUX_SHIFT, TX_RESULT_BYTES,
    WINDOW_BYTES,
};
use crate::timestamp::{Timestamp, format_size};
use crate::tx_result::{ResultCode, TxResult};

/// What packets may look like under a profile and direction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rules {
    pub direction: Direction,
    pub channel_mask: u8,
    pub formats: u8,
    pub d64: bool,
    pub align_mask: usize,
}

/// Packets of an image, in order. Ends after the first error: what came before stays valid, but
/// the place of what follows is unknown.
#[derive(Clone, Debug)]
pub struct Packets<'a> {
    header: Header,
    rest: &'a [u8],
    rules: Rules,
    // Packets that the header still promises.
    left: u8,
    next_index: u8,
}

/// A place among the packets of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PacketCursor {
    // Payload bytes, packets and CAN_FRAME packets before this place.
    consumed: u16,
    packets: u8,
    frames: u8,
}

impl<'a> Packets<'a> {
    #[inline]
    pub(crate) const fn from_start(rules: Rules, header: &Header, payload: &'a [u8]) -> Self {
        Self { header: *header, rest: payload, rules, left: header.frame_count, next_index: 0 }
    }

    #[inline]
    pub(crate) fn from_cursor(
        rules: Rules,
        header: &Header,
        payload: &'a [u8],
        cursor: PacketCursor,
    ) -> Self {
        Self {
            header: *header,
            rest: payload.get(usize::from(cursor.consumed)..).unwrap_or_default(),
            rules,
            left: header.frame_count.saturating_sub(cursor.packets),
            next_index: cursor.frames,
        }
    }

    /// The place of the next packet, for [`ImageReader::resume`](crate::ImageReader::resume).
    #[inline]
    #[must_use]
    pub const fn cursor(&self) -> PacketCursor {
        PacketCursor {
            consumed: self.header.payload_len.saturating_sub(self.rest.len() as u16),
            packets: self.header.frame_count.saturating_sub(self.left),
            frames: self.next_index,
        }
    }

    /// Offset of the current position in the image.
    #[inline(always)]
    const fn offset(&self) -> usize {
        // infallible: the rest is part of a payload of this length
        HEADER_BYTES + self.header.payload_len as usize - self.rest.len()
    }

    /// Ends the iteration with what is known about the packet at the current position.
    #[cold]
    #[inline(never)]
    fn fault(&mut self, error: PdoError, control: ControlWord) -> ParseDiagnosis {
        let size = match control.kind() {
            KIND_CAN_FRAME => self.frame_size(control),
            KIND_TX_RESULT => self.padded(TX_RESULT_BYTES),
            _ => CONTROL_BYTES,
        };
        let offset = self.offset();
        self.rest = &[];
        self.left = 0;
        ParseDiagnosis {
            offset: offset as u16,
            packet_end: (offset + size) as u16,
            ctrl: control.0,
            channel: control.channel(),
            dlc: control.dlc().value(),
            tsf: control.tsf(),
            kind: control.kind(),
            ..ParseDiagnosis::of_image(&self.header, ImageFault::Pdo(error), 0)
        }
    }

    #[inline(always)]
    const fn padded(&self, raw: usize) -> usize {
        (raw + self.rules.align_mask) & !self.rules.align_mask
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
        if self.rules.formats >> control.tsf() & 1 == 0 {
            return Err(PdoError::InvalidTsf);
        }
        if !control.has(ControlWord::FDF) {
            if control.dlc().value() > 8 {
                return Err(PdoError::InvalidDlc);
            }
            if control.has(ControlWord::BRS) {
                return Err(PdoError::ReservedBit);
            }
            // A remote frame has no data for a window to hold, so the mark is without effect.
            if control.has(ControlWord::D64) && !control.is_remote() {
                return Err(PdoError::InvalidDlc);
            }
        }
        if control.has(ControlWord::D64) && !self.rules.d64 {
            return Err(PdoError::FrameOverrun);
        }
        Ok(())
    }

    #[inline(always)]
    const fn has_channel(&self, control: ControlWord) -> bool {
        self.rules.channel_mask >> control.channel() & 1 != 0
    }

    /// Takes a packet whose control word has passed the rules. `PLAIN` frames, nearly all, have
    /// data of the DLC's length, no timestamp and no window.
    #[inline(always)]
    fn take_frame<const PLAIN: bool>(
        &mut self,
        control: ControlWord,
    ) -> Result<FramePacket<'a>, PdoError> {
        let extended = control.has(ControlWord::IDE);
        let length = if !PLAIN && control.is_remote() { 0 } else { control.dlc().fd_len() };
        let size = if PLAIN {
            self.padded(CONTROL_BYTES + if extended { 4 } else { 2 } + length)
        } else {
            self.frame_size(control)
        };
        let Some((packet, behind)) = self.rest.split_at_checked(size) else {
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
            if field >> 14 != 0 {
                return Err(PdoError::ReservedBit);
            }
            let id_aux = (field >> STANDARD_AUX_SHIFT) as u8;
            (CanId::standard_bits(field), id_aux, rest)
        };
        let (timestamp, rest) =
            if PLAIN { (Timestamp::None, rest) } else { take_timestamp(control.tsf(), rest) };
        // infallible: the packet's size was computed from these very fields
        let data = rest.get(..length).unwrap_or_default();
        let index = self.next_index;
        let offset = self.offset() as u16;
        self.rest = behind;
        self.left = self.left.saturating_sub(1);
        self.next_index = index.wrapping_add(1);
        Ok(FramePacket {
            direction: self.rules.direction,
            channel: control.channel(),
            id_aux,
            frame: FrameRef::from_checked(id, control, data),
            timestamp,
            index,
            offset,
        })
    }

    /// Takes the TX_RESULT packet at the current position.
    fn tx_result(&mut self, control: ControlWord) -> Result<TxResult, PdoError> {
        if self.rules.direction != Direction::TxPdo {
            return Err(PdoError::UnknownKind);
        }
        let size = self.padded(TX_RESULT_BYTES);
        let Some((packet, behind)) = self.rest.split_at_checked(size) else {
            return Err(PdoError::Truncated);
        };
        let ([_, _, sequence0, sequence1, frame_index, code], _) = split(packet);
        self.rest = behind;
        self.left = self.left.saturating_sub(1);
        Ok(TxResult {
            channel: control.channel(),
            sequence: u16::from_le_bytes([sequence0, sequence1]),
            frame_index,
            code: ResultCode::from_raw(code),
        })
    }

    /// Everything but an intact plain frame: other frames and kinds, the end of the payload, and
    /// what is wrong.
    #[inline(never)]
    fn other(&mut self) -> Option<Result<Packet<'a>, ParseDiagnosis>> {
        let Some(&bytes) = self.rest.first_chunk::<CONTROL_BYTES>() else {
            let error = match (self.rest.is_empty(), self.left) {
                (true, 0) => return None,
                (true, _) => PdoError::BadHeader,
                (false, _) => PdoError::Truncated,
            };
            return Some(Err(self.fault(error, ControlWord(0))));
        };
        let control = ControlWord(u16::from_le_bytes(bytes));
        let result = match control.kind() {
            _ if self.left == 0 => Err(PdoError::BadHeader),
            KIND_CAN_FRAME => match self.check(control) {
                Ok(()) => self.take_frame::<false>(control).map(Packet::Frame),
                Err(error) => Err(error),
            },
            KIND_TX_RESULT => self.tx_result(control).map(Packet::TxResult),
            _ => Err(PdoError::UnknownKind),
        };
        Some(result.map_err(|error| self.fault(error, control)))
    }
}

impl<'a> Iterator for Packets<'a> {
    type Item = Result<Packet<'a>, ParseDiagnosis>;

    #[inline]
    fn next(&mut self) -> Option<Self::Item> {
        if let Some(&bytes) = self.rest.first_chunk::<CONTROL_BYTES>() {
            let control = ControlWord(u16::from_le_bytes(bytes));
            // Most frames; with their size known, the next packet need not wait for this one's DLC.
            if self.left != 0
                && control.is_standard_of_eight()
                && self.has_channel(control)
                && let Ok(packet) = self.take_frame::<true>(ControlWord::standard_of_eight(control))
            {
                return Some(Ok(Packet::Frame(packet)));
            }
            if self.left != 0
                && control.is_plain()
                && self.has_channel(control)
                && let Ok(packet) = self.take_frame::<true>(control)
            {
                return Some(Ok(Packet::Frame(packet)));
            }
        }
        self.other()
    }
}

impl FusedIterator for Packets<'_> {}

/// The timestamp field of this format, and what follows it.
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
        // infallible: the packet's size was computed from these very fields
        None => ([0; N], &[]),
    }
}
