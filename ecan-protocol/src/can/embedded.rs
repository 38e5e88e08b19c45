//! `CanFrame` and `CanId` as types of the embedded-can traits.

use embedded_can::{ExtendedId, Frame, Id, StandardId};

use super::can_id::CanId;
use super::control::Dlc;
use super::frame::CanFrame;

/// Error: the CAN ID does not have the requested format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("CAN ID {id} is {}", if .id.is_extended() { "extended, not standard" } else { "standard, not extended" })]
pub struct IdFormatError {
    /// The CAN ID.
    pub id: CanId,
}

impl From<StandardId> for CanId {
    fn from(id: StandardId) -> Self {
        Self::standard_bits(id.as_raw())
    }
}

impl From<ExtendedId> for CanId {
    fn from(id: ExtendedId) -> Self {
        Self::extended_bits(id.as_raw())
    }
}

impl From<Id> for CanId {
    fn from(id: Id) -> Self {
        match id {
            Id::Standard(id) => id.into(),
            Id::Extended(id) => id.into(),
        }
    }
}

impl TryFrom<CanId> for StandardId {
    type Error = IdFormatError;

    fn try_from(id: CanId) -> Result<Self, IdFormatError> {
        let raw = u16::try_from(id.raw()).ok().filter(|_| !id.is_extended());
        raw.and_then(Self::new).ok_or(IdFormatError { id })
    }
}

impl TryFrom<CanId> for ExtendedId {
    type Error = IdFormatError;

    fn try_from(id: CanId) -> Result<Self, IdFormatError> {
        Self::new(id.raw()).filter(|_| id.is_extended()).ok_or(IdFormatError { id })
    }
}

impl From<CanId> for Id {
    fn from(id: CanId) -> Self {
        // infallible: a CAN ID is in the range of its format
        let raw = id.raw();
        if id.is_extended() {
            ExtendedId::new(raw).unwrap_or(ExtendedId::MAX).into()
        } else {
            StandardId::new(raw as u16).unwrap_or(StandardId::MAX).into()
        }
    }
}

/// Classic CAN frames are created through the trait, CAN FD frames with [`CanFrame::fd`] only.
impl Frame for CanFrame {
    fn new(id: impl Into<Id>, data: &[u8]) -> Option<Self> {
        Self::classic(id.into().into(), data).ok()
    }

    fn new_remote(id: impl Into<Id>, dlc: usize) -> Option<Self> {
        Self::remote(id.into().into(), Dlc::from_classic_len(dlc)?).ok()
    }

    fn is_extended(&self) -> bool {
        self.id().is_extended()
    }

    fn is_remote_frame(&self) -> bool {
        self.is_remote()
    }

    fn id(&self) -> Id {
        CanFrame::id(self).into()
    }

    fn dlc(&self) -> usize {
        self.len()
    }

    fn data(&self) -> &[u8] {
        CanFrame::data(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A driver that is independent of this crate.
    fn echo<F: Frame>(frame: &F) -> Option<F> {
        if frame.is_remote_frame() {
            F::new_remote(frame.id(), frame.dlc())
        } else {
            F::new(frame.id(), frame.data())
        }
    }

    #[test]
    fn classic_frames_pass_through_the_trait_unchanged() {
        for id in [CanId::standard(0x7FF).unwrap(), CanId::extended(0x1FFF_FFFF).unwrap()] {
            for length in 0..=8 {
                let frame = CanFrame::classic(id, &[0xA5; 8][..length]).unwrap();
                assert_eq!(echo(&frame), Some(frame));
                assert_eq!((Frame::dlc(&frame), frame.is_data_frame()), (length, true));
                let dlc = Dlc::from_classic_len(length).unwrap();
                let remote = CanFrame::remote(id, dlc).unwrap();
                assert_eq!(echo(&remote), Some(remote));
                assert_eq!(Frame::is_extended(&remote), id.is_extended());
            }
        }
    }

    #[test]
    fn frame_that_is_not_classic_can_is_not_created() {
        let id = StandardId::new(1).unwrap();
        assert_eq!(<CanFrame as Frame>::new(id, &[0; 9]), None);
        assert_eq!(<CanFrame as Frame>::new_remote(id, 9), None);
        let fd = CanFrame::fd(id.into(), &[0; 64], true, false).unwrap();
        assert_eq!((Frame::dlc(&fd), Frame::data(&fd).len()), (64, 64));
        assert_eq!(echo(&fd), None);
    }

    #[test]
    fn ids_convert_in_both_directions() {
        let standard = CanId::standard(0x123).unwrap();
        let extended = CanId::extended(0x123).unwrap();
        for id in [standard, extended, CanId::extended(CanId::MAX_EXTENDED).unwrap()] {
            assert_eq!(CanId::from(Id::from(id)), id);
        }
        assert_eq!(StandardId::try_from(standard).map(CanId::from), Ok(standard));
        assert_eq!(ExtendedId::try_from(extended).map(CanId::from), Ok(extended));
        assert_eq!(StandardId::try_from(extended), Err(IdFormatError { id: extended }));
        assert_eq!(ExtendedId::try_from(standard), Err(IdFormatError { id: standard }));
    }
}
