//! Keys of configuration objects, read as their declarations in ecan-protocol say.

use ecan_protocol::can::TDC_FORCED_FROM;
use ecan_protocol::config::{BitTimingMode, ConfigObject, InvalidValue, McanChannelConfig};
use ecan_protocol::object::{Entry, KeyForm, lookup, object};

use super::document::Table;

/// Reads the keys of an object into `config`. `group` is the table inside the object's table that
/// is read, empty for that table itself.
pub(crate) fn read<C: ConfigObject>(table: &mut Table<'_, '_>, group: &str, config: &mut C) {
    for entry in C::fields() {
        if let Some(key) = key_in(entry, group)
            && let Some(value) = read_value(table, key, entry)
            && let Err(fault) = config.set_value(entry.subindex, value)
        {
            table.fault(key, fault.to_string());
        }
    }
}

/// Reads the keys of the object at an index; `set` gets the subindex and value of each.
pub(crate) fn read_with(
    table: &mut Table<'_, '_>,
    index: u16,
    mut set: impl FnMut(u8, u32) -> Result<(), InvalidValue>,
) {
    for entry in object(index).map_or(&[][..], |object| object.entries) {
        if let Some(key) = entry.key
            && let Some(value) = read_value(table, key, entry)
            && let Err(fault) = set(entry.subindex, value)
        {
            table.fault(key, fault.to_string());
        }
    }
}

/// Keys of a group that the table does not have.
pub(crate) fn report_missing<C: ConfigObject>(table: &Table<'_, '_>, group: &str) {
    for key in C::fields().filter_map(|entry| key_in(entry, group)).filter(|key| !table.has(key)) {
        table.fault(key, format!("`{key}` is missing"));
    }
}

/// Reads one key as the entry at `index` and `subindex` says.
pub(crate) fn read_entry(
    table: &mut Table<'_, '_>,
    key: &'static str,
    (index, subindex): (u16, u8),
) -> Option<u32> {
    let (_, entry) = lookup(index, subindex)?;
    read_value(table, key, entry)
}

fn key_in(entry: &Entry, group: &str) -> Option<&'static str> {
    let key = entry.key?;
    let (table, name) = key.split_once('.').unwrap_or(("", key));
    (table == group).then_some(name)
}

/// The words of an entry, each with its raw value; the first one if two values have the same word.
fn words(entry: &Entry) -> Vec<(String, u32)> {
    let mut words: Vec<(String, u32)> = Vec::new();
    for (value, text) in entry.values {
        let word = text.to_lowercase().replace(' ', "_");
        if words.iter().all(|(known, _)| *known != word) {
            words.push((word, *value));
        }
    }
    words
}

fn read_value(table: &mut Table<'_, '_>, key: &'static str, entry: &Entry) -> Option<u32> {
    match entry.form {
        KeyForm::Number => {
            let number = table.unsigned(key, (entry.min, entry.max))?;
            if entry.accepts(number) {
                return Some(number);
            }
            let allowed: Vec<u32> = entry.values.iter().map(|(value, _)| *value).collect();
            invalid(table, key, number, &allowed)
        }
        KeyForm::Flag => table.flag(key).map(u32::from),
        KeyForm::Word => table.word(key, &words(entry)),
        KeyForm::Words(names) => {
            let words: Vec<_> =
                names.iter().map(|(name, bit)| (name.to_lowercase(), *bit)).collect();
            let bits = table.words(key, &words)?;
            Some(bits.into_iter().fold(0, |all, bit| all | bit))
        }
        KeyForm::Bits => {
            let bits: Vec<_> =
                entry.bits.iter().map(|(bit, name)| (name.to_lowercase(), 1 << bit)).collect();
            let bits: Vec<u32> = table.words(key, &bits)?;
            Some(bits.into_iter().fold(0, |all, bit| all | bit))
        }
        KeyForm::Size(sizes) => {
            let mut allowed = sizes.to_vec();
            allowed.sort_unstable();
            let range = (*allowed.first()?, *allowed.last()?);
            let size = table.unsigned(key, range)?;
            let raw = (0..).zip(sizes).find(|(_, known)| **known == size).map(|(raw, _)| raw);
            raw.or_else(|| invalid(table, key, size, &allowed))
        }
        KeyForm::LowerBound => table.permille_window(key).map(|[min, _]| min),
        KeyForm::UpperBound => table.permille_window(key).map(|[_, max]| max),
    }
}

fn invalid(table: &Table<'_, '_>, key: &str, number: u32, allowed: &[u32]) -> Option<u32> {
    let allowed: Vec<_> = allowed.iter().map(ToString::to_string).collect();
    let reason = format!("`{key}` = {number} is invalid; allowed: {}", allowed.join(", "));
    table.fault(key, reason);
    None
}

const BIT_TIMING: u8 = 7;
const NON_ISO: u8 = 9;
const FD: u8 = 15;
const TDC_OFFSET: u8 = 33;
const TDC_FILTER: u8 = 34;

/// Reports a fault for each key of a channel without an effect (manual 13.4).
pub(crate) fn check(table: &Table<'_, '_>, can: &McanChannelConfig) {
    for entry in McanChannelConfig::fields() {
        let Some(key) = entry.key.and_then(|key| key.split('.').next()) else { continue };
        // `false` for something that is off does no harm.
        let is_off = entry.form == KeyForm::Flag && can.value(entry.subindex) == Some(0);
        if is_off || !table.has(key) {
            continue;
        }
        let Some((decided_by, why)) = idle_reason(entry, can) else { continue };
        // A consequence of another fault is not reported, and one reason for a key is enough.
        if ![decided_by, key].iter().any(|key| table.is_faulty(key)) {
            table.fault(key, format!("`{key}` has no effect: {why}"));
        }
    }
    if can.fd && !can.tdc && can.tdc_runs() {
        let reason = format!(
            "`tdc` has no effect: from {} Mbit/s on delay compensation always runs",
            TDC_FORCED_FROM / 1_000_000
        );
        table.fault("tdc", reason);
    }
}

/// The key that makes an entry ineffective, and why.
fn idle_reason(entry: &Entry, can: &McanChannelConfig) -> Option<(&'static str, String)> {
    // Non-ISO mode is written for classic CAN too, as in the manual's example.
    let needs = if entry.subindex == NON_ISO { &[FD] } else { entry.needs };
    let off = needs.iter().copied().find(|&needed| can.value(needed) == Some(0));
    let is_window = matches!(entry.form, KeyForm::LowerBound | KeyForm::UpperBound);
    match off {
        Some(FD) => {
            let why = "without `data_bitrate` the channel is classic CAN";
            Some(("data_bitrate", why.to_owned()))
        }
        Some(BIT_TIMING) => Some(("bit_timing", "it needs `bit_timing = \"manual\"`".to_owned())),
        Some(other) => {
            let switch = McanChannelConfig::fields().find(|entry| entry.subindex == other)?.key?;
            Some((switch, format!("`{switch}` is off")))
        }
        None if is_window && can.bit_timing_mode == BitTimingMode::Manual => {
            Some(("bit_timing", "`bit_timing` is manual".to_owned()))
        }
        None if matches!(entry.subindex, TDC_OFFSET | TDC_FILTER) && !can.tdc_runs() => {
            Some(("tdc", "`tdc` is off at this data bit rate".to_owned()))
        }
        None => None,
    }
}

#[cfg(test)]
mod tests {
    use ecan_protocol::config::{
        DataPathConfig, DataPathGlobal, DiagnosticTest, McanChannelConfig,
    };
    use ecan_protocol::image::PdoProfile;

    use super::*;

    fn without_key<C: ConfigObject>() -> Vec<u8> {
        C::fields().filter(|entry| entry.key.is_none()).map(|entry| entry.subindex).collect()
    }

    #[test]
    fn configuration_fields_have_keys() {
        // The data bit rate enables CAN FD.
        assert_eq!(without_key::<McanChannelConfig>(), [15]);
        assert!(without_key::<PdoProfile>().is_empty());
        assert!(without_key::<DataPathGlobal>().is_empty());
        assert!(without_key::<DataPathConfig>().is_empty());
        assert!(without_key::<DiagnosticTest>().is_empty());
    }

    #[test]
    fn words_follow_from_the_texts_of_values() {
        let words_of = |index, subindex| {
            let words = words(lookup(index, subindex).unwrap().1);
            words.into_iter().map(|(word, _)| word).collect::<Vec<_>>().join(" ")
        };
        assert_eq!(words_of(0x8001, 8), "normal listen internal_loopback external_loopback");
        assert_eq!(words_of(0x8001, 36), "fifo0 fifo1 reject");
        assert_eq!(words_of(0x8001, 50), "range two masked disabled");
        assert_eq!(words_of(0x8001, 56), "range two masked range_unmasked");
        assert_eq!(
            words_of(0x8001, 51),
            "disabled fifo0 fifo1 reject priority priority_fifo0 priority_fifo1 rx_buffer"
        );
        assert_eq!(words_of(0x8001, 69), "fifo queue");
        assert_eq!(words_of(0x8010, 6), "balanced shared_only deterministic");
        assert_eq!(words_of(0x8021, 8), "drop_oldest drop_newest preserve_critical degraded");
        assert_eq!(words_of(0x8021, 9), "none canopen_safety canopen_all");
    }
}
