//! CAN frames: borrowed and owned.
//!
//! Length of a frame on the bus by its format: without stuff bits, and with the largest possible number
//! (ISO 11898-1).

use core::fmt;

use super::can_id::{CanId, FrameError};
use super::control::{ControlWord, Dlc};
use crate::copy::copy_data;

/// Kind of a CAN frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FrameKind {
    /// Classic CAN data frame, up to 8 bytes.
    Data,
    /// Classic CAN remote frame: a DLC without data.
    Remote,
    /// CAN FD frame, up to 64 bytes.
    Fd {
        /// The data phase runs at the data bit rate.
        brs: bool,
        /// Error state indicator: the sender is error passive.
        esi: bool,
    },
}

const fn frame_bits(id: CanId, kind: FrameKind, dlc: Dlc) -> u16 {
    let ide = if id.is_extended() { ControlWord::IDE } else { 0 };
    let format = match kind {
        FrameKind::Data => 0,
        FrameKind::Remote => ControlWord::X,
        FrameKind::Fd { brs, esi } => {
            ControlWord::FDF
                | if brs { ControlWord::BRS } else { 0 }
                | if esi { ControlWord::X } else { 0 }
        }
    };
    ide | format | (dlc.value() as u16) << 3
}

/// The methods that read `id` and `bits`, which both frames have.
macro_rules! frame_getters {
    () => {
        /// The CAN ID.
        #[inline]
        pub const fn id(&self) -> CanId {
            self.id
        }

        /// The kind: classic data, remote or CAN FD.
        #[inline]
        pub const fn kind(&self) -> FrameKind {
            let word = ControlWord(self.bits);
            if word.has(ControlWord::FDF) {
                FrameKind::Fd { brs: word.has(ControlWord::BRS), esi: word.has(ControlWord::X) }
            } else if word.has(ControlWord::X) {
                FrameKind::Remote
            } else {
                FrameKind::Data
            }
        }

        /// The data length code.
        #[inline]
        pub const fn dlc(&self) -> Dlc {
            ControlWord(self.bits).dlc()
        }

        /// True for a CAN FD frame.
        #[inline]
        pub const fn is_fd(&self) -> bool {
            ControlWord(self.bits).has(ControlWord::FDF)
        }

        /// True for a remote frame.
        #[inline]
        pub const fn is_remote(&self) -> bool {
            ControlWord(self.bits).is_remote()
        }

        /// True if the DLC is 0.
        #[inline]
        pub const fn is_empty(&self) -> bool {
            self.len() == 0
        }
    };
}

/// A CAN frame whose data is borrowed.
///
/// It is valid by construction: CAN ID in range, a data length that the DLC can express, no data in a
/// remote frame.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct FrameRef<'a> {
    id: CanId,
    // DLC, IDE, FDF, BRS and X at their positions in the control word, so that packing is an OR.
    bits: u16,
    data: &'a [u8],
}

impl<'a> FrameRef<'a> {
    frame_getters!();

    /// Creates a classic CAN data frame.
    ///
    /// # Errors
    /// [`FrameError::Length`] for more than 8 bytes.
    #[inline]
    pub const fn classic(id: CanId, data: &'a [u8]) -> Result<Self, FrameError> {
        match Dlc::from_classic_len(data.len()) {
            Some(dlc) => Ok(Self { id, bits: frame_bits(id, FrameKind::Data, dlc), data }),
            None => Err(FrameError::Length { length: data.len(), fd: false }),
        }
    }

    /// Creates a classic CAN remote frame that requests `dlc` bytes.
    ///
    /// # Errors
    /// [`FrameError::RemoteDlc`] above 8.
    #[inline]
    pub const fn remote(id: CanId, dlc: Dlc) -> Result<Self, FrameError> {
        if dlc.value() > 8 {
            return Err(FrameError::RemoteDlc { dlc: dlc.value() });
        }
        Ok(Self { id, bits: frame_bits(id, FrameKind::Remote, dlc), data: &[] })
    }

    /// Creates a CAN FD frame. `brs` switches to the data bit rate, `esi` is the error state indicator.
    ///
    /// # Errors
    /// [`FrameError::Length`] if no DLC stands for this number of bytes.
    #[inline]
    pub const fn fd(id: CanId, data: &'a [u8], brs: bool, esi: bool) -> Result<Self, FrameError> {
        match Dlc::from_fd_len(data.len()) {
            Some(dlc) => {
                Ok(Self { id, bits: frame_bits(id, FrameKind::Fd { brs, esi }, dlc), data })
            }
            None => Err(FrameError::Length { length: data.len(), fd: true }),
        }
    }

    /// Creates a frame from a checked control word and the data of its DLC.
    #[inline]
    pub(crate) const fn from_checked(id: CanId, control: ControlWord, data: &'a [u8]) -> Self {
        Self { id, bits: control.0 & ControlWord::FRAME_BITS, data }
    }

    /// The frame as scalars, for [`from_parts`](Self::from_parts) in a function that is not inlined: a
    /// frame in memory is read in other pieces than it was written, and waits for the stores.
    #[doc(hidden)]
    #[inline(always)]
    pub const fn into_parts(self) -> (u64, &'a [u8]) {
        (self.id.bits() as u64 | (self.bits as u64) << 32, self.data)
    }

    /// The frame of [`into_parts`](Self::into_parts).
    #[doc(hidden)]
    #[inline(always)]
    pub const fn from_parts(head: u64, data: &'a [u8]) -> Self {
        Self { id: CanId::from_bits(head as u32), bits: (head >> 32) as u16, data }
    }

    #[inline]
    pub(crate) const fn control_bits(&self) -> u16 {
        self.bits
    }

    /// The data bytes; empty in a remote frame.
    #[inline]
    pub const fn data(&self) -> &'a [u8] {
        self.data
    }

    /// Bytes that the DLC stands for: the length of the data, or the length that a remote frame
    /// requests.
    #[inline]
    pub const fn len(&self) -> usize {
        if self.is_remote() { self.dlc().value() as usize } else { self.data.len() }
    }

    /// Copies the data, followed by zeros.
    #[inline]
    pub fn padded_data(&self) -> [u8; 64] {
        let mut data = [0; 64];
        copy_data(&mut data, self.data);
        data
    }

    /// Copies the frame into one that owns its data.
    #[inline]
    pub fn to_owned(&self) -> CanFrame {
        CanFrame { id: self.id, bits: self.bits, data: self.padded_data() }
    }
}

/// A CAN frame that owns its data; the bytes after the data are zero.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct CanFrame {
    id: CanId,
    bits: u16,
    data: [u8; 64],
}

impl CanFrame {
    frame_getters!();

    /// As [`FrameRef::classic`].
    pub fn classic(id: CanId, data: &[u8]) -> Result<Self, FrameError> {
        FrameRef::classic(id, data).map(|frame| frame.to_owned())
    }

    /// As [`FrameRef::remote`].
    pub fn remote(id: CanId, dlc: Dlc) -> Result<Self, FrameError> {
        FrameRef::remote(id, dlc).map(|frame| frame.to_owned())
    }

    /// As [`FrameRef::fd`].
    pub fn fd(id: CanId, data: &[u8], brs: bool, esi: bool) -> Result<Self, FrameError> {
        FrameRef::fd(id, data, brs, esi).map(|frame| frame.to_owned())
    }

    /// Returns the frame as a borrowed view.
    #[inline]
    pub fn as_ref(&self) -> FrameRef<'_> {
        FrameRef { id: self.id, bits: self.bits, data: self.data() }
    }

    /// The data bytes; empty in a remote frame.
    #[inline]
    pub fn data(&self) -> &[u8] {
        let length = if self.is_remote() { 0 } else { self.dlc().fd_len() };
        // infallible: no DLC stands for more than 64 bytes
        self.data.get(..length).unwrap_or_default()
    }

    /// Bytes that the DLC stands for: the length of the data, or the length that a remote frame
    /// requests.
    #[inline]
    pub const fn len(&self) -> usize {
        if self.is_fd() { self.dlc().fd_len() } else { self.dlc().classic_len() }
    }
}

impl From<FrameRef<'_>> for CanFrame {
    #[inline]
    fn from(frame: FrameRef<'_>) -> Self {
        frame.to_owned()
    }
}

impl<'a> From<&'a CanFrame> for FrameRef<'a> {
    #[inline]
    fn from(frame: &'a CanFrame) -> Self {
        frame.as_ref()
    }
}

impl fmt::Debug for FrameRef<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {:?} dlc {} ", self.id, self.kind(), self.dlc())?;
        f.debug_list().entries(self.data).finish()
    }
}

impl fmt::Debug for CanFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&self.as_ref(), f)
    }
}

const CRC15_BITS: u32 = 15;
const CRC_DELIMITER_BITS: u32 = 1;
/// Acknowledge slot and delimiter, end of frame, intermission.
const TRAILER_BITS: u32 = 2 + 7 + 3;
/// ESI and DLC, which an FD frame sends after the bit rate switch.
const FD_CONTROL_BITS: u32 = 1 + 4;

/// Bits of one frame on the bus, from SOF to the end of the intermission.
///
/// With bit rate switching the CRC delimiter counts as the last bit of the data phase, and BRS as
/// the last one before it: exact if both phases have the same sample point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameBits {
    /// Bits at the nominal bit rate.
    pub nominal: u32,
    /// Bits at the data bit rate; 0 without bit rate switching.
    pub data: u32,
}

impl FrameBits {
    /// Returns the bits of the frame with only the fixed stuff bits of CAN FD. Only the sizes of CAN ID
    /// and data count. Real-time safe.
    pub fn least(frame: FrameRef<'_>) -> Self {
        let data_bits = 8 * frame.data().len() as u32;
        match frame.kind() {
            FrameKind::Data | FrameKind::Remote => Self {
                nominal: classic_stuffed(frame) + CRC_DELIMITER_BITS + TRAILER_BITS,
                data: 0,
            },
            FrameKind::Fd { brs, .. } => {
                let head = fd_head(frame) + TRAILER_BITS;
                let body = FD_CONTROL_BITS + data_bits + crc_field(frame) + CRC_DELIMITER_BITS;
                Self::in_phases(head, body, brs)
            }
        }
    }

    /// Returns the bits of the frame with the largest number of stuff bits for its sizes: one after the
    /// first five bits, then one after every four. Real-time safe.
    pub fn most(frame: FrameRef<'_>) -> Self {
        let least = Self::least(frame);
        match frame.kind() {
            FrameKind::Data | FrameKind::Remote => {
                Self { nominal: least.nominal + (classic_stuffed(frame) - 1) / 4, data: 0 }
            }
            FrameKind::Fd { brs, .. } => {
                // A stuff bit belongs to the phase of the next bit, and five equal bits at the end
                // of the data field get none: the CRC field begins with a fixed one.
                let before = (fd_head(frame) - 2) / 4;
                let after = 1 + (FD_CONTROL_BITS + 8 * frame.data().len() as u32 - 1) / 4;
                let stuff = Self::in_phases(before, after, brs);
                Self { nominal: least.nominal + stuff.nominal, data: least.data + stuff.data }
            }
        }
    }

    const fn in_phases(head: u32, body: u32, brs: bool) -> Self {
        if brs {
            Self { nominal: head, data: body }
        } else {
            Self { nominal: head + body, data: 0 }
        }
    }

    /// Bits of both phases.
    pub const fn total(self) -> u32 {
        self.nominal + self.data
    }

    /// Time on the bus in seconds, at bit rates in bit/s; a rate of 0 counts as 1.
    pub fn seconds(self, nominal_bitrate: u32, data_bitrate: u32) -> f64 {
        f64::from(self.nominal) / f64::from(nominal_bitrate.max(1))
            + f64::from(self.data) / f64::from(data_bitrate.max(1))
    }
}

/// Bits of a classic frame that are stuffed: SOF to the end of the CRC sequence.
fn classic_stuffed(frame: FrameRef<'_>) -> u32 {
    // SOF; CAN ID with RTR, and SRR where extended; IDE; reserved bits; DLC.
    let header = if frame.id().is_extended() { 1 + 31 + 1 + 2 + 4 } else { 1 + 12 + 1 + 1 + 4 };
    header + 8 * frame.data().len() as u32 + CRC15_BITS
}

/// Bits of an FD frame from SOF to BRS.
fn fd_head(frame: FrameRef<'_>) -> u32 {
    // SOF; CAN ID with RRS, and SRR where extended; IDE; FDF, res, BRS.
    if frame.id().is_extended() { 1 + 31 + 1 + 3 } else { 1 + 12 + 1 + 3 }
}

/// Stuff count, CRC and their fixed stuff bits: one before them, one after every four bits.
fn crc_field(frame: FrameRef<'_>) -> u32 {
    let bits = if frame.data().len() > 16 { 4 + 21 } else { 4 + 17 };
    bits + 1 + bits / 4
}

#[cfg(test)]
mod tests {
    use super::{CanFrame, FrameError, FrameKind, FrameRef};
    use crate::can::{CanId, Dlc};

    fn id() -> CanId {
        CanId::standard(0x123).unwrap()
    }

    #[test]
    fn classic_frame_with_nine_bytes_returns_error() {
        let frame = CanFrame::classic(id(), &[1; 8]).unwrap();
        assert_eq!(frame.data(), [1; 8]);
        assert_eq!(frame.kind(), FrameKind::Data);
        assert_eq!(
            CanFrame::classic(id(), &[1; 9]),
            Err(FrameError::Length { length: 9, fd: false })
        );
    }

    #[test]
    fn remote_frame_has_length_and_no_data() {
        let frame = CanFrame::remote(id(), Dlc::new(5).unwrap()).unwrap();
        assert_eq!((frame.len(), frame.data().len()), (5, 0));
        assert!(frame.is_remote() && !frame.is_fd());
        assert_eq!(
            CanFrame::remote(id(), Dlc::new(9).unwrap()),
            Err(FrameError::RemoteDlc { dlc: 9 })
        );
    }

    #[test]
    fn fd_frame_accepts_only_dlc_lengths() {
        for length in 0..=64 {
            let data = [7; 64];
            let frame = CanFrame::fd(id(), &data[..length], true, false);
            match Dlc::from_fd_len(length) {
                Some(dlc) => {
                    let frame = frame.unwrap();
                    assert_eq!(frame.dlc(), dlc);
                    assert_eq!(frame.len(), length);
                    assert_eq!(frame.data(), &data[..length]);
                    assert_eq!(frame.kind(), FrameKind::Fd { brs: true, esi: false });
                }
                None => assert_eq!(frame, Err(FrameError::Length { length, fd: true })),
            }
        }
    }

    #[test]
    fn frame_borrow_round_trip() {
        let data = [9; 12];
        let frame = FrameRef::fd(CanId::extended(0x1234_5678).unwrap(), &data, false, true);
        let frame = frame.unwrap();
        assert_eq!(frame.to_owned().as_ref(), frame);
    }
}

#[cfg(test)]
mod frame_bits_tests {
    use super::*;
    use crate::can::{CanFrame, CanId, Dlc};

    fn standard() -> CanId {
        CanId::standard(0).unwrap()
    }

    fn extended() -> CanId {
        CanId::extended(0).unwrap()
    }

    fn totals(frame: CanFrame) -> (u32, u32) {
        let frame = frame.as_ref();
        (FrameBits::least(frame).total(), FrameBits::most(frame).total())
    }

    /// 1 + 11 + 1 + 1 + 1 + 4 + 15 + 1 + 2 + 7 + 3 = 47 and 8 a byte; 34 of them and the data are
    /// stuffed: 33/4 = 8, 97/4 = 24. Extended there are 20 more: (118 - 1)/4 = 29.
    #[test]
    fn classic_frame_bits_match_the_literature() {
        let frame = |id, length| CanFrame::classic(id, &[0; 8][..length]).unwrap();
        assert_eq!(totals(frame(standard(), 0)), (47, 55));
        assert_eq!(totals(frame(standard(), 6)), (95, 115));
        assert_eq!(totals(frame(standard(), 8)), (111, 135));
        assert_eq!(totals(frame(extended(), 0)), (67, 80));
        assert_eq!(totals(frame(extended(), 8)), (131, 160));
        let remote = CanFrame::remote(standard(), Dlc::new(8).unwrap()).unwrap();
        assert_eq!(totals(remote), (47, 55));
    }

    /// Standard, 64 bytes: 17 up to BRS and 12 after the CRC delimiter; 5 + 512 + 32 + 1 between.
    /// Stuff bits: after bit 5, 9, 13 before the switch; after bit 17, 21, .. of the 517.
    #[test]
    fn fd_frame_bits_are_counted_by_phase() {
        let frame = CanFrame::fd(standard(), &[0; 64], true, false).unwrap();
        assert_eq!(FrameBits::least(frame.as_ref()), FrameBits { nominal: 29, data: 550 });
        assert_eq!(
            FrameBits::most(frame.as_ref()),
            FrameBits { nominal: 29 + 3, data: 550 + 1 + 129 }
        );
        let steady = CanFrame::fd(standard(), &[0; 64], false, false).unwrap();
        assert_eq!(FrameBits::most(steady.as_ref()), FrameBits { nominal: 712, data: 0 });
        // 4 + 17 + 6 bits of CRC field up to 16 bytes.
        let short = CanFrame::fd(extended(), &[0; 16], true, false).unwrap();
        assert_eq!(
            FrameBits::least(short.as_ref()),
            FrameBits { nominal: 36 + 12, data: 5 + 128 + 27 + 1 }
        );
    }

    #[test]
    fn time_adds_both_phases() {
        let bits = FrameBits { nominal: 500, data: 5_000 };
        assert!((bits.seconds(500_000, 5_000_000) - 0.002).abs() < 1e-12);
        assert!(bits.seconds(0, 0).is_finite());
    }
}
