//! Configuration of a whole bus: the Adapter's part and the Port's.

use std::time::Duration;

use ecan_host::{AdapterConfig, Faults, SlaveConfig};

use crate::config_check::PortConfigFault;
use crate::port_config::{GatewayConfig, MAX_GATEWAYS, PortConfig};

/// Default N of a gateway: chunks of 128 bytes per direction.
const DEFAULT_MULTIPLIER: u8 = 3;

/// Configuration of a Port with its Adapter: plain data.
///
/// ```
/// # use std::time::Duration;
/// # use ecan_mcan_port::{ChannelConfig, Config, GatewayConfig};
/// let channel = ChannelConfig::classic(1_000_000);
/// let config = Config::new(Duration::from_millis(10))
///     .with_gateway(GatewayConfig::on_channel(0, channel));
/// assert!(config.check().is_ok());
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Config {
    /// The EtherCAT side: master, cycle, slaves, distributed clocks.
    pub adapter: AdapterConfig,
    /// The CAN side: one gateway per slave, in the same order.
    pub port: PortConfig,
    /// Gateways that did not fit.
    excess: usize,
}

impl Config {
    /// A bus without gateways, with this cycle.
    pub fn new(cycle: Duration) -> Self {
        let adapter = AdapterConfig::new(0).with_cycle(cycle);
        Self { adapter, port: PortConfig::default(), excess: 0 }
    }

    /// Adds a gateway at the next position of the bus, with N = 3. At most [`MAX_GATEWAYS`];
    /// [`check`](Self::check) reports more.
    pub fn with_gateway(self, gateway: GatewayConfig) -> Self {
        let position = self.adapter.slaves.len() as u16;
        self.with_gateway_at(0, position, gateway)
    }

    /// As [`with_gateway`](Self::with_gateway), at a position counted from the slave with a station
    /// alias; alias 0 counts from the start of the bus.
    pub fn with_gateway_at(mut self, alias: u16, position: u16, gateway: GatewayConfig) -> Self {
        let slave = SlaveConfig { alias, ..SlaveConfig::at(position, DEFAULT_MULTIPLIER) };
        let added = self.adapter.slaves.push(slave).and_then(|()| self.port.gateways.push(gateway));
        self.excess += usize::from(added.is_err());
        self
    }

    /// Checks the configuration without accessing the bus.
    ///
    /// # Errors
    /// Every fault of both parts.
    pub fn check(&self) -> Result<(), Faults<PortConfigFault>> {
        let mut faults = self.port.check(&self.adapter).err().map_or_else(Vec::new, |it| it.0);
        if self.excess > 0 {
            let count = MAX_GATEWAYS + self.excess;
            faults.push(PortConfigFault::TooManyGateways { count });
        }
        Faults::check(faults)
    }
}

impl From<(AdapterConfig, PortConfig)> for Config {
    fn from((adapter, port): (AdapterConfig, PortConfig)) -> Self {
        Self { adapter, port, excess: 0 }
    }
}
