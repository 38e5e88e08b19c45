//! Receive FIFO in the Message RAM (manual 13.4).

use std::collections::VecDeque;

use ecan_protocol::can::CanFrame;
use ecan_protocol::config::FifoMode;

use crate::queue::take_first;

/// Largest size of a receive FIFO, and largest number of receive buffers.
pub(super) const RX_ELEMENTS_MAX: usize = 64;

#[derive(Clone, Copy, Debug)]
pub(super) struct Received {
    pub(super) frame: CanFrame,
    /// End of the frame on the bus, or its start if the TSU captures that.
    pub(super) at_ns: u64,
    /// ID_AUX of the packet: 0 FIFO0, 1 FIFO1, 2 RX buffer, 3 high priority (manual 8.1).
    pub(super) source: u8,
}

#[derive(Clone, Debug, Default)]
pub(super) struct ReceiveFifo {
    elements: VecDeque<Received>,
    get_index: u32,
    put_index: u32,
    lost: bool,
}

impl ReceiveFifo {
    pub(super) fn new() -> Self {
        Self { elements: VecDeque::with_capacity(RX_ELEMENTS_MAX), ..Self::default() }
    }

    pub(super) fn clear(&mut self) -> usize {
        let flushed = self.elements.len();
        self.elements.clear();
        self.get_index = 0;
        self.put_index = 0;
        self.lost = false;
        flushed
    }

    /// Stores a frame; returns `false` if that lost a frame.
    pub(super) fn store(&mut self, received: Received, size: u8, mode: FifoMode) -> bool {
        let size = usize::from(size).min(RX_ELEMENTS_MAX);
        let full = self.elements.len() >= size;
        if full {
            self.lost = true;
            if size == 0 || mode == FifoMode::Blocking {
                return false;
            }
            self.elements.pop_front();
            self.get_index = wrap_increment(self.get_index, size);
        }
        self.elements.push_back(received);
        self.put_index = wrap_increment(self.put_index, size);
        !full
    }

    pub(super) fn take(&mut self, size: u8) -> Option<Received> {
        let taken = take_first(&mut self.elements)?;
        self.get_index = wrap_increment(self.get_index, usize::from(size));
        self.lost = false;
        Some(taken)
    }

    /// Acknowledges the element at `index` and all before it, read or not; returns their number.
    /// Ignores an index without a frame.
    pub(super) fn acknowledge(&mut self, index: u32, size: u8) -> usize {
        let size = u32::from(size);
        if index >= size {
            return 0;
        }
        let count = (index + size).saturating_sub(self.get_index) % size + 1;
        if count as usize > self.elements.len() {
            return 0;
        }
        self.elements.drain(..count as usize);
        self.get_index = (self.get_index + count) % size;
        self.lost = false;
        count as usize
    }

    pub(super) fn len(&self) -> usize {
        self.elements.len()
    }

    /// Returns whether a frame was lost since the last one was taken.
    pub(super) fn has_lost(&self) -> bool {
        self.lost
    }

    /// RXF0S or RXF1S: fill level, get index, put index, full, message lost.
    pub(super) fn status(&self, size: u8) -> u32 {
        let fill = self.elements.len() as u32;
        fill | self.get_index << 8
            | self.put_index << 16
            | u32::from(size != 0 && fill >= u32::from(size)) << 24
            | u32::from(self.lost) << 25
    }
}

pub(super) fn wrap_increment(index: u32, size: usize) -> u32 {
    match u32::try_from(size) {
        Ok(size) if index + 1 < size => index + 1,
        _ => 0,
    }
}
