//! A `[[node]]` table of the configuration file.

use ecan_canopen::{BootReset, ConfigurationDate, NodeId, PdoDirection};
use ecan_protocol::mapping::CHANNELS;

use super::source::{NodeSource, ParameterSource, PdoSource, RevisionRule};
use crate::config_file::document::{Table, store};
use crate::config_file::located::Located;

const RESETS: [(&str, BootReset); 3] = [
    ("none", BootReset::None),
    ("communication", BootReset::Communication),
    ("node", BootReset::Node),
];
const REVISIONS: [(&str, RevisionRule); 3] = [
    ("any", RevisionRule::Any),
    ("compatible", RevisionRule::Compatible),
    ("exact", RevisionRule::Exact),
];
/// Subindices of 0x1011.
const RESTORES: [(&str, Option<u8>); 4] =
    [("none", None), ("all", Some(1)), ("communication", Some(2)), ("application", Some(3))];
const PDOS: [(&str, PdoDirection); 2] =
    [("rpdo", PdoDirection::Receive), ("tpdo", PdoDirection::Transmit)];
/// Days from 1984-01-01, the epoch of 0x1020, to 1970-01-01 are negative.
const EPOCH_DAYS: i64 = 5_113;

/// Reads a node. The tables of its axes remain for [`crate::config_file::axis`].
pub(crate) fn read(table: &mut Table<'_, '_>) -> NodeSource {
    let slave = table.required("gateway", "the index of its gateway in the file", (0, 0xFFFF));
    let channel = table.required("channel", "0 to 3", (0, CHANNELS as u32 - 1));
    let mut source = NodeSource::new(
        table.at(),
        slave.unwrap_or(0) as usize,
        channel.and_then(|it| u8::try_from(it).ok()).unwrap_or(0),
    );
    source.name = table.text("name").unwrap_or_default().to_owned();
    let node = table.unsigned::<u8>("node", (1, 127)).and_then(NodeId::new);
    source.node = node.map(|node| Located::new(node, table.location("node")));
    let file = table.text("device_file").map(Into::into);
    source.device_file = file.map(|file| Located::new(file, table.location("device_file")));
    source.is_mandatory = table.flag("mandatory");
    source.order = table.unsigned("order", (0, 255));
    source.reset = table.word("reset", &RESETS);
    source.boot_timeout_ms = table.unsigned("boot_timeout_ms", (1, 3_600_000));
    store(&mut source.checks_identity, table.flag("check_identity"));
    source.device_type = table.unsigned("device_type", (0, u32::MAX));
    source.vendor_id = table.unsigned("vendor_id", (0, u32::MAX));
    source.product_code = table.unsigned("product_code", (0, u32::MAX));
    store(&mut source.revision, table.word("revision", &REVISIONS));
    source.revision_number = table.unsigned("revision_number", (0, u32::MAX));
    source.serial_number = table.unsigned("serial_number", (0, u32::MAX));
    source.software = table.unsigned("software", (0, u32::MAX));
    source.restores = table.word("restore", &RESTORES).flatten();
    source.date = date(table);
    source.saves = table.flag("save");
    source.heartbeat_ms = table.unsigned("heartbeat_ms", (0, 0xFFFF));
    let guard_time = table.unsigned("guard_time_ms", (1, 0xFFFF));
    source.guard_time_ms = guard_time.map(|it| Located::new(it, table.location("guard_time_ms")));
    source.life_time_factor = table.unsigned("life_time_factor", (1, 0xFF));
    source.starts = table.flag("start");
    source.reboots = table.flag("reboot");
    if let Some(mut parameters) = table.table("parameters") {
        source.parameters = parameters
            .scalars()
            .into_iter()
            .map(|(key, at, value)| ParameterSource {
                object: Located::new(key, at),
                value: Located::new(value, at),
            })
            .collect();
    }
    for (key, direction) in PDOS {
        for pdo in table.tables(key) {
            source.pdos.push(read_pdo(pdo, direction));
        }
    }
    source
}

fn date(table: &mut Table<'_, '_>) -> Option<ConfigurationDate> {
    const KEY: &str = "configuration_date";
    let date = table.datetime(KEY)?;
    let days = date.date.map(|it| days_from_civil(it.year.into(), it.month.into(), it.day.into()));
    let days = days.and_then(|days| u32::try_from(days - EPOCH_DAYS).ok());
    let Some(days) = days else {
        table.fault(KEY, format!("`{KEY}` must be a date and time from 1984-01-01 on"));
        return None;
    };
    let milliseconds = date.time.map_or(0, |time| {
        let seconds = u32::from(time.second.unwrap_or(0))
            + 60 * (u32::from(time.minute) + 60 * u32::from(time.hour));
        seconds * 1_000 + time.nanosecond.unwrap_or(0) / 1_000_000
    });
    Some(ConfigurationDate { days, milliseconds })
}

/// Days from 1970-01-01 of a date of the Gregorian calendar.
fn days_from_civil(year: i64, month: i64, day: i64) -> i64 {
    // Years begin with March, so that the leap day is the last one.
    let year = if month <= 2 { year - 1 } else { year };
    let era = year.div_euclid(400);
    let of_era = year.rem_euclid(400);
    let day_of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    era * 146_097 + of_era * 365 + of_era / 4 - of_era / 100 + day_of_year - 719_468
}

fn read_pdo(mut table: Table<'_, '_>, direction: PdoDirection) -> PdoSource {
    let number = table.required("number", "1 to 512", (1, 512));
    let cob_id = table.unsigned("cob_id", (1, 0x7FF));
    let transmission = table.unsigned("transmission", (0, 255));
    let number = number.and_then(|it| u16::try_from(it).ok()).unwrap_or(1);
    PdoSource {
        is_enabled: table.flag("enabled").unwrap_or(true),
        cob_id: cob_id.map(|it| Located::new(it, table.location("cob_id"))),
        transmission: transmission.map(|it| Located::new(it, table.location("transmission"))),
        inhibit_time: table.unsigned("inhibit_time_100us", (0, 0xFFFF)),
        event_timer_ms: table.unsigned("event_timer_ms", (0, 0xFFFF)),
        sync_start: table.unsigned("sync_start", (0, 240)),
        objects: table.texts("objects"),
        ..PdoSource::new(table.at(), direction, number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_count_from_1984() {
        let days = |year, month, day| days_from_civil(year, month, day) - EPOCH_DAYS;
        assert_eq!(days_from_civil(1970, 1, 1), 0);
        assert_eq!(days(1984, 1, 1), 0);
        assert_eq!(days(1984, 3, 1), 60);
        assert_eq!(days(1985, 1, 1), 366);
        // 40 years with ten leap days, and 2024 is one.
        assert_eq!(days(2024, 1, 1), 40 * 365 + 10);
        assert_eq!(days(2026, 11, 24), 40 * 365 + 10 + 366 + 365 + 327);
    }
}
