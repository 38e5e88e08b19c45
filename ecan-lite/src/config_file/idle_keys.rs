//! Keys of a channel that have no effect with its other keys.

use ecan_protocol::can::TDC_FORCED_FROM;
use ecan_protocol::config::{BitTimingMode, ConfigObject, McanChannelConfig};
use ecan_protocol::object::{Entry, KeyForm};

use crate::config_file::document::Table;

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
