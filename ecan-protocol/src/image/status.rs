//! Channel status word of the image header (manual 7).

use core::fmt;

crate::open_enum! {
    /// State of a CAN channel, three bits of the status word (manual 7).
    #[derive(Default)]
    pub enum ChannelState: u8 else Unknown, "state";
    /// Not enabled.
    #[default]
    Disabled = 0, "disabled";
    Init = 1, "init";
    /// Active on the bus.
    Run = 2, "run";
    /// Off the bus after too many errors.
    BusOff = 3, "bus-off";
    Error = 4, "error";
    /// Listens without sending or acknowledging.
    Listen = 5, "listen";
}

const STATE: u16 = 7;
const RX_PENDING_SHIFT: u32 = 10;
const TX_PENDING_SHIFT: u32 = 13;

/// Declares the flags of the status once: bit, text, getter and setter.
macro_rules! flags {
    ($( $(#[$meta:meta])* $get:ident, $with:ident = $bit:literal, $text:literal; )+) => {
        impl ChannelStatus {
            const FLAGS: &[(u16, &str)] = &[$( (1 << $bit, $text), )+];

            $(
                $(#[$meta])*
                pub const fn $get(self) -> bool {
                    self.0 & 1 << $bit != 0
                }

                #[doc = concat!("Returns the status with [`", stringify!($get), "`](Self::",
                    stringify!($get), ") set or cleared.")]
                #[must_use]
                pub const fn $with(self, on: bool) -> Self {
                    Self(if on { self.0 | 1 << $bit } else { self.0 & !(1 << $bit) })
                }
            )+
        }
    };
}

flags! {
    /// CAN FD is enabled.
    fd_enabled, with_fd_enabled = 3, "CAN FD";
    /// Error warning, error passive or degraded bus.
    warn, with_warn = 4, "warning";
    /// Off the bus.
    bus_off, with_bus_off = 5, "bus-off";
    /// The receive FIFO is nearly full or has overflowed.
    rx_pressure, with_rx_pressure = 6, "receive pressure";
    /// The transmit FIFO or queue is congested.
    tx_pressure, with_tx_pressure = 7, "transmit pressure";
    /// A new detailed snapshot can be read by SDO from 0x9000 + channel.
    detail_pending, with_detail_pending = 8, "detail pending";
    /// A pending count is saturated.
    counter_sat, with_counter_sat = 9, "counts saturated";
}

/// The 16 bit status of one channel, as the TxPDO header carries it (manual 7).
#[derive(Clone, Copy, Default, PartialEq, Eq, Hash)]
pub struct ChannelStatus(u16);

impl ChannelStatus {
    /// From the word as transmitted.
    #[inline]
    pub const fn from_raw(raw: u16) -> Self {
        Self(raw)
    }

    /// The word as transmitted.
    #[inline]
    pub const fn raw(self) -> u16 {
        self.0
    }

    /// State of the channel.
    pub const fn state(self) -> ChannelState {
        ChannelState::from_raw((self.0 & STATE) as u8)
    }

    /// Number of pending received frames, 0 to 7, saturated.
    pub const fn rx_pending(self) -> u8 {
        (self.0 >> RX_PENDING_SHIFT) as u8 & 7
    }

    /// Number of frames pending to be sent, 0 to 7, saturated.
    pub const fn tx_pending(self) -> u8 {
        (self.0 >> TX_PENDING_SHIFT) as u8 & 7
    }

    const fn with_count(self, shift: u32, count: u8) -> Self {
        let count = if count > 7 { 7 } else { count };
        Self(self.0 & !(7 << shift) | (count as u16) << shift)
    }

    /// Returns the status with this state.
    #[must_use]
    pub const fn with_state(self, state: ChannelState) -> Self {
        Self(self.0 & !STATE | state.raw() as u16 & STATE)
    }

    /// Returns the status with this number of pending received frames; at most 7.
    #[must_use]
    pub const fn with_rx_pending(self, count: u8) -> Self {
        self.with_count(RX_PENDING_SHIFT, count)
    }

    /// Returns the status with this number of frames pending to be sent; at most 7.
    #[must_use]
    pub const fn with_tx_pending(self, count: u8) -> Self {
        self.with_count(TX_PENDING_SHIFT, count)
    }
}

impl fmt::Display for ChannelStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.state())?;
        for (bit, text) in Self::FLAGS {
            if self.0 & bit != 0 {
                write!(f, ", {text}")?;
            }
        }
        write!(f, ", {} received and {} to send pending", self.rx_pending(), self.tx_pending())
    }
}

impl fmt::Debug for ChannelStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ChannelStatus({:#06x}: {self})", self.0)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::{ChannelState, ChannelStatus};
    use std::string::ToString;

    #[test]
    fn fields_have_the_bits_of_the_manual() {
        let none = ChannelStatus::default();
        assert_eq!(none.with_state(ChannelState::Listen).raw(), 5);
        assert_eq!(none.with_fd_enabled(true).raw(), 0x0008);
        assert_eq!(none.with_warn(true).raw(), 0x0010);
        assert_eq!(none.with_bus_off(true).raw(), 0x0020);
        assert_eq!(none.with_rx_pressure(true).raw(), 0x0040);
        assert_eq!(none.with_tx_pressure(true).raw(), 0x0080);
        assert_eq!(none.with_detail_pending(true).raw(), 0x0100);
        assert_eq!(none.with_counter_sat(true).raw(), 0x0200);
        assert_eq!(none.with_rx_pending(5).raw(), 5 << 10);
        assert_eq!(none.with_tx_pending(200).raw(), 7 << 13);
    }

    #[test]
    fn status_word_round_trip() {
        for raw in 0..=u16::MAX {
            let status = ChannelStatus::from_raw(raw);
            let built = ChannelStatus::default()
                .with_state(status.state())
                .with_fd_enabled(status.fd_enabled())
                .with_warn(status.warn())
                .with_bus_off(status.bus_off())
                .with_rx_pressure(status.rx_pressure())
                .with_tx_pressure(status.tx_pressure())
                .with_detail_pending(status.detail_pending())
                .with_counter_sat(status.counter_sat())
                .with_rx_pending(status.rx_pending())
                .with_tx_pending(status.tx_pending());
            assert_eq!(built, status);
        }
    }

    #[test]
    fn status_display_names_the_set_flags() {
        let status = ChannelStatus::default()
            .with_state(ChannelState::Run)
            .with_warn(true)
            .with_tx_pending(3);
        assert_eq!(status.to_string(), "run, warning, 0 received and 3 to send pending");
    }
}
