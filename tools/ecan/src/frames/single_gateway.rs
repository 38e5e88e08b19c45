//! State of the only gateway of a Port.

use ecan_mcan_port::{Port, Session, SlaveStatistics};
use ecan_protocol::image::ChannelStatus;

pub fn session(port: &Port) -> Session {
    port.gateway(0).map_or(Session::Waiting, |gateway| port.session(gateway))
}

pub fn statistics(port: &Port) -> SlaveStatistics {
    port.gateway(0).map_or_else(|_| SlaveStatistics::default(), |gateway| port.statistics(gateway))
}

/// Status of a channel; "disabled" for one that is not enabled.
pub fn channel_status(port: &Port, channel: u8) -> ChannelStatus {
    let channel = port.channel(0, channel);
    channel.map_or_else(|_| ChannelStatus::default(), |channel| port.channel_status(channel))
}
