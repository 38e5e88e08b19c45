//! Warnings about settings that lose frames, or may not match the bus.

use ecan_protocol::config::ChannelWarning;
use ecan_protocol::mapping::Direction;
use thiserror::Error;

/// Smallest N of an image for CAN FD (manual 2).
pub(super) const FD_MULTIPLIER: u8 = 8;

/// A warning about settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SettingWarning {
    /// Elements of the Message RAM that truncate CAN FD frames (manual 13.4).
    #[error(
        "slave {slave}, channel {channel}: {elements} hold {bytes} bytes of a frame; longer CAN FD \
         frames are truncated; raise `{}` in its table `ram`, or use the layout \"fd\"",
        .elements.key()
    )]
    ShortElements {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
        /// The elements.
        elements: Elements,
        /// Data bytes of one element.
        bytes: u8,
    },
    /// The largest frame of a channel does not fit its share of an image (manual 12).
    #[error(
        "slave {slave}, channel {channel}: the largest frame needs {frame_bytes} bytes of the \
         {direction}, the channel has {share_bytes}; such frames are never received; use a larger \
         `n` or another `budget` than deterministic"
    )]
    ShareBelowFrame {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
        /// Direction of the image.
        direction: Direction,
        /// Bytes of the frame in the frame area.
        frame_bytes: usize,
        /// Bytes of the frame area that the channel can use.
        share_bytes: usize,
    },
    /// The bit timing may not match the bus.
    #[error("slave {slave}, channel {channel}: {warning}")]
    BitTiming {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
        /// What may not match.
        warning: ChannelWarning,
    },
    /// An image below the size from which the manual begins with CAN FD (2).
    #[error(
        "slave {slave}: CAN FD with N = {multiplier} in the {direction}; the manual begins with \
         N = {FD_MULTIPLIER} (chapter 2): full frames of 64 bytes wait for later images"
    )]
    FdImageSize {
        /// Slave index.
        slave: usize,
        /// Direction of the image.
        direction: Direction,
        /// N.
        multiplier: u8,
    },
    /// Results of frames on a channel that only sends (manual 10).
    #[error(
        "slave {slave}, channel {channel} only sends: the gateway may report no TX_RESULT of it, \
         because the TxPDO does not carry the channel (ASSUMPTIONS.md, H45); scheduled frames without \
         a result count as unknown"
    )]
    ResultsOfSendOnly {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
    },
    /// Filters reject every frame.
    #[error(
        "slave {slave}, channel {channel}: no filter accepts a frame and those without a match are \
         rejected; the channel receives nothing; add a filter, or set `non_match_standard` or \
         `non_match_extended`"
    )]
    NothingReceived {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
    },
}

/// Elements of the Message RAM that hold frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Elements {
    /// RX FIFO0.
    RxFifo0,
    /// RX FIFO1.
    RxFifo1,
    /// Receive buffers.
    RxBuffers,
    /// Transmit FIFO, queue and buffers.
    Transmit,
}

impl Elements {
    /// The key with their size.
    fn key(self) -> &'static str {
        match self {
            Self::RxFifo0 => "rx_fifo0_data_bytes",
            Self::RxFifo1 => "rx_fifo1_data_bytes",
            Self::RxBuffers => "rx_buffer_data_bytes",
            Self::Transmit => "tx_data_bytes",
        }
    }
}

impl std::fmt::Display for Elements {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::RxFifo0 => "the elements of RX FIFO0",
            Self::RxFifo1 => "the elements of RX FIFO1",
            Self::RxBuffers => "the receive buffers",
            Self::Transmit => "the transmit elements",
        })
    }
}
