//! Configuration of a bus with its gateways as plain data: the part of the Adapter and that of the Port.

use std::time::Duration;

use ecan_host::{AdapterConfig, ImageTimes, Plan, PlanWarning, SlaveConfig};
use ecan_protocol::config::{
    ConfigObject, DataPathConfig, DeviceConfig, ExtendedFilter, InvalidValue, List, ListFull,
    McanChannelConfig, StandardFilter,
};
use ecan_protocol::device::Capabilities;
use ecan_protocol::image::{BudgetPolicy, EncapsulationProfile, OptionFlags, PdoProfile};
use ecan_protocol::mapping::{CHANNELS, Direction};

use crate::transmit::window::DEFAULT_DEPTH;

/// First N of a gateway with classic CAN, chunks of 128 bytes per direction (manual 2, 5.2).
const CLASSIC_MULTIPLIER: u8 = 3;
/// First N of a gateway with CAN FD.
pub(crate) const FD_MULTIPLIER: u8 = 8;

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
    pub(crate) excess: usize,
}

impl Config {
    /// A bus without gateways, with this cycle.
    pub fn new(cycle: Duration) -> Self {
        let adapter = AdapterConfig::new(0).with_cycle(cycle);
        Self { adapter, port: PortConfig::default(), excess: 0 }
    }

    /// Adds a gateway at the next position of the bus, with its [default N](GatewayConfig::default_multiplier). At
    /// most [`MAX_GATEWAYS`]; [`check`](Self::check) reports more.
    pub fn with_gateway(self, gateway: GatewayConfig) -> Self {
        let position = self.adapter.slaves.len() as u16;
        self.with_gateway_at(0, position, gateway)
    }

    /// As [`with_gateway`](Self::with_gateway), at a position counted from the slave with a station
    /// alias; alias 0 counts from the start of the bus.
    pub fn with_gateway_at(mut self, alias: u16, position: u16, gateway: GatewayConfig) -> Self {
        let slave =
            SlaveConfig { alias, ..SlaveConfig::at(position, gateway.default_multiplier()) };
        let added = self.adapter.slaves.push(slave).and_then(|()| self.port.gateways.push(gateway));
        self.excess += usize::from(added.is_err());
        self
    }
}

impl From<(AdapterConfig, PortConfig)> for Config {
    fn from((adapter, port): (AdapterConfig, PortConfig)) -> Self {
        Self { adapter, port, excess: 0 }
    }
}

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

/// Direction of 0x8010 or 0x8011.
fn direction_of(index: u16) -> Direction {
    match index == Direction::TxPdo.profile_object() {
        true => Direction::TxPdo,
        false => Direction::RxPdo,
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
    /// Division of the RxPDO among the channels, 0x8011:06: a channel that has used its share sends the next frames
    /// in the following images ([`Backpressure::Share`](crate::Backpressure::Share)).
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
    /// Objects that belong to no channel and no direction: pin rotation, global data path, diagnostic test,
    /// access timeout (manual 13.2, 13.3, 13.7). By default none is written.
    pub device: DeviceConfig,
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
            device: DeviceConfig::default(),
            measured_on: None,
            allow_diagnostic_tests: false,
        }
    }
}

impl GatewayConfig {
    /// A gateway with one configuration for all four channels.
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

    /// N with which to start for these channels (manual 5.2): 3 with classic CAN only, 8 if a channel has CAN FD.
    pub fn default_multiplier(&self) -> u8 {
        let has_fd = self.channels.iter().flatten().any(|channel| channel.can.fd);
        if has_fd { FD_MULTIPLIER } else { CLASSIC_MULTIPLIER }
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

    /// Sets an entry of a configuration object as an SDO download would: 0x8000, 0x8001..0x8004, 0x8010:04 to
    /// :07, 0x8011:04 to :07, 0x8020, 0x8021..0x8024, 0x8030 and 0xB000:03 (manual 13.2 to 13.4, 13.7). Ranges
    /// are not checked. N (0x8010:03, 0x8011:03) is that of the slave, and filters have their own functions.
    ///
    /// # Errors
    /// [`InvalidValue`] for an entry that is not among them, a channel that is not enabled, or a value that the
    /// type or enumeration does not have.
    pub fn set_object(&mut self, index: u16, subindex: u8, value: u32) -> Result<(), InvalidValue> {
        let invalid = InvalidValue { index, subindex, value };
        let channel = usize::from(index & 0xF).wrapping_sub(1);
        match index {
            0x8001..=0x8004 | 0x8021..=0x8024 => {
                let channel = self.channels.get_mut(channel).and_then(Option::as_mut);
                let channel = channel.ok_or(invalid)?;
                match index {
                    0x8001..=0x8004 => channel.can.set_value(subindex, value),
                    _ => channel.data_path.set_value(subindex, value),
                }
                .map_err(|_| invalid)
            }
            0x8010 | 0x8011 if subindex != PdoProfile::MULTIPLIER => {
                let direction = direction_of(index);
                let mut profile = self.profile(direction, self.default_multiplier());
                profile.set_value(subindex, value).map_err(|_| invalid)?;
                let PdoProfile { channel_mask, profile, budget, options, .. } = profile;
                let mask = (subindex == PdoProfile::CHANNEL_MASK).then_some(channel_mask);
                match direction {
                    Direction::TxPdo => {
                        self.tx_channel_mask = mask.or(self.tx_channel_mask);
                        (self.tx_encapsulation, self.tx_budget) = (profile, budget);
                        self.tx_options = options;
                    }
                    Direction::RxPdo => {
                        self.rx_channel_mask = mask.or(self.rx_channel_mask);
                        (self.rx_encapsulation, self.rx_budget) = (profile, budget);
                        self.rx_options = options;
                    }
                }
                Ok(())
            }
            _ => self.device.set_value(index, subindex, value),
        }
    }

    /// Value of an entry that [`set_object`](Self::set_object) sets; `None` for another entry, a channel that is
    /// not enabled, or an entry of [`device`](Self::device) that is not configured.
    pub fn object(&self, index: u16, subindex: u8) -> Option<u32> {
        let channel = usize::from(index & 0xF).wrapping_sub(1);
        let channel = || self.channels.get(channel)?.as_ref();
        match index {
            0x8001..=0x8004 => channel()?.can.value(subindex),
            0x8021..=0x8024 => channel()?.data_path.value(subindex),
            0x8010 | 0x8011 if subindex != PdoProfile::MULTIPLIER => {
                self.profile(direction_of(index), self.default_multiplier()).value(subindex)
            }
            _ => self.device.value(index, subindex),
        }
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
        self.gateways
            .get(slave)
            .map_or_else(ImageTimes::default, |gateway| gateway.schedule.image_times())
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

/// Identity of a gateway on which `ecan probe` measured settings; `None` for a number that it does not
/// report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct MeasuredOn {
    /// Serial number (0xF000:07, :08).
    pub serial: Option<u64>,
    /// Major and minor firmware version (0xF000:05, :06).
    pub firmware: Option<(u32, u32)>,
}

impl MeasuredOn {
    /// Text of what differs from a gateway with these capabilities; `None` if nothing does. Numbers that
    /// one of them does not report are equal.
    #[must_use]
    pub fn difference(&self, gateway: &Capabilities) -> Option<String> {
        let is_other = |measured: u64, found: u64| measured != 0 && found != 0 && measured != found;
        let Capabilities { serial_number, firmware_major, firmware_minor, .. } = *gateway;
        let found = (u32::from(firmware_major), u32::from(firmware_minor));
        let other_firmware = self.firmware.filter(|version| *version != found && found != (0, 0));
        let other_serial = self.serial.filter(|number| is_other(*number, serial_number));
        match (other_firmware, other_serial) {
            (Some((major, minor)), _) => {
                Some(format!("firmware {major}.{minor}; this one has {}.{}", found.0, found.1))
            }
            (None, Some(serial)) => {
                Some(format!("serial number {serial}; this one has {serial_number}"))
            }
            (None, None) => None,
        }
    }
}

/// Treatment of a frame whose margin does not suffice for its phase.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum MarginCheck {
    /// The frame is sent all the same and counted in
    /// [`ScheduleAccount::without_margin`](crate::ScheduleAccount::without_margin).
    #[default]
    Count,
    /// The frame is rejected with [`NotSchedulable::NoMargin`](crate::NotSchedulable::NoMargin).
    Reject,
}

/// Scheduled transmission of one gateway: times from which margins are calculated, and reading of
/// the diagnostics (manual 8.4, 13.8, 13.9).
///
/// The manual gives no times; docs/ASSUMPTIONS.md states where the defaults come from. Measure better
/// ones on the machine with `mcan_gateway_tx_probe --sweep`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ScheduleConfig {
    /// Latest time after the cycle's deadline at which the application ends its cycle, in
    /// nanoseconds: wake-up delay and run time.
    pub latest_send_ns: u32,
    /// Time of an image through host and network card, in nanoseconds, without its time on the wire.
    pub transport_ns: u32,
    /// Time of the firmware from the arrival of an image until its frames wait for their phase, in
    /// nanoseconds.
    pub processing_ns: u32,
    /// Treatment of a frame without margin.
    pub margin_check: MarginCheck,
    /// Interval in milliseconds at which the gateway's diagnostics are read after the first
    /// scheduled frame; 0 never reads them, and accepted and late frames stay open. A reading takes 2 SDO transfers and 2 for each channel,
    /// in parallel with the cycle, and begins two Sync0 periods and a cycle after the frames that it
    /// decides. The next one waits at least as long as a reading takes.
    pub watch_ms: u32,
    /// Discards an unconfirmed image that holds only scheduled frames when the Sync0 pulse of its
    /// cycle has passed: repeating it could only send them a period late.
    ///
    /// An image with frames to be sent at once is repeated in any case, because they must not be
    /// lost. Its scheduled frames may then leave a period late, and count as unknown unless a result
    /// reports that they were dropped.
    pub discard_missed: bool,
    /// Scheduled frames that the gateway holds; the plan warns of more at one Sync0 pulse.
    pub depth: u16,
}

impl Default for ScheduleConfig {
    /// 100 us until the send, 30 us through the host, 50 us in the firmware; frames without margin
    /// are counted; the diagnostics are read every 100 ms; missed images are discarded; 64 frames.
    fn default() -> Self {
        let ImageTimes { latest_send_ns, transport_ns, processing_ns } = ImageTimes::default();
        Self {
            latest_send_ns,
            transport_ns,
            processing_ns,
            margin_check: MarginCheck::Count,
            watch_ms: 100,
            discard_missed: true,
            depth: DEFAULT_DEPTH,
        }
    }
}

impl ScheduleConfig {
    /// Times of the images, for the plan of the EtherCAT side.
    #[must_use]
    pub fn image_times(&self) -> ImageTimes {
        let Self { latest_send_ns, transport_ns, processing_ns, .. } = *self;
        ImageTimes { latest_send_ns, transport_ns, processing_ns }
    }
}
