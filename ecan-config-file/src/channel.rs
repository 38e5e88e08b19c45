//! One channel of a file: bit rates, mode, Message RAM, filters and data path.

use ecan_mcan_port::{ChannelConfig, Traffic};
use ecan_protocol::config::{ConfigObject, McanChannelConfig, MessageRamLayout};
use ecan_protocol::object::lookup;

use crate::data_path;
use crate::document::{Document, Table};
use crate::filter;
use crate::idle_keys;

/// How the value of a key is written.
#[derive(Clone, Copy)]
enum Kind {
    Number,
    Flag,
    Words(&'static [(&'static str, u32)]),
    /// 8, 12, 16, 20, 24, 32, 48 or 64.
    DataBytes,
}
use Kind::{DataBytes, Flag, Number, Words};

type Key = (&'static str, u8, Kind);

const NON_MATCH: Kind = Words(&[("fifo0", 0), ("fifo1", 1), ("reject", 2)]);
const FIFO_MODE: Kind = Words(&[("blocking", 0), ("overwrite", 1)]);
const DATA_BYTES: [u32; 8] = [8, 12, 16, 20, 24, 32, 48, 64];

/// Keys of a channel with their subindices of 0x8001.
const KEYS: [Key; 29] = [
    ("bitrate", 19, Number),
    ("data_bitrate", 20, Number),
    ("bit_timing", 7, Words(&[("automatic", 0), ("manual", 1)])),
    (
        "node_mode",
        8,
        Words(&[("normal", 0), ("listen", 1), ("internal_loopback", 2), ("external_loopback", 3)]),
    ),
    ("non_iso", 9, Flag),
    ("transmit_pause", 10, Flag),
    ("edge_filter", 11, Flag),
    ("protocol_exception_disable", 12, Flag),
    ("wide_message_marker", 13, Flag),
    ("external_timestamp", 14, Flag),
    ("tdc", 16, Flag),
    ("restricted_mode_disable", 17, Flag),
    ("disable_auto_retransmission", 18, Flag),
    ("tdc_offset", 33, Number),
    ("tdc_filter", 34, Number),
    ("non_match_standard", 36, NON_MATCH),
    ("non_match_extended", 37, NON_MATCH),
    ("reject_remote_standard", 38, Flag),
    ("reject_remote_extended", 39, Flag),
    ("extended_id_mask", 40, Number),
    ("timestamp_selection", 74, Number),
    ("timestamp_prescaler", 75, Number),
    ("tsu", 76, Flag),
    ("tsu_external_timebase", 77, Flag),
    ("tsu_capture_sof", 78, Flag),
    ("tsu_64_bit", 79, Flag),
    ("tsu_prescaler", 81, Number),
    ("tsu_timebase_source", 82, Number),
    ("tsu_tbsel", 83, Number),
];
const TIMEOUT_KEYS: [Key; 3] =
    [("timeout", 84, Flag), ("timeout_select", 85, Number), ("timeout_period", 87, Number)];

/// Keys of the table `ram`.
const RAM_KEYS: [Key; 13] = [
    ("rx_fifo0_mode", 61, FIFO_MODE),
    ("rx_fifo0_size", 62, Number),
    ("rx_fifo1_mode", 63, FIFO_MODE),
    ("rx_fifo1_size", 64, Number),
    ("rx_fifo0_data_bytes", 65, DataBytes),
    ("rx_fifo1_data_bytes", 66, DataBytes),
    ("rx_buffer_count", 67, Number),
    ("rx_buffer_data_bytes", 68, DataBytes),
    ("tx_mode", 69, Words(&[("fifo", 0), ("queue", 1)])),
    ("tx_fifo_size", 70, Number),
    ("tx_dedicated_count", 71, Number),
    ("tx_data_bytes", 72, DataBytes),
    ("tx_event_size", 73, Number),
];

/// The key of a subindex of 0x8001, as a path inside the channel's table.
pub(crate) fn key_of(subindex: u8) -> Option<String> {
    match subindex {
        21 | 22 => return Some("sample_point".to_owned()),
        23 | 24 => return Some("data_sample_point".to_owned()),
        25..=28 => return Some("nominal_timing".to_owned()),
        29..=32 => return Some("data_timing".to_owned()),
        _ => {}
    }
    let is_it = |(_, of, _): &&Key| *of == subindex;
    let outer = KEYS.iter().chain(&TIMEOUT_KEYS).find(is_it).map(|(key, ..)| (*key).to_owned());
    outer.or_else(|| RAM_KEYS.iter().find(is_it).map(|(key, ..)| format!("ram.{key}")))
}

pub(crate) fn read(document: &mut Document<'_>, mut table: Table<'_, '_>) -> ChannelConfig {
    // What is missing or wrong is a fault already; the rest is read all the same.
    let preset = |table: &mut Table<'_, '_>, document: &mut Document<'_>, key, subindex| {
        read_number(document, table, key, subindex)
    };
    let bitrate = preset(&mut table, document, "bitrate", 19);
    if !table.has("bitrate") {
        table.fault(document, "bitrate", "`bitrate` is missing: the nominal bit rate in bit/s");
    }
    let nominal = bitrate.unwrap_or(500_000);
    let mut settings = match preset(&mut table, document, "data_bitrate", 20) {
        Some(data) => ChannelConfig::fd(nominal, data),
        None if table.has("data_bitrate") => ChannelConfig::fd(nominal, nominal.max(1_000_000)),
        None => ChannelConfig::classic(nominal),
    };
    if let Some(traffic) = table.table(document, "traffic") {
        settings = read_traffic(document, traffic, settings);
    }
    for key in KEYS.iter().skip(2).chain(&TIMEOUT_KEYS) {
        read_key(document, &mut table, *key, &mut settings.can);
    }
    for (key, first) in [("sample_point", 21), ("data_sample_point", 23)] {
        if let Some(window) = table.permille_window(document, key) {
            for (subindex, bound) in (first..).zip(window) {
                set(document, &table, key, &mut settings.can, (subindex, bound));
            }
        }
    }
    for (key, first) in [("nominal_timing", 25), ("data_timing", 29)] {
        if let Some(timing) = table.table(document, key) {
            read_timing(document, timing, first, &mut settings.can);
        }
    }
    if let Some(ram) = table.table(document, "ram") {
        read_ram(document, ram, &mut settings.can);
    }
    if let Some(policy) = table.table(document, "data_path") {
        settings.data_path = data_path::read(document, policy, settings.data_path);
    }
    settings.standard_filters = filter::read_standard(document, &mut table);
    settings.extended_filters = filter::read_extended(document, &mut table);
    idle_keys::check(document, &table, &settings.can);
    table.finish(document);
    settings
}

/// A number within the range that the object has.
fn read_number(
    document: &mut Document<'_>,
    table: &mut Table<'_, '_>,
    key: &'static str,
    subindex: u8,
) -> Option<u32> {
    let range = lookup(0x8001, subindex).map_or((0, u32::MAX), |(_, entry)| (entry.min, entry.max));
    table.unsigned(document, key, range)
}

fn read_key(
    document: &mut Document<'_>,
    table: &mut Table<'_, '_>,
    (key, subindex, kind): Key,
    can: &mut McanChannelConfig,
) {
    let value = match kind {
        Number => read_number(document, table, key, subindex),
        Flag => table.flag(document, key).map(u32::from),
        Words(words) => table.word(document, key, words),
        DataBytes => table.unsigned(document, key, (8, 64)).and_then(|bytes| {
            let raw = (0..).zip(DATA_BYTES).find(|(_, size)| *size == bytes);
            if raw.is_none() {
                let possible = "possible are 8, 12, 16, 20, 24, 32, 48 and 64";
                table.fault(document, key, format!("`{key}` is {bytes}, {possible}"));
            }
            raw.map(|(raw, _)| raw)
        }),
    };
    if let Some(value) = value {
        set(document, table, key, can, (subindex, value));
    }
}

fn set(
    document: &mut Document<'_>,
    table: &Table<'_, '_>,
    key: &str,
    can: &mut McanChannelConfig,
    (subindex, value): (u8, u32),
) {
    if let Err(fault) = can.set_value(subindex, value) {
        table.fault(document, key, fault.to_string());
    }
}

fn read_traffic(
    document: &mut Document<'_>,
    mut table: Table<'_, '_>,
    settings: ChannelConfig,
) -> ChannelConfig {
    let mut traffic = Traffic::default();
    for (key, frames) in [("received", &mut traffic.received), ("sent", &mut traffic.sent)] {
        if let Some(number) = table.unsigned(document, key, (0, 255)) {
            *frames = number as u8;
        }
    }
    table.finish(document);
    settings.with_traffic(traffic)
}

fn read_timing(
    document: &mut Document<'_>,
    mut table: Table<'_, '_>,
    first: u8,
    can: &mut McanChannelConfig,
) {
    for (subindex, key) in (first..).zip(["brp", "tseg1", "tseg2", "sjw"]) {
        match read_number(document, &mut table, key, subindex) {
            Some(value) => set(document, &table, key, can, (subindex, value)),
            None if !table.has(key) => {
                table.fault(document, key, format!("`{key}` is missing"));
            }
            None => {}
        }
    }
    table.finish(document);
}

fn read_ram(document: &mut Document<'_>, mut table: Table<'_, '_>, can: &mut McanChannelConfig) {
    let layouts = [("classic", MessageRamLayout::classic()), ("fd", MessageRamLayout::fd())];
    if let Some(layout) = table.word(document, "layout", &layouts) {
        can.ram = layout;
    }
    for key in RAM_KEYS {
        read_key(document, &mut table, key, can);
    }
    table.finish(document);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_field_of_a_channel_has_a_key() {
        for write in McanChannelConfig::DEVICE_DEFAULT.writes(0) {
            // CAN FD is where there is a data bit rate.
            let has_key = key_of(write.subindex).is_some();
            assert_eq!(has_key, write.subindex != 15, "{write}");
        }
    }
}
