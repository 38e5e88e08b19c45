//! The preflight plan of a Port: its frames on the CAN buses and in the images, on top of the
//! EtherCAT side.

pub(crate) mod finding;
pub(crate) mod image;
pub(crate) mod load;

use std::collections::BTreeMap;

use ecan_host::{AdapterConfig, Plan};
use ecan_protocol::can::{CanFrame, CanId, FrameBits};
use ecan_protocol::config::{DataSize, FilterAction, NodeMode, NonMatch};
use ecan_protocol::image::OptionFlags;
use ecan_protocol::mapping::Direction;
use finding::{Elements, PortPlanError, PortWarning, SettingWarning};
use image::{CpuCost, ImagePlan};
use load::{ChannelLoad, FrameRate, FrameRoute, FrameStream};

use crate::config::{ChannelConfig, FD_MULTIPLIER, GatewayConfig, MarginCheck, PortConfig};
use crate::schedule::margin::{
    NotSchedulable, RECOMMENDED_OFFSET_NS, ScheduleMargin, ScheduleTimes,
};

/// Share of a bus from which a plan warns.
const LOAD_WARNING: f64 = 0.7;

/// One enabled channel in the plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChannelPlan {
    /// Slave index.
    pub slave: usize,
    /// The channel.
    pub channel: u8,
    /// Bus time of its frames.
    pub load: ChannelLoad,
    /// Most frames that a service of the gateway takes from the bus (0x8021:05).
    pub drain: u8,
    /// Most frames that a service hands to the bus (0x8021:12).
    pub serve: u8,
}

/// The images of one gateway.
#[derive(Debug, Clone, PartialEq)]
pub struct GatewayPlan {
    /// From the host.
    pub rx: ImagePlan,
    /// To the host, TX_RESULT included where the gateway is to report.
    pub tx: ImagePlan,
    schedule_times: ScheduleTimes,
}

/// Load of a configuration for a given traffic, before it touches a bus (manual 5.2, 8.4, 12,
/// 13.2.2).
///
/// Only arithmetic, as [`Plan`]: any configuration has a plan, sound or not.
///
/// ```
/// use ecan_protocol::can::{CanFrame, CanId};
/// use ecan_mcan_port::{ChannelConfig, FrameRate, FrameStream, GatewayConfig, PortConfig, PortPlan};
/// use std::time::Duration;
/// use ecan_host::AdapterConfig;
///
/// let gateway = GatewayConfig::on_channel(0, ChannelConfig::classic(1_000_000));
/// let frame = CanFrame::classic(CanId::standard(0x123)?, &[0; 8])?;
/// let plan = PortPlan::of(
///     &AdapterConfig::new(1).with_cycle(Duration::from_millis(1)),
///     &PortConfig::uniform(1, gateway),
///     &[FrameStream::to_bus(0, 0, frame, FrameRate::PerCycle(4))],
/// );
/// assert!(plan.rejections.is_empty());
/// assert!((plan.channels[0].load.most - 0.54).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct PortPlan {
    /// The EtherCAT side, with its findings; they are among those of the whole, too.
    pub ethercat: Plan,
    /// The enabled channels, in the order of slaves and channels.
    pub channels: Vec<ChannelPlan>,
    /// One entry per gateway.
    pub gateways: Vec<GatewayPlan>,
    /// Errors: what would not work.
    pub rejections: Vec<PortPlanError>,
    /// Warnings: what works with little margin.
    pub warnings: Vec<PortWarning>,
}

impl PortPlan {
    /// The plan of both configurations for this traffic. Allocates; not for the cycle.
    pub fn of(adapter: &AdapterConfig, port: &PortConfig, traffic: &[FrameStream]) -> Self {
        let ethercat = Plan::with_times(adapter, |slave| port.image_times(slave));
        let mut plan = Self {
            rejections: ethercat.rejections.iter().copied().map(PortPlanError::EtherCat).collect(),
            warnings: ethercat.warnings.iter().copied().map(PortWarning::EtherCat).collect(),
            ethercat,
            channels: Vec::new(),
            gateways: Vec::new(),
        };
        plan.add_streams(port, traffic);
        plan.add_channels(adapter, port, traffic);
        plan.add_images(adapter, port, traffic);
        plan.check_schedules(adapter, port, traffic);
        let settings = warnings(adapter, port, &plan.gateways);
        plan.warnings.extend(settings.into_iter().map(PortWarning::Setting));
        plan
    }

    /// Everything that would not work, in words: the rejections, and what the check of the
    /// configurations says besides.
    pub fn faults(&self, adapter: &AdapterConfig, port: &PortConfig) -> Vec<String> {
        let mut faults: Vec<String> = self.rejections.iter().map(ToString::to_string).collect();
        if let Err(checked) = port.check(adapter) {
            for fault in checked.0.iter().map(ToString::to_string) {
                if !faults.contains(&fault) {
                    faults.push(fault);
                }
            }
        }
        faults
    }

    fn add_streams(&mut self, port: &PortConfig, traffic: &[FrameStream]) {
        for stream in traffic {
            let FrameStream { slave, channel, way, .. } = *stream;
            let is_carried = carries(port, slave, channel, way);
            let rejection = match settings(port, slave, channel) {
                None => PortPlanError::NoChannel { slave, channel },
                Some(_) if !is_carried && way == FrameRoute::ToBus => {
                    PortPlanError::ReceiveOnly { slave, channel }
                }
                Some(_) if !is_carried => {
                    let warning = PortWarning::SendOnly { slave, channel };
                    if !self.warnings.contains(&warning) {
                        self.warnings.push(warning);
                    }
                    continue;
                }
                Some(settings) if stream.frame.is_fd() && !settings.can.fd => {
                    PortPlanError::NotFd { slave, channel }
                }
                Some(_) => continue,
            };
            if !self.rejections.contains(&rejection) {
                self.rejections.push(rejection);
            }
        }
    }

    fn add_channels(
        &mut self,
        adapter: &AdapterConfig,
        port: &PortConfig,
        traffic: &[FrameStream],
    ) {
        for (slave, gateway) in port.gateways.iter().enumerate() {
            for (channel, settings) in (0u8..).zip(&gateway.channels) {
                let Some(settings) = settings else { continue };
                let address = (slave, channel);
                let here = traffic.iter().filter(|s| (s.slave, s.channel) == address);
                let load = ChannelLoad::of(here, &settings.can, adapter.cycle_ns());
                let data_path = &settings.data_path;
                self.check_load(address, &load);
                // The gateway discards what it does not carry.
                let is_received = carries(port, slave, channel, FrameRoute::FromBus);
                let received = if is_received { up(load.mean_received) } else { 0 };
                let sent = up(load.mean_sent);
                if let Some(rejection) = finding::rejection(address, received, sent) {
                    self.rejections.push(rejection);
                } else {
                    self.warnings.extend(finding::warning(address, received, sent, data_path));
                }
                let (drain, serve) = (data_path.rx_drain_max, data_path.tx_budget_max);
                self.channels.push(ChannelPlan { slave, channel, load, drain, serve });
            }
        }
    }

    fn check_load(&mut self, (slave, channel): (usize, u8), load: &ChannelLoad) {
        let percent = |share: f64| (share * 100.0).round() as u32;
        // Rounded up to the next where it would read as 100 although it is more.
        let (least_percent, most_percent) = (percent(load.least), up(load.most * 100.0));
        if load.most > 1.0 {
            self.rejections.push(PortPlanError::BusLoad {
                slave,
                channel,
                least_percent,
                most_percent,
            });
        } else if load.most > LOAD_WARNING {
            let most_percent = percent(load.most);
            self.warnings.push(PortWarning::BusLoad {
                slave,
                channel,
                least_percent,
                most_percent,
            });
        }
    }

    fn add_images(&mut self, adapter: &AdapterConfig, port: &PortConfig, traffic: &[FrameStream]) {
        let sizes = adapter.slaves.iter().zip(&self.ethercat.slaves);
        for (slave, (gateway, (size, wire))) in port.gateways.iter().zip(sizes).enumerate() {
            let image = |direction, multiplier| {
                let profile = gateway.profile(direction, multiplier);
                let here = traffic.iter().filter(|stream| stream.slave == slave);
                ImagePlan::new(direction, profile, here, adapter.cycle_ns())
            };
            let images = GatewayPlan {
                rx: image(Direction::RxPdo, size.rx_multiplier),
                tx: image(Direction::TxPdo, size.tx_multiplier),
                schedule_times: ScheduleTimes::new(&gateway.schedule, adapter, wire),
            };
            images.rx.check(slave, &mut self.rejections, &mut self.warnings);
            images.tx.check(slave, &mut self.rejections, &mut self.warnings);
            self.gateways.push(images);
        }
    }

    /// Estimated processor time per cycle for the images of all gateways, in nanoseconds, in the
    /// fullest cycle. Without the master's own work and the application's.
    pub fn cpu_ns(&self, cost: CpuCost) -> f64 {
        let images = self.gateways.iter().flat_map(|gateway| [&gateway.rx, &gateway.tx]);
        images.map(|image| cost.image(image.peak)).sum()
    }

    /// Processor time of the images as a share of the cycle; 1 is one processor.
    pub fn cpu_share(&self, cost: CpuCost) -> f64 {
        self.cpu_ns(cost) / f64::from(self.ethercat.cycle_ns.max(1))
    }
}

/// Rounds a count up, except for a rounding error of the calculation.
fn up(value: f64) -> u32 {
    (value - 1e-9).ceil() as u32
}

/// Returns whether the images carry the channel's frames of this route.
fn carries(port: &PortConfig, slave: usize, channel: u8, route: FrameRoute) -> bool {
    let direction = match route {
        FrameRoute::ToBus => Direction::RxPdo,
        FrameRoute::FromBus => Direction::TxPdo,
        FrameRoute::OnBusOnly => return true,
    };
    port.gateways.get(slave).is_some_and(|gateway| gateway.carries(direction, channel))
}

fn settings(port: &PortConfig, slave: usize, channel: u8) -> Option<&ChannelConfig> {
    port.gateways.get(slave)?.channels.get(usize::from(channel))?.as_ref()
}

impl PortPlan {
    /// The margin that a phase will have, as
    /// [`Port::schedule_margin`](crate::Port::schedule_margin) gives it for gateways that have the
    /// capability, which a plan cannot know.
    ///
    /// # Errors
    /// [`NotSchedulable`] if no frame can be scheduled at this phase: without Sync0, beyond the Sync0
    /// period. A slave index out of range is not supported.
    pub fn schedule_margin(
        &self,
        slave: usize,
        offset_ns: u32,
    ) -> Result<ScheduleMargin, NotSchedulable> {
        let gateway = self.gateways.get(slave).ok_or(NotSchedulable::NotSupported)?;
        gateway.schedule_times.margin(offset_ns)
    }

    fn check_schedules(
        &mut self,
        adapter: &AdapterConfig,
        port: &PortConfig,
        traffic: &[FrameStream],
    ) {
        for stream in traffic {
            // What has no place is rejected for that.
            let (slave, Some(offset_ns)) = (stream.slave, stream.offset_ns()) else { continue };
            let Some(gateway) = port.gateways.get(slave) else { continue };
            if slave < self.gateways.len() {
                self.check_phase(slave, offset_ns, gateway.schedule.margin_check);
            }
        }
        self.check_simultaneous_frames(adapter, port, traffic);
    }

    /// An error for a phase that the Port would reject, a warning for one that it would count.
    fn check_phase(&mut self, slave: usize, offset_ns: u32, check: MarginCheck) {
        let checked = self.schedule_margin(slave, offset_ns).and_then(|margin| {
            let lacking_ns = margin.lacking_ns();
            match check {
                MarginCheck::Reject if lacking_ns > 0 => {
                    Err(NotSchedulable::NoMargin { lacking_ns })
                }
                _ => Ok(margin),
            }
        });
        let margin = match checked {
            Ok(margin) => margin,
            Err(reason) => {
                let rejection = PortPlanError::NotSchedulable { slave, offset_ns, reason };
                if !self.rejections.contains(&rejection) {
                    self.rejections.push(rejection);
                }
                return;
            }
        };
        let lacking_ns = margin.lacking_ns();
        let short =
            (lacking_ns > 0).then_some(PortWarning::NoMargin { slave, offset_ns, lacking_ns });
        let thin = margin.is_thin().then_some(PortWarning::ThinMargin { slave, offset_ns, margin });
        let small =
            (offset_ns < RECOMMENDED_OFFSET_NS).then_some(PortWarning::SmallOffset { offset_ns });
        for warning in [short, thin, small].into_iter().flatten() {
            if !self.warnings.contains(&warning) {
                self.warnings.push(warning);
            }
        }
    }

    /// Warns of more frames for one Sync0 pulse than a gateway holds, and of frames that are still
    /// on the bus when the next period begins.
    fn check_simultaneous_frames(
        &mut self,
        adapter: &AdapterConfig,
        port: &PortConfig,
        traffic: &[FrameStream],
    ) {
        let Some(sync0_ns) = adapter.dc.map(|dc| dc.cycle_ns()) else { return };
        let mut meeting: BTreeMap<usize, u32> = BTreeMap::new();
        // Per channel: the first offset, and the bus time of all that meets at a pulse.
        let mut scheduled: BTreeMap<(usize, u8), (u32, f64)> = BTreeMap::new();
        for stream in traffic {
            let Some(offset_ns) = stream.offset_ns() else { continue };
            let Some(settings) = settings(port, stream.slave, stream.channel) else { continue };
            let can = &settings.can;
            let bits = FrameBits::most(stream.frame.as_ref());
            let frames = frames_at_a_pulse(stream.rate, adapter.cycle_ns(), sync0_ns);
            let held = meeting.entry(stream.slave).or_default();
            *held = held.saturating_add(frames);
            let frames_s = f64::from(frames) * bits.seconds(can.nominal_bitrate, can.data_bitrate);
            let (first, total_s) =
                scheduled.entry((stream.slave, stream.channel)).or_insert((offset_ns, 0.0));
            *first = (*first).min(offset_ns);
            *total_s += frames_s;
        }
        for (slave, frames) in meeting {
            let depth =
                port.gateways.get(slave).map_or(0, |gateway| u32::from(gateway.schedule.depth));
            if frames > depth {
                self.warnings.push(PortWarning::ScheduleCrowded { slave, frames, depth });
            }
        }
        for ((slave, channel), (offset_ns, total_s)) in scheduled {
            let frames_ns = (total_s * 1e9) as u64;
            let is_phase = offset_ns < sync0_ns;
            if is_phase && u64::from(offset_ns) + frames_ns > u64::from(sync0_ns) {
                self.warnings.push(PortWarning::ScheduleOverruns {
                    slave,
                    channel,
                    offset_ns,
                    frames_ns,
                    sync0_ns,
                });
            }
        }
    }
}

/// Frames of all cycles that lie in a Sync0 period: they wait for the same pulse.
fn frames_at_a_pulse(rate: FrameRate, cycle_ns: u32, sync0_ns: u32) -> u32 {
    let cycles = (sync0_ns / cycle_ns.max(1)).max(1);
    match rate {
        FrameRate::PerCycle(frames) => frames.saturating_mul(cycles),
        FrameRate::EveryCycles(every) => cycles.div_ceil(every.max(1)),
        FrameRate::PerSecond(_) => rate.peak(cycle_ns.max(sync0_ns)),
    }
}

/// The warnings of a configuration. Allocates.
fn warnings(
    adapter: &AdapterConfig,
    port: &PortConfig,
    plans: &[GatewayPlan],
) -> Vec<SettingWarning> {
    let mut warnings = Vec::new();
    let gateways = port.gateways.iter().zip(&adapter.slaves).zip(plans);
    for (slave, ((gateway, size), images)) in gateways.enumerate() {
        for (channel, settings) in channels(gateway) {
            settings.can.warnings(&mut |warning| {
                warnings.push(SettingWarning::BitTiming { slave, channel, warning });
            });
            let actions = filter_actions(port, slave, channel);
            let [sends, receives] =
                [&images.rx, &images.tx].map(|image| image.profile.has_channel(channel));
            let uses = |elements| if elements == Elements::Transmit { sends } else { receives };
            warnings.extend(short_elements(slave, channel, settings, &actions, uses));
            if receives && receives_nothing(settings, &actions) {
                warnings.push(SettingWarning::NothingReceived { slave, channel });
            }
            let reports = images.tx.profile.options.contains(OptionFlags::TX_RESULT);
            if reports && !receives {
                warnings.push(SettingWarning::ResultsOfSendOnly { slave, channel });
            }
            let directions = [&images.rx, &images.tx].into_iter();
            let carrying = directions.filter(|image| image.profile.has_channel(channel));
            warnings
                .extend(carrying.filter_map(|image| short_share(slave, channel, settings, image)));
        }
        let sizes =
            [(Direction::RxPdo, size.rx_multiplier), (Direction::TxPdo, size.tx_multiplier)];
        for (direction, multiplier) in sizes {
            let has_fd = channels(gateway)
                .any(|(channel, settings)| settings.can.fd && gateway.carries(direction, channel));
            if has_fd && multiplier < FD_MULTIPLIER {
                warnings.push(SettingWarning::FdImageSize { slave, direction, multiplier });
            }
        }
    }
    warnings
}

fn short_share(
    slave: usize,
    channel: u8,
    settings: &ChannelConfig,
    image: &ImagePlan,
) -> Option<SettingWarning> {
    let frame = largest_frame(settings.can.fd)?;
    let direction = image.direction;
    let frame_bytes = image.packet_bytes(frame.as_ref(), false);
    let share_bytes = image.channel_bytes();
    (frame_bytes > share_bytes).then_some(SettingWarning::ShareBelowFrame {
        slave,
        channel,
        direction,
        frame_bytes,
        share_bytes,
    })
}

fn filter_actions(port: &PortConfig, slave: usize, channel: u8) -> Vec<FilterAction> {
    let standard = port.standard_filters(slave, channel).into_iter().map(|filter| filter.action);
    let extended = port.extended_filters(slave, channel).into_iter().map(|filter| filter.action);
    standard.chain(extended).collect()
}

fn receives_nothing(settings: &ChannelConfig, actions: &[FilterAction]) -> bool {
    let can = &settings.can;
    let rejects = |non_match| matches!(non_match, NonMatch::Reject | NonMatch::RejectToo);
    let takes_none = |action: &FilterAction| {
        matches!(action, FilterAction::Disabled | FilterAction::Reject | FilterAction::Priority)
    };
    rejects(can.non_match_standard)
        && rejects(can.non_match_extended)
        && actions.iter().all(takes_none)
}

fn channels(gateway: &GatewayConfig) -> impl Iterator<Item = (u8, &ChannelConfig)> {
    (0..).zip(&gateway.channels).filter_map(|(channel, it)| Some((channel, it.as_ref()?)))
}

/// Data of the largest length with a CAN ID of 29 bits.
fn largest_frame(is_fd: bool) -> Option<CanFrame> {
    let id = CanId::extended(0).ok()?;
    match is_fd {
        true => CanFrame::fd(id, &[0; 64], true, false).ok(),
        false => CanFrame::classic(id, &[0; 8]).ok(),
    }
}

/// Elements that a CAN FD channel uses and that do not hold 64 bytes.
fn short_elements(
    slave: usize,
    channel: u8,
    settings: &ChannelConfig,
    actions: &[FilterAction],
    uses: impl Fn(Elements) -> bool,
) -> impl Iterator<Item = SettingWarning> {
    let (can, ram) = (&settings.can, &settings.can.ram);
    let takes = |non_match, is_used: fn(FilterAction) -> bool| {
        [can.non_match_standard, can.non_match_extended].map(Some).contains(&non_match)
            || actions.iter().any(|action| is_used(*action))
    };
    let fifo0 = |action| matches!(action, FilterAction::Fifo0 | FilterAction::PriorityFifo0);
    let fifo1 = |action| matches!(action, FilterAction::Fifo1 | FilterAction::PriorityFifo1);
    let buffer = |action| matches!(action, FilterAction::RxBuffer(_));
    let used = [
        (Elements::RxFifo0, ram.rx_fifo0.data_size, takes(Some(NonMatch::Fifo0), fifo0)),
        (Elements::RxFifo1, ram.rx_fifo1.data_size, takes(Some(NonMatch::Fifo1), fifo1)),
        (Elements::RxBuffers, ram.rx_buffer_data_size, takes(None, buffer)),
        (Elements::Transmit, ram.tx_data_size, can.node_mode != NodeMode::Listen),
    ];
    let is_fd = can.fd;
    let is_short = move |(elements, size, is_used): (Elements, DataSize, bool)| {
        let bytes = size.bytes();
        (is_fd && is_used && uses(elements) && bytes < DataSize::B64.bytes())
            .then_some(SettingWarning::ShortElements { slave, channel, elements, bytes })
    };
    used.into_iter().filter_map(is_short)
}
