//! Configuration of a table of axes, its check, and its errors.

use std::fmt;
use std::ops::Range;
use std::time::Duration;

use ecan_canopen::{
    BootProgress, HostHeartbeat, NetworkConfig, NetworkError, NmtError, NodeConfig,
    PdoMappingError, Step, SyncConfig, WaitError,
};
use ecan_host::CycleError;
use ecan_mcan_port::{NotSchedulable, Port};
use ecan_protocol::can::CanId;
use ecan_protocol::config::TxMode;
use ecan_protocol::mapping::{CHANNELS, Direction};
use thiserror::Error;

use crate::axis::config::{AxisConfig, Takeover};
use crate::axis::error::{AxisFault, CommandError};
use crate::axis::plan::SyncPeriod;
use crate::axis::ramp::RampLimits;
use crate::axis::script::{axis_step, mode_steps};
use crate::axis::setup_steps::{self, BusConfig};
use crate::axis::status::AxisProgress;
use crate::axis::targets::{TargetPeriod, interpolation_time};

/// Configuration that all axes of a bus share.
#[derive(Debug, Clone, PartialEq)]
pub struct Cia402Config {
    /// CANopen network; by its host heartbeat drives detect that the host has stopped.
    pub network: NetworkConfig,
    /// SDO client of each node. Its heartbeat timeout follows from
    /// [`DriveConfig::heartbeat_ms`](crate::DriveConfig::heartbeat_ms).
    pub node: NodeConfig,
    /// Production of SYNC, with which the drives apply targets and send TPDOs.
    pub sync: SyncConfig,
    /// Fewest cycles from target to target; 0 counts as 1. See [`target_cycles`](Self::target_cycles).
    pub motion_div: u32,
    /// Treatment of a drive that is enabled at the first contact.
    pub takeover: Takeover,
}

impl Cia402Config {
    /// Cycles from target to target, the target period: the least multiple of
    /// [`SyncConfig::every_cycles`] that is at least [`motion_div`](Self::motion_div), since a target
    /// takes effect with a SYNC. Drives get it as interpolation time 0x60C2.
    pub fn target_cycles(&self) -> u32 {
        target_cycles(self.motion_div, self.sync.every_cycles)
    }

    /// The steps that configure a node with these axes and set their modes, for
    /// [`NodeDescription::setup`](ecan_canopen::NodeDescription::setup).
    ///
    /// # Errors
    /// An invalid PDO.
    pub fn setup_steps(
        &self,
        axes: &[&AxisConfig],
        cycle_ns: u32,
    ) -> Result<Vec<Step>, PdoMappingError> {
        let clock = TargetClock::new(cycle_ns, self);
        let mut steps = setup_steps::steps(axes, &self.bus(&clock))?;
        for axis in axes {
            let mode = mode_steps(axis.mode);
            steps.extend(mode.map(|step| axis_step(axis.node_axis, step)));
        }
        Ok(steps)
    }

    pub(super) fn bus(&self, clock: &TargetClock) -> BusConfig {
        BusConfig {
            sync_period_ns: clock.sync().ns,
            target_period_ns: clock.period_ns(),
            host: self.network.host_heartbeat,
            sync: self.sync,
        }
    }
}

/// Period of the targets of all axes, counted in SYNC periods.
#[derive(Debug, Clone, Copy)]
pub(super) struct TargetClock {
    cycle_ns: u32,
    cycles_per_sync: u32,
    /// Cycles from target to target: a multiple of the SYNC period.
    cycles: u32,
    syncs_to_target: u32,
    is_target_cycle: bool,
}

impl TargetClock {
    pub(super) fn new(cycle_ns: u32, config: &Cia402Config) -> Self {
        Self {
            cycle_ns,
            cycles_per_sync: config.sync.every_cycles.max(1),
            cycles: config.target_cycles(),
            syncs_to_target: 0,
            is_target_cycle: false,
        }
    }

    /// Returns the clock with another [`Cia402Config::motion_div`], at the begin of a period.
    pub(super) fn with_motion_div(self, motion_div: u32) -> Self {
        let cycles = target_cycles(motion_div, self.cycles_per_sync);
        Self { cycles, syncs_to_target: 0, ..self }
    }

    pub(super) fn cycle_ns(&self) -> u32 {
        self.cycle_ns
    }

    pub(super) fn cycles(&self) -> u32 {
        self.cycles
    }

    pub(super) fn period_ns(&self) -> u64 {
        u64::from(self.cycle_ns) * u64::from(self.cycles)
    }

    /// Period of one axis.
    pub(super) fn target_period(&self) -> TargetPeriod {
        TargetPeriod::new(self.cycles, self.period_ns())
    }

    /// SYNC period of the bus.
    pub(super) fn sync(&self) -> SyncPeriod {
        let cycles = self.cycles_per_sync;
        SyncPeriod { cycles, ns: u64::from(self.cycle_ns) * u64::from(cycles) }
    }

    /// Counts a cycle.
    pub(super) fn begin_cycle(&mut self, sync_period_begins: bool) {
        self.is_target_cycle = false;
        if sync_period_begins {
            self.is_target_cycle = self.syncs_to_target == 0;
            let syncs = self.cycles / self.cycles_per_sync;
            self.syncs_to_target = self.syncs_to_target.checked_sub(1).unwrap_or(syncs - 1);
        }
    }

    /// Returns whether a target period begins in this cycle.
    pub(super) fn is_target_cycle(&self) -> bool {
        self.is_target_cycle
    }
}

fn target_cycles(motion_div: u32, cycles_per_sync: u32) -> u32 {
    let cycles_per_sync = cycles_per_sync.max(1);
    motion_div.max(1).checked_next_multiple_of(cycles_per_sync).unwrap_or(cycles_per_sync)
}

impl Default for Cia402Config {
    /// SYNC and targets in every cycle, at once; a heartbeat of the host every 50 ms, as node 127.
    fn default() -> Self {
        let node = ecan_canopen::NodeId::MAX;
        Self {
            network: NetworkConfig {
                host_heartbeat: Some(HostHeartbeat { node, period: Duration::from_millis(50) }),
                ..NetworkConfig::default()
            },
            node: NodeConfig::default(),
            sync: SyncConfig::default(),
            motion_div: 1,
            takeover: Takeover::default(),
        }
    }
}

/// Faults of axes on a Port, each with the index of its axis in the table, in this order.
///
/// [`Cia402::new`](super::Cia402::new) rejects a table with any of them.
pub fn axis_faults<'a>(
    port: &Port,
    axes: impl IntoIterator<Item = (usize, &'a AxisConfig)>,
    config: &Cia402Config,
) -> Vec<(usize, AxisFault)> {
    let mut faults = Vec::new();
    examine(port, axes, config, &mut faults);
    faults
}

/// The axes with their limits in increments of a target period.
pub(super) fn checked(
    port: &Port,
    axes: Vec<AxisConfig>,
    config: &Cia402Config,
) -> Result<Vec<(AxisConfig, RampLimits)>, AxisFaults> {
    let mut faults = Vec::new();
    let axes = examine(port, axes.iter().enumerate(), config, &mut faults);
    if faults.is_empty() { Ok(axes) } else { Err(AxisFaults { faults }) }
}

fn examine<'a>(
    port: &Port,
    axes: impl IntoIterator<Item = (usize, &'a AxisConfig)>,
    config: &Cia402Config,
    faults: &mut Vec<(usize, AxisFault)>,
) -> Vec<(AxisConfig, RampLimits)> {
    let cycle_ns = u64::from(port.adapter().config().cycle_ns());
    let period_ns = cycle_ns * u64::from(config.target_cycles());
    let has_period = interpolation_time(period_ns).is_some();
    let mut earlier: Vec<(usize, &AxisConfig)> = Vec::new();
    let mut limited = Vec::new();
    for (index, axis) in axes {
        let before = faults.len();
        let mut report = |fault| faults.push((index, fault));
        axis.check(&mut report);
        if axis.needs_interpolation_time() && !has_period {
            report(AxisFault::TargetPeriod { period_ns });
        }
        check_address(port, axis, &mut report);
        axis_conflicts(axis, &earlier, &mut report);
        let address = axis.address;
        if config.network.host_heartbeat.is_some_and(|host| host.node == address.node) {
            report(AxisFault::HostNode { address });
        }
        earlier.push((index, axis));
        // The increments of faulty limits have no meaning.
        if faults.len() == before {
            let period = Duration::from_nanos(period_ns);
            limited.push(axis.at_period(period, &mut |fault| faults.push((index, fault))));
        }
    }
    limited
}

/// Reports the faults of an axis with earlier ones of its table, each with its index: the same axis of a
/// node, different settings of a node, PDO numbers of a node and COB-IDs of a channel that are used twice.
/// [`axis_faults`] reports these, too; for tools that have no Port.
pub fn axis_conflicts(
    axis: &AxisConfig,
    earlier: &[(usize, &AxisConfig)],
    report: &mut dyn FnMut(AxisFault),
) {
    let address = axis.address;
    let of_node = || earlier.iter().filter(|(_, earlier)| earlier.address == address);
    if let Some((other, _)) = of_node().find(|(_, it)| it.node_axis == axis.node_axis) {
        report(AxisFault::SameNode { address, other: *other });
    } else if let Some((other, _)) = of_node().find(|(_, it)| !it.shares_node_settings(axis)) {
        report(AxisFault::NodeSettings { address, other: *other });
    }
    for (other, earlier) in earlier {
        let channel = |axis: &AxisConfig| (axis.address.slave, axis.address.channel);
        if channel(earlier) == channel(axis)
            && (earlier.address, earlier.node_axis) != (address, axis.node_axis)
            && let Some(cob_id) =
                pdo_ids(axis).find(|id| pdo_ids(earlier).any(|other| other == *id))
        {
            return report(AxisFault::SameCobId { cob_id, other: *other });
        }
    }
    for (other, earlier) in of_node().filter(|(_, it)| it.node_axis != axis.node_axis) {
        if let Some(number) = first_common(rpdos(axis), rpdos(earlier))
            .or_else(|| first_common(tpdos(axis), tpdos(earlier)))
        {
            return report(AxisFault::SamePdo { number, other: *other });
        }
    }
}

/// Numbers of the RPDOs of an axis, from the first to one beyond the last.
fn rpdos(axis: &AxisConfig) -> Range<usize> {
    let first = usize::from(axis.pdos.number);
    first..first + axis.layout().rpdo_count()
}

/// As [`rpdos`], of the TPDOs.
fn tpdos(axis: &AxisConfig) -> Range<usize> {
    let first = usize::from(axis.pdos.number);
    first..first + axis.layout().tpdo_count()
}

fn first_common(one: Range<usize>, other: Range<usize>) -> Option<u16> {
    let first = one.start.max(other.start);
    let is_common = first < one.end.min(other.end);
    u16::try_from(first).ok().filter(|_| is_common)
}

/// CAN IDs of the PDOs of an axis.
fn pdo_ids(axis: &AxisConfig) -> impl Iterator<Item = CanId> + '_ {
    let layout = axis.layout();
    let received = (0..layout.rpdo_count()).map(|nth| axis.rpdo_id(nth));
    received.chain((0..layout.tpdo_count()).map(|nth| axis.tpdo_id(nth)))
}

/// Checks that the Port has the channel of an axis, in both directions and in order.
fn check_address(port: &Port, axis: &AxisConfig, report: &mut impl FnMut(AxisFault)) {
    let (slave, channel) = (axis.address.slave, axis.address.channel);
    let Some(gateway) = port.config().gateways.get(slave) else {
        return report(AxisFault::NoSuchSlave { slave, slaves: port.slave_count() });
    };
    if usize::from(channel) >= CHANNELS {
        return;
    }
    let enabled = gateway.channels.get(usize::from(channel)).and_then(Option::as_ref);
    match enabled.map(|enabled| enabled.can.ram.tx_mode) {
        None => return report(AxisFault::ChannelNotEnabled { slave, channel }),
        Some(TxMode::Queue) => report(AxisFault::TransmitQueue { slave, channel }),
        Some(TxMode::Fifo) => {}
    }
    for direction in Direction::ALL {
        if !gateway.carries(direction, channel) {
            report(AxisFault::ChannelDirection { slave, channel, direction });
        }
    }
}

/// Reason for which targets or SYNC cannot be scheduled at a phase of Sync0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ScheduleError {
    /// The configuration or a gateway cannot serve it.
    #[error("slave {slave} cannot schedule at {offset_ns} ns: {reason}")]
    NotSchedulable {
        /// Slave index.
        slave: usize,
        /// The offset.
        offset_ns: u32,
        /// Reason.
        reason: NotSchedulable,
    },
    /// An axis is active: an immediate target would overtake one that is still scheduled.
    #[error("axis {axis} is active; disable it first")]
    Active {
        /// Index of the axis.
        axis: usize,
    },
}

/// Faults of an axis table.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisFaults {
    /// Axis and fault, in the order of the table.
    pub faults: Vec<(usize, AxisFault)>,
}

impl fmt::Display for AxisFaults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the axis table has faults")?;
        self.faults.iter().try_for_each(|(axis, fault)| write!(f, "\n  - axis {axis}: {fault}"))
    }
}

impl std::error::Error for AxisFaults {}

/// Axes that did not reach a state.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisTimeout {
    /// The state.
    pub what: &'static str,
    /// Waiting time by the bus clock.
    pub waited: Duration,
    /// The axes that did not reach it, with their progress.
    pub axes: Vec<AxisProgress>,
    /// Error of the last cycle of a stop: its frames were not sent.
    pub cycle_error: Option<CycleError>,
}

impl AxisTimeout {
    pub(super) const STOPPED: &str = "stopped (may still move)";
    pub(super) const SWITCHED_OFF: &str = "switched off (may still move)";
}

impl fmt::Display for AxisTimeout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let count = self.axes.len();
        let axes = if count == 1 { "axis" } else { "axes" };
        write!(f, "{count} {axes} not {} after {} ms", self.what, self.waited.as_millis())?;
        if let Some(error) = &self.cycle_error {
            write!(f, "; the cycle fails: {error}")?;
        }
        self.axes.iter().try_for_each(|axis| write!(f, "\n  - {axis}"))
    }
}

impl std::error::Error for AxisTimeout {}

/// Mandatory nodes that are not booted.
#[derive(Debug, Clone, PartialEq)]
pub struct BootTimeout {
    /// Waiting time by the bus clock.
    pub waited: Duration,
    /// The nodes, with their progress.
    pub nodes: Vec<BootProgress>,
}

impl fmt::Display for BootTimeout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let count = self.nodes.len();
        let nodes = if count == 1 { "node" } else { "nodes" };
        write!(f, "{count} mandatory {nodes} not booted after {} ms", self.waited.as_millis())?;
        self.nodes.iter().try_for_each(|node| write!(f, "\n  - {node}"))
    }
}

impl std::error::Error for BootTimeout {}

/// Errors of [`Cia402`](super::Cia402) outside the cycle.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Cia402Error {
    /// The axis table has faults; nothing was changed.
    #[error(transparent)]
    Axes(#[from] AxisFaults),
    /// The network rejected its configuration.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// A command was rejected.
    #[error(transparent)]
    Command(#[from] CommandError),
    /// An NMT command could not be queued.
    #[error(transparent)]
    Nmt(#[from] NmtError),
    /// Axes did not reach a state.
    #[error(transparent)]
    AxisTimeout(#[from] AxisTimeout),
    /// Mandatory nodes are not booted.
    #[error(transparent)]
    BootTimeout(#[from] BootTimeout),
    /// The cycle failed while waiting.
    #[error(transparent)]
    Wait(#[from] WaitError),
    /// The PDOs cannot be mapped.
    #[error("axis {axis}: {error}")]
    Mapping {
        /// Index of the axis.
        axis: usize,
        /// Cause.
        error: PdoMappingError,
    },
}
