//! The random machine: gateways, their configuration and what is on their buses.

use std::fmt::Write as _;
use std::path::Path;
use std::time::Duration;

use ecan_cia402::axis_traffic;
use ecan_host::{AdapterConfig, DcSync};
use ecan_mcan_port::{
    ChannelConfig, Config, FrameRate, FrameStream, GatewayConfig, PortConfig, PortPlan, Traffic,
};
use ecan_protocol::can::{CanFrame, CanId};
use ecan_protocol::config::{ExtendedFilter, ExtendedMatch, FilterAction};
use ecan_protocol::image::{BudgetPolicy, EncapsulationProfile, OptionFlags};
use ecan_sim::variant::variants;
use ecan_sim::{Scenario, ScenarioError};
use fastrand::Rng;
use serde::{Deserialize, Serialize};

use crate::draw::{chance, pick, weighted};
use crate::drives::{self, Mode};
use crate::frame_number::Kinds;

/// Variants with which a gateway does not start, which is no fault.
const NO_START: [&str; 2] = ["missing_entries", "assignment_rewritten"];
/// Least distance of the outputs from Sync0, ns.
const SYNC0_MARGIN_NS: i64 = 20_000;
/// Bits of a frame of medium length, for the load of a bus.
pub const FRAME_BITS: u64 = 130;

/// A machine, in the form of the file that repeats a trial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Machine {
    /// Simulated release of libethercat.
    pub version: String,
    pub like: String,
    pub topology: String,
    pub cycle_us: u32,
    /// Shift of Sync0; without it the gateways run free.
    pub sync0_shift_us: Option<u32>,
    /// Cycles from one SYNC of CANopen to the next.
    #[serde(default = "one")]
    pub sync_cycles: u32,
    /// An application owns the master, and the Port is attached to it.
    #[serde(default)]
    pub is_attached: bool,
    /// An I/O slave downstream of the gateways.
    #[serde(default)]
    pub has_io: bool,
    /// The master segments process data above 1486 bytes.
    #[serde(default)]
    pub has_large_pdos: bool,
    /// Lines of each gateway's table in the scenario.
    pub gateway_keys: Vec<String>,
    /// Lines of `[gateway.variant]`.
    pub variants: Vec<String>,
    pub gateway: Vec<Gateway>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gateway {
    pub alias: Option<u16>,
    pub rx_multiplier: u8,
    pub tx_multiplier: u8,
    /// With transmit results.
    pub results: bool,
    pub paced: bool,
    pub tx_profile: u8,
    pub rx_profile: u8,
    /// Option bits (manual 5.2), without TX_RESULT.
    #[serde(default)]
    pub tx_options: u8,
    #[serde(default)]
    pub rx_options: u8,
    /// Number of the budget policy of both directions.
    #[serde(default)]
    pub budget: u8,
    pub channel: Vec<Channel>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Channel {
    /// 0 to 3.
    pub number: u8,
    pub bitrate: u32,
    /// CAN FD.
    pub data_bitrate: Option<u32>,
    /// In the masks of both directions, or of one.
    pub receives: bool,
    pub sends: bool,
    /// Frames of the host in 1000 cycles.
    pub frames: u32,
    /// Range of extended CAN IDs that a filter rejects.
    pub rejects: Option<[u32; 2]>,
    pub partner: Partner,
}

/// What is on the bus besides the gateway.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum Partner {
    /// Nobody acknowledges.
    Nobody,
    Silent,
    Echo,
    /// Sends bursts of numbered frames.
    Talker {
        period_us: u32,
        burst: u32,
    },
    /// CiA 402 drives; the axes send, too.
    Drives {
        count: u8,
        mode: Mode,
    },
}

fn one() -> u32 {
    1
}

/// Replaces the partners of some channels by drives, and returns the cycles from SYNC to SYNC.
fn put_drives(r: &mut Rng, gateways: &mut [Gateway], cycle_us: u32) -> u32 {
    let (mut left, mut sync_cycles) = (drives::MOST, 1);
    for channel in gateways.iter_mut().flat_map(|gateway| &mut gateway.channel) {
        if chance(r, 40) || channel.bitrate < 500_000 {
            continue;
        }
        let count = r.u8(1..=drives::MOST_ON_CHANNEL).min(left);
        left -= count;
        if count == 0 {
            break;
        }
        let mode = weighted(r, &[(5, Mode::Csp), (2, Mode::Csv), (1, Mode::Pp), (2, Mode::Ip)]);
        channel.partner = Partner::Drives { count, mode };
        (channel.receives, channel.sends) = (true, true);
        // Little traffic of the application in addition to the axes.
        channel.frames = if chance(r, 50) { 0 } else { channel.frames.min(200) };
        sync_cycles = sync_cycles.max(drives::sync_cycles(count, channel.bitrate, cycle_us));
    }
    drives::with_interpolation_time(sync_cycles + pick(r, &[0, 0, 0, 1, 2]), cycle_us)
}

impl Channel {
    pub fn kinds(&self) -> Kinds {
        Kinds { is_fd: self.data_bitrate.is_some(), is_shared: self.drives() > 0 }
    }

    /// Frames in 1000 cycles that nodes send, without the TPDOs of drives.
    fn received(&self, cycle_us: u32) -> u32 {
        match self.partner {
            Partner::Talker { period_us, burst } => {
                let frames = u64::from(cycle_us) * 1_000 * u64::from(burst);
                (frames / u64::from(period_us)) as u32
            }
            Partner::Echo => self.frames,
            // SDO responses and heartbeats.
            Partner::Drives { .. } => 1_000,
            Partner::Nobody | Partner::Silent => 0,
        }
    }

    /// Number of drives.
    pub fn drives(&self) -> u8 {
        match self.partner {
            Partner::Drives { count, .. } => count,
            _ => 0,
        }
    }
}

impl Machine {
    /// A machine that the checks and the planner accept.
    pub fn draw(r: &mut Rng) -> Self {
        loop {
            let machine = Self::draw_any(r);
            if machine.is_planned() {
                return machine;
            }
        }
    }

    fn is_planned(&self) -> bool {
        let Config { adapter, port, .. } = self.config();
        let (axes, table) = drives::configs(self);
        let mut traffic = axis_traffic(&axes, &table);
        // An axis does not run while its gateway leaves frames out of its images.
        if !axes.is_empty() {
            traffic.extend(self.other_traffic());
        }
        let plan = PortPlan::of(&adapter, &port, &traffic);
        // The firmware misses outputs that arrive shortly after a pulse, too.
        let is_apart = adapter.dc.is_none_or(|dc| {
            plan.ethercat
                .output_arrivals()
                .is_none_or(|it| it.margin_ns(dc.shift_ns()) >= SYNC0_MARGIN_NS)
        });
        plan.faults(&adapter, &port).is_empty()
            && plan.warnings.is_empty()
            && is_apart
            && self.can_start()
    }

    /// The longest frames of application and nodes, without the process data of drives.
    fn other_traffic(&self) -> Vec<FrameStream> {
        let mut streams = Vec::new();
        for (slave, gateway) in self.gateway.iter().enumerate() {
            for channel in &gateway.channel {
                let id = CanId::extended(1).expect("valid");
                let frame = match channel.data_bitrate {
                    Some(_) => CanFrame::fd(id, &[0; 64], true, false),
                    None => CanFrame::classic(id, &[0; 8]),
                };
                let frame = frame.expect("valid");
                let rate = |frames: u32| {
                    FrameRate::PerSecond(f64::from(frames) * 1e3 / f64::from(self.cycle_us))
                };
                if channel.receives {
                    let rate = rate(channel.received(self.cycle_us));
                    streams.push(FrameStream::from_bus(slave, channel.number, frame, rate));
                }
                if channel.sends {
                    let rate = rate(channel.frames);
                    streams.push(FrameStream::to_bus(slave, channel.number, frame, rate));
                }
            }
        }
        streams
    }

    /// Gateways that take an image less often than the cycle, and those with Sync0 that need another
    /// AssignActivate, do not start.
    fn can_start(&self) -> bool {
        let variant = |key| {
            let lines = self.gateway_keys.iter().chain(&self.variants);
            let mut lines = lines.filter_map(|line| line.split_once(" = "));
            lines.find(|(known, _)| *known == key).map(|(_, value)| value)
        };
        // The answers of four drives saturate the count of waiting frames.
        let most = self.gateway.iter().flat_map(|it| &it.channel).map(Channel::drives).max();
        if most.unwrap_or(0) > 3 && variant("publishes_after_read").is_some() {
            return false;
        }
        let period_us = variant("service_period_us").and_then(|value| value.parse().ok());
        period_us.unwrap_or(0) <= self.cycle_us
            && (self.sync0_shift_us.is_none() || variant("assign_activate").is_none())
    }

    /// Returns whether an error names an assumption that the gateways do not meet.
    pub fn explains(&self, error: &str) -> bool {
        let lines = self.gateway_keys.iter().chain(&self.variants);
        let keys = lines.filter_map(|line| line.split_once(" =")).map(|(key, _)| key);
        let mut rows = keys
            .filter_map(|key| variants().find(|variant| variant.key == key))
            .flat_map(|variant| variant.assumptions);
        let words: Vec<&str> = error.split(|c: char| !c.is_ascii_alphanumeric()).collect();
        rows.any(|row| words.contains(row))
    }

    fn draw_any(r: &mut Rng) -> Self {
        let cycle_us = pick(r, &[250, 500, 1_000, 1_000, 1_000, 2_000, 4_000, 10_000]);
        let gateways = weighted(r, &[(50, 1), (25, 2), (10, 3), (8, 4), (4, 6), (3, 8)]);
        let mut gateway_keys = Vec::new();
        let mut switches = Vec::new();
        if chance(r, 30) {
            for _ in 0..r.usize(1..4) {
                let all: Vec<_> =
                    variants().filter(|variant| !NO_START.contains(&variant.key)).collect();
                let variant = pick(r, &all);
                let alternative = pick(r, &variant.alternatives[1..]);
                let (header, line) = (variant.table.header(), (variant.key, alternative.value));
                let lines = if header == "[[gateway]]" { &mut gateway_keys } else { &mut switches };
                let line = format!("{} = {}", line.0, line.1);
                let is_new = |known: &String| !known.starts_with(&format!("{} ", variant.key));
                if lines.iter().all(is_new) {
                    lines.push(line);
                }
            }
        }
        let is_star = gateways > 1 && chance(r, 30);
        // Positions shift while a branch of a star is away: then only an alias names a gateway.
        let has_aliases = is_star || chance(r, 30);
        let has_large_pdos = chance(r, 5);
        let gateway = (1..=gateways).map(|n| Gateway {
            alias: has_aliases.then_some(100 + n),
            ..Gateway::draw(r, cycle_us, has_large_pdos)
        });
        let mut gateway: Vec<Gateway> = gateway.collect();
        let sync_cycles = if chance(r, 35) { put_drives(r, &mut gateway, cycle_us) } else { 1 };
        Self {
            // Masters that segment process data are newer than 1.5.
            version: if has_large_pdos { "1.6" } else { pick(r, &["1.5", "1.6"]) }.to_owned(),
            like: pick(r, &["ideal", "ideal", "ideal", "igh"]).to_owned(),
            topology: if is_star { "star" } else { "line" }.to_owned(),
            cycle_us,
            sync0_shift_us: chance(r, 40).then(|| cycle_us * pick(r, &[10, 50, 70]) / 100),
            sync_cycles,
            is_attached: chance(r, 20),
            has_io: !is_star && chance(r, 20),
            has_large_pdos,
            gateway_keys,
            variants: switches,
            gateway,
        }
    }

    pub fn scenario(&self, seed: u64) -> Result<Scenario, ScenarioError> {
        Scenario::from_toml(&self.scenario_text(seed), "soak", Path::new("."))
    }

    /// The scenario file of the machine, without the talkers.
    pub fn scenario_text(&self, seed: u64) -> String {
        let mut text = format!(
            "seed = {seed}\nclock = \"stepped\"\nversion = \"{}\"\ncarries_large_pdos = {}\ntopology = \"{}\"\n\n\
             [master]\nlike = \"{}\"\n",
            self.version, self.has_large_pdos, self.topology, self.like
        );
        for gateway in &self.gateway {
            text.push_str("\n[[gateway]]\n");
            if let Some(alias) = gateway.alias {
                text.push_str(&format!("alias = {alias}\n"));
            }
            self.gateway_keys.iter().for_each(|line| text.push_str(&format!("{line}\n")));
            if !self.variants.is_empty() {
                text.push_str("[gateway.variant]\n");
                self.variants.iter().for_each(|line| text.push_str(&format!("{line}\n")));
            }
        }
        for (slave, gateway) in self.gateway.iter().enumerate() {
            for channel in &gateway.channel {
                let kind = match channel.partner {
                    Partner::Echo => "echo",
                    Partner::Silent => "silent",
                    Partner::Nobody | Partner::Talker { .. } | Partner::Drives { .. } => continue,
                };
                let bus = Self::bus(slave, channel);
                // infallible: writing to a string
                let _ = write!(
                    text,
                    "\n[[node]]\nkind = \"{kind}\"\nbus = \"{bus}\"\nname = \"{kind} {bus}\"\n"
                );
            }
        }
        if self.has_io {
            let position = self.gateway.len();
            // infallible: writing to a string
            let _ = write!(text, "\n[[io]]\nposition = {position}\noutputs = 1\ninputs = 1\n");
        }
        text.push_str(&drives::scenario_text(self));
        text
    }

    /// Name of the bus of a channel.
    pub fn bus(slave: usize, channel: &Channel) -> String {
        format!("{slave}.{}", channel.number)
    }

    pub fn config(&self) -> Config {
        let cycle = Duration::from_micros(self.cycle_us.into());
        let mut adapter = AdapterConfig::new(self.gateway.len() as u16).with_cycle(cycle);
        for (slave, gateway) in adapter.slaves.iter_mut().zip(&self.gateway) {
            slave.rx_multiplier = gateway.rx_multiplier;
            slave.tx_multiplier = gateway.tx_multiplier;
            if let Some(alias) = gateway.alias {
                (slave.alias, slave.position) = (alias, 0);
            }
        }
        adapter.allow_large_pdos = self.has_large_pdos;
        adapter.dc = self
            .sync0_shift_us
            .map(|shift| DcSync::new(cycle, Duration::from_micros(shift.into())));
        let mut port = PortConfig::default();
        for (slave, gateway) in self.gateway.iter().enumerate() {
            port.gateways.push(gateway.config(self.cycle_us)).expect("at most 8 gateways");
            for channel in &gateway.channel {
                if let Some([id1, id2]) = channel.rejects {
                    let filter = ExtendedFilter {
                        matching: ExtendedMatch::RangeUnmasked,
                        action: FilterAction::Reject,
                        sync: false,
                        id1,
                        id2,
                    };
                    port.add_filter(slave, channel.number, filter).expect("at most 32 filters");
                }
            }
        }
        (adapter, port).into()
    }
}

impl Gateway {
    fn draw(r: &mut Rng, cycle_us: u32, has_large_pdos: bool) -> Self {
        let multipliers: &[u8] = match has_large_pdos {
            true => &[3, 11, 12, 16, 24],
            false => &[1, 2, 3, 3, 3, 4, 6, 8, 11],
        };
        let options = |r: &mut Rng| {
            let all = [OptionFlags::ALIGN4, OptionFlags::NO_CRC16, OptionFlags::PAYLOAD_ONLY];
            let set = all.into_iter().filter(|_| chance(r, 15));
            set.fold(OptionFlags::NONE, OptionFlags::with).bits()
        };
        let first = r.u8(..4);
        let count = weighted(r, &[(4, 1), (3, 2), (1, 3), (1, 4)]);
        let mut channel: Vec<Channel> =
            (0..count).map(|n| Channel::draw(r, (first + n) % 4, cycle_us)).collect();
        channel.sort_by_key(|channel| channel.number);
        if !channel.iter().any(|channel| channel.sends) {
            channel[0].sends = true;
        }
        if !channel.iter().any(|channel| channel.receives) {
            channel[0].receives = true;
        }
        Self {
            alias: None,
            rx_multiplier: pick(r, multipliers),
            tx_multiplier: pick(r, multipliers),
            results: chance(r, 30),
            paced: chance(r, 80),
            tx_profile: pick(r, &[0, 1, 4, 5]),
            rx_profile: pick(r, &[0, 1, 4, 5]),
            tx_options: options(r),
            rx_options: options(r),
            budget: pick(r, &[0, 0, 1, 2]),
            channel,
        }
    }

    fn config(&self, cycle_us: u32) -> GatewayConfig {
        let mut config = GatewayConfig { paced: self.paced, ..GatewayConfig::default() };
        let (mut tx, mut rx) = (0, 0);
        for channel in &self.channel {
            let per_cycle = |frames: u32| frames.div_ceil(1_000).clamp(1, 8) as u8;
            // A TPDO or a target of each axis, and SYNC.
            let of_axes = 1_000 * u32::from(channel.drives().min(1) + channel.drives());
            let can = match channel.data_bitrate {
                Some(data) => ChannelConfig::fd(channel.bitrate, data),
                None => ChannelConfig::classic(channel.bitrate),
            };
            config = config.with_channel(
                channel.number,
                can.with_traffic(Traffic {
                    received: per_cycle(channel.received(cycle_us) + of_axes),
                    sent: per_cycle(channel.frames + of_axes),
                }),
            );
            tx |= u8::from(channel.receives) << channel.number;
            rx |= u8::from(channel.sends) << channel.number;
        }
        config = config.with_channel_masks(tx, rx);
        config.tx_encapsulation = profile(self.tx_profile);
        config.rx_encapsulation = profile(self.rx_profile);
        let options = |bits| OptionFlags::from_bits(bits).unwrap_or_default();
        (config.tx_options, config.rx_options) =
            (options(self.tx_options), options(self.rx_options));
        if self.results {
            config.tx_options = config.tx_options.with(OptionFlags::TX_RESULT);
        }
        let budget = BudgetPolicy::from_raw(self.budget).unwrap_or_default();
        (config.tx_budget, config.rx_budget) = (budget, budget);
        config
    }
}

fn profile(number: u8) -> EncapsulationProfile {
    match number {
        1 => EncapsulationProfile::CompactTimestamped,
        4 => EncapsulationProfile::Window64,
        5 => EncapsulationProfile::Window64Timestamped,
        _ => EncapsulationProfile::Compact,
    }
}

impl Channel {
    fn draw(r: &mut Rng, number: u8, cycle_us: u32) -> Self {
        let (bitrate, data_bitrate) = pick(
            r,
            &[
                (1_000_000, None),
                (1_000_000, None),
                (500_000, None),
                (125_000, None),
                (500_000, Some(2_000_000)),
                (1_000_000, Some(5_000_000)),
            ],
        );
        // Frames that the bus carries in 1000 cycles.
        let capacity = u64::from(bitrate) * u64::from(cycle_us) / FRAME_BITS / 1_000;
        let frames = |percent: u64| (capacity * percent / 100) as u32;
        let partner = match r.u8(..20) {
            0 => Partner::Nobody,
            1..5 => Partner::Silent,
            5..12 => Partner::Echo,
            _ => {
                let burst = pick(r, &[1, 1, 1, 3, 8]);
                let percent = pick(r, &[2, 10, 30, 60]);
                let period_us = u64::from(cycle_us) * 1_000 * u64::from(burst)
                    / u64::from(frames(percent).max(1));
                Partner::Talker { period_us: period_us.min(1_000_000) as u32, burst }
            }
        };
        let (receives, sends) =
            weighted(r, &[(8, (true, true)), (1, (true, false)), (1, (false, true))]);
        let percent = pick(r, &[1, 10, 10, 30, 50, 150]);
        Self {
            number,
            bitrate,
            data_bitrate,
            receives,
            sends,
            frames: frames(percent).min(20_000),
            rejects: chance(r, 15).then(|| {
                let first = r.u32(..0x1000_0000);
                [first, first + r.u32(..0x1000_0000)]
            }),
            partner,
        }
    }
}
