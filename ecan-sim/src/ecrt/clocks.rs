//! Distributed clocks of the bus as the master keeps them.

use crate::ecrt::datagram::DatagramState;
use crate::ecrt::slave_config::DcConfig;
use crate::ecrt::timing::SYNC0_AHEAD_NS;
use crate::gateway::Sync0;

/// AssignActivate bit of Sync0.
const SYNC0_ACTIVE: u16 = 0x0200;
const SYNC1_ACTIVE: u16 = 0x0400;

#[derive(Debug, Default)]
pub(crate) struct Clocks {
    pub(crate) app_time: u64,
    /// When it was set, in simulated time.
    pub(crate) set_at_ns: u64,
    /// First application time: Sync0 keeps its phase to it.
    pub(crate) reference_time: u64,
    /// True if the slaves' times were set since activation or scan.
    pub(crate) are_set: bool,
    /// Configuration of the slave that the application has chosen as reference clock.
    pub(crate) selected: Option<usize>,
    /// Time to write into the reference clock.
    pub(crate) reference_target: u64,
    pub(crate) reference: DatagramState,
    pub(crate) slaves: DatagramState,
    pub(crate) monitor: DatagramState,
    /// Result of the datagram for the slaves: lower half of the reference clock.
    pub(crate) reference_value: u32,
    /// Result of the monitor datagram: the slaves' differences, combined by OR.
    pub(crate) monitor_value: u32,
}

impl Clocks {
    pub(crate) fn application_time(&mut self, time: u64, now: u64) {
        self.app_time = time;
        self.set_at_ns = now;
        if self.reference_time == 0 {
            self.reference_time = time;
        }
    }

    pub(crate) fn has_sync1(dc: &DcConfig) -> bool {
        dc.assign_activate & SYNC1_ACTIVE != 0
    }

    pub(crate) fn sync0(&self, dc: &DcConfig) -> Option<Sync0> {
        if dc.assign_activate & SYNC0_ACTIVE == 0 {
            return None;
        }
        let cycle = u64::from(dc.sync0_cycle) + u64::from(dc.sync1_cycle);
        let mut start_ns = self.app_time.wrapping_add(SYNC0_AHEAD_NS);
        if cycle > 0 && self.reference_time != 0 {
            start_ns += cycle - start_ns.wrapping_sub(self.reference_time) % cycle;
        }
        Some(Sync0 { start_ns, cycle_ns: dc.sync0_cycle, shift_ns: dc.sync0_shift })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sync0_keeps_its_phase_to_the_first_application_time() {
        let mut clocks = Clocks::default();
        clocks.application_time(5_000_000_300, 1_000_000_000);
        clocks.application_time(5_007_000_300, 1_007_000_000);
        let dc = DcConfig {
            assign_activate: 0x0300,
            sync0_cycle: 1_000_000,
            sync0_shift: 250_000,
            sync1_cycle: 0,
        };
        let sync0 = clocks.sync0(&dc).unwrap();
        assert_eq!(sync0.shift_ns, 250_000);
        assert_eq!((sync0.start_ns - 5_000_000_300) % 1_000_000, 0);
        assert!(sync0.start_ns > 5_007_000_000 + SYNC0_AHEAD_NS - 1);
        assert!(clocks.sync0(&DcConfig { assign_activate: 0, ..dc }).is_none());
    }
}
