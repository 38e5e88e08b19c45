//! Log events of the cycle: one per transition, without allocation or lock while no subscriber is
//! set.

use tracing::{info, warn};

/// Cycles without process data of one slave.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Outage {
    has_exchanged: bool,
    cycles: u64,
}

impl Outage {
    pub(super) fn update(&mut self, slave: usize, is_lost: bool) {
        match (self.cycles, is_lost) {
            (0, true) if !self.has_exchanged => {}
            (0, true) => {
                warn!(slave, "slave {slave}: no process data (working counter 0)");
                self.cycles = 1;
            }
            (_, true) => self.cycles += 1,
            (0, false) => self.has_exchanged = true,
            (cycles, false) => {
                info!(slave, cycles, "slave {slave}: process data resumed ({cycles} cycles lost)");
                self.cycles = 0;
            }
        }
    }
}

/// Consecutive cycles that started after a missed deadline.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Overruns {
    cycles: u64,
    skipped: u64,
}

impl Overruns {
    pub(super) fn update(&mut self, skipped: u64) {
        if skipped > 0 {
            if self.cycles == 0 {
                warn!(skipped, "cycle: overrun ({skipped} deadlines skipped)");
            }
            self.cycles += 1;
            self.skipped += skipped;
        } else if self.cycles > 0 {
            let Self { cycles, skipped } = std::mem::take(self);
            info!(cycles, skipped, "cycle: in time again ({skipped} deadlines skipped)");
        }
    }
}
