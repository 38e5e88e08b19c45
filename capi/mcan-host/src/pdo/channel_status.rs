//! Channel status

use ecan_c_export::export;
use ecan_protocol::image::ChannelStatus;

use crate::pointers;

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

/// Status of a channel, as the TxPDO header carries it (manual 7). Flags are 0 or 1.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct igh_mcan_channel_status_t {
    /// The word as transmitted.
    pub raw: u16,
    /// An igh_mcan_state_t.
    pub state: u8,
    /// CAN FD is enabled.
    pub fd_enabled: u8,
    /// Error warning, error passive or degraded bus.
    pub warn: u8,
    /// Off the bus.
    pub bus_off: u8,
    /// The receive cache is filling up.
    pub rx_pressure: u8,
    /// The transmit queue is filling up.
    pub tx_pressure: u8,
    /// The channel's diagnostic object has new content.
    pub detail_pending: u8,
    /// A counter has reached its maximum.
    pub counter_saturated: u8,
    /// Received frames that wait, as a coarse figure: 0 to 7.
    pub rx_pending: u8,
    /// Frames that wait to be sent, as a coarse figure: 0 to 7.
    pub tx_pending: u8,
}

impl From<ChannelStatus> for igh_mcan_channel_status_t {
    fn from(status: ChannelStatus) -> Self {
        Self {
            raw: status.raw(),
            state: status.state().raw(),
            fd_enabled: status.fd_enabled().into(),
            warn: status.warn().into(),
            bus_off: status.bus_off().into(),
            rx_pressure: status.rx_pressure().into(),
            tx_pressure: status.tx_pressure().into(),
            detail_pending: status.detail_pending().into(),
            counter_saturated: status.counter_sat().into(),
            rx_pending: status.rx_pending(),
            tx_pending: status.tx_pending(),
        }
    }
}

/// Decodes a channel status word.
///
/// @param raw     The word of the image header.
/// @param status  Is overwritten.
///
/// @usage   rt, any thread, any time
#[export(call)]
pub fn igh_mcan_channel_status_decode(raw: u16, status: *mut igh_mcan_channel_status_t) {
    pointers!(call, out(status));
    status.set(ChannelStatus::from_raw(raw).into());
}
