//! The preflight plan of a Port: its frames on the CAN buses and in the images, on top of the
//! EtherCAT side.

pub(crate) mod budget;
mod channel_load;
mod cpu_cost;
mod finding;
mod frame_stream;
mod image;
mod schedule;
mod setting_check;
mod setting_warning;

pub use channel_load::ChannelLoad;
pub use cpu_cost::CpuCost;
pub use finding::{PortPlanError, PortWarning};
pub use frame_stream::{FrameRate, FrameRoute, FrameStream};
pub use image::{ImageFill, ImagePlan};
pub use setting_warning::{Elements, SettingWarning};

use ecan_host::{AdapterConfig, Plan};
use ecan_protocol::mapping::Direction;

use crate::port_config::{ChannelConfig, PortConfig};
use crate::schedule::margin::ScheduleTimes;

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
        let settings = setting_check::warnings(adapter, port, &plan.gateways);
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
                if let Some(rejection) = budget::rejection(address, received, sent) {
                    self.rejections.push(rejection);
                } else {
                    self.warnings.extend(budget::warning(address, received, sent, data_path));
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

    /// The same as a share of the cycle; 1 is one processor.
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
