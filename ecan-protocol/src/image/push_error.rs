//! Rejection of a packet by the writer.

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
