//! Terms of the motion guard: its input, its states and decisions, and the range of positions.

use std::fmt;

use ecan_canopen::DriveState;

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

/// Actual position of an axis in one cycle, and its age.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Actual {
    /// From a TPDO of this cycle's image, and at most the next TPDO can be on the path: the image
    /// is new, complete and of the configured layout, it brought all received frames of the
    /// channel, or at least those that the image before left in the gateway, the working counter is
    /// complete, and all this applied to the two previous cycles, too. (An image waits in the
    /// gateway until it is fetched, a delayed TPDO comes with a later one, a gateway that builds its
    /// image at the end of a read leaves the answers to the last SYNC, and while an image is
    /// repeated no new SYNC requests a TPDO.)
    Fresh(i32),
    /// From a TPDO of this cycle's image, but something newer may be on the path. It proves that the
    /// drive is alive and where it roughly is, but no axis starts from it.
    Late(i32),
    /// No usable position in this cycle.
    None(PositionUnavailable),
}

ecan_protocol::text_enum! {
    /// Reason for which a cycle has no usable actual position.
    pub enum PositionUnavailable;
    NoImage = "no new image from the gateway";
    /// The image is damaged, or was written while it was read.
    Damaged = "the gateway's image is damaged";
    /// The gateway marked the image as truncated or overflowed (manual 6.1): newer frames are
    /// delayed or lost.
    Incomplete = "the gateway's image is incomplete";
    Layout = "the gateway's image has another layout";
    /// The gateway's count of waiting received frames is saturated, or it reports receive
    /// pressure: the age of the position is unknown.
    Backlog = "received frames pile up in the gateway";
    NoTpdo = "no TPDO in the image";
}

/// Status word of the channel in one cycle (manual 7).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ChannelView {
    /// No new image, so nothing new is known.
    NotSeen,
    /// Bus-off.
    BusOff,
    /// Disabled, initialising, in error or listening.
    NotRunning,
    /// Takes part in the bus.
    Running {
        /// Frames that wait to be sent, 0 to 7; 7 means 7 or more.
        pending: u8,
        /// The transmit queue is congested.
        pressure: bool,
    },
}

/// Status of the communication path to a drive in one cycle: gateway, image and channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PathStatus {
    /// The gateway is ready, and was without interruption since the last cycle.
    pub is_ready: bool,
    /// The working counter confirms that both directions were exchanged.
    pub is_complete: bool,
    /// The last RxPDO image may not have arrived and is published again; new frames wait.
    pub is_unconfirmed: bool,
    /// Frames for the gateway were discarded since the last cycle, by any part of the application.
    pub discarded: bool,
    /// The gateway's transmit queue of the channel rejected a frame since the last cycle, of this
    /// axis or of another sender on the channel.
    pub queue_rejected: bool,
    /// The RxPDO image had no space for a frame of the channel in the last cycle. It may have been
    /// the SYNC of targets that were sent.
    pub image_full: bool,
    /// Cycles since the last input, this one not included, whose working counter was incomplete: 0
    /// unless the application skipped cycles.
    pub skipped_incomplete: u16,
    /// The gateway reported a target of this axis as not sent (manual 10).
    pub target_lost: bool,
    /// Status of the channel.
    pub channel: ChannelView,
    /// Frames of the channel that were sent before the newest images still wait in the gateway, or may
    /// wait there, since its count is saturated and the drive does not answer.
    pub has_backlog: bool,
    /// Frames of the channel in images whose working counter was complete, counted from any start.
    pub confirmed: u64,
    /// Part of `confirmed` that the channel's status certainly includes: the frames that were
    /// confirmed two new images ago.
    pub covered: u64,
}

impl PathStatus {
    /// A path without faults, on a channel without frames.
    #[cfg(test)]
    pub(crate) const CLEAR: PathStatus = PathStatus {
        is_ready: true,
        is_complete: true,
        is_unconfirmed: false,
        discarded: false,
        queue_rejected: false,
        image_full: false,
        skipped_incomplete: 0,
        target_lost: false,
        channel: ChannelView::Running { pending: 0, pressure: false },
        has_backlog: false,
        confirmed: 0,
        covered: 0,
    };

    /// Returns whether the path has no known fault, so that a frame of this cycle reaches the bus with
    /// the next image.
    /// Real-time safe.
    pub fn is_clear(&self) -> bool {
        let is_running = matches!(
            self.channel,
            ChannelView::NotSeen | ChannelView::Running { pressure: false, .. }
        );
        self.is_ready
            && self.is_complete
            && is_running
            && !(self.is_unconfirmed
                || self.discarded
                || self.queue_rejected
                || self.image_full
                || self.has_backlog)
    }
}

/// Status of the drive in one cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DriveView {
    /// State of the last statusword, however old; `None` before the first one.
    pub state: Option<DriveState>,
    /// A watched heartbeat has timed out.
    pub heartbeat_lost: bool,
    /// The node is in another NMT state than Operational, or restarted since the last cycle.
    pub not_operational: bool,
    /// The connection to the drive was lost, it may have restarted, and its configuration is not
    /// verified yet.
    pub unverified: bool,
    /// The drive reports that it follows the target (statusword bit 12 in the cyclic modes).
    pub follows: bool,
    /// The drive reports a following error (statusword bit 13 in the cyclic position mode).
    pub following_error: bool,
}

/// Input of the guard in one cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GuardInput {
    /// Communication path to the drive.
    pub path: PathStatus,
    /// The drive.
    pub drive: DriveView,
    /// Its actual position.
    pub actual: Actual,
}

/// Reason for which an axis gets no targets until it is activated again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum HoldReason {
    /// The gateway is no longer ready.
    #[error("the gateway was lost")]
    GatewayLost,
    /// Frames for the gateway were discarded, and a target may be among them.
    #[error("pending frames were discarded")]
    FramesDiscarded,
    /// The working counter was incomplete in more cycles in a row than the axis tolerates.
    #[error("the working counter stayed incomplete")]
    WorkingCounter,
    /// The channel is bus-off.
    #[error("the channel went bus-off")]
    BusOff,
    /// The channel left the bus without being bus-off.
    #[error("the channel left the bus")]
    ChannelStopped,
    /// The gateway's transmit queue was full.
    #[error("the gateway's transmit queue was full")]
    QueueFull,
    /// The gateway reported a target as not sent.
    #[error("the gateway reported a target as not sent")]
    TargetLost,
    /// TPDOs were missing, the axis got no target for more than four target periods, and the drive does
    /// not rest at the last one, within two standstill windows: targets were lost, or the motor is blocked.
    #[error("the drive is not at its last target, after missing TPDOs")]
    NotAtTarget,
    /// The drive's heartbeat timed out.
    #[error("the drive's heartbeat timed out")]
    HeartbeatLost,
    /// The drive left the NMT state Operational, or restarted.
    #[error("the drive is not Operational")]
    NotOperational,
    /// The connection to the drive was lost, and its configuration is not verified yet.
    #[error("the drive's configuration is being verified")]
    Unverified,
    /// No usable TPDO arrived in more cycles in a row than the axis tolerates.
    #[error("TPDO missing: {0}")]
    TpdoLost(PositionUnavailable),
    /// The drive left Operation Enabled.
    #[error("the drive left Operation Enabled and is in {0}")]
    LeftOperationEnabled(DriveState),
    /// The drive stopped following its target while it was enabled.
    #[error("the drive stopped following its target")]
    NotFollowing,
    /// The drive reports a following error.
    #[error("the drive reports a following error")]
    FollowingError,
    /// The application commanded it.
    #[error("commanded")]
    Commanded,
}

impl HoldReason {
    /// Returns what to do before the axis is enabled again, as a command; `None` if nothing is needed.
    pub fn remedy(self) -> Option<&'static str> {
        match self {
            Self::GatewayLost | Self::FramesDiscarded => Some("wait until the gateway is ready"),
            Self::WorkingCounter => Some("check the EtherCAT link and the real-time priority"),
            Self::BusOff => Some("wait until the channel has recovered from bus-off"),
            Self::ChannelStopped => Some("wait until the channel takes part in the bus"),
            Self::QueueFull | Self::TargetLost => Some("check the load of the bus"),
            Self::NotAtTarget => Some("check that the motor can move"),
            Self::HeartbeatLost | Self::NotOperational | Self::Unverified => {
                Some("wait until the drive is configured")
            }
            Self::TpdoLost(_) => Some("wait until the drive answers"),
            Self::LeftOperationEnabled(_) => Some("check the drive"),
            Self::NotFollowing | Self::FollowingError => Some("check load and limits of the drive"),
            Self::Commanded => None,
        }
    }

    /// Returns whether the reason lies on the path to the drive, not in the drive or in a command.
    pub(crate) fn is_on_path(self) -> bool {
        !matches!(
            self,
            Self::LeftOperationEnabled(_)
                | Self::NotFollowing
                | Self::FollowingError
                | Self::NotOperational
                | Self::Commanded
        )
    }
}

/// Range of the position counter of a drive.
///
/// Every comparison of positions (step limit, following-error window, standstill) goes through
/// [`distance`](Self::distance), every addition through [`add`](Self::add), so that a wrap is
/// never taken for a jump nor a jump for a wrap.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PositionRange {
    /// The counter ends at the limits of an `i32`. Nothing may be commanded beyond them, and
    /// -2147483648 is as far from 2147483647 as it looks.
    #[default]
    Linear,
    /// The counter wraps over the whole `i32`: one step beyond 2147483647 is -2147483648.
    Wrapping,
    /// The counter wraps within 0x607B (position range limit): one step beyond `max` is `min`.
    Modulo {
        /// Smallest position, 0x607B:01.
        min: i32,
        /// Largest position, 0x607B:02; above `min`.
        max: i32,
    },
}

impl PositionRange {
    /// Signed distance from one position to another, in steps: the shorter one if the counter
    /// wraps. Real-time safe.
    pub fn distance(self, from: i32, to: i32) -> i64 {
        match self {
            Self::Linear => i64::from(to) - i64::from(from),
            Self::Wrapping => i64::from(to.wrapping_sub(from)),
            Self::Modulo { min, max } => {
                let span = span(min, max);
                let steps = (i64::from(to) - i64::from(from)).rem_euclid(span);
                if steps * 2 >= span { steps - span } else { steps }
            }
        }
    }

    /// The position at a distance of `steps` from `from`; `None` if a linear counter ends before. Real-time safe.
    pub fn add(self, from: i32, steps: i64) -> Option<i32> {
        match self {
            Self::Linear => i32::try_from(i64::from(from).checked_add(steps)?).ok(),
            // The cast keeps the low 32 bits: that is the wrap.
            Self::Wrapping => Some(i64::from(from).wrapping_add(steps) as i32),
            Self::Modulo { min, max } => {
                let offset = i64::from(from).checked_sub(i64::from(min))?.checked_add(steps)?;
                i32::try_from(i64::from(min) + offset.rem_euclid(span(min, max))).ok()
            }
        }
    }

    /// Returns whether the counter can stand there. Real-time safe.
    pub fn contains(self, position: i32) -> bool {
        match self {
            Self::Linear | Self::Wrapping => true,
            Self::Modulo { min, max } => (min..=max).contains(&position),
        }
    }
}

/// Positions of a modulo counter; at least one, so that it can divide.
fn span(min: i32, max: i32) -> i64 {
    (i64::from(max) - i64::from(min) + 1).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const TURN: PositionRange = PositionRange::Modulo { min: 0, max: 3599 };

    #[test]
    fn each_fault_of_a_path_alone_makes_it_unclear() {
        const CLEAR: PathStatus = PathStatus::CLEAR;
        assert!(CLEAR.is_clear());
        assert!(PathStatus { channel: ChannelView::NotSeen, ..CLEAR }.is_clear());
        let pressed = ChannelView::Running { pending: 0, pressure: true };
        let channels = [pressed, ChannelView::BusOff, ChannelView::NotRunning];
        let faults = [
            PathStatus { is_ready: false, ..CLEAR },
            PathStatus { is_complete: false, ..CLEAR },
            PathStatus { is_unconfirmed: true, ..CLEAR },
            PathStatus { discarded: true, ..CLEAR },
            PathStatus { queue_rejected: true, ..CLEAR },
            PathStatus { image_full: true, ..CLEAR },
            PathStatus { has_backlog: true, ..CLEAR },
        ];
        for fault in
            faults.into_iter().chain(channels.map(|channel| PathStatus { channel, ..CLEAR }))
        {
            assert!(!fault.is_clear(), "{fault:?}");
        }
    }

    #[test]
    fn linear_counter_ends_at_its_limits() {
        assert_eq!(PositionRange::Linear.distance(i32::MAX, i32::MIN), -0xFFFF_FFFF);
        assert_eq!(PositionRange::Linear.add(i32::MAX, 1), None);
        assert_eq!(PositionRange::Linear.add(i32::MIN, -1), None);
        assert_eq!(PositionRange::Linear.add(-5, 10), Some(5));
    }

    #[test]
    fn wrapping_counter_continues() {
        assert_eq!(PositionRange::Wrapping.distance(i32::MAX, i32::MIN), 1);
        assert_eq!(PositionRange::Wrapping.distance(i32::MIN, i32::MAX), -1);
        assert_eq!(PositionRange::Wrapping.add(i32::MAX, 1), Some(i32::MIN));
        assert_eq!(PositionRange::Wrapping.add(i32::MIN, -1), Some(i32::MAX));
    }

    #[test]
    fn modulo_counter_uses_the_shorter_distance() {
        assert_eq!(TURN.distance(3590, 10), 20);
        assert_eq!(TURN.distance(10, 3590), -20);
        assert_eq!(TURN.distance(0, 1799), 1799);
        assert_eq!(TURN.distance(0, 1800), -1800);
        assert_eq!(TURN.add(3590, 20), Some(10));
        assert_eq!(TURN.add(10, -20), Some(3590));
        assert!(TURN.contains(3599) && !TURN.contains(3600) && !TURN.contains(-1));
    }

    #[test]
    fn empty_modulo_range_does_not_divide_by_zero() {
        let range = PositionRange::Modulo { min: 5, max: -5 };
        assert_eq!(range.distance(1, 9), 0);
        assert_eq!(range.add(5, 7), Some(5));
    }

    fn any_range() -> impl Strategy<Value = PositionRange> {
        prop_oneof![
            Just(PositionRange::Linear),
            Just(PositionRange::Wrapping),
            (any::<i32>(), any::<i32>())
                .prop_map(|(a, b)| PositionRange::Modulo { min: a.min(b), max: a.max(b) }),
        ]
    }

    proptest! {
        #[test]
        fn adding_the_distance_reaches_the_target(range in any_range(), from: i32, to: i32) {
            prop_assume!(range.contains(from) && range.contains(to));
            let steps = range.distance(from, to);
            prop_assert_eq!(range.add(from, steps), Some(to));
        }

        #[test]
        fn adding_stays_in_the_range(range in any_range(), from: i32, steps: i64) {
            if let Some(to) = range.add(from, steps) {
                prop_assert!(range.contains(to) || !range.contains(from));
            }
        }
    }
}
