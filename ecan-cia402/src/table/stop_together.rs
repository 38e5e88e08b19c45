//! Coordinated stop of all axes, in each cycle.

use super::cia402::Cia402;
use super::path_stop::{PathProfile, PathStop, PathTurn};
use crate::axis::axis::Axis;
use crate::axis::target_path::PathStep;
use crate::axis::target_source::MOST_GAP;
use crate::guard::terms::Decision;

impl Cia402 {
    /// Brings all axes to rest and keeps them enabled, the CSP axes together on their path; targets
    /// of the application are ignored until [`resume`](Self::resume). Real-time safe.
    ///
    /// The running CSP axes continue straight in the direction of their last targets, also from a
    /// curve, and decelerate by one common profile: it has the acceleration and jerk at which no
    /// axis exceeds its [`ramp`](crate::AxisConfig::ramp) or its
    /// [`limits`](crate::AxisConfig::limits), and so takes as long as the axis that needs longest. It
    /// begins with the acceleration of that axis in the direction of the motion; acceleration across
    /// the direction ends at once. Each target is within an increment of the straight line.
    ///
    /// A target is only sent if every one of these axes can get one in the cycle; otherwise none
    /// moves. After more than two target periods without targets the drives are at rest, and the axes
    /// stay where they are on the path. A lost EtherCAT frame or an occupied bus can delay targets that
    /// were sent: an axis is then up to three steps behind, on the same line, until they arrive. If an
    /// axis holds, leaves Operation Enabled, is resumed or cannot move on (a bound, the end of its
    /// counter, a motor that does not follow), or if the frame of one is rejected, the others stop by
    /// their own ramps from their motion of that moment.
    ///
    /// All other axes stop as by [`halt`](Self::halt). [`path_stop`](Self::path_stop) reports the
    /// state, [`is_at_rest`](Self::is_at_rest) when an axis is at rest. A call during the stop changes
    /// nothing for axes that are part of it.
    pub fn stop_together(&mut self) {
        let is_new = self.path_stop != PathStop::Decelerating;
        for axis in &mut self.axes {
            let joins = is_new && is_on_path(axis);
            if joins {
                axis.path.targets.join_path();
            } else if is_new {
                axis.path.targets.leave_path();
            }
            axis.halt();
        }
        if is_new {
            self.path_profile =
                PathProfile::of(self.axes.iter().filter(|axis| axis.path.targets.is_in_path()));
            self.path_stop = PathStop::Decelerating;
            if self.path_profile.is_none() {
                self.end_path(PathStop::Done);
            }
        }
    }

    /// State of the last [`stop_together`](Self::stop_together).
    pub fn path_stop(&self) -> PathStop {
        self.path_stop
    }

    fn end_path(&mut self, state: PathStop) {
        if let PathStop::Split { axis } = state {
            tracing::warn!(axis, "axis {axis}: left the common path of a stop");
        }
        self.path_stop = state;
        self.path_profile = None;
        self.axes.iter_mut().for_each(|axis| axis.path.targets.leave_path());
    }

    /// Before the targets of a cycle: decides for all axes of a stop together. `can_send` states
    /// whether a target of the axis can be sent now, `None` if none is due.
    pub(super) fn begin_path_turn(
        &mut self,
        can_send: impl Fn(&Self, &Axis) -> Option<bool>,
    ) -> PathTurn {
        let Some(profile) = self.path_profile.map(|path| path.next()) else {
            return PathTurn::NotDue;
        };
        let (mut due, mut waiting, mut left) = (false, None, None);
        for axis in self.axes.iter().filter(|axis| axis.path.targets.is_in_path()) {
            let can_send = can_send(self, axis);
            due |= can_send.is_some();
            match axis.path.path_step(&axis.plan, profile) {
                PathStep::Left => left = left.or(Some(axis.plan.index)),
                PathStep::Ready if can_send == Some(true) => {}
                PathStep::Ready | PathStep::Waits => waiting = waiting.or(Some(axis.plan.index)),
            }
        }
        if let Some(axis) = left {
            self.end_path(PathStop::Split { axis });
            return PathTurn::NotDue;
        }
        let turn = match waiting {
            _ if !due => PathTurn::NotDue,
            Some(axis) => PathTurn::Wait { axis },
            None => PathTurn::Move(profile),
        };
        let part = if let PathTurn::Move(profile) = turn { Some(profile) } else { None };
        self.axes.iter_mut().for_each(|axis| axis.path.targets.set_path_step(part));
        turn
    }

    /// After the targets of a cycle.
    pub(super) fn end_path_turn(&mut self, turn: PathTurn) {
        let Some(path) = &mut self.path_profile else { return };
        match turn {
            PathTurn::NotDue => {}
            PathTurn::Wait { axis } => {
                path.waits = path.waits.saturating_add(1);
                if path.waits > MOST_GAP {
                    tracing::warn!(axis, "axis {axis}: got no targets; all axes of the stop rest");
                    let members =
                        self.axes.iter_mut().filter(|axis| axis.path.targets.is_in_path());
                    members.for_each(|axis| axis.path.targets.stop());
                    self.end_path(PathStop::Done);
                }
            }
            PathTurn::Move(profile) => {
                path.profile = profile;
                path.waits = 0;
                let has_moved = |axis: &&Axis| matches!(axis.path.decision(), Decision::Target(_));
                let mut members = self.axes.iter().filter(|axis| axis.path.targets.is_in_path());
                if let Some(axis) = members.find(|axis| !has_moved(axis)) {
                    self.end_path(PathStop::Split { axis: axis.plan.index });
                } else if profile.rate == 0 {
                    self.end_path(PathStop::Done);
                }
            }
        }
    }
}

/// Returns whether a stop on the path includes the axis.
fn is_on_path(axis: &Axis) -> bool {
    axis.path.follows_application()
        && axis.path.follows_positions()
        && axis.task.procedure.is_none()
}
