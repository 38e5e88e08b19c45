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

use crate::channel::{Channel, Partner};
use crate::draw::{chance, pick, weighted};
use crate::drives::{self, Mode};
use crate::service_plan::ServicePlan;

/// Variants with which a gateway does not start, which is no fault.
const NO_START: [&str; 2] = ["missing_entries", "assignment_rewritten"];
/// Least distance of the outputs from Sync0, ns.
const SYNC0_MARGIN_NS: i64 = 20_000;
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
    /// The application uses the C interface.
    #[serde(default)]
    pub uses_c: bool,
    /// The application serves other programs.
    #[serde(default)]
    pub service: Option<ServicePlan>,
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

/// Connects some channels to the bus of another one, of the same gateway or of one before it.
fn share_buses(r: &mut Rng, gateways: &mut [Gateway]) {
    let places = gateways.iter().enumerate();
    let places = places.flat_map(|(slave, it)| (0..it.channel.len()).map(move |at| (slave, at)));
    let places: Vec<_> = places.collect();
    for (nth, (slave, at)) in places.iter().copied().enumerate().skip(1) {
        let (first_slave, first_at) = places[r.usize(..nth)];
        let other = &mut gateways[first_slave].channel[first_at];
        if chance(r, 50) || other.drives() > 0 {
            continue;
        }
        // An echo node would send each frame twice to the other channel.
        if other.partner == Partner::Echo {
            other.partner = Partner::Silent;
        }
        let (bus, other) = (Machine::bus(first_slave, other), other.clone());
        let channel = &mut gateways[slave].channel[at];
        if channel.drives() == 0 {
            channel.connect(bus, &other);
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
                .is_none_or(|arrivals| arrivals.margin_ns(dc.shift_ns()) >= SYNC0_MARGIN_NS)
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
                    let rate = rate(self.received(slave, channel));
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

    /// Frames in 1000 cycles that others send on the bus of a channel, without the TPDOs of drives.
    fn received(&self, slave: usize, channel: &Channel) -> u32 {
        let others = self.sharing(slave, channel).map(|other| {
            let sent = if other.sends { other.frames } else { 0 };
            other.of_nodes(self.cycle_us) + sent
        });
        channel.of_nodes(self.cycle_us) + others.sum::<u32>()
    }

    /// The other channels on the bus of a channel.
    pub fn sharing(&self, slave: usize, channel: &Channel) -> impl Iterator<Item = &Channel> {
        let (bus, number) = (Self::bus(slave, channel), channel.number);
        let places = self.gateway.iter().enumerate();
        let places = places.flat_map(|(at, it)| it.channel.iter().map(move |other| (at, other)));
        let others = places.filter(move |(at, other)| {
            (*at, other.number) != (slave, number) && Self::bus(*at, other) == bus
        });
        others.map(|(_, other)| other)
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
        let most =
            self.gateway.iter().flat_map(|channels| &channels.channel).map(Channel::drives).max();
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
        if chance(r, 35) {
            share_buses(r, &mut gateway);
        }
        let has_drives = gateway
            .iter()
            .flat_map(|channels| &channels.channel)
            .any(|channel| channel.drives() > 0);
        let service = chance(r, 15).then(|| ServicePlan::draw(r, has_drives));
        let is_attached = chance(r, 20);
        let uses_c = !has_drives && !is_attached && service.is_none() && chance(r, 35);
        Self {
            // Masters that segment process data are newer than 1.5.
            version: if has_large_pdos { "1.6" } else { pick(r, &["1.5", "1.6"]) }.to_owned(),
            like: pick(r, &["ideal", "ideal", "ideal", "igh"]).to_owned(),
            topology: if is_star { "star" } else { "line" }.to_owned(),
            cycle_us,
            sync0_shift_us: chance(r, 40).then(|| cycle_us * pick(r, &[10, 50, 70]) / 100),
            sync_cycles,
            is_attached,
            uses_c,
            has_io: !is_star && chance(r, 20),
            has_large_pdos,
            service,
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
        for (slave, gateway) in self.gateway.iter().enumerate() {
            text.push_str("\n[[gateway]]\n");
            if let Some(alias) = gateway.alias {
                text.push_str(&format!("alias = {alias}\n"));
            }
            if gateway.channel.iter().any(|channel| channel.bus.is_some()) {
                text.push_str(&format!("buses = {:?}\n", gateway.buses(slave)));
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
                // A silent node of several channels is one node.
                if text.contains(&format!("name = \"{kind} {bus}\"")) {
                    continue;
                }
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
        channel.bus.clone().unwrap_or_else(|| format!("{slave}.{}", channel.number))
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
            let received = |channel: &Channel| self.received(slave, channel);
            port.gateways.push(gateway.config(received)).expect("at most 8 gateways");
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

    /// Names of the buses of all four channels.
    fn buses(&self, slave: usize) -> [String; 4] {
        let mut buses = [0, 1, 2, 3].map(|number| format!("{slave}.{number}"));
        for channel in &self.channel {
            buses[usize::from(channel.number)] = Machine::bus(slave, channel);
        }
        buses
    }

    /// `received`: frames in 1000 cycles that others send on the bus of a channel.
    fn config(&self, received: impl Fn(&Channel) -> u32) -> GatewayConfig {
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
                    received: per_cycle(received(channel) + of_axes),
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
