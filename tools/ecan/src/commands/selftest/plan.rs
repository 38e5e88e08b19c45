//! Plan of a test: arguments, wired channels, bit rates, steps, and the configuration in which they run.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;

use clap::{Args, FromArgMatches as _};
use ecan_host::{AdapterConfig, StartupStep};
use ecan_mcan_port::{ChannelConfig, Config, GatewayConfig, MAX_GATEWAYS, PortConfig};
use ecan_protocol::config::{McanChannelConfig, NodeMode};
use ecan_protocol::mapping::CHANNELS;
use ecan_protocol::object::SdoWrite;
use ecan_tool_support::command_line::options::{RealTimeArguments, milliseconds};

use crate::config_file;
use crate::context::{Failure, Result};
use crate::frames::{Channels, WATCHDOG};

/// Most frames per direction and bit rate: the CAN ID has a byte for the number.
pub(super) const MOST_FRAMES: u16 = 256;
/// Time that one byte takes on the EtherCAT wire, in ns.
const BYTE_NS: u64 = 80;
/// Part of a cycle that the process data of gateways tested in parallel may take, in percent.
const WIRE_PERCENT: u64 = 60;

#[derive(Debug, Args)]
pub struct SelftestArguments {
    /// Use the bit rates of this configuration file
    #[arg(long, value_name = "FILE")]
    pub(super) config: Option<PathBuf>,
    /// Channels for the loopback test, 0 to 3, comma-separated, or all
    #[arg(long, value_name = "CHANNELS", default_value = "all")]
    pub(super) channels: Channels,
    /// Pairs of wired channels, for example 0-1,2-3
    #[arg(long, value_name = "PAIRS")]
    pub(super) wired: Option<Wiring>,
    /// Expected firmware version, as shown by `ecan firmware version`
    #[arg(long, value_name = "VERSION")]
    pub(super) expect_version: Option<String>,
    /// Expected number of gateways; fail if the bus has another number
    #[arg(long, value_name = "COUNT")]
    pub(super) gateways: Option<usize>,
    /// Frames per direction and bit rate; 96 cover every length
    #[arg(long, value_name = "COUNT", default_value_t = 96,
          value_parser = clap::value_parser!(u16).range(1..=i64::from(MOST_FRAMES)))]
    pub(super) frames: u16,
    /// Write a report per gateway into this directory
    #[arg(long, value_name = "DIR")]
    pub(super) report: Option<PathBuf>,
    /// Time to listen for traffic on each bus before the test
    #[arg(long, value_name = "TIME", default_value = "1s", value_parser = milliseconds::<u32>(1..=600_000))]
    pub(super) observe: u32,
    /// Test even if there is traffic on a bus; nodes on it lose frames
    #[arg(long, conflicts_with = "observe")]
    pub(super) force: bool,
    /// Restart the gateways afterwards instead of restoring unsaved settings: faster
    #[arg(long)]
    pub(super) restart: bool,
    /// PDO size per direction in chunks of 128 bytes, 1 to 24 [default: 3, with CAN FD 8]
    #[arg(long, value_name = "N")]
    pub(super) pdo_n: Option<u8>,
    /// Allow PDO sizes above 11 chunks, for masters that support large PDOs
    #[arg(long)]
    pub(super) large_pdos: bool,
    /// EtherCAT cycle time, in us
    #[arg(long, value_name = "US", default_value_t = 1000,
          value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub(super) cycle_us: u32,
    #[command(flatten)]
    pub(super) real_time: RealTimeArguments,
}

impl SelftestArguments {
    /// The default of each argument, with wired channels.
    pub(super) fn with_wiring(wired: Option<Wiring>) -> Result<Self> {
        let command = Self::augment_args(clap::Command::new("selftest"));
        let matches = command.try_get_matches_from(["selftest"]);
        let defaults = matches.and_then(|matches| Self::from_arg_matches(&matches));
        let defaults = defaults.map_err(|error| Failure::Usage(error.to_string()))?;
        Ok(Self { wired, ..defaults })
    }
}

/// Route from one channel to another, or to itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Route {
    pub(super) from: u8,
    pub(super) to: u8,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TestPath {
    Loopback,
    Wire,
}

/// Exchange of frames on all routes of a path, at one bit rate.
#[derive(Clone, Copy, Debug)]
pub(super) struct TestStep<'a> {
    pub(super) path: TestPath,
    pub(super) rate: &'a Rate,
    pub(super) routes: &'a [Route],
}

impl TestStep<'_> {
    pub(super) fn name(&self) -> String {
        match self.path {
            TestPath::Loopback => format!("loopback, {}", self.rate.name()),
            TestPath::Wire => format!("wires, {}", self.rate.name()),
        }
    }

    pub(super) fn check_name(&self, Route { from, to }: Route) -> String {
        match self.path {
            TestPath::Loopback => format!("loopback of channel {from}, {}", self.rate.name()),
            TestPath::Wire => format!("wire from channel {from} to {to}, {}", self.rate.name()),
        }
    }

    pub(super) fn node_mode(&self) -> NodeMode {
        match self.path {
            TestPath::Loopback => NodeMode::InternalLoopback,
            TestPath::Wire => NodeMode::Normal,
        }
    }

    pub(super) fn channels(&self) -> Vec<u8> {
        self.routes.iter().map(|route| route.from).collect()
    }

    fn gateway(&self) -> GatewayConfig {
        let mut gateway = GatewayConfig::default();
        for channel in self.channels() {
            gateway.channels[usize::from(channel)] = Some(self.rate.channel(self.node_mode()));
        }
        gateway
    }
}

#[derive(Debug)]
pub(super) struct TestPlan<'a> {
    arguments: &'a SelftestArguments,
    rates: &'a [Rate],
    master: u32,
    loops: Vec<Route>,
    wires: Vec<Route>,
}

impl<'a> TestPlan<'a> {
    /// Checks every step; `rates` is not empty.
    pub(super) fn new(
        arguments: &'a SelftestArguments,
        rates: &'a [Rate],
        master: u32,
    ) -> Result<Self> {
        let loops =
            arguments.channels.iter().map(|channel| Route { from: channel, to: channel }).collect();
        let pairs = arguments.wired.iter().flat_map(|wiring| wiring.pairs());
        let both = |&(a, b): &(u8, u8)| [Route { from: a, to: b }, Route { from: b, to: a }];
        let plan = Self { arguments, rates, master, loops, wires: pairs.flat_map(both).collect() };
        let (adapter, _) = plan.configs(&[0])?;
        for step in plan.steps() {
            let config = PortConfig::uniform(1, step.gateway());
            config.check(&adapter).map_err(|faults| Failure::Usage(faults.to_string()))?;
        }
        Ok(plan)
    }

    pub(super) fn arguments(&self) -> &SelftestArguments {
        self.arguments
    }

    /// The wired channels.
    pub(super) fn pairs(&self) -> &[(u8, u8)] {
        self.arguments.wired.as_ref().map_or(&[], |wiring| wiring.pairs())
    }

    /// At each bit rate the loopbacks, then the wires.
    pub(super) fn steps(&self) -> Vec<TestStep<'_>> {
        let paths = [(TestPath::Loopback, &self.loops[..]), (TestPath::Wire, &self.wires[..])];
        let at_rate = |rate| {
            paths
                .into_iter()
                .filter(|(_, routes)| !routes.is_empty())
                .map(move |(path, routes)| TestStep { path, rate, routes })
        };
        self.rates.iter().flat_map(at_rate).collect()
    }

    /// Channels that the test uses.
    pub(super) fn tested(&self) -> [bool; CHANNELS] {
        let mut tested = [false; CHANNELS];
        for route in self.loops.iter().chain(&self.wires) {
            if let Some(is_tested) = tested.get_mut(usize::from(route.from)) {
                *is_tested = true;
            }
        }
        tested
    }

    /// Bit rate with which the gateways start: with CAN FD if any step uses it.
    fn start(&self) -> Option<&Rate> {
        self.rates.iter().find(|rate| rate.is_fd()).or(self.rates.first())
    }

    /// Configuration in which gateways start: all tested channels only listen, or if forced are in
    /// loopback, with CAN FD if any step uses it, so that the Port accepts every frame.
    pub(super) fn configs(&self, positions: &[usize]) -> Result<(AdapterConfig, PortConfig)> {
        let SelftestArguments { cycle_us, large_pdos, .. } = *self.arguments;
        let count = u16::try_from(positions.len()).unwrap_or(u16::MAX);
        let mut adapter = AdapterConfig::new(count)
            .with_multiplier(self.pdo_n())
            .with_cycle(Duration::from_micros(cycle_us.into()))
            .with_watchdog(WATCHDOG);
        adapter.master_index = self.master;
        adapter.allow_large_pdos = large_pdos;
        for (slave, position) in adapter.slaves.iter_mut().zip(positions) {
            slave.position = u16::try_from(*position)
                .map_err(|_| Failure::Slave(format!("slave {position} does not exist")))?;
        }
        let mut gateway = GatewayConfig::default();
        let start = self.start();
        let mode = match self.arguments.force {
            true => NodeMode::InternalLoopback,
            false => NodeMode::Listen,
        };
        for (channel, is_tested) in gateway.channels.iter_mut().zip(self.tested()) {
            let start = start.filter(|_| is_tested);
            *channel = start.map(|rate| rate.channel(mode));
        }
        Ok((adapter, PortConfig::uniform(positions.len(), gateway)))
    }

    /// N of the gateways.
    fn pdo_n(&self) -> u8 {
        let start = self.start().map(|rate| rate.channel(NodeMode::Listen));
        let gateway = GatewayConfig { channels: [start; CHANNELS], ..GatewayConfig::default() };
        self.arguments.pdo_n.unwrap_or_else(|| gateway.default_multiplier())
    }

    /// Number of gateways whose process data fit into a cycle.
    pub(super) fn group_size(&self) -> usize {
        let bytes = u64::from(self.pdo_n()) * 256 + 50;
        let available_ns = u64::from(self.arguments.cycle_us) * 1000 * WIRE_PERCENT / 100;
        let fits = available_ns / (bytes * BYTE_NS);
        usize::try_from(fits).unwrap_or(MAX_GATEWAYS).clamp(1, MAX_GATEWAYS)
    }

    /// Objects that the test writes, apart from the commands.
    pub(super) fn written_objects(&self) -> Result<BTreeSet<(u16, u8)>> {
        let (adapter, config) = self.configs(&[0])?;
        let startup = config.startup_plan(&adapter).steps(&adapter, 0);
        let downloads = startup.iter().filter_map(|step| match step {
            StartupStep::Download(write) => Some((write.index, write.subindex)),
            _ => None,
        });
        let mut written: BTreeSet<_> = downloads.collect();
        for step in self.steps() {
            let can = step.rate.channel(step.node_mode()).can;
            let writes = step.channels().into_iter().flat_map(|channel| can.needed_writes(channel));
            written.extend(writes.map(|write| (write.index, write.subindex)));
        }
        Ok(written)
    }
}

/// Pairs of channels, for example `0-1,2-3`; each channel at most once.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Wiring(Vec<(u8, u8)>);

impl Wiring {
    pub fn pairs(&self) -> &[(u8, u8)] {
        &self.0
    }
}

impl FromStr for Wiring {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let wrong = || "expected pairs of channels 0 to 3, for example 0-1,2-3".to_owned();
        let mut pairs = Vec::new();
        let mut is_used = [false; CHANNELS];
        for pair in text.split(',') {
            let (first, second) = pair.split_once('-').ok_or_else(wrong)?;
            let mut channel = |text: &str| {
                let channel: u8 = text.parse().map_err(|_| wrong())?;
                let used = is_used.get_mut(usize::from(channel)).ok_or_else(wrong)?;
                match std::mem::replace(used, true) {
                    true => Err(format!("channel {channel} is used twice")),
                    false => Ok(channel),
                }
            };
            pairs.push((channel(first)?, channel(second)?));
        }
        Ok(Self(pairs))
    }
}

/// Default list: nominal and data bit rate in bit/s.
const USUAL: [(u32, Option<u32>); 6] = [
    (125_000, None),
    (250_000, None),
    (500_000, None),
    (1_000_000, None),
    (500_000, Some(2_000_000)),
    (1_000_000, Some(5_000_000)),
];

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Rate {
    can: McanChannelConfig,
}

impl Rate {
    pub(super) fn usual() -> Vec<Self> {
        let settings = USUAL.map(|(nominal, data)| plain_channel(nominal, data));
        settings.into_iter().map(|setting| Self { can: setting.can }).collect()
    }

    /// Bit rates of a file, without duplicates, in the order of the file.
    pub(super) fn of_file(file: &Config) -> Vec<Self> {
        let mut rates = Vec::new();
        for channel in
            file.port.gateways.iter().flat_map(|gateway| gateway.channels.iter().flatten())
        {
            let own = channel.can;
            let mut can =
                plain_channel(own.nominal_bitrate, own.fd.then_some(own.data_bitrate)).can;
            can.bit_timing_mode = own.bit_timing_mode;
            can.nominal_sample_point = own.nominal_sample_point;
            can.manual_nominal = own.manual_nominal;
            can.non_iso = own.non_iso;
            // The data phase has no effect in classic CAN.
            if own.fd {
                can.data_sample_point = own.data_sample_point;
                can.manual_data = own.manual_data;
                (can.tdc, can.tdc_offset, can.tdc_filter) =
                    (own.tdc, own.tdc_offset, own.tdc_filter);
            }
            let rate = Self { can };
            if !rates.contains(&rate) {
                rates.push(rate);
            }
        }
        rates
    }

    pub(super) fn of_channel(can: &McanChannelConfig) -> Self {
        Self { can: *can }
    }

    pub(super) fn channel(&self, mode: NodeMode) -> ChannelConfig {
        let data = self.is_fd().then_some(self.can.data_bitrate);
        let mut settings = plain_channel(self.can.nominal_bitrate, data);
        settings.can = McanChannelConfig { node_mode: mode, ..self.can };
        settings
    }

    pub(super) fn is_fd(&self) -> bool {
        self.can.fd
    }

    /// Name such as `500 kbit/s` or `500/2000 kbit/s FD`.
    pub(super) fn name(&self) -> String {
        let kilo = |rate: u32| match rate % 1000 {
            0 => (rate / 1000).to_string(),
            _ => format!("{}", f64::from(rate) / 1000.0),
        };
        let nominal = kilo(self.can.nominal_bitrate);
        match self.can.fd {
            true => format!("{nominal}/{} kbit/s FD", kilo(self.can.data_bitrate)),
            false => format!("{nominal} kbit/s"),
        }
    }

    /// Nominal and, with CAN FD, data bit rate in bit/s.
    pub(super) fn bit_rates(&self) -> (u32, Option<u32>) {
        (self.can.nominal_bitrate, self.can.fd.then_some(self.can.data_bitrate))
    }
}

fn plain_channel(nominal: u32, data: Option<u32>) -> ChannelConfig {
    match data {
        Some(data) => ChannelConfig::fd(nominal, data),
        None => ChannelConfig::classic(nominal),
    }
}

/// Reads a valid file with at least one channel.
pub(super) fn read_rates(path: &Path) -> Result<Config> {
    let file = config_file::read(path)?;
    if Rate::of_file(&file).is_empty() {
        let reason = "the file has no channel and thus no bit rate to test";
        return Err(Failure::file("use", path, reason));
    }
    Ok(file)
}

/// Values that the last configuration of the channels wrote.
#[derive(Clone, Debug)]
pub(super) struct ChannelSetup {
    values: BTreeMap<(u16, u8), u32>,
}

impl ChannelSetup {
    /// As after the start of the gateway.
    pub(super) fn started(channels: [Option<McanChannelConfig>; CHANNELS]) -> Self {
        let mut setup = Self { values: BTreeMap::new() };
        for (channel, config) in (0..).zip(&channels) {
            if let Some(config) = config {
                setup.note(config.needed_writes(channel));
            }
        }
        setup
    }

    /// Downloads that change the channels of a step and apply the changes, with the check of each
    /// status.
    pub(super) fn changes(&self, step: &TestStep<'_>) -> Vec<StartupStep> {
        let can = step.rate.channel(step.node_mode()).can;
        let mut changes = Vec::new();
        for channel in step.channels() {
            let differs = |write: &SdoWrite| {
                self.values.get(&(write.index, write.subindex)) != Some(&write.value)
            };
            let before = changes.len();
            let writes = can.needed_writes(channel).filter(differs);
            changes.extend(writes.map(StartupStep::Download));
            if changes.len() > before {
                let apply = McanChannelConfig::apply_write(channel);
                changes.push(StartupStep::Download(apply));
                changes.push(StartupStep::expect(apply.index, 2, 0));
            }
        }
        changes
    }

    /// Notes that the changes of a step are active.
    pub(super) fn set(&mut self, step: &TestStep<'_>) {
        let can = step.rate.channel(step.node_mode()).can;
        for channel in step.channels() {
            self.note(can.needed_writes(channel));
        }
    }

    fn note(&mut self, writes: impl Iterator<Item = SdoWrite>) {
        self.values.extend(writes.map(|write| ((write.index, write.subindex), write.value)));
    }
}

#[cfg(test)]
mod tests {
    use super::{Rate, Route, TestPath, *};

    #[test]
    fn pairs_use_each_channel_once() {
        let parse = |text: &str| text.parse::<Wiring>();
        assert_eq!(parse("0-1,3-2"), Ok(Wiring(vec![(0, 1), (3, 2)])));
        for wrong in ["", "0", "0-4", "0-1,", "0:1", "a-b", "0-0", "0-1,1-2"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn only_changed_values_are_written() {
        let rates = Rate::usual();
        let routes = [0, 1].map(|channel| Route { from: channel, to: channel });
        let step = |rate, path| TestStep { path, rate, routes: &routes };
        let first = step(&rates[0], TestPath::Loopback);
        let can = first.rate.channel(first.node_mode()).can;
        let mut setup = ChannelSetup::started([Some(can), Some(can), None, None]);
        assert_eq!(setup.changes(&first), []);
        let wires = step(&rates[0], TestPath::Wire);
        let objects = |setup: &ChannelSetup, step| -> Vec<_> {
            setup.changes(step).iter().map(StartupStep::object).collect()
        };
        let expected =
            [(0x8001, 8), (0x8001, 1), (0x8001, 2), (0x8002, 8), (0x8002, 1), (0x8002, 2)];
        assert_eq!(objects(&setup, &wires), expected);
        setup.set(&wires);
        assert_eq!(setup.changes(&wires), []);
        let faster = objects(&setup, &step(&rates[1], TestPath::Wire));
        assert_eq!(faster[..3], [(0x8001, 19), (0x8001, 1), (0x8001, 2)]);
        assert_eq!(faster.len(), 6);
    }
}
