//! What a cycle tells the motion guard about an axis.

use std::fmt;

use ecan_canopen::DriveState;

/// The actual position of an axis in one cycle, and how much it is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Actual {
    /// From a TPDO of this cycle's image, and nothing newer can be anywhere on the way: the image
    /// is new, whole and of the configured layout, the gateway has no received frame of the channel
    /// left, the working counter is complete, and all that was so in the two cycles before, too. (An
    /// image waits in the gateway until it is fetched, a TPDO that stayed behind comes with a later
    /// one, and while an image is repeated no new SYNC asks for a TPDO.)
    Fresh(i32),
    /// From a TPDO of this cycle's image, but something newer may be on the way. Good enough to see
    /// that the axis lives and where it roughly is, never good enough to begin at.
    Late(i32),
    /// No usable position in this cycle.
    None(PositionUnavailable),
}

/// Why a cycle brought no usable actual position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PositionUnavailable {
    /// No new image came from the gateway.
    NoImage,
    /// The image is damaged, or was being written while it was read.
    Damaged,
    /// The gateway marked the image as truncated or overflowed (manual 6.1): newer frames stayed
    /// behind or were lost.
    Incomplete,
    /// The image has another layout than the configured one.
    Layout,
    /// So many received frames wait in the gateway that its count is at its end, or it reports
    /// receive pressure: what came is of unknown age.
    Backlog,
    /// The image is good, and has no TPDO of this axis.
    NoTpdo,
}

impl fmt::Display for PositionUnavailable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NoImage => "no new image from the gateway",
            Self::Damaged => "the gateway's image is damaged",
            Self::Incomplete => "the gateway's image is incomplete",
            Self::Layout => "the gateway's image has another layout",
            Self::Backlog => "received frames pile up in the gateway",
            Self::NoTpdo => "no TPDO in the image",
        })
    }
}

/// The channel's status word of a cycle (manual 7).
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
        /// Frames that wait to be sent, 0 to 7; 7 stands for 7 or more.
        pending: u8,
        /// The transmit queue is congested.
        pressure: bool,
    },
}

/// The way to the drive in one cycle: gateway, image and channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PathStatus {
    /// The gateway is in service, and was without a break since the last cycle.
    pub in_service: bool,
    /// The working counter says that both directions were exchanged.
    pub complete: bool,
    /// The last RxPDO image may not have arrived and is published again; what is sent now waits.
    pub holding: bool,
    /// Frames for the gateway were given up since the last cycle, by whomever.
    pub discarded: bool,
    /// The gateway's transmit queue of the channel refused a frame since the last cycle, of this
    /// axis or of another sender on the channel.
    pub queue_refused: bool,
    /// The RxPDO image had no room for a frame of the channel in the last cycle. It may have been the
    /// SYNC of targets that went out.
    pub image_full: bool,
    /// The gateway reported for a target of this axis that it was not sent (manual 10).
    pub target_lost: bool,
    /// The channel.
    pub channel: ChannelView,
    /// Frames of the channel in images that the gateway took, counted from any start.
    pub delivered: u64,
    /// The part of `delivered` that the channel's status covers for sure: what was delivered two
    /// new images ago.
    pub covered: u64,
}

/// The drive in one cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DriveView {
    /// State by the last statusword, however old; `None` while none was ever seen.
    pub state: Option<DriveState>,
    /// A heartbeat is watched and has timed out.
    pub heartbeat_lost: bool,
    /// The node is known to be in another NMT state than Operational, or restarted since the
    /// last cycle.
    pub not_operational: bool,
    /// The drive was out of sight, and may have restarted meanwhile; that it still has its
    /// configuration is not proven yet.
    pub unverified: bool,
    /// The drive says that it follows the target (statusword bit 12 in the cyclic modes).
    pub follows: bool,
    /// The drive reports a following error (statusword bit 13 in the cyclic position mode).
    pub following_error: bool,
}

/// Everything that a cycle tells the guard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GuardInput {
    /// The way to the drive.
    pub way: PathStatus,
    /// The drive.
    pub drive: DriveView,
    /// Its actual position.
    pub actual: Actual,
}

/// Why an axis gets no targets any more and must be taken up again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum HoldReason {
    /// The gateway went out of service.
    GatewayLost,
    /// Frames that were under way to the gateway were given up, and a target may be among them.
    FramesDiscarded,
    /// The working counter was not complete in more cycles in a row than the axis allows.
    WorkingCounter,
    /// The channel went bus-off.
    BusOff,
    /// The channel left the bus without being bus-off.
    ChannelStopped,
    /// The gateway's transmit queue was full.
    QueueFull,
    /// The gateway reported a target as not sent.
    TargetLost,
    /// The drive's heartbeat stayed away.
    HeartbeatLost,
    /// The drive left the NMT state Operational, or restarted.
    NotOperational,
    /// The drive was out of sight, and its configuration is not verified again yet.
    Unverified,
    /// No usable TPDO came for more cycles in a row than the axis allows.
    TpdoLost(PositionUnavailable),
    /// The drive left Operation Enabled.
    LeftOperationEnabled(DriveState),
    /// The drive stopped following its target while it was enabled.
    NotFollowing,
    /// The drive reports a following error.
    FollowingError,
    /// The axis moved while it was to be taken up.
    Moving,
    /// The application asked for it.
    Commanded,
}

impl HoldReason {
    /// Whether the reason lies on the path to the drive, not in the drive or in a command.
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

impl fmt::Display for HoldReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::GatewayLost => "the gateway went out of service",
            Self::FramesDiscarded => "frames under way were discarded",
            Self::WorkingCounter => "the working counter stayed incomplete",
            Self::BusOff => "the channel went bus-off",
            Self::ChannelStopped => "the channel left the bus",
            Self::QueueFull => "the gateway's transmit queue was full",
            Self::TargetLost => "the gateway reported a target as not sent",
            Self::HeartbeatLost => "the drive's heartbeat stayed away",
            Self::NotOperational => "the drive is not Operational",
            Self::Unverified => "the drive's configuration is being verified",
            Self::TpdoLost(why) => return write!(f, "TPDO missing: {why}"),
            Self::LeftOperationEnabled(state) => {
                return write!(f, "the drive left Operation Enabled and is in {state}");
            }
            Self::NotFollowing => "the drive stopped following its target",
            Self::FollowingError => "the drive reports a following error",
            Self::Moving => "the axis moves",
            Self::Commanded => "commanded",
        })
    }
}
