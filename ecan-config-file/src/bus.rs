//! The keys of a file outside its gateways.

use std::time::Duration;

use ecan_host::{AdapterConfig, ClockSource, DcSync, MAX_SLAVES, MAX_STARTUP_STEPS};
use ecan_mcan_port::{MAX_FILTERS, PortConfig};

use crate::document::{Document, Table};
use crate::gateway;
use ecan_mcan_port::Config;

/// Largest index of a master or slave.
const INDEX_MAX: u32 = 0xFFFF;

pub(crate) fn read(document: &mut Document<'_>, mut table: Table<'_, '_>) -> Config {
    let mut adapter = AdapterConfig::new(0);
    let mut port = PortConfig::default();
    if let Some(master) = table.unsigned(document, "master", (0, INDEX_MAX)) {
        adapter.master_index = master;
    }
    if let Some(cycle_ns) = table.microseconds(document, "cycle_us") {
        adapter.cycle = Duration::from_nanos(cycle_ns.into());
    }
    if let Some(allowed) = table.flag(document, "allow_large_pdos") {
        adapter.allow_large_pdos = allowed;
    }
    if let Some(timeout) = table.unsigned(document, "preop_timeout_ms", (1, 3_600_000)) {
        adapter.preop_timeout = Duration::from_millis(timeout.into());
    }
    if let Some(watchdog) = table.unsigned(document, "watchdog_us", (100, 6_553_500)) {
        adapter.watchdog = Duration::from_micros(watchdog.into());
    }
    if let Some(dc) = table.table(document, "dc") {
        adapter.dc = Some(read_dc(document, dc, adapter.cycle_ns()));
    }
    for (at, gateway) in table.tables(document, "gateway").into_iter().enumerate() {
        let read = gateway::read(document, gateway, at);
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
            table.fault(document, "gateway", text);
            break;
        }
    }
    table.finish(document);
    (adapter, port).into()
}

fn read_dc(document: &mut Document<'_>, mut table: Table<'_, '_>, cycle_ns: u32) -> DcSync {
    // The shift has no default.
    let sync0_ns = table.microseconds(document, "cycle_us").unwrap_or(cycle_ns);
    let shift_ns = table.microseconds(document, "shift_us");
    if shift_ns.is_none() && !table.has("shift_us") {
        table.fault(document, "shift_us", "`shift_us` is missing: the phase of Sync0 in the cycle");
    }
    let mut dc = DcSync::new(sync0_ns, shift_ns.unwrap_or(0));
    if let Some(word) = table.unsigned(document, "assign_activate", (0, 0xFFFF)) {
        dc.assign_activate = word as u16;
    }
    let sources = [("host", ClockSource::Host), ("reference", ClockSource::Reference)];
    if let Some(source) = table.word(document, "source", &sources) {
        dc.source = source;
    }
    dc.reference =
        table.unsigned(document, "reference", (0, INDEX_MAX)).map(|slave| slave as usize);
    if let Some(every) = table.unsigned(document, "monitor_every", (0, u32::MAX)) {
        dc.monitor_every = every;
    }
    table.finish(document);
    dc
}
