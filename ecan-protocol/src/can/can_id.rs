//! CAN IDs, and the errors of CAN IDs and frames.

use core::fmt;

const EXTENDED: u32 = 1 << 31;

/// A CAN ID: 11 bits (standard) or 29 bits (extended).
///
/// The order is that of the raw values, standard before extended; it is not the order of
/// arbitration on the bus.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CanId(u32);

impl CanId {
    /// Largest standard CAN ID.
    pub const MAX_STANDARD: u32 = 0x7FF;
    /// Largest extended CAN ID.
    pub const MAX_EXTENDED: u32 = 0x1FFF_FFFF;

    /// Creates a standard CAN ID.
    ///
    /// # Errors
    /// [`FrameError::IdRange`] above 0x7FF.
    pub const fn standard(id: u16) -> Result<Self, FrameError> {
        Self::new(id as u32, false)
    }

    /// Creates an extended CAN ID.
    ///
    /// # Errors
    /// [`FrameError::IdRange`] above 0x1FFF_FFFF.
    pub const fn extended(id: u32) -> Result<Self, FrameError> {
        Self::new(id, true)
    }

    /// Creates a CAN ID of the given format.
    ///
    /// # Errors
    /// [`FrameError::IdRange`] if `raw` does not fit the format.
    pub const fn new(raw: u32, extended: bool) -> Result<Self, FrameError> {
        let (limit, mark) =
            if extended { (Self::MAX_EXTENDED, EXTENDED) } else { (Self::MAX_STANDARD, 0) };
        if raw > limit {
            return Err(FrameError::IdRange { id: raw, extended });
        }
        Ok(Self(raw | mark))
    }

    #[inline]
    pub(crate) const fn standard_bits(bits: u16) -> Self {
        Self(bits as u32 & Self::MAX_STANDARD)
    }

    #[inline]
    pub(crate) const fn extended_bits(bits: u32) -> Self {
        Self(bits & Self::MAX_EXTENDED | EXTENDED)
    }

    /// The value with the mark of an extended CAN ID.
    #[inline]
    pub(crate) const fn bits(self) -> u32 {
        self.0
    }

    /// The CAN ID of [`bits`](Self::bits).
    #[inline]
    pub(crate) const fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    /// The value without its format: 0 to 0x7FF or 0 to 0x1FFF_FFFF.
    #[inline]
    pub const fn raw(self) -> u32 {
        self.0 & Self::MAX_EXTENDED
    }

    /// True for a 29-bit CAN ID.
    #[inline]
    pub const fn is_extended(self) -> bool {
        self.0 & EXTENDED != 0
    }
}

/// Three hex digits for a standard CAN ID, eight for an extended one, as in candump logs.
impl fmt::Display for CanId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_extended() {
            write!(f, "{:08X}", self.raw())
        } else {
            write!(f, "{:03X}", self.raw())
        }
    }
}

impl fmt::Debug for CanId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "CanId({self})")
    }
}

/// Error: the values do not make a CAN frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// The CAN ID does not fit its format.
    #[error(
        "CAN ID {id:#X} is out of range; allowed: 0 to {}",
        if *.extended { "0x1FFFFFFF" } else { "0x7FF" }
    )]
    IdRange {
        /// The CAN ID.
        id: u32,
        /// True for the format with 29 bits.
        extended: bool,
    },
    /// The frame format has no DLC for this number of data bytes.
    #[error(
        "{length} data bytes do not fit a {} frame; allowed: {}",
        if *.fd { "CAN FD" } else { "classic CAN" },
        if *.fd { "0 to 8, 12, 16, 20, 24, 32, 48, 64" } else { "0 to 8" }
    )]
    Length {
        /// Number of data bytes.
        length: usize,
        /// True for a CAN FD frame.
        fd: bool,
    },
    /// A DLC has four bits.
    #[error("DLC {dlc} is out of range; allowed: 0 to 15")]
    DlcRange {
        /// The DLC.
        dlc: u8,
    },
    /// A remote frame requests at most 8 bytes.
    #[error("DLC {dlc} of a remote frame is out of range; allowed: 0 to 8")]
    RemoteDlc {
        /// The DLC.
        dlc: u8,
    },
}

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::{CanId, FrameError};

    extern crate std;

    #[test]
    fn id_above_limit_returns_error() {
        assert_eq!(CanId::standard(0x7FF).unwrap().raw(), 0x7FF);
        assert_eq!(CanId::standard(0x800), Err(FrameError::IdRange { id: 0x800, extended: false }));
        assert!(CanId::extended(0x1FFF_FFFF).unwrap().is_extended());
        assert!(CanId::extended(0x2000_0000).is_err());
        assert_ne!(CanId::standard(1), CanId::extended(1));
    }

    #[test]
    fn id_display_is_candump_format() {
        assert_eq!(CanId::standard(0x1A).unwrap().to_string(), "01A");
        assert_eq!(CanId::extended(0x1A).unwrap().to_string(), "0000001A");
    }
}
