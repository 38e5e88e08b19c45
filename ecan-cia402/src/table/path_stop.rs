//! Stop of all axes on their path.

use std::fmt;

use crate::axis::axis::Axis;
use crate::axis::ramp::{Profile, RampLimits};
use crate::axis::target_source::ONE_BITS;

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
pub(super) struct PathProfile {
    pub(super) profile: Profile,
    limits: RampLimits,
    most: i128,
    pub(super) waits: u8,
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
    /// It begins with the acceleration of the axis that needs longest to decelerate.
    pub(super) fn of<'a>(axes: impl Iterator<Item = &'a Axis>) -> Option<Self> {
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

    pub(super) fn next(&self) -> Profile {
        self.profile.next(0, self.most, &self.limits)
    }
}
