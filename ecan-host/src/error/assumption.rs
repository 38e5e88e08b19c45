//! Assumptions that a value of an object contradicts (docs/ASSUMPTIONS.md).

/// Assumption that an unexpected value may contradict, and the remedy, as an appendix of a message; empty
/// without one.
#[must_use]
pub fn contradicted_assumption(index: u16, subindex: u8, found: u32) -> &'static str {
    match (index, subindex, found) {
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
