//! Texts of SDO transfers: causes of failures, values, and the assumptions that values contradict.

use ecan_protocol::object::{AbortCode, lookup};
use ecan_protocol::sequence::Expectation;
use ecrt_sys::Errno;

/// Returns whether the slave does not have the object.
pub(crate) fn is_missing(code: AbortCode) -> bool {
    [AbortCode::NO_OBJECT, AbortCode::NO_SUBINDEX].contains(&code)
}

/// Cause of a transfer that failed, with the object and the number of attempts.
pub(crate) fn sdo_cause(
    (index, subindex): (u16, u8),
    abort_code: Option<AbortCode>,
    errno: Errno,
    attempts: u32,
) -> String {
    match abort_code {
        Some(code) if is_missing(code) && lookup(index, subindex).is_some() => {
            format!("aborted: {code} (assumption H42: the firmware lacks it)")
        }
        Some(code) => format!("aborted: {code}"),
        None if attempts > 1 => format!("failed {attempts} times: {errno}"),
        None => format!("failed: {errno}"),
    }
}

/// A condition on a value, with the meaning of a single value.
pub(crate) fn expected_text(index: u16, subindex: u8, expected: Expectation) -> String {
    match expected {
        Expectation::Equals(value) => value_text(index, subindex, value as u32),
        other => other.to_string(),
    }
}

/// A value with its meaning from the object dictionary, if it has one.
pub fn value_text(index: u16, subindex: u8, value: u32) -> String {
    match lookup(index, subindex).and_then(|(_, entry)| entry.meaning(value)) {
        Some(meaning) => format!("{value} ({meaning})"),
        None if value > 9 => format!("{value} (0x{value:X})"),
        None => value.to_string(),
    }
}

/// Assumption that an unexpected value may contradict, and the remedy, as an appendix of a message; empty
/// without one.
#[must_use]
pub fn contradicted_assumption(index: u16, subindex: u8, found: u32) -> &'static str {
    match (index, subindex, found) {
        (0x8000, 13, _) => {
            " (assumption H47: the firmware may activate a pin rotation only at its start; save the \
             configuration with `ecan config save` and restart the gateway with `ecan reboot`)"
        }
        (0x8000, 15, 1) => {
            " (assumption H47: the firmware may reject a pin rotation in OP; set it in PREOP)"
        }
        (0x8001..=0x8004, 2, 1) => {
            " (assumption H38: in OP the firmware may reject a configuration; apply it in PREOP)"
        }
        (0x8001..=0x8004, 2, 3) => {
            " (assumption H43: the firmware may find no bit timing for the sample point, H11: or no delay \
             compensation; set the bit timing by hand, or another sample point)"
        }
        (0x8001..=0x8004, 2, 4) => {
            " (assumption H13: its Message RAM may have less than 8192 bytes; configure fewer or smaller \
             elements)"
        }
        _ => "",
    }
}
