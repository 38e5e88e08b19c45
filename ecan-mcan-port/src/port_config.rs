//! Configuration of the Port: plain data.

use ecan_host::{AdapterConfig, ImageTimes, Plan, PlanWarning};
use ecan_protocol::config::{
    DataPathConfig, ExtendedFilter, List, ListFull, McanChannelConfig, StandardFilter,
};
use ecan_protocol::image::{BudgetPolicy, EncapsulationProfile, OptionFlags, PdoProfile};
use ecan_protocol::mapping::{CHANNELS, Direction};

use crate::measured_on::MeasuredOn;
use crate::schedule::config::ScheduleConfig;

/// Most gateways of a Port.
pub const MAX_GATEWAYS: usize = ecan_host::MAX_SLAVES;
/// Most acceptance filters of a Port, of all channels together.
pub const MAX_FILTERS: usize = 512;

// Numbers in the fields, as in `ecan_host::AdapterConfig`.
const _: () = assert!(MAX_GATEWAYS == 32 && MAX_FILTERS == 512);

/// Frames per cycle that a channel is expected to carry, for the gateway's data-path budgets
/// (0x8021..0x8024, manual 13.2.2).
///
/// By default the device drains 2 received frames and sends 4 per service; it keeps more traffic in
/// its caches and loses what they cannot hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Traffic {
    /// Frames received from the bus per cycle; at most 8 are drained.
    pub received: u8,
    /// Frames sent to the bus per cycle; at most 8 are served.
    pub sent: u8,
}

impl Default for Traffic {
    /// The maximum that the gateway serves.
    fn default() -> Self {
        Self { received: 8, sent: 8 }
    }
}

/// One enabled CAN channel.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ChannelConfig {
    /// Bit rates, mode, Message RAM and the other objects of 0x8001..0x8004 (manual 13.4).
    pub can: McanChannelConfig,
    /// Budgets and policies of 0x8021..0x8024 (manual 13.2.2).
    pub data_path: DataPathConfig,
    /// Traffic for which budgets and Message RAM are configured.
    pub traffic: Traffic,
}

impl ChannelConfig {
    /// A classic CAN channel, with the Message RAM laid out for 8-byte frames. `bitrate` in bit/s.
    pub fn classic(bitrate: u32) -> Self {
        Self::new(McanChannelConfig::classic(bitrate))
    }

    /// A CAN FD channel with bit rate switch and transmitter delay compensation (manual 14.3). Bit
    /// rates in bit/s.
    pub fn fd(nominal: u32, data: u32) -> Self {
        Self::new(McanChannelConfig::fd(nominal, data))
    }

    fn new(can: McanChannelConfig) -> Self {
        let traffic = Traffic::default();
        let data_path = DataPathConfig::for_traffic(traffic.received, traffic.sent);
        Self { can, data_path, traffic }
    }

    /// Configures data-path budgets, caches and the transmit share of the Message RAM for a traffic.
    pub fn with_traffic(mut self, traffic: Traffic) -> Self {
        self.traffic = traffic;
        self.can.ram = self.can.ram.for_traffic(traffic.sent);
        self.data_path = DataPathConfig::for_traffic(traffic.received, traffic.sent);
        self
    }
}

/// One gateway.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct GatewayConfig {
    /// The channels; `None` leaves one out of the channel masks.
    pub channels: [Option<ChannelConfig>; CHANNELS],
    /// Channels whose frames the TxPDO carries to the host, 0x8010:04, bit 0 for channel 0 (manual
    /// 3); `None` for all enabled ones. A channel outside it only sends.
    pub tx_channel_mask: Option<u8>,
    /// Channels that the RxPDO carries frames to, 0x8011:04; `None` for all enabled ones. A channel
    /// outside it only receives.
    pub rx_channel_mask: Option<u8>,
    /// Packet profile of the TxPDO, 0x8010:05 (manual 9).
    pub tx_encapsulation: EncapsulationProfile,
    /// Packet profile of the RxPDO, 0x8011:05.
    pub rx_encapsulation: EncapsulationProfile,
    /// Division of the TxPDO among the channels, 0x8010:06 (manual 12).
    pub tx_budget: BudgetPolicy,
    /// Division of the RxPDO among the channels, 0x8011:06. The Port itself does not limit channels by it.
    pub rx_budget: BudgetPolicy,
    /// Options of the TxPDO, 0x8010:07 (manual 9.1). [`OptionFlags::TX_RESULT`] requests a result
    /// for every frame sent.
    pub tx_options: OptionFlags,
    /// Options of the RxPDO, 0x8011:07.
    pub rx_options: OptionFlags,
    /// Rejects frames that may overrun the gateway's transmit queue, or for a channel that is
    /// bus-off, with [`SendError::Backpressure`](crate::SendError::Backpressure).
    ///
    /// If false, the queue drops what it cannot hold, by the channel's TX overflow policy.
    pub paced: bool,
    /// Images in a row that may miss the gateway before the session counts as lost: pending
    /// frames are discarded, and nothing is sent until the gateway has been verified again.
    pub hold_limit: u16,
    /// Cycles in a row without a new TxPDO image before the session counts as lost; 0 for no limit.
    pub input_limit: u16,
    /// Scheduled transmission: margin and diagnostics.
    pub schedule: ScheduleConfig,
    /// Gateway on which settings were measured; the Port warns at opening if it is another one.
    pub measured_on: Option<MeasuredOn>,
    /// Permits the application bypass and the tests of 0x8030, which disconnect the CAN side.
    pub allow_diagnostic_tests: bool,
}

impl Default for GatewayConfig {
    /// No channel enabled, profile 0, no options: the manual's base (5.4.3).
    fn default() -> Self {
        Self {
            channels: [None; CHANNELS],
            tx_channel_mask: None,
            rx_channel_mask: None,
            tx_encapsulation: EncapsulationProfile::default(),
            rx_encapsulation: EncapsulationProfile::default(),
            tx_budget: BudgetPolicy::Balanced,
            rx_budget: BudgetPolicy::Balanced,
            tx_options: OptionFlags::default(),
            rx_options: OptionFlags::default(),
            paced: true,
            hold_limit: 10,
            input_limit: 100,
            schedule: ScheduleConfig::default(),
            measured_on: None,
            allow_diagnostic_tests: false,
        }
    }
}

impl GatewayConfig {
    /// The same configuration on all four channels.
    pub fn on_all_channels(channel: ChannelConfig) -> Self {
        Self { channels: [Some(channel); CHANNELS], ..Self::default() }
    }

    /// One channel; the others are disabled. A channel above 3 enables none.
    pub fn on_channel(channel: u8, config: ChannelConfig) -> Self {
        Self::default().with_channel(channel, config)
    }

    /// Adds a channel, 0 to 3; one above 3 is ignored.
    pub fn with_channel(mut self, channel: u8, config: ChannelConfig) -> Self {
        if let Some(entry) = self.channels.get_mut(usize::from(channel)) {
            *entry = Some(config);
        }
        self
    }

    /// Sets the channel masks of the TxPDO (channels that receive) and of the RxPDO (channels that
    /// send). Each has at least one channel, and only enabled ones; an enabled channel is in at least
    /// one of them. Without this call both have all enabled channels.
    pub fn with_channel_masks(mut self, tx_pdo: u8, rx_pdo: u8) -> Self {
        (self.tx_channel_mask, self.rx_channel_mask) = (Some(tx_pdo), Some(rx_pdo));
        self
    }

    /// Takes over `paced`, `hold_limit` and `input_limit` of another configuration.
    pub fn set_limits(&mut self, other: &Self) {
        (self.paced, self.hold_limit) = (other.paced, other.hold_limit.max(1));
        self.input_limit = other.input_limit;
    }

    /// Bit mask of the enabled channels.
    pub fn channel_mask(&self) -> u8 {
        self.channels
            .iter()
            .enumerate()
            .fold(0, |mask, (channel, config)| mask | u8::from(config.is_some()) << channel)
    }

    /// Bit mask of the channels of a direction.
    pub fn direction_mask(&self, direction: Direction) -> u8 {
        let mask = match direction {
            Direction::TxPdo => self.tx_channel_mask,
            Direction::RxPdo => self.rx_channel_mask,
        };
        mask.unwrap_or_else(|| self.channel_mask())
    }

    /// Returns whether the images of a direction carry frames of a channel.
    pub fn carries(&self, direction: Direction, channel: u8) -> bool {
        let mask = self.direction_mask(direction);
        mask.checked_shr(channel.into()).is_some_and(|mask| mask & 1 == 1)
    }

    /// The PDO profile of a direction with N = `multiplier`.
    pub fn profile(&self, direction: Direction, multiplier: u8) -> PdoProfile {
        let channel_mask = self.direction_mask(direction);
        let (profile, budget, options) = match direction {
            Direction::TxPdo => (self.tx_encapsulation, self.tx_budget, self.tx_options),
            Direction::RxPdo => (self.rx_encapsulation, self.rx_budget, self.rx_options),
        };
        PdoProfile { multiplier, channel_mask, profile, budget, options }
    }
}

/// An acceptance filter (manual 13.4).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum AcceptanceFilter {
    /// For 11-bit CAN IDs.
    Standard(StandardFilter),
    /// For 29-bit CAN IDs.
    Extended(ExtendedFilter),
}

impl Default for AcceptanceFilter {
    fn default() -> Self {
        Self::Standard(StandardFilter::default())
    }
}

impl From<StandardFilter> for AcceptanceFilter {
    fn from(filter: StandardFilter) -> Self {
        Self::Standard(filter)
    }
}

impl From<ExtendedFilter> for AcceptanceFilter {
    fn from(filter: ExtendedFilter) -> Self {
        Self::Extended(filter)
    }
}

/// An acceptance filter of a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ChannelFilter {
    /// Slave index.
    pub slave: usize,
    /// Channel, 0 to 3. The filter of a channel that is not enabled has no effect.
    pub channel: u8,
    /// The filter.
    pub filter: AcceptanceFilter,
}

/// The gateways, in the order of the Adapter's slaves, and the filters of their channels.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PortConfig {
    /// One entry per slave.
    pub gateways: List<GatewayConfig, 32>,
    /// Acceptance filters; a channel evaluates its own in this order. A channel without filters
    /// accepts by its non-match rule.
    pub filters: List<ChannelFilter, 512>,
}

impl PortConfig {
    /// `count` gateways with the same configuration, at most [`MAX_GATEWAYS`].
    pub fn uniform(count: usize, gateway: GatewayConfig) -> Self {
        let mut config = Self::default();
        // Beyond the capacity the check reports fewer gateways than slaves.
        let _ = (0..count).try_for_each(|_| config.gateways.push(gateway));
        config
    }

    /// Times of a gateway's images, for the plan of the EtherCAT side; the default without gateway.
    #[must_use]
    pub fn image_times(&self, slave: usize) -> ImageTimes {
        self.gateways.get(slave).map_or_else(ImageTimes::default, |it| it.schedule.image_times())
    }

    /// Warning of the plan about a Sync0 shift among the arrivals of the outputs (manual 16.1), with
    /// the times of the gateways.
    #[must_use]
    pub fn sync0_warning(&self, adapter: &AdapterConfig) -> Option<PlanWarning> {
        let plan = Plan::with_times(adapter, |slave| self.image_times(slave));
        let is_sync0 = |warning: &PlanWarning| matches!(warning, PlanWarning::Sync0Shift { .. });
        plan.warnings.into_iter().find(is_sync0)
    }

    /// Adds a filter after those of its channel.
    ///
    /// # Errors
    /// There are [`MAX_FILTERS`] filters already.
    pub fn add_filter(
        &mut self,
        slave: usize,
        channel: u8,
        filter: impl Into<AcceptanceFilter>,
    ) -> Result<(), ListFull> {
        self.filters.push(ChannelFilter { slave, channel, filter: filter.into() })
    }

    /// Adds gateway `slave` of another configuration, with its filters.
    ///
    /// # Errors
    /// There are [`MAX_GATEWAYS`] gateways or [`MAX_FILTERS`] filters already.
    pub fn add_gateway_of(&mut self, other: &Self, slave: usize) -> Result<(), ListFull> {
        let Some(gateway) = other.gateways.get(slave) else { return Ok(()) };
        let new = self.gateways.len();
        self.gateways.push(*gateway)?;
        other
            .filters
            .iter()
            .filter(|filter| filter.slave == slave)
            .try_for_each(|filter| self.filters.push(ChannelFilter { slave: new, ..*filter }))
    }

    /// Filters of a channel, in order.
    fn channel_filters(&self, slave: usize, channel: u8) -> impl Iterator<Item = AcceptanceFilter> {
        let filters = self.filters.iter();
        filters
            .filter(move |entry| (entry.slave, entry.channel) == (slave, channel))
            .map(|entry| entry.filter)
    }

    /// Filters of a channel for 11-bit CAN IDs, in order. Allocates.
    pub fn standard_filters(&self, slave: usize, channel: u8) -> Vec<StandardFilter> {
        let standard = |filter| match filter {
            AcceptanceFilter::Standard(filter) => Some(filter),
            AcceptanceFilter::Extended(_) => None,
        };
        self.channel_filters(slave, channel).filter_map(standard).collect()
    }

    /// Filters of a channel for 29-bit CAN IDs, in order. Allocates.
    pub fn extended_filters(&self, slave: usize, channel: u8) -> Vec<ExtendedFilter> {
        let extended = |filter| match filter {
            AcceptanceFilter::Extended(filter) => Some(filter),
            AcceptanceFilter::Standard(_) => None,
        };
        self.channel_filters(slave, channel).filter_map(extended).collect()
    }
}

impl<const N: usize> From<[GatewayConfig; N]> for PortConfig {
    fn from(gateways: [GatewayConfig; N]) -> Self {
        Self { gateways: gateways.into(), ..Self::default() }
    }
}
