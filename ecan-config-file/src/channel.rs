//! One channel of a file: bit rates, mode, Message RAM, filters and data path.

use ecan_mcan_port::{AcceptanceFilter, ChannelConfig, Traffic};
use ecan_protocol::config::{ConfigObject, McanChannelConfig, MessageRamLayout};

use crate::document::{Document, Table};
use crate::fields;
use crate::filter;
use crate::idle_keys;

const CHANNEL: u16 = McanChannelConfig::INDEX;

pub(crate) fn read(
    document: &mut Document<'_>,
    mut table: Table<'_, '_>,
) -> (ChannelConfig, Vec<AcceptanceFilter>) {
    // A missing or wrong bit rate is already a fault; the rest is read with another one.
    let bitrate = fields::read_entry(document, &mut table, "bitrate", (CHANNEL, 19));
    if !table.has("bitrate") {
        table.fault(document, "bitrate", "`bitrate` is missing: the nominal bit rate in bit/s");
    }
    let nominal = bitrate.unwrap_or(500_000);
    let mut config = match fields::read_entry(document, &mut table, "data_bitrate", (CHANNEL, 20)) {
        Some(data) => ChannelConfig::fd(nominal, data),
        None if table.has("data_bitrate") => ChannelConfig::fd(nominal, nominal.max(1_000_000)),
        None => ChannelConfig::classic(nominal),
    };
    if let Some(traffic) = table.table(document, "traffic") {
        config = config.with_traffic(read_traffic(document, traffic));
    }
    fields::read(document, &mut table, "", &mut config.can);
    for group in ["nominal_timing", "data_timing"] {
        if let Some(mut timing) = table.table(document, group) {
            fields::read(document, &mut timing, group, &mut config.can);
            fields::report_missing::<McanChannelConfig>(document, &timing, group);
            timing.finish(document);
        }
    }
    if let Some(mut ram) = table.table(document, "ram") {
        let layouts = [("classic", MessageRamLayout::classic()), ("fd", MessageRamLayout::fd())];
        if let Some(layout) = ram.word(document, "layout", &layouts) {
            config.can.ram = layout;
        }
        fields::read(document, &mut ram, "ram", &mut config.can);
        ram.finish(document);
    }
    if let Some(mut policy) = table.table(document, "data_path") {
        fields::read(document, &mut policy, "", &mut config.data_path);
        policy.finish(document);
    }
    let standard = filter::read_standard(document, &mut table).into_iter().map(Into::into);
    let extended = filter::read_extended(document, &mut table).into_iter().map(Into::into);
    let filters = standard.chain(extended).collect();
    idle_keys::check(document, &table, &config.can);
    table.finish(document);
    (config, filters)
}

fn read_traffic(document: &mut Document<'_>, mut table: Table<'_, '_>) -> Traffic {
    let mut traffic = Traffic::default();
    for (key, frames) in [("received", &mut traffic.received), ("sent", &mut traffic.sent)] {
        if let Some(number) = table.unsigned(document, key, (0, 255)) {
            *frames = number as u8;
        }
    }
    table.finish(document);
    traffic
}
