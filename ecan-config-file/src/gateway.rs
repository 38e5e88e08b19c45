//! One gateway of a file.

use ecan_host::{Identity, SlaveConfig, StartupStep};
use ecan_mcan_port::{AcceptanceFilter, GatewayConfig, MarginCheck, ScheduleConfig};
use ecan_protocol::config::DataPathGlobal;
use ecan_protocol::image::PdoProfile;
use ecan_protocol::mapping::{Direction, MAX_MULTIPLIER};

use crate::channel;
use crate::document::{Document, Table};
use crate::fields;

/// Tables of the channels.
pub(crate) const CHANNEL_TABLES: [&str; ecan_protocol::mapping::CHANNELS] =
    ["can0", "can1", "can2", "can3"];

const N: (u32, u32) = (1, MAX_MULTIPLIER as u32);

/// A gateway with its startup steps, and its filters by channel.
pub(crate) struct ReadGateway {
    pub(crate) slave: SlaveConfig,
    pub(crate) gateway: GatewayConfig,
    pub(crate) startup: Vec<StartupStep>,
    pub(crate) filters: Vec<(u8, AcceptanceFilter)>,
}

pub(crate) fn read(
    document: &mut Document<'_>,
    mut table: Table<'_, '_>,
    at: usize,
) -> ReadGateway {
    // Without `alias` and `position` in the file, the gateways are the first slaves of the bus.
    let mut slave = SlaveConfig::at(u16::try_from(at).unwrap_or(u16::MAX), 3);
    let mut gateway = GatewayConfig::default();
    let mut startup = Vec::new();
    if let Some(alias) = table.unsigned(document, "alias", (0, 0xFFFF)) {
        slave.alias = alias as u16;
        if alias != 0 {
            slave.position = 0;
        }
    }
    if let Some(position) = table.unsigned(document, "position", (0, 0xFFFF)) {
        slave.position = position as u16;
    }
    if let Some(identity) = table.table(document, "identity") {
        slave.identity = read_identity(document, identity);
    }
    if let Some(n) = table.unsigned(document, "n", N) {
        (slave.rx_multiplier, slave.tx_multiplier) = (n as u8, n as u8);
    }
    for direction in Direction::ALL {
        read_direction(document, &mut table, direction, &mut slave, &mut gateway);
    }
    let has_each = table.has("rx_pdo") && table.has("tx_pdo");
    if !table.has("n") && !has_each {
        table.fault(document, "n", "`n` is missing: the size of the PDOs in 128 bytes, 1 to 24");
    }
    let flags = [
        ("paced", &mut gateway.paced),
        ("allow_diagnostic_tests", &mut gateway.allow_diagnostic_tests),
    ];
    for (key, flag) in flags {
        if let Some(is_set) = table.flag(document, key) {
            *flag = is_set;
        }
    }
    let limits =
        [("hold_limit", &mut gateway.hold_limit), ("input_limit", &mut gateway.input_limit)];
    for (key, limit) in limits {
        if let Some(cycles) = table.unsigned(document, key, (0, 0xFFFF)) {
            *limit = cycles as u16;
        }
    }
    if let Some(schedule) = table.table(document, "schedule") {
        gateway.schedule = read_schedule(document, schedule);
    }
    if let Some(global) = table.table(document, "data_path") {
        startup = global_steps(document, global);
    }
    let mut filters = Vec::new();
    let channels = CHANNEL_TABLES.into_iter().zip(&mut gateway.channels);
    for (channel, (key, place)) in (0..).zip(channels) {
        let Some(table) = table.table(document, key) else { continue };
        let (config, own) = channel::read(document, table);
        *place = Some(config);
        filters.extend(own.into_iter().map(|filter| (channel, filter)));
    }
    table.finish(document);
    ReadGateway { slave, gateway, startup, filters }
}

fn read_identity(document: &mut Document<'_>, mut table: Table<'_, '_>) -> Option<Identity> {
    let mut number = |key| {
        let number = table.unsigned(document, key, (0, u32::MAX));
        if !table.has(key) {
            table.fault(document, key, format!("`{key}` is missing"));
        }
        number
    };
    let (vendor_id, product_code) = (number("vendor_id"), number("product_code"));
    table.finish(document);
    Some(Identity { vendor_id: vendor_id?, product_code: product_code? })
}

fn read_direction(
    document: &mut Document<'_>,
    table: &mut Table<'_, '_>,
    direction: Direction,
    slave: &mut SlaveConfig,
    gateway: &mut GatewayConfig,
) {
    let (key, n, profile, budget, options) = match direction {
        Direction::TxPdo => (
            "tx_pdo",
            &mut slave.tx_multiplier,
            &mut gateway.tx_encapsulation,
            &mut gateway.tx_budget,
            &mut gateway.tx_options,
        ),
        Direction::RxPdo => (
            "rx_pdo",
            &mut slave.rx_multiplier,
            &mut gateway.rx_encapsulation,
            &mut gateway.rx_budget,
            &mut gateway.rx_options,
        ),
    };
    let has_common_n = table.has("n");
    let Some(mut table) = table.table(document, key) else { return };
    let mut requested = PdoProfile {
        multiplier: *n,
        profile: *profile,
        budget: *budget,
        options: *options,
        ..PdoProfile::default()
    };
    fields::read(document, &mut table, "", &mut requested);
    (*n, *profile) = (requested.multiplier, requested.profile);
    (*budget, *options) = (requested.budget, requested.options);
    if !has_common_n && !table.has("n") {
        table.fault(document, "n", "`n` is missing: the size of the PDO in 128 bytes, 1 to 24");
    }
    table.finish(document);
}

fn read_schedule(document: &mut Document<'_>, mut table: Table<'_, '_>) -> ScheduleConfig {
    let mut schedule = ScheduleConfig::default();
    let times = [
        ("latest_send_us", &mut schedule.latest_send_ns),
        ("transport_us", &mut schedule.transport_ns),
        ("processing_us", &mut schedule.processing_ns),
    ];
    for (key, time) in times {
        if let Some(ns) = table.microseconds(document, key) {
            *time = ns;
        }
    }
    let checks = [("count", MarginCheck::Count), ("refuse", MarginCheck::Reject)];
    if let Some(check) = table.word(document, "margin_check", &checks) {
        schedule.margin_check = check;
    }
    if let Some(ms) = table.unsigned(document, "watch_ms", (0, 3_600_000)) {
        schedule.watch_ms = ms;
    }
    if let Some(is_set) = table.flag(document, "give_up_missed") {
        schedule.give_up_missed = is_set;
    }
    table.finish(document);
    schedule
}

/// 0x8020, applied and read back.
fn global_steps(document: &mut Document<'_>, mut table: Table<'_, '_>) -> Vec<StartupStep> {
    let mut global = DataPathGlobal::default();
    fields::read(document, &mut table, "", &mut global);
    table.finish(document);
    let apply = DataPathGlobal::apply_write();
    let writes = global.writes().chain([apply]).map(StartupStep::Download);
    writes.chain([StartupStep::expect(apply.index, 3, 0)]).collect()
}
