//! One gateway of a file, with its channels and filters.

use ecan_host::{Identity, SlaveConfig, StartupStep};
use ecan_mcan_port::{
    AcceptanceFilter, ChannelConfig, GatewayConfig, MarginCheck, ScheduleConfig, Traffic,
};
use ecan_protocol::config::{
    ConfigObject, DeviceConfig, ExtendedFilter, ExtendedMatch, FilterAction, FilterWindow,
    McanChannelConfig, MessageRamLayout, NodeMode, StandardFilter, StandardMatch,
};
use ecan_protocol::image::PdoProfile;
use ecan_protocol::mapping::{Direction, MAX_MULTIPLIER};
use ecan_protocol::object::{ObjectType, SdoWrite, lookup};
use ecan_protocol::text::Printable;

use super::device_profile::IncludedProfile;
use super::document::{Table, store};
use super::{device_profile, fields};

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
    let mut gateway = GatewayConfig::default();
    let default_n = gateway.default_multiplier();
    let mut slave = SlaveConfig::at(u16::try_from(at).unwrap_or(u16::MAX), default_n);
    store(&mut slave.alias, table.unsigned("alias", (0, 0xFFFF)));
    if slave.alias != 0 {
        slave.position = 0;
    }
    store(&mut slave.position, table.unsigned("position", (0, 0xFFFF)));
    if let Some(identity) = table.table("identity") {
        slave.identity = read_identity(identity);
    }
    let n = table.unsigned("n", N);
    if let Some(n) = n {
        (slave.rx_multiplier, slave.tx_multiplier) = (n, n);
    }
    let has_n = Direction::ALL
        .map(|direction| read_direction(&mut table, direction, &mut slave, &mut gateway));
    store(&mut gateway.paced, table.flag("paced"));
    store(&mut gateway.allow_diagnostic_tests, table.flag("allow_diagnostic_tests"));
    store(&mut gateway.hold_limit, table.unsigned("hold_limit", (0, 0xFFFF)));
    store(&mut gateway.input_limit, table.unsigned("input_limit", (0, 0xFFFF)));
    let profile = device_profile::read(&mut table, at);
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
    for (index, key) in DeviceConfig::OBJECTS {
        if let Some(table) = table.table(key) {
            read_device(table, index, &mut gateway.device);
        }
    }
    let mut filters = Vec::new();
    let channels = CHANNEL_TABLES.into_iter().zip(&mut gateway.channels);
    for (channel, (key, entry)) in (0..).zip(channels) {
        let Some(table) = table.table(key) else { continue };
        let (config, own) = read_channel(table);
        *entry = Some(config);
        filters.extend(own.into_iter().map(|filter| (channel, filter)));
    }
    if n.is_none() {
        let sizes = Direction::ALL.into_iter().zip(has_n).filter(|(_, has_n)| !has_n);
        for (direction, _) in sizes {
            *multiplier_of(&mut slave, direction) = gateway.default_multiplier();
        }
    }
    let startup = table.tables("startup_sdo").into_iter().flat_map(read_startup_sdo).collect();
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

fn multiplier_of(slave: &mut SlaveConfig, direction: Direction) -> &mut u8 {
    match direction {
        Direction::TxPdo => &mut slave.tx_multiplier,
        Direction::RxPdo => &mut slave.rx_multiplier,
    }
}

/// Reads the table of a direction; returns whether it has a size of its own.
fn read_direction(
    table: &mut Table<'_, '_>,
    direction: Direction,
    slave: &mut SlaveConfig,
    gateway: &mut GatewayConfig,
) -> bool {
    let n = multiplier_of(slave, direction);
    let (key, mask, profile, budget, options) = match direction {
        Direction::TxPdo => (
            "tx_pdo",
            &mut gateway.tx_channel_mask,
            &mut gateway.tx_encapsulation,
            &mut gateway.tx_budget,
            &mut gateway.tx_options,
        ),
        Direction::RxPdo => (
            "rx_pdo",
            &mut gateway.rx_channel_mask,
            &mut gateway.rx_encapsulation,
            &mut gateway.rx_budget,
            &mut gateway.rx_options,
        ),
    };
    let Some(mut table) = table.table(key) else { return false };
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
    table.has("n")
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

/// An object of the whole gateway. 0x8020 and 0x8030 are written as a whole, of the others only the keys.
fn read_device(mut table: Table<'_, '_>, index: u16, device: &mut DeviceConfig) {
    device.enable(index);
    fields::read_with(&mut table, index, |subindex, value| {
        device.set_value(index, subindex, value)
    });
}

/// A write, a readback, or both.
fn read_startup_sdo(mut table: Table<'_, '_>) -> Vec<StartupStep> {
    let index = table.required("index", "that of the object", (0x1000, 0xFFFF)).unwrap_or(0);
    let subindex = table.unsigned("subindex", (0, 0xFF)).unwrap_or(0);
    let index = index as u16;
    let types = [("u8", ObjectType::U8), ("u16", ObjectType::U16), ("u32", ObjectType::U32)];
    let known = lookup(index, subindex).map(|(_, entry)| entry.ty);
    let known = known.filter(|ty| types.iter().any(|(_, named)| named == ty));
    let ty = table.word("type", &types).or(known);
    let range = (0, ty.unwrap_or(ObjectType::U32).max_value());
    let (value, expected) = (table.unsigned("value", range), table.unsigned("expect", range));
    if !table.is_recorded() {
        if !table.has("value") && !table.has("expect") {
            table.fault(
                "value",
                "`value` and `expect` are missing: the number to write, and the one to read",
            );
        }
        if ty.is_none() && table.has("value") && !table.has("type") {
            table.fault(
                "type",
                "`type` is missing: the object is not in the dictionary; u8, u16 or u32",
            );
        }
    }
    let write = value.zip(ty).map(|(value, ty)| SdoWrite::new(index, subindex, ty, value).into());
    let expect = expected.map(|value| StartupStep::expect(index, subindex, value));
    write.into_iter().chain(expect).collect()
}

const CHANNEL: u16 = McanChannelConfig::INDEX;

pub(crate) fn read_channel(mut table: Table<'_, '_>) -> (ChannelConfig, Vec<AcceptanceFilter>) {
    // A missing or wrong bit rate is already a fault; the rest is read with another one.
    let bitrate = fields::read_entry(&mut table, "bitrate", (CHANNEL, 19));
    if !table.has("bitrate") {
        table.fault("bitrate", "`bitrate` is missing: the nominal bit rate in bit/s");
    }
    let nominal = bitrate.unwrap_or(500_000);
    let mut config = match fields::read_entry(&mut table, "data_bitrate", (CHANNEL, 20)) {
        Some(data) => ChannelConfig::fd(nominal, data),
        None if table.has("data_bitrate") => ChannelConfig::fd(nominal, nominal.max(1_000_000)),
        None => ChannelConfig::classic(nominal),
    };
    if let Some(traffic) = table.table("traffic") {
        config = config.with_traffic(read_traffic(traffic));
    }
    fields::read(&mut table, "", &mut config.can);
    for group in ["nominal_timing", "data_timing"] {
        if let Some(mut timing) = table.table(group) {
            fields::read(&mut timing, group, &mut config.can);
            fields::report_missing::<McanChannelConfig>(&timing, group);
        }
    }
    if let Some(mut ram) = table.table("ram") {
        let layouts = [("classic", MessageRamLayout::classic()), ("fd", MessageRamLayout::fd())];
        store(&mut config.can.ram, ram.word("layout", &layouts));
        fields::read(&mut ram, "ram", &mut config.can);
    }
    if let Some(mut policy) = table.table("data_path") {
        fields::read(&mut policy, "", &mut config.data_path);
    }
    let standard = read_standard(&mut table).into_iter().map(Into::into);
    let extended = read_extended(&mut table).into_iter().map(Into::into);
    let filters = standard.chain(extended).collect();
    fields::check(&table, &config.can);
    (config, filters)
}

fn read_traffic(mut table: Table<'_, '_>) -> Traffic {
    let mut traffic = Traffic::default();
    store(&mut traffic.received, table.unsigned("received", (0, 255)));
    store(&mut traffic.sent, table.unsigned("sent", (0, 255)));
    traffic
}

pub(crate) const STANDARD_TABLE: &str = "standard_filter";
pub(crate) const EXTENDED_TABLE: &str = "extended_filter";

/// Numbers of receive buffers.
const BUFFERS: (u32, u32) = (0, 63);

const KEYS: [&str; 5] = ["match", "action", "sync", "id1", "id2"];

pub(crate) fn read_standard(table: &mut Table<'_, '_>) -> Vec<StandardFilter> {
    let tables = table.tables(STANDARD_TABLE);
    let read = |table| {
        let filter = Filter::read(table, FilterWindow::STANDARD);
        StandardFilter {
            matching: filter.matching(StandardMatch::from_raw, StandardMatch::Two),
            action: filter.action,
            sync: filter.sync,
            id1: filter.id1 as u16,
            id2: filter.id2 as u16,
        }
    };
    tables.into_iter().map(read).collect()
}

pub(crate) fn read_extended(table: &mut Table<'_, '_>) -> Vec<ExtendedFilter> {
    let tables = table.tables(EXTENDED_TABLE);
    let read = |table| {
        let filter = Filter::read(table, FilterWindow::EXTENDED);
        ExtendedFilter {
            matching: filter.matching(ExtendedMatch::from_raw, ExtendedMatch::Two),
            action: filter.action,
            sync: filter.sync,
            id1: filter.id1,
            id2: filter.id2,
        }
    };
    tables.into_iter().map(read).collect()
}

struct Filter {
    /// Raw value; `None` for a filter into a receive buffer, whose type the core ignores.
    matching: Option<u32>,
    action: FilterAction,
    sync: bool,
    id1: u32,
    id2: u32,
}

impl Filter {
    fn read(mut table: Table<'_, '_>, window: FilterWindow) -> Self {
        let mut fields = window.fields().zip(KEYS).map(|(subindex, key)| {
            let entry = (McanChannelConfig::INDEX, subindex);
            fields::read_entry(&mut table, key, entry)
        });
        let [matching, action, sync, id1, id2] = std::array::from_fn(|_| fields.next().flatten());
        drop(fields);
        let buffer_action = u32::from(FilterAction::RxBuffer(0).raw());
        let is_buffer = action == Some(buffer_action);
        // A filter into a receive buffer matches the one CAN ID `id1`.
        let needed: &[&str] = match is_buffer || table.is_recorded() {
            true => &["action", "id1"],
            false => &["action", "match", "id1", "id2"],
        };
        for key in needed.iter().filter(|key| !table.has(key)) {
            table.fault(key, format!("`{key}` is missing"));
        }
        let mut buffer = 0;
        if table.is_recorded() {
            table.unsigned::<u8>("rx_buffer", BUFFERS);
        }
        if is_buffer {
            for key in ["match", "id2"].into_iter().filter(|key| table.has(key)) {
                let why = "a filter into a receive buffer matches the one CAN ID `id1`";
                table.fault(key, format!("`{key}` has no effect: {why}"));
            }
            buffer = table.unsigned("rx_buffer", BUFFERS).unwrap_or(0);
            if !table.has("rx_buffer") {
                table.fault("rx_buffer", "`rx_buffer` is missing: the buffer's number");
            }
        }
        let action = action.and_then(|raw| FilterAction::from_raw(raw as u8, buffer));
        Self {
            matching,
            action: action.unwrap_or(FilterAction::Disabled),
            sync: sync == Some(1),
            id1: id1.unwrap_or(0),
            id2: id2.or(id1).unwrap_or(0),
        }
    }

    /// The type of the filter. `two` for a receive buffer: no firmware can interpret it as a filter
    /// that is not used.
    fn matching<M>(&self, from_raw: fn(u8) -> Option<M>, two: M) -> M {
        self.matching.and_then(|raw| from_raw(raw as u8)).unwrap_or(two)
    }
}
