//! SM2 and SM3 as single buffers: full or empty, never half (manual 5.3).
//!
//! A write is complete with its last byte and fills the buffer; until the firmware has
//! read it, further writes are refused. A read succeeds only while the buffer is full and
//! empties it.

use ecan_protocol::mapping::{Direction, MAX_PDO_BYTES};

use super::settings::SmSettings;

/// Memory from which process data sync managers may start (manual 5.3).
const PROCESS_DATA_START: u32 = 0x1100;
/// End of the two 3072 byte areas of manual 5.3.
const PROCESS_DATA_END: u32 = 0x1100 + 2 * MAX_PDO_BYTES as u32;
/// A write of this sync manager feeds the process data watchdog.
const WATCHDOG_TRIGGER: u8 = 0x40;

/// One single-buffer sync manager with its memory.
#[derive(Debug)]
pub(super) struct SingleBuffer {
    settings: Option<SmSettings>,
    data: Box<[u8]>,
    full: bool,
}

impl SingleBuffer {
    pub(super) fn new() -> Self {
        Self { settings: None, data: vec![0; MAX_PDO_BYTES].into_boxed_slice(), full: false }
    }

    /// A buffer without memory, to stand in while the real one is lent out.
    pub(super) fn vacant() -> Self {
        Self { settings: None, data: Box::default(), full: false }
    }

    /// Enables or disables the sync manager; either empties the buffer, its memory stays.
    pub(super) fn configure(&mut self, settings: Option<SmSettings>) {
        self.settings = settings;
        self.full = false;
    }

    pub(super) fn settings(&self) -> Option<SmSettings> {
        self.settings
    }

    /// Length in bytes while enabled and within the memory.
    pub(super) fn length(&self) -> Option<usize> {
        self.settings
            .map(|sm| usize::from(sm.length))
            .filter(|&length| length > 0 && length <= self.data.len())
    }

    pub(super) fn feeds_watchdog(&self) -> bool {
        self.settings.is_some_and(|sm| sm.control & WATCHDOG_TRIGGER != 0)
    }

    pub(super) fn is_full(&self) -> bool {
        self.full
    }

    /// Forgets what is in the buffer; the bytes stay in the memory.
    pub(super) fn empty(&mut self) {
        self.full = false;
    }

    /// Power loss: memory cleared, sync manager disabled.
    pub(super) fn clear(&mut self) {
        self.settings = None;
        self.full = false;
        self.data.fill(0);
    }

    /// A complete write from the bus side; refused when disabled, full or of another length.
    pub(super) fn write(&mut self, bytes: &[u8]) -> bool {
        if self.full || self.length() != Some(bytes.len()) {
            return false;
        }
        match self.data.get_mut(..bytes.len()) {
            Some(memory) => memory.copy_from_slice(bytes),
            None => return false,
        }
        self.full = true;
        true
    }

    /// A complete read from the bus side; refused when disabled, empty or of another length.
    pub(super) fn read(&mut self, out: &mut [u8]) -> bool {
        if !self.full || self.length() != Some(out.len()) {
            return false;
        }
        match self.data.get(..out.len()) {
            Some(memory) => out.copy_from_slice(memory),
            None => return false,
        }
        self.full = false;
        true
    }

    /// What the firmware sees of the memory.
    pub(super) fn memory(&self) -> &[u8] {
        &self.data
    }

    /// The firmware copies bytes to the start of the memory.
    pub(super) fn store(&mut self, bytes: &[u8]) {
        self.store_at(0, bytes);
    }

    /// The firmware copies bytes to an offset of the memory; what lies outside is left out.
    pub(super) fn store_at(&mut self, offset: usize, bytes: &[u8]) {
        if let Some(to) = self.data.get_mut(offset..offset + bytes.len()) {
            to.copy_from_slice(bytes);
        }
    }

    /// The firmware has completed the buffer: the master may read it.
    pub(super) fn release(&mut self) {
        self.full = true;
    }
}

/// Whether `settings` are what the firmware accepts for this direction with a PDO of
/// `bytes`: enabled, single buffer, right direction, exact length, inside the process
/// data memory.
pub(super) fn is_acceptable(
    settings: Option<SmSettings>,
    direction: Direction,
    bytes: usize,
) -> bool {
    let Some(sm) = settings else {
        return false;
    };
    let start = u32::from(sm.start);
    let end = start + u32::from(sm.length);
    bytes > 0
        && usize::from(sm.length) == bytes
        && sm.is_single_buffer(direction == Direction::RxPdo)
        && start >= PROCESS_DATA_START
        && end <= PROCESS_DATA_END
}

/// Whether two enabled sync managers share memory.
pub(super) fn overlap(a: Option<SmSettings>, b: Option<SmSettings>) -> bool {
    let (Some(a), Some(b)) = (a, b) else {
        return false;
    };
    let end = |sm: SmSettings| u32::from(sm.start) + u32::from(sm.length);
    u32::from(a.start) < end(b) && u32::from(b.start) < end(a)
}
