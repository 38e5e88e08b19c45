//! Level of the processor's instructions, detected once.

use core::sync::atomic::{AtomicU8, Ordering};

use super::processor;

const UNKNOWN: u8 = 0;
pub(super) const ABSENT: u8 = 1;
pub(super) const PRESENT: u8 = 2;
static LEVEL: AtomicU8 = AtomicU8::new(UNKNOWN);

#[inline]
pub(super) fn level() -> u8 {
    match LEVEL.load(Ordering::Relaxed) {
        UNKNOWN => detect(),
        known => known,
    }
}

#[cold]
#[inline(never)]
fn detect() -> u8 {
    let level = processor::detect();
    LEVEL.store(level, Ordering::Relaxed);
    level
}

#[inline]
pub(in super::super) fn is_available() -> bool {
    processor::IS_CERTAIN || level() >= PRESENT
}

/// Stops or resumes the use of the instructions.
pub(in super::super) fn pretend_absent(on: bool) {
    LEVEL.store(if on { ABSENT } else { UNKNOWN }, Ordering::Relaxed);
}

/// Calls `test` with each level of this processor, then returns their number.
#[cfg(test)]
pub(super) fn with_each_level(test: impl Fn(u8)) -> usize {
    let highest = detect();
    for level in ABSENT..=highest {
        LEVEL.store(level, Ordering::Relaxed);
        test(level);
    }
    LEVEL.store(highest, Ordering::Relaxed);
    usize::from(highest)
}
