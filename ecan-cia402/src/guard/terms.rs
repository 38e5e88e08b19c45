//! Terms of the motion guard: limits, states, decisions.

use std::fmt;

use super::input::HoldReason;
use super::position_range::PositionRange;

/// Kind of the targets of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TargetKind {
    /// A position per cycle (CSP). The first one is the actual position.
    #[default]
    Position,
    /// A velocity or torque per cycle (CSV, CST). The first one is 0.
    Rate,
    /// A position that the drive approaches by its own profile (PP). It may be far away; only the
    /// bounds limit it. The first one is the actual position.
    Profile,
    /// The application gives no targets (homing); the axis stays at the first one, its actual
    /// position.
    None,
}

/// Limits of one axis, in raw units and cycles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GuardLimits {
    /// Kind of the targets.
    pub kind: TargetKind,
    /// Range of the position counter.
    pub range: PositionRange,
    /// Longest distance of a target from the previous one, in steps (or velocity or torque
    /// units); ignored for [`TargetKind::Profile`].
    pub step: u32,
    /// Longest distance of a position target from the last known actual position, in steps.
    pub window: u32,
    /// Smallest and largest target. An axis that is outside may be led back inside.
    pub bounds: Option<(i32, i32)>,
    /// Longest distance of the fresh actual positions of an axis at standstill, in steps.
    pub standstill: u32,
    /// Tolerated cycles in a row without a usable TPDO.
    pub tpdo_timeout: u16,
    /// Tolerated cycles in a row with an incomplete working counter.
    pub wc_misses: u16,
    /// Fewest new images that must be received while old targets drain.
    pub drain_images: u16,
}

/// State of the guard.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum GuardState {
    /// The axis is not active.
    #[default]
    Idle,
    /// Activation: old targets may still be on the path to the drive; the guard waits for their
    /// end.
    Draining,
    /// Activation: the guard waits for fresh actual positions that show the axis at rest.
    Reading,
    /// A fresh actual position is known; the drive is not enabled yet, and every frame to it
    /// carries its latest actual position as target.
    Armed {
        /// That position, or 0 for [`TargetKind::Rate`].
        target: i32,
    },
    /// The application's targets are sent.
    Running {
        /// The last target sent.
        target: i32,
    },
    /// The axis gets no targets until it is activated again.
    Holding {
        /// Cause.
        reason: HoldReason,
    },
}

impl fmt::Display for GuardState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Idle => f.write_str("not active"),
            Self::Draining => f.write_str("waiting until stale targets are gone"),
            Self::Reading => f.write_str("waiting for a fresh actual position at rest"),
            Self::Armed { .. } => f.write_str("at its actual position"),
            Self::Running { .. } => f.write_str("following targets"),
            Self::Holding { reason } => write!(f, "holding: {reason}"),
        }
    }
}

/// Rejection of a target. The previous target stays in force.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TargetRejection {
    /// Too far from the previous target.
    #[error("the step of {step} exceeds the limit of {limit} per target")]
    Step {
        /// Distance from the previous target.
        step: i64,
        /// Limit.
        limit: u32,
    },
    /// Too far from the actual position.
    #[error("the target is {distance} steps from the actual position, the window is {window}")]
    Window {
        /// Distance from the actual position.
        distance: i64,
        /// Limit.
        window: u32,
    },
    /// Outside the bounds of the axis.
    #[error("the target {target} is outside {min}..{max}")]
    Bounds {
        /// The target.
        target: i32,
        /// Smallest target.
        min: i32,
        /// Largest target.
        max: i32,
    },
    /// Outside the range of the position counter.
    #[error("the target {target} is outside the range of the drive's position counter")]
    Counter {
        /// The target.
        target: i32,
    },
    /// The mode of the axis has no targets.
    #[error("the operating mode takes no targets")]
    NoTargets,
}

ecan_protocol::text_enum! {
    /// Reason for which nothing is sent in this cycle although the axis is active. The application's
    /// motion must not continue in such a cycle: the next target is compared with the last one sent.
    pub enum WaitReason;
    /// The working counter of this cycle is incomplete (manual 15.5.2, step 8).
    WorkingCounter = "the working counter is incomplete";
    /// The last image is unconfirmed and repeated; a target now would follow it in the same bus
    /// cycle.
    ImageUnconfirmed = "the last image is repeated";
    /// The first target must be an actual position of this very cycle. A running axis waits for
    /// positions that show it at its last target, if TPDOs were missing and it got no target for more than
    /// four target periods.
    NoFreshPosition = "no fresh actual position in this cycle";
    /// The drive is enabled and holds an old target further than a step from its position: blocked,
    /// or targets were lost. Its actual position would be a jump for the drive; it must be
    /// switched off first.
    HoldsOldTarget = "the drive holds an old target far from the axis";
    /// The image of the last cycle had no space for a frame of the channel. If that was SYNC, the
    /// targets of that cycle are not effective yet, and another one would be a double step.
    ImageFull = "the image was full";
    /// Frames that were sent before the newest images still wait in the gateway: the bus is occupied. A
    /// target now would be released together with them.
    Backlog = "earlier frames still wait in the gateway";
    /// No target is due: the target period, counted from the SYNC that made the last target effective,
    /// has not ended, or this cycle has no SYNC.
    NotDue = "no target is due in this cycle";
    /// `process_rx` was not called in this cycle, so that the status of drive and gateway is old.
    NotReceived = "process_rx was not called in this cycle";
    /// Another axis of a stop on the path cannot get a target in this cycle.
    Together = "another axis of the stop waits";
    Spent = "the target of this cycle was sent";
    Rejected = "a frame was rejected";
}

/// Decision about the target of a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Decision {
    /// The axis is not active: no target.
    Closed,
    /// The drive is not enabled: only its own actual position.
    Track(i32),
    /// The drive is enabled: its actual position, regardless of the application's target.
    First(i32),
    /// The application's target, or the last one again if it gave none.
    Target(i32),
    /// Nothing in this cycle.
    Wait(WaitReason),
    /// The application's target is rejected.
    Reject(TargetRejection),
}

impl Decision {
    /// The target to send, if one may be sent.
    pub fn target(self) -> Option<i32> {
        match self {
            Self::Track(target) | Self::First(target) | Self::Target(target) => Some(target),
            Self::Closed | Self::Wait(_) | Self::Reject(_) => None,
        }
    }
}
