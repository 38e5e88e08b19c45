//! Data path policies of a file: 0x8020 of the gateway, 0x8021..0x8024 of its channels.

use ecan_protocol::config::{ConfigObject, DataPathConfig, DataPathGlobal};

use crate::document::{Document, Table};

/// Words of a field.
type Words = &'static [(&'static str, u32)];

/// Keys of a channel's policy with their subindices of 0x8021. What the manual reserves is left out.
pub(crate) const KEYS: [(&str, u8, Words); 13] = [
    ("enable", 1, &[]),
    ("rx_drain_min", 4, &[]),
    ("rx_drain_max", 5, &[]),
    ("rx_budget", 6, &[("balanced", 0), ("limited", 1), ("performance", 2), ("adaptive", 3)]),
    ("rx_cache_depth", 7, &[]),
    (
        "rx_overflow",
        8,
        &[("drop_oldest", 0), ("drop_newest", 1), ("preserve_critical", 2), ("degraded", 3)],
    ),
    ("critical_frames", 9, &[("none", 0), ("canopen_safety", 1), ("canopen_all", 2)]),
    ("tx_budget_min", 11, &[]),
    ("tx_budget_max", 12, &[]),
    ("tx_overflow", 13, &[("drop_newest", 0), ("drop_oldest", 1), ("backoff", 2), ("degraded", 3)]),
    ("bus_off_recovery", 14, &[("manual", 0), ("auto", 1), ("aggressive", 2), ("degraded", 3)]),
    ("backoff_base_cycles", 15, &[]),
    ("degraded_threshold", 16, &[]),
];

/// Greatest value of a field without words, as the manual's type holds it.
const fn greatest(subindex: u8) -> u32 {
    match subindex {
        4 | 5 | 11 | 12 => 8,
        _ => 0xFFFF,
    }
}

/// A channel's policy, on top of what was there.
pub(crate) fn read(
    document: &mut Document<'_>,
    mut table: Table<'_, '_>,
    base: DataPathConfig,
) -> DataPathConfig {
    let mut values: Vec<(u8, u32)> = Vec::new();
    for (key, subindex, words) in KEYS {
        let value = match (subindex, words) {
            (1, _) => table.flag(document, key).map(u32::from),
            (7, _) => table.unsigned(document, key, (8, 32)).and_then(|frames| {
                let is_known = frames % 8 == 0;
                if !is_known {
                    let reason = format!("`{key}` is {frames}, possible are 8, 16, 24 and 32");
                    table.fault(document, key, reason);
                }
                is_known.then_some(frames)
            }),
            (_, []) => table.unsigned(document, key, (0, greatest(subindex))),
            (_, words) => table.word(document, key, words),
        };
        values.extend(value.map(|value| (subindex, value)));
    }
    table.finish(document);
    let read = |subindex| {
        let written = values.iter().find(|(of, _)| *of == subindex).map(|(_, value)| *value);
        written.or_else(|| base.value(subindex)).unwrap_or_default()
    };
    DataPathConfig::from_values(read).unwrap_or(base)
}

/// 0x8020.
pub(crate) fn read_global(document: &mut Document<'_>, mut table: Table<'_, '_>) -> DataPathGlobal {
    let mut global = DataPathGlobal::default();
    if let Some(mode) = table.unsigned(document, "compat_mode", (0, 0xFFFF)) {
        global.compat_mode = mode as u16;
    }
    // The manual's capability masks are 0: no bit has a meaning yet.
    if let Some(options) = table.unsigned(document, "runtime_options", (0, 0)) {
        global.runtime_options = options;
    }
    if let Some(options) = table.unsigned(document, "diagnostic_options", (0, 0)) {
        global.diagnostic_options = options;
    }
    if let Some(budget) = table.unsigned(document, "max_service_budget_us", (0, 1_000)) {
        global.max_service_budget_us = budget as u16;
    }
    table.finish(document);
    global
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_field_of_a_policy_has_a_key_and_every_word_a_meaning() {
        for write in DataPathConfig::default().writes(0) {
            let has_key = KEYS.iter().any(|(_, subindex, _)| *subindex == write.subindex);
            let is_reserved = matches!(write.subindex, 10 | 17..=19);
            assert_eq!(has_key, !is_reserved, "{write}");
        }
        for (key, subindex, words) in KEYS {
            let (_, entry) = ecan_protocol::object::lookup(0x8021, subindex).unwrap();
            for (word, value) in words {
                let meaning = entry.meaning(*value).unwrap().to_lowercase().replace(' ', "_");
                assert_eq!(meaning, *word, "{key}");
            }
        }
    }
}
