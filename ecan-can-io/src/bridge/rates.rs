//! Bit rates of a bus.

/// Bit rates of a bus. Plain data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusRates {
    /// Bit rate of the arbitration phase in bit/s.
    pub nominal_bitrate: u32,
    /// Bit rate of the data phase of CAN FD frames with bit rate switch in bit/s.
    pub data_bitrate: u32,
    /// True if CAN FD frames can be on the bus.
    pub fd: bool,
}

impl BusRates {
    /// A classic bus.
    #[must_use]
    pub const fn classic(bitrate: u32) -> Self {
        Self { nominal_bitrate: bitrate, data_bitrate: bitrate, fd: false }
    }

    /// A CAN FD bus.
    #[must_use]
    pub const fn fd(nominal_bitrate: u32, data_bitrate: u32) -> Self {
        Self { nominal_bitrate, data_bitrate, fd: true }
    }
}
