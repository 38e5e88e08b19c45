//! The check of a Port's configuration before anything touches the bus: every fault.

use ecan_host::{AdapterConfig, ConfigFault, Faults};
use ecan_protocol::config::{
    ChannelFault, DataPathFault, DeviceFault, DiagnosticTest, FilterFault, check_filters,
};
use ecan_protocol::image::{OptionFlags, ProfileError};
use ecan_protocol::mapping::{CHANNELS, Direction};
use thiserror::Error;

use crate::config::{Config, GatewayConfig, MAX_GATEWAYS, PortConfig, Traffic};
use crate::plan::finding;
use crate::plan::finding::PortPlanError;

/// One thing that is wrong with the configuration of a Port.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PortConfigFault {
    /// A fault of the Adapter's configuration.
    #[error(transparent)]
    Adapter(ConfigFault),
    /// As many gateways as slaves are needed.
    #[error("{gateways} gateway(s) are configured for {slaves} slave(s)")]
    GatewayCount {
        /// Gateways configured.
        gateways: usize,
        /// Slaves configured.
        slaves: usize,
    },
    /// More gateways than a configuration holds.
    #[error("{count} gateways are too many; allowed: at most {MAX_GATEWAYS}")]
    TooManyGateways {
        /// Number of gateways.
        count: usize,
    },
    /// A gateway without an enabled channel.
    #[error("slave {slave}: no channel is enabled")]
    NoChannel {
        /// Slave index.
        slave: usize,
    },
    /// A channel mask with channels that are not enabled.
    #[error(
        "slave {slave}, {direction}: channel mask 0x{mask:02X} has channels that are not enabled; \
         allowed: the bits of 0x{enabled:02X}; enable the channels, or leave them out"
    )]
    MaskBeyondChannels {
        /// Slave index.
        slave: usize,
        /// The direction.
        direction: Direction,
        /// The mask.
        mask: u8,
        /// Mask of the enabled channels.
        enabled: u8,
    },
    /// An enabled channel that is in neither channel mask.
    #[error(
        "slave {slave}, channel {channel}: it is enabled, but in neither channel mask (0x8010:04, \
         0x8011:04); add it to one of them, or do not enable it"
    )]
    ChannelInNoMask {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
    },
    /// A PDO profile that the gateway does not have.
    #[error("slave {slave}, {direction}: {fault}")]
    Profile {
        /// Slave index.
        slave: usize,
        /// The direction.
        direction: Direction,
        /// The fault.
        fault: ProfileError,
    },
    /// The application bypass cuts the CAN side off.
    #[error(
        "slave {slave}, {direction}: the option APP_BYPASS cuts the CAN channels off; allow \
         diagnostic tests if that is intended"
    )]
    Bypass {
        /// Slave index.
        slave: usize,
        /// The direction.
        direction: Direction,
    },
    /// An object of the whole gateway that the gateway rejects.
    #[error("slave {slave}: {fault}")]
    Device {
        /// Slave index.
        slave: usize,
        /// The fault.
        fault: DeviceFault,
    },
    /// A diagnostic test of 0x8030.
    #[error(
        "slave {slave}: a diagnostic test (0x8030) disconnects parts of the data path; allow diagnostic \
         tests if that is intended"
    )]
    DiagnosticTest {
        /// Slave index.
        slave: usize,
    },
    /// A CAN channel that the gateway cannot run.
    #[error("slave {slave}, channel {channel}: {fault}")]
    Channel {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
        /// The fault.
        fault: ChannelFault,
    },
    /// A data path that the gateway rejects.
    #[error("slave {slave}, channel {channel}: {fault}")]
    DataPath {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
        /// The fault.
        fault: DataPathFault,
    },
    /// The [`PortPlan`](crate::PortPlan) finds that it would not work.
    #[error(transparent)]
    Plan(PortPlanError),
    /// A filter that the channel cannot have.
    #[error("slave {slave}, channel {channel}: {fault}")]
    Filter {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
        /// The fault.
        fault: FilterFault,
    },
    /// A limit of lost images that no image could keep.
    #[error("slave {slave}: the hold limit must be at least 1 cycle")]
    HoldLimit {
        /// Slave index.
        slave: usize,
    },
}

impl Config {
    /// Checks the configuration without accessing the bus.
    ///
    /// # Errors
    /// Every fault of both parts.
    pub fn check(&self) -> Result<(), Faults<PortConfigFault>> {
        let mut faults =
            self.port.check(&self.adapter).err().map_or_else(Vec::new, |faults| faults.0);
        if self.excess > 0 {
            let count = MAX_GATEWAYS + self.excess;
            faults.push(PortConfigFault::TooManyGateways { count });
        }
        Faults::check(faults)
    }
}

impl PortConfig {
    /// Checks this configuration together with the Adapter's, without touching the bus.
    ///
    /// # Errors
    /// Every fault found in both.
    pub fn check(&self, adapter: &AdapterConfig) -> Result<(), Faults<PortConfigFault>> {
        let mut faults = Vec::new();
        if let Err(adapter_faults) = adapter.check() {
            faults.extend(adapter_faults.0.into_iter().map(PortConfigFault::Adapter));
        }
        let (gateways, slaves) = (self.gateways.len(), adapter.slaves.len());
        if gateways != slaves {
            faults.push(PortConfigFault::GatewayCount { gateways, slaves });
        }
        for (slave, (gateway, settings)) in self.gateways.iter().zip(&adapter.slaves).enumerate() {
            let sizes = [
                (Direction::RxPdo, settings.rx_multiplier),
                (Direction::TxPdo, settings.tx_multiplier),
            ];
            for (direction, multiplier) in sizes {
                check_profile(slave, gateway, direction, multiplier, &mut faults);
            }
            check_channels(slave, gateway, self, &mut faults);
            check_device(slave, gateway, &mut faults);
        }
        Faults::check(faults)
    }
}

fn check_profile(
    slave: usize,
    gateway: &GatewayConfig,
    direction: Direction,
    multiplier: u8,
    faults: &mut Vec<PortConfigFault>,
) {
    let profile = gateway.profile(direction, multiplier);
    // A wrong N and a gateway without a channel are reported once, where they belong.
    let known = (1..=ecan_protocol::mapping::MAX_MULTIPLIER).contains(&multiplier)
        && gateway.channel_mask() != 0;
    if known && let Err(fault) = profile.check(direction) {
        faults.push(PortConfigFault::Profile { slave, direction, fault });
    }
    if profile.options.contains(OptionFlags::APP_BYPASS) && !gateway.allow_diagnostic_tests {
        faults.push(PortConfigFault::Bypass { slave, direction });
    }
}

fn check_device(slave: usize, gateway: &GatewayConfig, faults: &mut Vec<PortConfigFault>) {
    gateway.device.check(&mut |fault| faults.push(PortConfigFault::Device { slave, fault }));
    let has_test = gateway.device.diagnostic_test.is_some_and(|test| test != DiagnosticTest::OFF);
    if has_test && !gateway.allow_diagnostic_tests {
        faults.push(PortConfigFault::DiagnosticTest { slave });
    }
}

fn check_channels(
    slave: usize,
    gateway: &GatewayConfig,
    config: &PortConfig,
    faults: &mut Vec<PortConfigFault>,
) {
    if gateway.channel_mask() == 0 {
        faults.push(PortConfigFault::NoChannel { slave });
    }
    check_masks(slave, gateway, faults);
    if gateway.hold_limit == 0 {
        faults.push(PortConfigFault::HoldLimit { slave });
    }
    for channel in 0..CHANNELS as u8 {
        let Some(settings) = &gateway.channels[usize::from(channel)] else { continue };
        settings
            .can
            .check(&mut |fault| faults.push(PortConfigFault::Channel { slave, channel, fault }));
        settings
            .data_path
            .check(&mut |fault| faults.push(PortConfigFault::DataPath { slave, channel, fault }));
        let Traffic { received, sent } = settings.traffic;
        let unserved = finding::rejection((slave, channel), received.into(), sent.into());
        faults.extend(unserved.map(PortConfigFault::Plan));
        check_filters(
            &settings.can,
            &config.standard_filters(slave, channel),
            &config.extended_filters(slave, channel),
            &mut |fault| faults.push(PortConfigFault::Filter { slave, channel, fault }),
        );
    }
}

fn check_masks(slave: usize, gateway: &GatewayConfig, faults: &mut Vec<PortConfigFault>) {
    let enabled = gateway.channel_mask();
    let mask = |direction| gateway.direction_mask(direction);
    for direction in [Direction::RxPdo, Direction::TxPdo] {
        let mask = mask(direction);
        if mask & !enabled != 0 {
            faults.push(PortConfigFault::MaskBeyondChannels { slave, direction, mask, enabled });
        }
    }
    let unused = enabled & !mask(Direction::RxPdo) & !mask(Direction::TxPdo);
    let unused = (0..CHANNELS as u8).filter(|channel| unused >> channel & 1 == 1);
    faults.extend(unused.map(|channel| PortConfigFault::ChannelInNoMask { slave, channel }));
}
