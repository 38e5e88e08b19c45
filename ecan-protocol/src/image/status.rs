//! Channel status word of the image header (manual 7).

use core::fmt;

/// State of a CAN channel (manual 7).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ChannelState {
    /// Not enabled.
    #[default]
    Disabled,
    /// Being initialised.
    Init,
    /// Takes part in the bus.
    Run,
    /// Off the bus after too many errors.
    BusOff,
    /// In error.
    Error,
    /// Listens without sending or acknowledging.
    Listen,
    /// A state that the manual does not name: 6 or 7.
    Unknown(u8),
}

impl ChannelState {
    /// The state in the low three bits of `raw`.
    #[must_use]
    pub const fn from_raw(raw: u8) -> Self {
        match raw & 7 {
            0 => Self::Disabled,
            1 => Self::Init,
            2 => Self::Run,
            3 => Self::BusOff,
            4 => Self::Error,
            5 => Self::Listen,
            other => Self::Unknown(other),
        }
    }

    /// The state's number, 0 to 7.
    #[must_use]
    pub const fn raw(self) -> u8 {
        match self {
            Self::Disabled => 0,
            Self::Init => 1,
            Self::Run => 2,
            Self::BusOff => 3,
            Self::Error => 4,
            Self::Listen => 5,
            Self::Unknown(other) => other & 7,
        }
    }
}

impl fmt::Display for ChannelState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Disabled => "disabled",
            Self::Init => "init",
            Self::Run => "run",
            Self::BusOff => "bus-off",
            Self::Error => "error",
            Self::Listen => "listen",
            Self::Unknown(raw) => return write!(f, "state {raw}"),
        })
    }
}

const STATE: u16 = 7;
const FD_ENABLED: u16 = 1 << 3;
const WARN: u16 = 1 << 4;
const BUS_OFF: u16 = 1 << 5;
const RX_PRESSURE: u16 = 1 << 6;
const TX_PRESSURE: u16 = 1 << 7;
const DETAIL_PENDING: u16 = 1 << 8;
const COUNTER_SAT: u16 = 1 << 9;
const RX_PENDING_SHIFT: u32 = 10;
const TX_PENDING_SHIFT: u32 = 13;

/// The 16 bit status of one channel, as the TxPDO header carries it (manual 7).
#[derive(Clone, Copy, Default, PartialEq, Eq, Hash)]
pub struct ChannelStatus(u16);

impl ChannelStatus {
    /// From the word as transmitted.
    #[inline]
    #[must_use]
    pub const fn from_raw(raw: u16) -> Self {
        Self(raw)
    }

    /// The word as transmitted.
    #[inline]
    #[must_use]
    pub const fn raw(self) -> u16 {
        self.0
    }

    /// State of the channel.
    #[must_use]
    pub const fn state(self) -> ChannelState {
        ChannelState::from_raw((self.0 & STATE) as u8)
    }

    /// CAN FD is enabled.
    #[must_use]
    pub const fn fd_enabled(self) -> bool {
        self.0 & FD_ENABLED != 0
    }

    /// Error warning, error passive or degraded bus.
    #[must_use]
    pub const fn warn(self) -> bool {
        self.0 & WARN != 0
    }

    /// Off the bus.
    #[must_use]
    pub const fn bus_off(self) -> bool {
        self.0 & BUS_OFF != 0
    }

    /// The receive FIFO is nearly full or has overflowed.
    #[must_use]
    pub const fn rx_pressure(self) -> bool {
        self.0 & RX_PRESSURE != 0
    }

    /// The transmit FIFO or queue is congested.
    #[must_use]
    pub const fn tx_pressure(self) -> bool {
        self.0 & TX_PRESSURE != 0
    }

    /// A new detailed snapshot can be read by SDO from 0x9000 + channel.
    #[must_use]
    pub const fn detail_pending(self) -> bool {
        self.0 & DETAIL_PENDING != 0
    }

    /// A pending count is saturated.
    #[must_use]
    pub const fn counter_sat(self) -> bool {
        self.0 & COUNTER_SAT != 0
    }

    /// Received frames that wait, 0 to 7, saturated.
    #[must_use]
    pub const fn rx_pending(self) -> u8 {
        (self.0 >> RX_PENDING_SHIFT) as u8 & 7
    }

    /// Frames that wait to be sent, 0 to 7, saturated.
    #[must_use]
    pub const fn tx_pending(self) -> u8 {
        (self.0 >> TX_PENDING_SHIFT) as u8 & 7
    }

    /// Whether a detailed look by SDO is due: warning, bus-off, pressure or a pending snapshot.
    #[must_use]
    pub const fn needs_attention(self) -> bool {
        self.0 & (WARN | BUS_OFF | RX_PRESSURE | TX_PRESSURE | DETAIL_PENDING) != 0
    }

    const fn with_bit(self, bit: u16, on: bool) -> Self {
        Self(if on { self.0 | bit } else { self.0 & !bit })
    }

    const fn with_count(self, shift: u32, count: u8) -> Self {
        let count = if count > 7 { 7 } else { count };
        Self(self.0 & !(7 << shift) | (count as u16) << shift)
    }

    /// The same with this state.
    #[must_use]
    pub const fn with_state(self, state: ChannelState) -> Self {
        Self(self.0 & !STATE | state.raw() as u16)
    }

    /// The same with CAN FD enabled or not.
    #[must_use]
    pub const fn with_fd_enabled(self, on: bool) -> Self {
        self.with_bit(FD_ENABLED, on)
    }

    /// The same with or without the warning.
    #[must_use]
    pub const fn with_warn(self, on: bool) -> Self {
        self.with_bit(WARN, on)
    }

    /// The same with or without bus-off.
    #[must_use]
    pub const fn with_bus_off(self, on: bool) -> Self {
        self.with_bit(BUS_OFF, on)
    }

    /// The same with or without receive pressure.
    #[must_use]
    pub const fn with_rx_pressure(self, on: bool) -> Self {
        self.with_bit(RX_PRESSURE, on)
    }

    /// The same with or without transmit pressure.
    #[must_use]
    pub const fn with_tx_pressure(self, on: bool) -> Self {
        self.with_bit(TX_PRESSURE, on)
    }

    /// The same with or without a pending snapshot.
    #[must_use]
    pub const fn with_detail_pending(self, on: bool) -> Self {
        self.with_bit(DETAIL_PENDING, on)
    }

    /// The same with or without the mark of saturated counts.
    #[must_use]
    pub const fn with_counter_sat(self, on: bool) -> Self {
        self.with_bit(COUNTER_SAT, on)
    }

    /// The same with this many received frames waiting; 7 stands for 7 or more.
    #[must_use]
    pub const fn with_rx_pending(self, count: u8) -> Self {
        self.with_count(RX_PENDING_SHIFT, count)
    }

    /// The same with this many frames waiting to be sent; 7 stands for 7 or more.
    #[must_use]
    pub const fn with_tx_pending(self, count: u8) -> Self {
        self.with_count(TX_PENDING_SHIFT, count)
    }
}

impl fmt::Display for ChannelStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.state())?;
        for (on, name) in [
            (self.fd_enabled(), "CAN FD"),
            (self.warn(), "warning"),
            (self.bus_off(), "bus-off"),
            (self.rx_pressure(), "receive pressure"),
            (self.tx_pressure(), "transmit pressure"),
            (self.detail_pending(), "detail pending"),
            (self.counter_sat(), "counts saturated"),
        ] {
            if on {
                write!(f, ", {name}")?;
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
    fn fields_stand_at_the_manuals_bits() {
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
    fn reading_any_word_loses_nothing() {
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
    fn text_names_what_is_set() {
        let status = ChannelStatus::default()
            .with_state(ChannelState::Run)
            .with_warn(true)
            .with_tx_pending(3);
        assert_eq!(status.to_string(), "run, warning, 0 received and 3 to send pending");
        assert!(status.needs_attention());
    }
}
