//! Rules that keep an axis from jumping: pure, without frames and time.

mod drain;
pub(crate) mod feed_forward;
pub(crate) mod gateway_watch;
pub(crate) mod input;
pub(crate) mod motion_guard;
pub(crate) mod position_range;
pub(crate) mod terms;

pub use feed_forward::{FeedForward, FeedForwardGuard, FeedForwardLimits};
pub use input::{
    Actual, ChannelView, DriveView, GuardInput, HoldReason, PathStatus, PositionUnavailable,
};
pub use motion_guard::MotionGuard;
pub use position_range::PositionRange;
pub use terms::{Decision, GuardLimits, GuardState, TargetKind, TargetRejection, WaitReason};

#[cfg(test)]
mod path_model;
#[cfg(test)]
mod properties;
#[cfg(test)]
mod tests;
