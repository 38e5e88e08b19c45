//! The Message RAM of one MCAN channel (manual 13.4, "RAM/FIFO/Buffer").

use super::value::{KeyForm, raw_enum};

/// Message RAM of one channel in bytes: the sum of the default layout.
pub const MESSAGE_RAM_BYTES: u32 = 8192;

/// Standard filter elements that the firmware always reserves (0x8001:41).
pub const STANDARD_FILTERS_MAX: u8 = 64;
/// Extended filter elements that the firmware always reserves (0x8001:42).
pub const EXTENDED_FILTERS_MAX: u8 = 24;

const ELEMENT_HEADER_BYTES: u32 = 8;
const EVENT_BYTES: u32 = 8;
const FILTER_BYTES: u32 = STANDARD_FILTERS_MAX as u32 * 4 + EXTENDED_FILTERS_MAX as u32 * 8;

raw_enum! {
    /// Data bytes that one element can store.
    pub enum DataSize: u8, KeyForm::Size(&[8, 12, 16, 20, 24, 32, 48, 64]);
    /// 8 bytes: classic CAN.
    B8 = 0, "8 bytes";
    B12 = 1, "12 bytes";
    B16 = 2, "16 bytes";
    B20 = 3, "20 bytes";
    B24 = 4, "24 bytes";
    B32 = 5, "32 bytes";
    B48 = 6, "48 bytes";
    /// 64 bytes: any CAN FD frame.
    B64 = 7, "64 bytes";
}

impl DataSize {
    /// Size in bytes.
    pub const fn bytes(self) -> u8 {
        match self {
            Self::B8 => 8,
            Self::B12 => 12,
            Self::B16 => 16,
            Self::B20 => 20,
            Self::B24 => 24,
            Self::B32 => 32,
            Self::B48 => 48,
            Self::B64 => 64,
        }
    }

    const fn element_bytes(self) -> u32 {
        ELEMENT_HEADER_BYTES + self.bytes() as u32
    }
}

raw_enum! {
    /// Reaction of a full receive FIFO to the next frame.
    pub enum FifoMode: u8;
    /// Drops the new frame.
    Blocking = 0, "blocking";
    /// Drops the oldest frame.
    Overwrite = 1, "overwrite";
}

raw_enum! {
    /// Order in which the controller sends from the transmit elements.
    pub enum TxMode: u8;
    /// In order of arrival.
    Fifo = 0, "FIFO";
    /// The highest priority (lowest CAN ID) first.
    Queue = 1, "queue";
}

/// A receive FIFO.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RxFifo {
    /// Reaction when it is full.
    pub mode: FifoMode,
    /// Elements, 0 to 64.
    pub size: u8,
    /// Data bytes per element.
    pub data_size: DataSize,
}

/// Elements in the Message RAM of a channel: 0x8001:61 to :73.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct MessageRamLayout {
    /// RX FIFO0, the default target of frames that no filter matches.
    pub rx_fifo0: RxFifo,
    /// RX FIFO1.
    pub rx_fifo1: RxFifo,
    /// Dedicated receive buffers, 0 to 64; only filters that name one use them.
    pub rx_buffer_count: u8,
    /// Data bytes per receive buffer.
    pub rx_buffer_data_size: DataSize,
    /// FIFO or queue.
    pub tx_mode: TxMode,
    /// Transmit FIFO or queue elements, 0 to 32.
    pub tx_fifo_size: u8,
    /// Dedicated transmit buffers; with the FIFO at most 32. The firmware sends through the FIFO.
    pub tx_dedicated_count: u8,
    /// Data bytes per transmit element.
    pub tx_data_size: DataSize,
    /// Transmit event elements, 0 to 32.
    pub tx_event_size: u8,
}

impl Default for MessageRamLayout {
    fn default() -> Self {
        Self::fd()
    }
}

impl MessageRamLayout {
    /// The device default: elements of 64 bytes for any CAN FD frame.
    pub const fn fd() -> Self {
        Self {
            rx_fifo0: RxFifo { mode: FifoMode::Blocking, size: 48, data_size: DataSize::B64 },
            rx_fifo1: RxFifo { mode: FifoMode::Blocking, size: 12, data_size: DataSize::B64 },
            rx_buffer_count: 12,
            rx_buffer_data_size: DataSize::B64,
            tx_mode: TxMode::Fifo,
            tx_fifo_size: 32,
            tx_dedicated_count: 0,
            tx_data_size: DataSize::B64,
            tx_event_size: 32,
        }
    }

    /// The layout for classic CAN: elements of 8 bytes, and receive FIFOs of full length in the
    /// space gained.
    pub const fn classic() -> Self {
        Self {
            rx_fifo0: RxFifo { mode: FifoMode::Blocking, size: 64, data_size: DataSize::B8 },
            rx_fifo1: RxFifo { mode: FifoMode::Blocking, size: 64, data_size: DataSize::B8 },
            rx_buffer_data_size: DataSize::B8,
            tx_data_size: DataSize::B8,
            ..Self::fd()
        }
    }

    /// Returns the layout with a transmit FIFO for `sent` frames per cycle: four cycles of them,
    /// 8 to 32 elements, and the same number of transmit events. RX FIFO0 gets the space gained,
    /// up to 64 elements.
    pub const fn for_traffic(mut self, sent: u8) -> Self {
        let size = match sent.saturating_mul(4) {
            0..=7 => 8,
            33.. => 32,
            size => size,
        };
        self.tx_fifo_size = size;
        self.tx_event_size = size;
        while self.rx_fifo0.size < 64 {
            self.rx_fifo0.size += 1;
            if self.bytes() > MESSAGE_RAM_BYTES {
                self.rx_fifo0.size -= 1;
                break;
            }
        }
        self
    }

    /// Bytes that the layout needs, with the reserved filter elements; at most
    /// [`MESSAGE_RAM_BYTES`] are available.
    pub const fn bytes(&self) -> u32 {
        FILTER_BYTES
            + self.rx_fifo0.size as u32 * self.rx_fifo0.data_size.element_bytes()
            + self.rx_fifo1.size as u32 * self.rx_fifo1.data_size.element_bytes()
            + self.rx_buffer_count as u32 * self.rx_buffer_data_size.element_bytes()
            + (self.tx_fifo_size as u32 + self.tx_dedicated_count as u32)
                * self.tx_data_size.element_bytes()
            + self.tx_event_size as u32 * EVENT_BYTES
    }
}
