//! Bus time of frames, without stuff bits.

use ecan_mcan_port::{ChannelConfig, GatewayConfig};
use ecan_protocol::can::{CanFrame, FrameBits};
use ecan_protocol::mapping::CHANNELS;

/// Bit rates of a channel in bit/s; 0 for a channel that is not enabled.
#[derive(Clone, Copy, Debug, Default)]
pub struct ChannelRates {
    nominal: u32,
    data: u32,
}

impl ChannelRates {
    pub fn of(gateway: &GatewayConfig) -> [Self; CHANNELS] {
        let channel = |channel: &Option<ChannelConfig>| {
            let Some(ChannelConfig { can, .. }) = channel else { return Self::default() };
            let nominal = can.nominal_bitrate;
            Self { nominal, data: if can.fd { can.data_bitrate } else { nominal } }
        };
        gateway.channels.each_ref().map(channel)
    }

    /// Shortest time of a frame on the bus, in seconds.
    pub fn seconds(self, frame: &CanFrame) -> f64 {
        if self.nominal == 0 {
            return 0.0;
        }
        FrameBits::least(frame.as_ref()).seconds(self.nominal, self.data)
    }
}
