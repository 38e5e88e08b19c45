//! What the Port is told about each gateway: plain data.

use ecan_protocol::config::{DataPathConfig, ExtendedFilter, McanChannelConfig, StandardFilter};
use ecan_protocol::image::{BudgetPolicy, EncapsulationProfile, OptionFlags, PdoProfile};
use ecan_protocol::mapping::{CHANNELS, Direction};

use crate::schedule_settings::ScheduleConfig;

/// Frames per cycle that a channel is expected to carry, for the gateway's data-path budgets
/// (0x8021..0x8024, manual 13.2.2).
///
/// The device's own default drains 2 received frames and sends 4 per service; more traffic than
/// that stays in its caches and is lost there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Traffic {
    /// Frames received from the bus per cycle, at most 8 are drained.
    pub received: u8,
    /// Frames sent to the bus per cycle, at most 8 are served.
    pub sent: u8,
}

impl Default for Traffic {
    /// The most that the gateway serves.
    fn default() -> Self {
        Self { received: 8, sent: 8 }
    }
}

/// One enabled CAN channel.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelConfig {
    /// Bit rates, mode, Message RAM and the other objects of 0x8001..0x8004 (manual 13.4).
    pub can: McanChannelConfig,
    /// Filters for 11-bit identifiers, in order; empty accepts by the non-match rule.
    pub standard_filters: Vec<StandardFilter>,
    /// Filters for 29-bit identifiers, in order; empty accepts by the non-match rule.
    pub extended_filters: Vec<ExtendedFilter>,
    /// Budgets and policies of 0x8021..0x8024 (manual 13.2.2).
    pub data_path: DataPathConfig,
    /// The traffic that budgets and Message RAM are made for.
    pub traffic: Traffic,
}

impl ChannelConfig {
    /// A classic CAN channel, with the Message RAM laid out for 8-byte frames.
    pub fn classic(bitrate: u32) -> Self {
        Self::new(McanChannelConfig::classic(bitrate))
    }

    /// A CAN FD channel with bit rate switch and transmitter delay compensation (manual 14.3).
    pub fn fd(nominal: u32, data: u32) -> Self {
        Self::new(McanChannelConfig::fd(nominal, data))
    }

    fn new(can: McanChannelConfig) -> Self {
        let expected = Traffic::default();
        Self {
            can,
            standard_filters: Vec::new(),
            extended_filters: Vec::new(),
            data_path: DataPathConfig::for_traffic(expected.received, expected.sent),
            traffic: expected,
        }
    }

    /// Sets data-path budgets, cache and the share of transmission in the Message RAM for the
    /// traffic that is expected.
    pub fn with_traffic(mut self, traffic: Traffic) -> Self {
        self.traffic = traffic;
        self.can.ram = self.can.ram.for_traffic(traffic.sent);
        self.data_path = DataPathConfig::for_traffic(traffic.received, traffic.sent);
        self
    }
}

/// One gateway.
#[derive(Debug, Clone, PartialEq)]
pub struct GatewayConfig {
    /// The channels; `None` leaves one out of the channel masks.
    pub channels: [Option<ChannelConfig>; CHANNELS],
    /// Packet profile of the TxPDO, 0x8010:05 (manual 9).
    pub tx_encapsulation: EncapsulationProfile,
    /// Packet profile of the RxPDO, 0x8011:05.
    pub rx_encapsulation: EncapsulationProfile,
    /// How channels share the TxPDO, 0x8010:06 (manual 12).
    pub tx_budget: BudgetPolicy,
    /// How channels share the RxPDO, 0x8011:06. The Port itself does not limit channels by it.
    pub rx_budget: BudgetPolicy,
    /// Options of the TxPDO, 0x8010:07 (manual 9.1). [`OptionFlags::TX_RESULT`] asks for the
    /// outcome of every frame sent.
    pub tx_options: OptionFlags,
    /// Options of the RxPDO, 0x8011:07.
    pub rx_options: OptionFlags,
    /// Refuse frames, as "no room", that would overrun the gateway's transmit queue or meet a
    /// channel that is bus-off.
    ///
    /// Off, the queue drops what it cannot hold, by the channel's TX overflow policy.
    pub paced: bool,
    /// Images in a row that may miss the gateway before the session counts as lost: pending
    /// frames are discarded, and nothing is sent until the gateway has been verified again.
    pub hold_limit: u16,
    /// Cycles in a row that may bring no new TxPDO image before the session counts as lost; 0 for
    /// no limit.
    pub input_limit: u16,
    /// Scheduled transmission: margin, and how the gateway is watched.
    pub schedule: ScheduleConfig,
    /// Permits the application bypass and the tests of 0x8030, which cut the CAN side off.
    pub allow_diagnostic_tests: bool,
}

impl Default for GatewayConfig {
    /// No channel enabled, profile 0, no options: the manual's base (5.4.3).
    fn default() -> Self {
        Self {
            channels: [const { None }; CHANNELS],
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
            allow_diagnostic_tests: false,
        }
    }
}

impl GatewayConfig {
    /// The same settings on all four channels.
    pub fn on_all_channels(settings: &ChannelConfig) -> Self {
        Self { channels: std::array::from_fn(|_| Some(settings.clone())), ..Self::default() }
    }

    /// One channel, the others left out. A channel beyond the gateway's four enables none.
    pub fn on_channel(channel: u8, settings: ChannelConfig) -> Self {
        let mut config = Self::default();
        if let Some(place) = config.channels.get_mut(usize::from(channel)) {
            *place = Some(settings);
        }
        config
    }

    /// Bit mask of the enabled channels.
    pub fn channel_mask(&self) -> u8 {
        self.channels
            .iter()
            .enumerate()
            .fold(0, |mask, (channel, settings)| mask | u8::from(settings.is_some()) << channel)
    }

    /// The PDO profile of a direction with N = `multiplier`.
    pub fn profile(&self, direction: Direction, multiplier: u8) -> PdoProfile {
        let (profile, budget, options) = match direction {
            Direction::TxPdo => (self.tx_encapsulation, self.tx_budget, self.tx_options),
            Direction::RxPdo => (self.rx_encapsulation, self.rx_budget, self.rx_options),
        };
        PdoProfile { multiplier, channel_mask: self.channel_mask(), profile, budget, options }
    }
}

/// The gateways, in the order of the Adapter's slaves.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PortConfig {
    /// One entry per slave.
    pub gateways: Vec<GatewayConfig>,
}

impl PortConfig {
    /// `count` gateways with the same configuration.
    pub fn uniform(count: usize, gateway: GatewayConfig) -> Self {
        Self { gateways: vec![gateway; count] }
    }
}
