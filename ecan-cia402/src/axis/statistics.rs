//! Counters of an axis. They only grow.

use crate::guard::input::{Actual, HoldReason};
use crate::guard::terms::{Decision, TargetRejection, WaitReason};

/// SYNC periods that a TPDO may be under way before it counts as lost: out through the gateway,
/// over the bus and back, with the reply of one cycle lost.
const IN_FLIGHT: u32 = 8;

/// Counters of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct AxisStatistics {
    /// Targets handed to the gateway, the first ones included.
    pub targets_sent: u64,
    /// Times that the axis was activated while enabled: first targets.
    pub activations: u64,
    /// Targets of the application that were rejected, for any reason.
    pub targets_rejected: u64,
    /// Those rejected because of the step limit.
    pub rejected_step: u64,
    /// Those rejected because of the following-error window.
    pub rejected_window: u64,
    /// Cycles in which a running axis got no target although one was due: an incomplete working
    /// counter, an unconfirmed image, no space, or earlier frames that wait in the gateway.
    pub waits: u64,
    /// Times that the axis held.
    pub holds: u64,
    /// Reason of its last hold.
    pub last_hold: Option<HoldReason>,
    /// Times that the axis became uncontrolled: to be stopped, possibly moving, and silent.
    pub uncontrolled: u64,
    /// TPDOs received.
    pub tpdos: u64,
    /// TPDOs too short for the mapping.
    pub malformed_tpdos: u64,
    /// TPDOs that never came, by the number of SYNCs sent.
    pub lost_tpdos: u64,
    /// Most cycles in a row without a usable TPDO while the axis was enabled.
    pub longest_gap: u16,
    /// Cycles with an unusable actual position: in an incomplete image, after a backlog.
    pub unusable_positions: u64,
    /// Largest distance between target and actual position while targets went out, in steps.
    pub max_following_error: u64,
    /// Targets that the gateway reported as not sent.
    pub targets_lost: u64,
    /// Feed-forwards that a limit changed.
    pub feed_forwards_limited: u64,
    /// Emergency messages.
    pub emergencies: u32,
    /// Faults of the drive.
    pub faults: u64,
    outstanding: u32,
}

impl AxisStatistics {
    pub(crate) fn sync_sent(&mut self) {
        self.outstanding += 1;
        if self.outstanding > IN_FLIGHT {
            self.outstanding -= 1;
            self.lost_tpdos += 1;
        }
    }

    pub(crate) fn tpdo_received(&mut self) {
        self.tpdos += 1;
        self.outstanding = self.outstanding.saturating_sub(1);
    }

    /// The count of SYNCs and TPDOs starts over: the drive was not Operational, or is not any more.
    pub(crate) fn restart_tpdo_count(&mut self) {
        self.outstanding = 0;
    }

    pub(crate) fn observed(&mut self, actual: Actual, had_tpdo: bool) {
        self.unusable_positions += u64::from(had_tpdo && matches!(actual, Actual::None(_)));
    }

    pub(crate) fn held(&mut self, reason: HoldReason) {
        self.holds += 1;
        self.last_hold = Some(reason);
    }

    pub(crate) fn decided(&mut self, decision: Decision, is_running: bool) {
        match decision {
            Decision::Reject(rejection) => {
                self.targets_rejected += 1;
                match rejection {
                    TargetRejection::Step { .. } => self.rejected_step += 1,
                    TargetRejection::Window { .. } => self.rejected_window += 1,
                    _ => {}
                }
            }
            Decision::Wait(WaitReason::NotDue) => {}
            Decision::Wait(_) if is_running => self.waits += 1,
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_tpdo_is_counted_once() {
        let mut statistics = AxisStatistics::default();
        for n in 0..100 {
            statistics.sync_sent();
            // Two cycles late, and the one of cycle 50 is lost.
            if n >= 2 && n != 52 {
                statistics.tpdo_received();
            }
        }
        assert_eq!(statistics.lost_tpdos, 0, "it may still be under way");
        for _ in 0..IN_FLIGHT {
            statistics.sync_sent();
        }
        assert_eq!(statistics.lost_tpdos, 3, "two under way and the lost one");
    }
}
