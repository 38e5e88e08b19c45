//! RPDOs of an axis after the first: feed-forward and outputs.

use ecan_canopen::OperatingMode;
use ecan_protocol::can::CanId;

use super::axis::Axis;
use super::axis_cycle::TargetTurn;
use super::pdo_layout::RpdoBytes;
use crate::guard::feed_forward::FeedForward;
use crate::guard::terms::Decision;

/// Cycles with a clear path after a frame without feed-forward until the drive certainly has it, with SYNC in every
/// cycle and frames that are sent at once.
const CLEARED_CYCLES: u32 = 4;

impl Axis {
    /// After the first RPDO of a cycle: takes the feed-forward of its target, and returns whether the
    /// other RPDOs are to be sent. `is_own_motion` states whether the host made the target.
    ///
    /// They go out with each target, and in the same cycles while the axis gets none, so that an
    /// output that was lost arrives. A feed-forward ends with the targets, at once.
    pub(crate) fn prepare_auxiliary(&mut self, turn: TargetTurn, is_own_motion: bool) -> bool {
        self.step_offsets(turn);
        let before = self.further.feed_forward.last();
        match self.decision {
            Decision::Target(_) => {
                let has_effect = matches!(
                    self.mode,
                    OperatingMode::CyclicPosition | OperatingMode::CyclicVelocity
                );
                let requested = self.targets.feed_forward.take();
                let requested = requested.filter(|_| has_effect && !is_own_motion);
                let is_limited = self.further.feed_forward.follow(requested);
                self.statistics.feed_forwards_limited += u64::from(is_limited);
            }
            Decision::Reject(_) => {
                self.targets.feed_forward = None;
                self.further.feed_forward.follow(None);
            }
            Decision::Wait(_) => return false,
            Decision::Track(_) | Decision::First(_) | Decision::Closed => {
                self.targets.feed_forward = None;
                self.further.feed_forward.end();
            }
        }
        self.further.outputs.velocity_offset = self.further.feed_forward.last().velocity;
        self.further.outputs.torque_offset = self.further.feed_forward.last().torque;
        self.further.outputs.probe_function = self.further.probes.function();
        let has_ended =
            before != FeedForward::NONE && self.further.feed_forward.last() == FeedForward::NONE;
        (turn == TargetTurn::Due || has_ended)
            && self.setup.is_complete()
            && self.further.is_path_clear
            && self.is_verified()
            && self.reachability.operational
    }

    /// A motor with a feed-forward is not where its position controller leads it: the position of the
    /// first target is read after the end of the feed-forward, and only later positions show standstill.
    fn step_offsets(&mut self, turn: TargetTurn) {
        // The drive takes a frame over with a SYNC, which these cycles do not have.
        let has_no_sync = matches!(turn, TargetTurn::NotReceived | TargetTurn::NoSync);
        if !self.further.is_path_clear {
            self.further.cleared_cycles = 0;
        } else if self.further.cleared_cycles > 0 && !has_no_sync {
            self.further.cleared_cycles += 1;
            let until_sync = self.cycles_per_sync.saturating_sub(1);
            let in_schedule = u32::from(self.schedule_images);
            if self.further.cleared_cycles > CLEARED_CYCLES + until_sync + in_schedule {
                self.further.offsets_in_force = false;
                self.further.cleared_cycles = 0;
                self.guard.restart_activation();
                self.drive.rest.restart();
            }
        }
    }

    /// A drive that stops drops its feed-forward: the motor, which may have been at rest without being at its target,
    /// moves there. So only positions after that show the end of the stop.
    pub(crate) fn restart_rest_after_offsets(&mut self) {
        if !self.has_auxiliary {
            return;
        }
        let is_enabled = self.drive.is_enabled();
        let has_left = std::mem::replace(&mut self.further.was_enabled, is_enabled) && !is_enabled;
        if has_left && self.further.offsets_in_force {
            self.drive.rest.restart();
        }
    }

    /// The RPDOs after the first were sent; the last ones were not unless `is_complete`.
    pub(crate) fn auxiliary_sent(&mut self, is_complete: bool) {
        if self.further.feed_forward.last() != FeedForward::NONE {
            self.further.offsets_in_force = true;
            self.further.cleared_cycles = 0;
        } else if self.further.offsets_in_force && is_complete && self.further.cleared_cycles == 0 {
            self.further.cleared_cycles = 1;
        }
    }

    /// Returns whether the drive has a feed-forward although the axis gets no targets.
    pub(crate) fn awaits_end_of_feed_forward(&self) -> bool {
        self.further.offsets_in_force && !self.is_running()
    }

    /// The RPDOs after the first.
    pub(crate) fn auxiliary_frames(&self) -> impl Iterator<Item = (CanId, RpdoBytes)> {
        self.further
            .auxiliary
            .iter()
            .copied()
            .zip(self.further.layout.encode_auxiliary(&self.further.outputs))
    }
}
