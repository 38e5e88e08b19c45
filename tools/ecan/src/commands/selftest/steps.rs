//! Steps of a test and the configuration in which they run.

use std::collections::BTreeSet;
use std::time::Duration;

use ecan_host::{AdapterConfig, StartupStep};
use ecan_mcan_port::{GatewayConfig, MAX_GATEWAYS, PortConfig};
use ecan_protocol::config::NodeMode;
use ecan_protocol::mapping::CHANNELS;

use crate::context::{Failure, Result};
use crate::frames::WATCHDOG;

use super::SelftestArguments;
use super::exchange::Route;
use super::rates::Rate;

/// Time that one byte takes on the EtherCAT wire, in ns.
const BYTE_NS: u64 = 80;
/// Part of a cycle that the process data of gateways tested in parallel may take, in percent.
const WIRE_PERCENT: u64 = 60;

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
        let loops = arguments.channels.iter().map(|it| Route { from: it, to: it }).collect();
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

    /// Configuration in which gateways start: all tested channels only listen, or if forced are in
    /// loopback, with CAN FD if any step uses it, so that the Port accepts every frame.
    pub(super) fn configs(&self, positions: &[usize]) -> Result<(AdapterConfig, PortConfig)> {
        let SelftestArguments { pdo_n, cycle_us, large_pdos, .. } = *self.arguments;
        let count = u16::try_from(positions.len()).unwrap_or(u16::MAX);
        let mut adapter = AdapterConfig::new(count)
            .with_multiplier(pdo_n)
            .with_cycle(Duration::from_micros(cycle_us.into()))
            .with_watchdog(WATCHDOG);
        adapter.master_index = self.master;
        adapter.allow_large_pdos = large_pdos;
        for (slave, position) in adapter.slaves.iter_mut().zip(positions) {
            slave.position = u16::try_from(*position)
                .map_err(|_| Failure::Slave(format!("slave {position} does not exist")))?;
        }
        let mut gateway = GatewayConfig::default();
        let start = self.rates.iter().find(|rate| rate.is_fd()).or(self.rates.first());
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

    /// Number of gateways whose process data fit into a cycle.
    pub(super) fn group_size(&self) -> usize {
        let bytes = u64::from(self.arguments.pdo_n) * 256 + 50;
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
