//! The keys of a file outside its gateways: cycle, clocks, network, service.

use super::axis::FileAxis;
use super::device_profile::IncludedProfile;
use super::document::Located;
use super::document::{Table, store};
use super::node::FileNode;
use super::{axis, gateway, node};
use ecan_canopen::{
    HostHeartbeat, NodeDescription, NodeId, Step, TimeConfig, TimeReference, object,
};
use ecan_cia402::{Cia402Config, Takeover};
use ecan_host::{AdapterConfig, ClockSource, DcSync, MAX_SLAVES, MAX_STARTUP_STEPS};
use ecan_mcan_port::{Config, MAX_FILTERS, PortConfig};
use std::time::Duration;

/// Largest index of a master or slave.
const INDEX_MAX: u32 = 0xFFFF;

/// The content of a file.
pub(crate) struct Bus {
    pub(crate) config: Config,
    /// `None` for an axis without a valid address.
    pub(crate) axes: Vec<Option<FileAxis>>,
    pub(crate) profiles: Vec<IncludedProfile>,
    pub(crate) service: ServiceSettings,
    pub(crate) network: NetworkSettings,
    /// Nodes whose device files are read and whose names are resolved.
    pub(crate) nodes: Vec<FileNode>,
}

pub(crate) fn read(mut table: Table<'_, '_>) -> Bus {
    let mut adapter = AdapterConfig::new(0);
    let mut port = PortConfig::default();
    store(&mut adapter.master_index, table.unsigned("master", (0, INDEX_MAX)));
    let cycle_ns = table.microseconds("cycle_us").map(u64::from);
    store(&mut adapter.cycle, cycle_ns.map(Duration::from_nanos));
    store(&mut adapter.allow_large_pdos, table.flag("allow_large_pdos"));
    let timeout_ms = table.unsigned("preop_timeout_ms", (1, 3_600_000));
    store(&mut adapter.preop_timeout, timeout_ms.map(Duration::from_millis));
    let watchdog_us = table.unsigned("watchdog_us", (100, 6_553_500));
    store(&mut adapter.watchdog, watchdog_us.map(Duration::from_micros));
    let mut profiles = Vec::new();
    let dc = table.table("dc").map(|dc| read_dc(dc, adapter.cycle));
    for (at, gateway) in table.tables("gateway").into_iter().enumerate() {
        let read = gateway::read(gateway, at);
        let startup = read.startup.into_iter().map(|step| adapter.add_startup(at, step));
        let filters = read.filters.into_iter();
        let filters = filters.map(|(channel, filter)| port.add_filter(at, channel, filter));
        let is_full = startup.chain(filters).any(|added| added.is_err())
            || adapter.slaves.push(read.slave).is_err()
            || port.gateways.push(read.gateway).is_err();
        if is_full {
            let text = format!(
                "too many gateways, startup SDOs or filters; allowed: {MAX_SLAVES} gateways, \
                 {MAX_STARTUP_STEPS} startup SDOs, {MAX_FILTERS} filters"
            );
            table.fault("gateway", text);
        }
        profiles.extend(read.profile.map(|profile| (profile, read.gateway, read.own_keys)));
    }
    let has_timeout = table.has("preop_timeout_ms");
    if !has_timeout {
        profiles.iter().for_each(|(profile, ..)| profile.apply_restart(&mut adapter));
    }
    let profiles = profiles.into_iter().map(|(mut profile, gateway, own_keys)| {
        let has = |key: &str| has_timeout && key == "preop_timeout_ms" || own_keys.contains(&key);
        profile.note_effects(&adapter, &gateway, has);
        profile
    });
    let profiles = profiles.collect();
    adapter.dc = dc.map(|(dc, shift)| {
        // Depends on the gateways.
        let times = |slave| port.image_times(slave);
        let planned = || DcSync::planned_with(dc.cycle, &adapter, times).shift;
        DcSync { shift: shift.unwrap_or_else(planned), ..dc }
    });
    let mut axes: Vec<_> = table.tables("axis").into_iter().map(axis::read).collect();
    let mut network = table.table("network").map(NetworkTable::read).unwrap_or_default();
    let nodes = node::read_all(&mut table, &mut axes, &mut network, adapter.cycle_ns());
    let network = network.settings;
    let service = table.table("service").map(read_service).unwrap_or_default();
    Bus { config: (adapter, port).into(), axes, profiles, service, network, nodes }
}

/// The settings, and the shift if it is there.
fn read_dc(mut table: Table<'_, '_>, cycle: Duration) -> (DcSync, Option<Duration>) {
    let mut duration = |key| Some(Duration::from_nanos(table.microseconds(key)?.into()));
    let (sync0, shift) = (duration("cycle_us"), duration("shift_us"));
    let mut dc = DcSync::new(sync0.unwrap_or(cycle), Duration::ZERO);
    store(&mut dc.assign_activate, table.unsigned("assign_activate", (0, 0xFFFF)));
    let sources = [("host", ClockSource::Host), ("reference", ClockSource::Reference)];
    store(&mut dc.source, table.word("source", &sources));
    dc.reference = table.unsigned("reference", (0, INDEX_MAX));
    store(&mut dc.monitor_every, table.unsigned("monitor_every", (0, u32::MAX)));
    (dc, shift)
}

/// Values of the master of a bus.
#[derive(Clone, Debug, Default)]
pub(crate) struct MasterSource {
    pub(crate) node: Option<NodeId>,
    pub(crate) sync_period_us: Option<Located<u32>>,
    pub(crate) sync_overflow: Option<Located<u8>>,
    pub(crate) heartbeat_ms: Option<u16>,
    /// Consumer heartbeat time of nodes that watch it, in periods.
    pub(crate) heartbeat_multiplier: Option<f64>,
}

/// Settings of a service, by `ecan serve`. `None` for its default.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ServiceSettings {
    /// No client may send frames or change something.
    pub read_only: Option<bool>,
    /// Group whose members may.
    pub control_group: Option<String>,
    /// Most clients at a time.
    pub max_clients: Option<u16>,
}

pub(crate) fn read_service(mut table: Table<'_, '_>) -> ServiceSettings {
    let read_only = table.flag("read_only");
    let control_group = table.text("control_group").map(str::to_owned);
    if read_only == Some(true) && control_group.is_some() {
        table.fault("control_group", "`control_group` and `read_only` exclude each other");
    }
    ServiceSettings {
        read_only,
        control_group,
        max_clients: table.unsigned("max_clients", (1, 1000)),
    }
}

/// Settings of the CANopen network of a configuration.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NetworkSettings {
    /// Network, SYNC and takeover, for `Cia402::new`; without axes `network` is for `Network::new`,
    /// and `sync` for `Network::set_sync`.
    pub cia402: Cia402Config,
    /// Time between two TIME messages; `None` sends none.
    pub time_period: Option<Duration>,
}

impl NetworkSettings {
    /// TIME by the system clock, for `Network::set_time` at the time `bus_ns` of the bus clock. Makes a
    /// system call: call it outside the cycle.
    pub fn time(&self, bus_ns: u64) -> Option<TimeConfig> {
        let reference = || TimeReference::from_system_clock(bus_ns);
        self.time_period.map(|period| TimeConfig { period, reference: reference() })
    }

    /// The node with the SYNC counter of the network (0x1019), if it has one.
    pub(crate) fn complete(&self, mut node: NodeDescription) -> NodeDescription {
        let sync = self.cia402.sync;
        if sync.counter_overflow.is_some() {
            // The counter can change only while SYNC has no period.
            let stop = Step::write(object::COMMUNICATION_CYCLE, 0, 0_u32).named("no SYNC period");
            node.boot.steps.extend([stop.if_accepted(), sync.counter_step()]);
        }
        node
    }
}

const TAKEOVERS: [(&str, Takeover); 2] = [("stop", Takeover::Stop), ("adopt", Takeover::Adopt)];

/// The settings while the file is read.
#[derive(Debug, Default)]
pub(crate) struct NetworkTable {
    pub(crate) settings: NetworkSettings,
    /// Keys that the master of a `bus.yml` does not change.
    has_sync: bool,
    has_counter: bool,
    has_host: bool,
    has_host_heartbeat: bool,
}

impl NetworkTable {
    pub(crate) fn read(mut table: Table<'_, '_>) -> Self {
        let mut settings = NetworkSettings::default();
        let config = &mut settings.cia402;
        store(&mut config.sync.every_cycles, table.unsigned("sync_cycles", (1, 0xFFFF)));
        let counter: Option<u8> = table.unsigned("sync_counter", (0, 240));
        if counter == Some(1) {
            table.fault("sync_counter", COUNTER);
        }
        config.sync.counter_overflow = counter.filter(|it| *it > 1);
        store(&mut config.motion_div, table.unsigned("target_cycles", (1, 0xFFFF)));
        store(&mut config.takeover, table.word("takeover", &TAKEOVERS));
        let time_ms = table.unsigned("time_ms", (0, 3_600_000)).filter(|ms| *ms > 0);
        settings.time_period = time_ms.map(Duration::from_millis);
        let host = table.unsigned("host_node", (1, 127)).and_then(NodeId::new);
        let heartbeat_ms: Option<u64> = table.unsigned("host_heartbeat_ms", (0, 0xFFFF));
        let network = &mut config.network;
        network.host_heartbeat = host_heartbeat(network.host_heartbeat, host, heartbeat_ms);
        store(
            &mut network.service_frames_per_cycle,
            table.unsigned("service_frames_per_cycle", (1, 8)),
        );
        store(&mut network.sdo_pending_limit, table.unsigned("sdo_pending_limit", (1, 7)));
        store(&mut network.reserved_image_bytes, table.unsigned("reserved_image_bytes", (0, 3072)));
        store(&mut network.nmt_queue, table.unsigned("nmt_queue", (1, 1024)));
        let sdo = &mut config.node.sdo;
        let mut time = |key| table.unsigned(key, (1, 3_600_000)).map(Duration::from_millis);
        store(&mut sdo.timeout, time("sdo_timeout_ms"));
        store(&mut sdo.storage_timeout, time("sdo_storage_timeout_ms"));
        store(&mut sdo.retries, table.unsigned("sdo_retries", (0, 255)));
        store(&mut sdo.buffer_bytes, table.unsigned("sdo_buffer_bytes", (8, 1 << 24)));
        Self {
            has_sync: table.has("sync_cycles"),
            has_counter: table.has("sync_counter"),
            has_host: table.has("host_node"),
            has_host_heartbeat: table.has("host_heartbeat_ms"),
            settings,
        }
    }

    /// Takes over the values of the master of a bus that the table does not have. `cycle_ns` is the
    /// cycle, if it is known.
    pub(crate) fn add_master(
        &mut self,
        master: &MasterSource,
        cycle_ns: Option<u32>,
        report: &mut dyn FnMut(usize, String),
    ) {
        let config = &mut self.settings.cia402;
        let period = master.sync_period_us.as_ref().filter(|it| it.value > 0 && !self.has_sync);
        if let (Some(period), Some(cycle_ns)) = (period, cycle_ns.filter(|it| *it > 0)) {
            let period_ns = u64::from(period.value) * 1_000;
            match period_ns % u64::from(cycle_ns) {
                0 => {
                    let cycles = u32::try_from(period_ns / u64::from(cycle_ns)).unwrap_or(u32::MAX);
                    config.sync.every_cycles = cycles;
                    // Another bus must have the same.
                    self.has_sync = true;
                }
                _ => report(
                    period.at,
                    format!(
                        "`sync_period` = {} must be a multiple of the cycle, {} us; change the cycle, or \
                         set `sync_cycles` in [network]",
                        period.value,
                        cycle_ns / 1_000
                    ),
                ),
            }
        }
        if let Some(overflow) = master.sync_overflow.as_ref().filter(|_| !self.has_counter) {
            if overflow.value == 1 {
                report(overflow.at, COUNTER.replace("sync_counter", "sync_overflow"));
            }
            config.sync.counter_overflow = Some(overflow.value).filter(|it| *it > 1);
            self.has_counter = true;
        }
        let host = master.node.filter(|_| !self.has_host);
        let ms = master.heartbeat_ms.filter(|ms| *ms > 0 && !self.has_host_heartbeat);
        self.has_host |= host.is_some();
        self.has_host_heartbeat |= ms.is_some();
        let network = &mut config.network;
        network.host_heartbeat = host_heartbeat(network.host_heartbeat, host, ms.map(u64::from));
    }
}

const COUNTER: &str = "`sync_counter` = 1 is out of range; allowed: 0 for none, 2 to 240";

/// The heartbeat with another node-ID or period; 0 is none.
fn host_heartbeat(
    before: Option<HostHeartbeat>,
    node: Option<NodeId>,
    period_ms: Option<u64>,
) -> Option<HostHeartbeat> {
    let before = before?;
    let period = period_ms.map_or(before.period, Duration::from_millis);
    let heartbeat = HostHeartbeat { node: node.unwrap_or(before.node), period };
    (!period.is_zero()).then_some(heartbeat)
}
