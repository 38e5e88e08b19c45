//! Configurations and frames of the tests of the plan.
#![allow(missing_docs)]

use std::time::Duration;

use ecan_host::AdapterConfig;
use ecan_mcan_port::{ChannelConfig, FrameRate, GatewayConfig, PortConfig};
use ecan_protocol::can::CanFrame;

use super::common::frame;

pub const EVERY_CYCLE: FrameRate = FrameRate::PerCycle(1);

pub fn adapter(multiplier: u8) -> AdapterConfig {
    AdapterConfig::new(1).with_multiplier(multiplier).with_cycle(Duration::from_millis(1))
}

pub fn one_channel(settings: ChannelConfig) -> PortConfig {
    PortConfig::uniform(1, GatewayConfig::on_channel(0, settings))
}

pub fn eight() -> CanFrame {
    frame(0x123, &[0x5A; 8])
}
