//! One gateway of a file.

use ecan_host::{Identity, SlaveConfig, StartupStep};
use ecan_mcan_port::{AcceptanceFilter, GatewayConfig, MarginCheck, ScheduleConfig};
use ecan_protocol::config::{DataPathGlobal, NodeMode};
use ecan_protocol::image::PdoProfile;
use ecan_protocol::mapping::{Direction, MAX_MULTIPLIER};
use ecan_protocol::text::Printable;

use crate::config_file::DEFAULT_N;
use crate::config_file::channel;
use crate::config_file::document::{Table, store};
use crate::config_file::fields;
use crate::config_file::included_profile::{self, IncludedProfile};

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
    pub(crate) profile: Option<IncludedProfile>,
    /// Keys of the file that a device profile could set, too.
    pub(crate) own_keys: Vec<&'static str>,
}

pub(crate) fn read(mut table: Table<'_, '_>, at: usize) -> ReadGateway {
    // Without `alias` and `position` in the file, the gateways are the first slaves of the bus.
    let mut slave = SlaveConfig::at(u16::try_from(at).unwrap_or(u16::MAX), DEFAULT_N);
    let mut gateway = GatewayConfig::default();
    let mut startup = Vec::new();
    store(&mut slave.alias, table.unsigned("alias", (0, 0xFFFF)));
    if slave.alias != 0 {
        slave.position = 0;
    }
    store(&mut slave.position, table.unsigned("position", (0, 0xFFFF)));
    if let Some(identity) = table.table("identity") {
        slave.identity = read_identity(identity);
    }
    if let Some(n) = table.unsigned("n", N) {
        (slave.rx_multiplier, slave.tx_multiplier) = (n, n);
    }
    for direction in Direction::ALL {
        read_direction(&mut table, direction, &mut slave, &mut gateway);
    }
    store(&mut gateway.paced, table.flag("paced"));
    store(&mut gateway.allow_diagnostic_tests, table.flag("allow_diagnostic_tests"));
    store(&mut gateway.hold_limit, table.unsigned("hold_limit", (0, 0xFFFF)));
    store(&mut gateway.input_limit, table.unsigned("input_limit", (0, 0xFFFF)));
    let profile = included_profile::read(&mut table, at);
    if let Some(profile) = &profile {
        profile.apply(&mut gateway);
    }
    let mut own_keys = Vec::new();
    if let Some(schedule) = table.table("schedule") {
        let keys = [("processing_us", "schedule.processing_us"), ("depth", "schedule.depth")];
        own_keys.extend(keys.into_iter().filter(|(key, _)| schedule.has(key)).map(|(_, key)| key));
        read_schedule(schedule, &mut gateway.schedule);
    }
    if !own_keys.contains(&"schedule.processing_us") {
        let transport_ns = gateway.schedule.transport_ns;
        let measured = profile.as_ref().and_then(|profile| profile.processing_ns(transport_ns));
        store(&mut gateway.schedule.processing_ns, measured);
    }
    if let Some(global) = table.table("data_path") {
        startup = global_steps(global);
    }
    let mut filters = Vec::new();
    let channels = CHANNEL_TABLES.into_iter().zip(&mut gateway.channels);
    for (channel, (key, entry)) in (0..).zip(channels) {
        let Some(table) = table.table(key) else { continue };
        let (config, own) = channel::read(table);
        *entry = Some(config);
        filters.extend(own.into_iter().map(|filter| (channel, filter)));
    }
    if let Some(profile) = &profile {
        report_node_modes(&table, profile, &gateway);
    }
    ReadGateway { slave, gateway, startup, filters, profile, own_keys }
}

/// Reports node modes that have another number on the gateway (assumption H9).
fn report_node_modes(table: &Table<'_, '_>, profile: &IncludedProfile, gateway: &GatewayConfig) {
    for (channel, mode) in profile.misnumbered(gateway) {
        let key = CHANNEL_TABLES.get(channel).copied().unwrap_or("can0");
        // A channel that must not disturb its bus must not be made a normal one.
        let action = match mode {
            NodeMode::Listen => "listen-only is not available with this number; remove the channel",
            _ => "use \"normal\"",
        };
        let reason = format!(
            "`node_mode` of `{key}` has another number on this gateway: internal loopback is {}, by \
             {} (assumption H9); {action}",
            profile.profile.internal_loopback.unwrap_or(0),
            Printable(profile.path.display())
        );
        table.fault(key, reason);
    }
}

fn read_identity(mut table: Table<'_, '_>) -> Option<Identity> {
    let mut number = |key| {
        let number = table.unsigned(key, (0, u32::MAX));
        if !table.has(key) {
            table.fault(key, format!("`{key}` is missing"));
        }
        number
    };
    let (vendor_id, product_code) = (number("vendor_id"), number("product_code"));
    Some(Identity { vendor_id: vendor_id?, product_code: product_code? })
}

fn read_direction(
    table: &mut Table<'_, '_>,
    direction: Direction,
    slave: &mut SlaveConfig,
    gateway: &mut GatewayConfig,
) {
    let (key, n, mask, profile, budget, options) = match direction {
        Direction::TxPdo => (
            "tx_pdo",
            &mut slave.tx_multiplier,
            &mut gateway.tx_channel_mask,
            &mut gateway.tx_encapsulation,
            &mut gateway.tx_budget,
            &mut gateway.tx_options,
        ),
        Direction::RxPdo => (
            "rx_pdo",
            &mut slave.rx_multiplier,
            &mut gateway.rx_channel_mask,
            &mut gateway.rx_encapsulation,
            &mut gateway.rx_budget,
            &mut gateway.rx_options,
        ),
    };
    let Some(mut table) = table.table(key) else { return };
    let mut requested = PdoProfile {
        multiplier: *n,
        profile: *profile,
        budget: *budget,
        options: *options,
        ..PdoProfile::default()
    };
    fields::read(&mut table, "", &mut requested);
    (*n, *profile) = (requested.multiplier, requested.profile);
    *mask = table.has("channels").then_some(requested.channel_mask);
    (*budget, *options) = (requested.budget, requested.options);
}

fn read_schedule(mut table: Table<'_, '_>, schedule: &mut ScheduleConfig) {
    store(&mut schedule.latest_send_ns, table.microseconds("latest_send_us"));
    store(&mut schedule.transport_ns, table.microseconds("transport_us"));
    store(&mut schedule.processing_ns, table.microseconds("processing_us"));
    let checks = [("count", MarginCheck::Count), ("reject", MarginCheck::Reject)];
    store(&mut schedule.margin_check, table.word("margin_check", &checks));
    store(&mut schedule.watch_ms, table.unsigned("watch_ms", (0, 3_600_000)));
    store(&mut schedule.discard_missed, table.flag("discard_missed"));
    store(&mut schedule.depth, table.unsigned("depth", (1, 0xFFFF)));
}

/// 0x8020, applied and read back.
fn global_steps(mut table: Table<'_, '_>) -> Vec<StartupStep> {
    let mut global = DataPathGlobal::default();
    fields::read(&mut table, "", &mut global);
    let apply = DataPathGlobal::apply_write();
    let writes = global.writes().chain([apply]).map(StartupStep::Download);
    writes.chain([StartupStep::expect(apply.index, 3, 0)]).collect()
}
