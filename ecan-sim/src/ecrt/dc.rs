//! Distributed clocks: the application's time and what the slaves' clocks make of it.

use crate::ecrt::slave_config::DcConfig;
use crate::ecrt::timing::SYNC0_AHEAD_NS;
use crate::gateway::Sync0;

/// AssignActivate bit that switches Sync0 on.
const SYNC0_ACTIVE: u16 = 0x0200;

/// State of a datagram of the clocks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum ClockDatagram {
    #[default]
    Idle,
    Queued,
    Sent {
        at_ns: u64,
        arrives_ns: Option<u64>,
    },
    Received,
    Lost,
}

/// The clocks of the bus. Slave clocks do not drift here: they run with simulated time, at an
/// offset that the master sets.
#[derive(Debug, Default)]
pub(crate) struct Clocks {
    /// Last application time.
    pub(crate) app_time: u64,
    /// First application time: Sync0 keeps its phase to it.
    pub(crate) reference_time: u64,
    /// Slaves' system time minus simulated time; `None` until the master has written it.
    pub(crate) offset: Option<i128>,
    /// Application time to write into the reference clock.
    pub(crate) reference_target: u64,
    pub(crate) reference: ClockDatagram,
    pub(crate) slaves: ClockDatagram,
    pub(crate) monitor: ClockDatagram,
    /// What the datagram for the slaves brought back: lower half of the reference clock.
    pub(crate) reference_value: u32,
}

impl Clocks {
    pub(crate) fn application_time(&mut self, time: u64) {
        self.app_time = time;
        if self.reference_time == 0 {
            self.reference_time = time;
        }
    }

    /// Writes the slaves' offsets, as the master does once after activation and when a slave
    /// comes new.
    pub(crate) fn write_offsets(&mut self, now: u64) {
        self.set_system_time(self.app_time, now);
    }

    pub(crate) fn set_system_time(&mut self, time: u64, now: u64) {
        self.offset = Some(i128::from(time) - i128::from(now));
    }

    /// System time of the slaves.
    pub(crate) fn system_time(&self, now: u64) -> u64 {
        (i128::from(now) + self.offset.unwrap_or(0)) as u64
    }

    /// Sync0 of a slave that is started now.
    pub(crate) fn sync0(&self, dc: &DcConfig) -> Option<Sync0> {
        if dc.assign_activate & SYNC0_ACTIVE == 0 {
            return None;
        }
        let cycle = u64::from(dc.sync0_cycle) + u64::from(dc.sync1_cycle);
        let mut start = self.app_time.wrapping_add(SYNC0_AHEAD_NS);
        if cycle > 0 && self.reference_time != 0 {
            start += cycle - start.wrapping_sub(self.reference_time) % cycle;
        }
        let start_ns = i128::from(start) - self.offset.unwrap_or(0);
        Some(Sync0 {
            start_ns: u64::try_from(start_ns).unwrap_or(0),
            cycle_ns: dc.sync0_cycle,
            shift_ns: dc.sync0_shift,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sync0_keeps_its_phase_to_the_first_application_time() {
        let mut clocks = Clocks::default();
        clocks.application_time(5_000_000_300);
        clocks.write_offsets(1_000_000_000);
        clocks.application_time(5_007_000_300);
        let dc = DcConfig {
            assign_activate: 0x0300,
            sync0_cycle: 1_000_000,
            sync0_shift: 250_000,
            sync1_cycle: 0,
        };
        let sync0 = clocks.sync0(&dc).unwrap();
        assert_eq!(sync0.shift_ns, 250_000);
        assert_eq!((sync0.start_ns - 1_000_000_000) % 1_000_000, 0);
        assert!(sync0.start_ns > 1_007_000_000 + SYNC0_AHEAD_NS - 1);
        assert!(clocks.sync0(&DcConfig { assign_activate: 0, ..dc }).is_none());
    }
}
