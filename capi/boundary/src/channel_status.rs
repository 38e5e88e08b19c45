//! Channel status

use ecan_protocol::image::ChannelStatus;

use crate::mirror;

/// State of a CAN channel (manual 7). The device may report other values.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_mcan_state_t {
    /// Not enabled.
    IGH_MCAN_STATE_DISABLED = 0,
    /// Being initialised.
    IGH_MCAN_STATE_INIT = 1,
    /// Takes part in the bus.
    IGH_MCAN_STATE_RUN = 2,
    /// Off the bus after too many errors.
    IGH_MCAN_STATE_BUS_OFF = 3,
    /// In error.
    IGH_MCAN_STATE_ERROR = 4,
    /// Listens without sending or acknowledging.
    IGH_MCAN_STATE_LISTEN = 5,
}

mirror! {
    /// Status of a channel, as the TxPDO header carries it (manual 7). Flags are 0 or 1.
    #[derive(Default)]
    pub struct igh_mcan_channel_status_t from status: ChannelStatus {
        /// The word as transmitted.
        raw: u16 = status.raw(),
        /// An igh_mcan_state_t.
        state: u8 = status.state().raw(),
        /// CAN FD is enabled.
        fd_enabled: u8 = status.fd_enabled().into(),
        /// Error warning, error passive or degraded bus.
        warn: u8 = status.warn().into(),
        /// Off the bus.
        bus_off: u8 = status.bus_off().into(),
        /// The receive cache is filling up.
        rx_pressure: u8 = status.rx_pressure().into(),
        /// The transmit queue is filling up.
        tx_pressure: u8 = status.tx_pressure().into(),
        /// The channel's diagnostic object has new content.
        detail_pending: u8 = status.detail_pending().into(),
        /// A counter has reached its maximum.
        counter_saturated: u8 = status.counter_sat().into(),
        /// Received frames that wait, as a coarse figure: 0 to 7.
        rx_pending: u8 = status.rx_pending(),
        /// Frames that wait to be sent, as a coarse figure: 0 to 7.
        tx_pending: u8 = status.tx_pending(),
        /// Zero; for fields of later versions.
        reserved: [u8; 4] = [0; 4],
    }
}
