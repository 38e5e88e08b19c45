//! 0xB000: access mode, maintenance commands and diagnostic flags (manual 13.7).
//!
//! Flash, FoE and EEPROM commands are answered with "denied": this gateway has nothing to
//! keep them in.

/// Legacy maintenance diag flags, 0xB000:6.
pub(super) mod flag {
    pub(in crate::gateway) const TX_RING_DROP: u16 = 1 << 4;
    pub(in crate::gateway) const TX_FIFO_FULL: u16 = 1 << 5;
    pub(in crate::gateway) const SCHED_LATE_DROP: u16 = 1 << 6;
    pub(in crate::gateway) const SCHED_QUEUE_FULL: u16 = 1 << 7;
    pub(in crate::gateway) const SCHED_TX_FAIL: u16 = 1 << 8;
    pub(in crate::gateway) const SCHED_TIMER_MISS: u16 = 1 << 9;
}

/// Maintenance command "clear runtime diagnostics", the only one that may be executed.
const COMMAND_CLEAR_DIAGNOSTICS: u32 = 1 << 5;

const STATUS_OK: u8 = 0;
const STATUS_DENIED: u8 = 2;

/// Run mode, from which and to which engineering and factory mode are entered and left.
const MODE_RUN: u8 = 0;

/// State behind 0xB000.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Maintenance {
    mode: u8,
    mode_ends: Option<u64>,
    status: u8,
    sequence: u32,
    pub(super) flags: u16,
}

impl Maintenance {
    /// An access mode request: granted at once, for `timeout_s` seconds or, at 0, without end.
    pub(super) fn request_mode(&mut self, now: u64, mode: u8, timeout_s: u16) {
        self.mode = mode;
        self.mode_ends = (mode != MODE_RUN && timeout_s != 0)
            .then(|| now.saturating_add(u64::from(timeout_s) * 1_000_000_000));
    }

    /// When the access mode falls back to run.
    pub(super) fn mode_ends(&self) -> Option<u64> {
        self.mode_ends
    }

    /// Lets the access mode fall back to run when its time is over.
    pub(super) fn expire(&mut self, now: u64) {
        if self.mode_ends.is_some_and(|ends| ends <= now) {
            self.mode = MODE_RUN;
            self.mode_ends = None;
        }
    }

    /// Engineering or factory mode.
    pub(super) fn is_engineering(&self) -> bool {
        self.mode != MODE_RUN
    }

    /// A maintenance command; returns whether diagnostics are to be cleared. No bit at all
    /// is no command.
    pub(super) fn command(&mut self, bits: u32) -> bool {
        if bits == 0 {
            return false;
        }
        self.sequence = self.sequence.wrapping_add(1);
        let clear = bits == COMMAND_CLEAR_DIAGNOSTICS;
        if clear {
            self.flags = 0;
        }
        self.status = if clear { STATUS_OK } else { STATUS_DENIED };
        clear
    }

    /// What a subindex of 0xB000 shows; `None` for the others.
    pub(super) fn readback(&self, subindex: u8) -> Option<u32> {
        Some(match subindex {
            2 => u32::from(self.mode),
            5 => u32::from(self.status),
            6 => u32::from(self.flags),
            12 => self.sequence,
            _ => return None,
        })
    }
}
