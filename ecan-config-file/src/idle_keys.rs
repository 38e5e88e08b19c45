//! Keys of a channel that would be read and then do nothing beside its other keys.

use ecan_protocol::can::TDC_FORCED_FROM;
use ecan_protocol::config::{BitTimingMode, ConfigObject, McanChannelConfig};

use crate::document::{Document, Table};

/// Some keys, and when they do nothing.
struct Rule<'a> {
    is_idle: bool,
    keys: &'a [&'a str],
    /// The key that makes it so.
    decided_by: &'a str,
    why: &'a str,
}

/// Flags, with their subindices of 0x8001: `false` says what is so anyway and does no harm.
const FLAGS: [(&str, u8); 5] = [
    ("non_iso", 9),
    ("tdc", 16),
    ("tsu_external_timebase", 77),
    ("tsu_capture_sof", 78),
    ("tsu_64_bit", 79),
];

/// A fault for each key of a channel without an effect (manual 13.4).
pub(crate) fn check(document: &mut Document<'_>, table: &Table<'_, '_>, can: &McanChannelConfig) {
    let is_manual = can.bit_timing_mode == BitTimingMode::Manual;
    let rules = [
        Rule {
            is_idle: !can.fd,
            keys: &[
                "data_sample_point",
                "data_timing",
                "tdc",
                "tdc_offset",
                "tdc_filter",
                "non_iso",
            ],
            decided_by: "data_bitrate",
            why: "without `data_bitrate` the channel is classic CAN",
        },
        Rule {
            is_idle: !is_manual,
            keys: &["nominal_timing", "data_timing"],
            decided_by: "bit_timing",
            why: "it needs `bit_timing = \"manual\"`",
        },
        Rule {
            is_idle: is_manual,
            keys: &["sample_point", "data_sample_point"],
            decided_by: "bit_timing",
            why: "`bit_timing` is manual",
        },
        Rule {
            is_idle: !can.tdc_runs(),
            keys: &["tdc_offset", "tdc_filter"],
            decided_by: "tdc",
            why: "`tdc` is off at this data bit rate",
        },
        Rule {
            is_idle: !can.tsu,
            keys: &[
                "tsu_external_timebase",
                "tsu_capture_sof",
                "tsu_64_bit",
                "tsu_prescaler",
                "tsu_timebase_source",
                "tsu_tbsel",
            ],
            decided_by: "tsu",
            why: "`tsu` is off",
        },
        Rule {
            is_idle: !can.timeout,
            keys: &["timeout_select", "timeout_period"],
            decided_by: "timeout",
            why: "`timeout` is off",
        },
    ];
    let is_off = |key: &str| {
        let flag = FLAGS.iter().find(|(flag, _)| *flag == key);
        flag.is_some_and(|(_, subindex)| can.value(*subindex) == Some(0))
    };
    for Rule { keys, decided_by, why, .. } in rules.iter().filter(|rule| rule.is_idle) {
        // What follows from a fault is none of its own, and one reason for a key is enough.
        if document.is_faulty(&table.path(decided_by)) {
            continue;
        }
        for key in keys.iter().filter(|key| table.has(key) && !is_off(key)) {
            if !document.is_faulty(&table.path(key)) {
                table.fault(document, key, format!("`{key}` has no effect: {why}"));
            }
        }
    }
    if can.fd && !can.tdc && can.tdc_runs() {
        let reason = format!(
            "`tdc` has no effect: from {} Mbit/s on delay compensation always runs",
            TDC_FORCED_FROM / 1_000_000
        );
        table.fault(document, "tdc", reason);
    }
}
