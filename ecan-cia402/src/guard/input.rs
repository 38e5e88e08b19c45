//! Input of the motion guard in one cycle.

use ecan_canopen::DriveState;

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
