//! The terms of the motion guard: what it is told beforehand, where it can stand, what it can say.

use std::fmt;

use super::input::HoldReason;
use super::position_range::PositionRange;

/// What the targets of an axis are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TargetKind {
    /// A position per cycle (CSP). The first one is the actual position.
    #[default]
    Position,
    /// A velocity or torque per cycle (CSV, CST). The first one is 0.
    Rate,
    /// A position that the drive approaches by its own profile (PP). It may be far away: only
    /// the bounds hold it. The first one is the actual position.
    Profile,
    /// The application gives no targets (homing); the axis stays at the first one, its actual
    /// position.
    None,
}

/// The rules of one axis, in raw units and cycles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GuardLimits {
    /// What the targets are.
    pub kind: TargetKind,
    /// How the position counter runs.
    pub range: PositionRange,
    /// Farthest that a target may be from the one before, in steps (or velocity or torque
    /// units); of no meaning for [`TargetKind::Profile`].
    pub step: u32,
    /// Farthest that a position target may be from the last known actual position, in steps.
    pub window: u32,
    /// Smallest and largest target. An axis that stands outside may be led back inside.
    pub bounds: Option<(i32, i32)>,
    /// Farthest that two fresh actual positions may be apart for an axis that stands still.
    pub standstill: u32,
    /// Cycles in a row without a usable TPDO that are put up with.
    pub tpdo_timeout: u16,
    /// Cycles in a row with an incomplete working counter that are put up with.
    pub wc_misses: u16,
    /// New images that must be seen while stale targets are waited out, at least.
    pub drain_images: u16,
}

/// Where the guard stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum GuardState {
    /// The axis is not taken up.
    #[default]
    Idle,
    /// Being taken up: targets of before may still be under way and are waited out.
    Draining,
    /// Being taken up: two fresh actual positions are waited for that show the axis at rest.
    Reading,
    /// A fresh actual position is at hand; the drive is not enabled yet, and every frame to it
    /// carries its latest actual position as target.
    Armed {
        /// That position, or 0 for [`TargetKind::Rate`].
        target: i32,
    },
    /// The application's targets go out.
    Running {
        /// The last target sent.
        target: i32,
    },
    /// The axis gets no targets, until it is taken up again.
    Holding {
        /// Why.
        reason: HoldReason,
    },
}

impl fmt::Display for GuardState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Idle => f.write_str("not taken up"),
            Self::Draining => f.write_str("waiting until stale targets are gone"),
            Self::Reading => f.write_str("waiting for a fresh actual position at rest"),
            Self::Armed { .. } => f.write_str("at its actual position"),
            Self::Running { .. } => f.write_str("following targets"),
            Self::Holding { reason } => write!(f, "holding: {reason}"),
        }
    }
}

/// Why a target was not taken. The target before it stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TargetRejection {
    /// Too far from the target before.
    #[error("the step of {step} exceeds the limit of {limit} per cycle")]
    Step {
        /// The way from the target before.
        step: i64,
        /// The limit.
        limit: u32,
    },
    /// Too far from the actual position.
    #[error("the target is {distance} steps from the actual position, the window is {window}")]
    Window {
        /// The way from the actual position.
        distance: i64,
        /// The window.
        window: u32,
    },
    /// Outside the bounds of the axis.
    #[error("the target {target} is outside {min}..{max}")]
    Bounds {
        /// The target.
        target: i32,
        /// Smallest.
        min: i32,
        /// Largest.
        max: i32,
    },
    /// The position counter cannot stand there.
    #[error("the drive's position counter never stands at {target}")]
    Counter {
        /// The target.
        target: i32,
    },
    /// The mode of the axis takes no targets.
    #[error("the operating mode takes no targets")]
    NoTargets,
}

/// Why nothing is sent in this cycle although the axis is taken up. The application's motion must
/// not go on meanwhile: the next target is judged against the last one that was sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WaitReason {
    /// The working counter of this cycle is incomplete (manual 15.5.2, step 8).
    WorkingCounter,
    /// The last image may not have arrived and is repeated; a target now would follow it in the
    /// same bus cycle.
    ImageHeld,
    /// The first target must be an actual position of this very cycle.
    NoFreshPosition,
    /// The drive is enabled and still holds an old target, and the axis stands further than a step
    /// from it: blocked, or targets were lost on the way. Its actual position would be a jump for
    /// the drive; it must be switched off first.
    HoldsOldTarget,
    /// The image of the last cycle had no room for a frame of the channel. If that was SYNC, the
    /// targets of that cycle are not effective yet, and another would be a double step.
    ImageFull,
    /// This cycle has had its target.
    Spent,
    /// A frame was refused in this cycle; the axis will hold from the next one on.
    Refused,
}

impl fmt::Display for WaitReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::WorkingCounter => "the working counter is incomplete",
            Self::ImageHeld => "the last image is repeated",
            Self::HoldsOldTarget => "the drive holds an old target far from the axis",
            Self::ImageFull => "the image was full",
            Self::Spent => "the target of this cycle is out",
            Self::NoFreshPosition => "no fresh actual position in this cycle",
            Self::Refused => "a frame was refused",
        })
    }
}

/// What may be sent in this cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Decision {
    /// The axis is not taken up: no target.
    Closed,
    /// The drive is not enabled: only its own actual position.
    Track(i32),
    /// The drive is enabled: its actual position, whatever the application wants.
    First(i32),
    /// The application's target, or the last one again where it gave none.
    Target(i32),
    /// Nothing now.
    Wait(WaitReason),
    /// Not this target.
    Refuse(TargetRejection),
}

impl Decision {
    /// The target to send, if one may be sent.
    pub fn target(self) -> Option<i32> {
        match self {
            Self::Track(target) | Self::First(target) | Self::Target(target) => Some(target),
            Self::Closed | Self::Wait(_) | Self::Refuse(_) => None,
        }
    }
}
