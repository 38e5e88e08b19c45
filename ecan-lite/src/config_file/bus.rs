//! The keys of a file outside its gateways, and the table `[service]`: access to the service of a bus.

use std::time::Duration;

use ecan_host::{AdapterConfig, ClockSource, DcSync, MAX_SLAVES, MAX_STARTUP_STEPS};
use ecan_mcan_port::{Config, MAX_FILTERS, PortConfig};

use super::axis::FileAxis;
use super::device_profile::IncludedProfile;
use super::document::{Table, store};
use super::network::{NetworkSettings, NetworkTable};
use super::node::FileNode;
use super::{axis, gateway, node};

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

fn read_service(mut table: Table<'_, '_>) -> ServiceSettings {
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
