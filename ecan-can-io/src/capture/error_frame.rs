//! Error frames for changes of the channel state.

use ecan_protocol::image::ChannelStatus;

const CONTROLLER: u32 = 1 << 2;
const BUS_OFF: u32 = 1 << 6;
const RESTARTED: u32 = 1 << 8;
/// Index of the controller state in the data, and its values.
const CONTROLLER_STATE: usize = 1;
const WARNING_BOTH_WAYS: u8 = 0x04 | 0x08;
const ACTIVE_AGAIN: u8 = 0x40;

/// Error frame with the classes and data bytes of Linux (`linux/can/error.h`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ErrorFrame {
    classes: u32,
    data: [u8; 8],
}

impl ErrorFrame {
    /// Creates an error frame of these classes; bits 29 to 31 are ignored.
    pub const fn new(classes: u32, data: [u8; 8]) -> Self {
        Self { classes: classes & 0x1FFF_FFFF, data }
    }

    /// Converts a change of the channel status word (manual 7): bus-off, recovery, error warning
    /// set or cleared; `None` for other changes.
    ///
    /// The word has one bit for error warning and error passive; the frame reports error warning
    /// for both.
    pub fn of_change(before: ChannelStatus, after: ChannelStatus) -> Option<Self> {
        let mut data = [0; 8];
        let classes = if before.bus_off() != after.bus_off() {
            if after.bus_off() { BUS_OFF } else { RESTARTED }
        } else if before.warn() != after.warn() && !after.bus_off() {
            data[CONTROLLER_STATE] = if after.warn() { WARNING_BOTH_WAYS } else { ACTIVE_AGAIN };
            CONTROLLER
        } else {
            return None;
        };
        Some(Self { classes, data })
    }

    /// Error classes, bits 0 to 28.
    pub const fn classes(&self) -> u32 {
        self.classes
    }

    /// Data bytes.
    pub const fn data(&self) -> &[u8; 8] {
        &self.data
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn status_changes_become_error_frames() {
        let fine = ChannelStatus::from_raw(2);
        let warned = fine.with_warn(true);
        let off = warned.with_bus_off(true);
        let of = |before, after| {
            ErrorFrame::of_change(before, after).map(|it| (it.classes(), it.data()[1]))
        };
        assert_eq!(of(fine, fine.with_rx_pending(3)), None);
        assert_eq!(of(fine, warned), Some((0x004, 0x0C)));
        assert_eq!(of(warned, fine), Some((0x004, 0x40)));
        assert_eq!(of(warned, off), Some((0x040, 0)));
        assert_eq!(of(off, off.with_warn(false)), None);
        assert_eq!(of(off, fine), Some((0x100, 0)));
    }
}
