//! One channel of a file: bit rates, mode, Message RAM, filters and data path.

use ecan_mcan_port::{AcceptanceFilter, ChannelConfig, Traffic};
use ecan_protocol::config::{ConfigObject, McanChannelConfig, MessageRamLayout};

use crate::config_file::document::{Table, store};
use crate::config_file::fields;
use crate::config_file::filter;
use crate::config_file::idle_keys;

const CHANNEL: u16 = McanChannelConfig::INDEX;

pub(crate) fn read(mut table: Table<'_, '_>) -> (ChannelConfig, Vec<AcceptanceFilter>) {
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
    let standard = filter::read_standard(&mut table).into_iter().map(Into::into);
    let extended = filter::read_extended(&mut table).into_iter().map(Into::into);
    let filters = standard.chain(extended).collect();
    idle_keys::check(&table, &config.can);
    (config, filters)
}

fn read_traffic(mut table: Table<'_, '_>) -> Traffic {
    let mut traffic = Traffic::default();
    store(&mut traffic.received, table.unsigned("received", (0, 255)));
    store(&mut traffic.sent, table.unsigned("sent", (0, 255)));
    traffic
}
