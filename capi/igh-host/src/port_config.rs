//! The Port's configuration as C holds it: with all gateways that a configuration may have.

use ecan_c_boundary::Call;
use ecan_c_boundary::constants::ECAN_MCAN_CHANNELS;
use ecan_c_boundary::result::ecan_result_t::{self, ECAN_ERR_CHANNEL};
use ecan_mcan_port::{ChannelConfig, GatewayConfig, MAX_GATEWAYS, PortConfig};
use ecan_protocol::config::List;

use crate::errors::no_slave;

/// Adds default gateways up to the maximum.
pub(crate) fn extended(config: &PortConfig) -> PortConfig {
    let mut all = PortConfig::uniform(MAX_GATEWAYS, GatewayConfig::default());
    for (gateway, configured) in all.gateways.iter_mut().zip(config.gateways) {
        *gateway = configured;
    }
    PortConfig { filters: config.filters, ..all }
}

/// The first `count` gateways, with the filters of their enabled channels.
pub(crate) fn configured(config: &PortConfig, count: usize) -> PortConfig {
    let is_enabled = |slave: usize, channel: u8| {
        slave < count && config.gateways[slave].channels[usize::from(channel)].is_some()
    };
    let filters = config.filters.into_iter().filter(|f| is_enabled(f.slave, f.channel));
    PortConfig {
        gateways: List::collect(config.gateways.into_iter().take(count)).unwrap_or_default(),
        filters: List::collect(filters).unwrap_or_default(),
    }
}

/// A gateway, to change it.
pub(crate) fn gateway(
    call: Call,
    config: &mut PortConfig,
    slave: usize,
) -> Result<&mut GatewayConfig, ecan_result_t> {
    config.gateways.get_mut(slave).ok_or_else(|| no_slave(call, slave, MAX_GATEWAYS))
}

/// A channel, enabled or not, to change it.
pub(crate) fn channel_entry(
    call: Call,
    config: &mut PortConfig,
    slave: usize,
    channel: u8,
) -> Result<&mut Option<ChannelConfig>, ecan_result_t> {
    gateway(call, config, slave)?.channels.get_mut(usize::from(channel)).ok_or_else(|| {
        let most = ECAN_MCAN_CHANNELS - 1;
        let text = format_args!("channel {channel} is out of range; allowed: 0 to {most}");
        call.fail(ECAN_ERR_CHANNEL, text)
    })
}

/// An enabled channel, to change it.
pub(crate) fn channel(
    call: Call,
    config: &mut PortConfig,
    slave: usize,
    channel: u8,
) -> Result<&mut ChannelConfig, ecan_result_t> {
    let entry = channel_entry(call, config, slave, channel)?;
    entry.as_mut().ok_or_else(|| not_enabled(call, slave, channel))
}

pub(crate) fn channel_of(
    call: Call,
    config: &PortConfig,
    slave: usize,
    channel: u8,
) -> Result<&ChannelConfig, ecan_result_t> {
    let gateway = config.gateways.get(slave).ok_or_else(|| no_slave(call, slave, MAX_GATEWAYS))?;
    let entry = gateway.channels.get(usize::from(channel)).and_then(Option::as_ref);
    entry.ok_or_else(|| not_enabled(call, slave, channel))
}

#[cold]
fn not_enabled(call: Call, slave: usize, channel: u8) -> ecan_result_t {
    let text = format_args!("channel {channel} of slave {slave} is not enabled");
    call.fail(ECAN_ERR_CHANNEL, text)
}
