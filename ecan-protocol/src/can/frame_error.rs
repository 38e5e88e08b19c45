//! Errors of CAN frames and CAN IDs.

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
    /// A remote frame requests at most 8 bytes.
    #[error("DLC {dlc} of a remote frame is out of range; allowed: 0 to 8")]
    RemoteDlc {
        /// The DLC.
        dlc: u8,
    },
}
