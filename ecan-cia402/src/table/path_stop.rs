//! Stop of all axes on their path.

use std::fmt;

use crate::axis::axis::Axis;
use crate::axis::ramp::{Profile, RampLimits};
use crate::axis::target_path::PathStep;
use crate::axis::targets::{MOST_GAP, ONE_BITS};
use crate::guard::terms::Decision;

/// Rate of the common profile at the call.
const ONE: i128 = 1 << ONE_BITS;

/// State of a stop on the path, see [`Cia402::stop_together`](crate::Cia402::stop_together).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PathStop {
    /// No stop was requested.
    #[default]
    None,
    /// The axes decelerate together.
    Decelerating,
    /// The axes came to rest on their path.
    Done,
    /// An axis left the path; the others came or come to rest by their own ramps.
    Split {
        /// The first axis that did.
        axis: usize,
    },
}

impl fmt::Display for PathStop {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => f.write_str("no stop on the path"),
            Self::Decelerating => f.write_str("decelerating on the path"),
            Self::Done => f.write_str("stopped on the path"),
            Self::Split { axis } => write!(f, "axis {axis} left the path"),
        }
    }
}

/// The common profile of a stop: each axis moves at its rate at the call times the profile's rate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct PathProfile {
    profile: Profile,
    limits: RampLimits,
    most: i128,
    waits: u8,
}

/// Targets of a stop in one cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PathTurn {
    /// No target is due.
    NotDue,
    /// Every axis moves, by this rate of the profile.
    Move(Profile),
    /// A target is due, but this axis cannot get one.
    Wait { axis: usize },
}

impl PathProfile {
    /// The profile by the axis that needs longest for each limit; `None` without a moving axis.
    ///
    /// The profile begins with the acceleration of the axis that needs longest to decelerate.
    fn of<'a>(axes: impl Iterator<Item = &'a Axis>) -> Option<Self> {
        let (mut change, mut jerk, mut most) = (i128::MAX, i128::MAX, i128::MAX);
        let mut start = 0;
        for axis in axes {
            let moving = axis.path.targets.motion().profile();
            let rate = moving.rate.abs();
            if rate == 0 {
                continue;
            }
            let share = |limit: i128| (limit << ONE_BITS) / rate;
            let limits = axis.path.targets.limits;
            if share(limits.change()) < change {
                change = share(limits.change());
                start = (moving.change << ONE_BITS) / moving.rate;
            }
            if limits.jerk() > 0 {
                jerk = jerk.min(share(limits.jerk()).max(1));
            }
            most = most.min(share(axis.path.most_rate()));
        }
        let jerk = if jerk == i128::MAX { 0 } else { jerk };
        (change != i128::MAX).then(|| Self {
            profile: Profile { rate: ONE, change: start },
            limits: RampLimits::new(change, jerk),
            most: most.max(ONE),
            waits: 0,
        })
    }

    fn next(&self) -> Profile {
        self.profile.next(0, self.most, &self.limits)
    }
}

/// Axes that stop together on their path.
#[derive(Debug, Default)]
pub(super) struct PathGroup {
    state: PathStop,
    /// The common profile, while the axes decelerate.
    profile: Option<PathProfile>,
}

impl PathGroup {
    pub(super) fn state(&self) -> PathStop {
        self.state
    }

    /// Halts all axes; those that follow positions join the group. A call during a stop changes nothing for
    /// axes that are part of it.
    pub(super) fn stop(&mut self, axes: &mut [Axis]) {
        let is_new = self.state != PathStop::Decelerating;
        for axis in axes.iter_mut() {
            let joins = is_new && is_on_path(axis);
            if joins {
                axis.path.targets.join_path();
            } else if is_new {
                axis.path.targets.leave_path();
            }
            axis.halt();
        }
        if is_new {
            self.profile = PathProfile::of(members(axes));
            self.state = PathStop::Decelerating;
            if self.profile.is_none() {
                self.end(axes, PathStop::Done);
            }
        }
    }

    fn end(&mut self, axes: &mut [Axis], state: PathStop) {
        if let PathStop::Split { axis } = state {
            tracing::warn!(axis, "axis {axis}: left the common path of a stop");
        }
        self.state = state;
        self.profile = None;
        axes.iter_mut().for_each(|axis| axis.path.targets.leave_path());
    }

    /// Decides for all axes of the group together, before the targets of a cycle. `can_send` states
    /// whether a target of the axis can be sent now, `None` if none is due.
    pub(super) fn begin_turn(
        &mut self,
        axes: &mut [Axis],
        can_send: impl Fn(&Axis) -> Option<bool>,
    ) -> PathTurn {
        let Some(profile) = self.profile.map(|path| path.next()) else {
            return PathTurn::NotDue;
        };
        let (mut due, mut waiting, mut left) = (false, None, None);
        for axis in members(axes) {
            let can_send = can_send(axis);
            due |= can_send.is_some();
            match axis.path.path_step(&axis.plan, profile) {
                PathStep::Left => left = left.or(Some(axis.plan.index)),
                PathStep::Ready if can_send == Some(true) => {}
                PathStep::Ready | PathStep::Waits => waiting = waiting.or(Some(axis.plan.index)),
            }
        }
        if let Some(axis) = left {
            self.end(axes, PathStop::Split { axis });
            return PathTurn::NotDue;
        }
        let turn = match waiting {
            _ if !due => PathTurn::NotDue,
            Some(axis) => PathTurn::Wait { axis },
            None => PathTurn::Move(profile),
        };
        let part = if let PathTurn::Move(profile) = turn { Some(profile) } else { None };
        axes.iter_mut().for_each(|axis| axis.path.targets.set_path_step(part));
        turn
    }

    /// Evaluates the targets of a cycle, after they were sent.
    pub(super) fn end_turn(&mut self, axes: &mut [Axis], turn: PathTurn) {
        let Some(path) = &mut self.profile else { return };
        match turn {
            PathTurn::NotDue => {}
            PathTurn::Wait { axis } => {
                path.waits = path.waits.saturating_add(1);
                if path.waits > MOST_GAP {
                    tracing::warn!(axis, "axis {axis}: got no targets; all axes of the stop rest");
                    let members = axes.iter_mut().filter(|axis| axis.path.targets.is_in_path());
                    members.for_each(|axis| axis.path.targets.stop());
                    self.end(axes, PathStop::Done);
                }
            }
            PathTurn::Move(profile) => {
                path.profile = profile;
                path.waits = 0;
                let has_moved = |axis: &Axis| matches!(axis.path.decision(), Decision::Target(_));
                let stopped = members(axes).find(|axis| !has_moved(axis));
                if let Some(axis) = stopped.map(|axis| axis.plan.index) {
                    self.end(axes, PathStop::Split { axis });
                } else if profile.rate == 0 {
                    self.end(axes, PathStop::Done);
                }
            }
        }
    }
}

/// Axes of the group.
fn members(axes: &[Axis]) -> impl Iterator<Item = &Axis> {
    axes.iter().filter(|axis| axis.path.targets.is_in_path())
}

/// Returns whether a stop on the path includes the axis.
fn is_on_path(axis: &Axis) -> bool {
    axis.path.follows_application()
        && axis.path.follows_positions()
        && axis.task.procedure.is_none()
}
