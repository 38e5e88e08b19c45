//! Rules that keep an axis from jumping: pure, without frames and time.

mod drain;
pub(crate) mod feed_forward;
pub(crate) mod gateway_watch;
pub(crate) mod motion_guard;
pub(crate) mod terms;

pub use feed_forward::{FeedForward, FeedForwardGuard, FeedForwardLimits};
pub use motion_guard::MotionGuard;
pub use terms::{
    Actual, ChannelView, Decision, DriveView, GuardInput, GuardLimits, GuardState, HoldReason,
    PathStatus, PositionRange, PositionUnavailable, TargetKind, TargetRejection, WaitReason,
};

#[cfg(test)]
mod motion_guard_tests;
#[cfg(test)]
mod path_model_tests;
#[cfg(test)]
mod property_tests;
