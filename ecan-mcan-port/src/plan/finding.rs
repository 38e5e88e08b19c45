//! Errors and warnings of a plan.

use ecan_host::{PlanError, PlanWarning};
use ecan_protocol::config::{ChannelWarning, DATA_PATH_BUDGET_MAX, DataPathConfig};
use ecan_protocol::mapping::{Direction, MAX_MULTIPLIER, MAX_PACKETS};
use thiserror::Error;

use crate::config::FD_MULTIPLIER;
use crate::schedule::margin::{NotSchedulable, RECOMMENDED_OFFSET_NS, ScheduleMargin};

fn us(ns: u64) -> f64 {
    ns as f64 / 1e3
}

/// Something that would not work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PortPlanError {
    /// On the EtherCAT side.
    #[error(transparent)]
    EtherCat(PlanError),
    /// Frames for a channel that is not there, or left out.
    #[error(
        "slave {slave} has no channel {channel} in use: enable it, or leave its frames out of the \
         plan"
    )]
    NoChannel {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
    },
    /// Frames to be sent on a channel that only receives.
    #[error(
        "slave {slave}, channel {channel} only receives: add it to the channel mask of the RxPDO \
         (0x8011:04), or leave the frames that it sends out of the plan"
    )]
    ReceiveOnly {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
    },
    /// CAN FD frames for a classic channel.
    #[error(
        "slave {slave}, channel {channel} is configured for classic CAN and cannot carry CAN FD \
         frames: give it a data bit rate"
    )]
    NotFd {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
    },
    /// The frames take more than the whole bus.
    #[error(
        "slave {slave}, channel {channel}: the frames take {} to {} % of the bus, depending on stuff \
         bits: send fewer or shorter ones, lengthen the cycle, raise the bit rate, or spread them \
         over channels",
        least_percent,
        most_percent
    )]
    BusLoad {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
        /// Percent without a stuff bit.
        least_percent: u32,
        /// Percent with as many as possible.
        most_percent: u32,
    },
    /// More frames in the long run than the gateway serves.
    #[error(
        "slave {slave}, channel {channel}: {received} received and {sent} sent frames per cycle \
         are expected, the gateway serves at most {DATA_PATH_BUDGET_MAX} of each (manual 13.2.2): \
         shorten the cycle, or spread them over channels"
    )]
    Budget {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
        /// Frames received per cycle, rounded up.
        received: u32,
        /// Frames sent per cycle, rounded up.
        sent: u32,
    },
    /// More in the long run than the images of a direction carry.
    #[error(
        "slave {slave}: {packets} packets of together {bytes} bytes per cycle do not fit its \
         {direction} image, which holds {area} bytes and {MAX_PACKETS} packets: {}, a shorter cycle, \
         or fewer frames", size(*needed)
    )]
    ImageTooSmall {
        /// Slave index.
        slave: usize,
        /// The direction.
        direction: Direction,
        /// Packets per cycle on the average, rounded up.
        packets: u64,
        /// Bytes per cycle on the average, rounded up.
        bytes: u64,
        /// Bytes of the frame area.
        area: u64,
        /// Smallest N that carries the frames of every cycle, if any does.
        needed: Option<u8>,
    },
    /// More in the long run than a channel's share of an image, by the budget policy.
    #[error(
        "slave {slave}, channel {channel}: {bytes} bytes per cycle do not fit the channel's share \
         of {share} bytes of the {direction} (manual 12): {}, or the budget policy SharedOnly",
        size(*needed)
    )]
    ShareTooSmall {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
        /// The direction.
        direction: Direction,
        /// Bytes per cycle on the average, rounded up.
        bytes: u64,
        /// Bytes of the share.
        share: u64,
        /// Smallest N that carries the frames of every cycle, if any does.
        needed: Option<u8>,
    },
    /// An offset that the Port would reject: no Sync0, beyond its period, or without margin where
    /// [`MarginCheck::Reject`](crate::MarginCheck::Reject) is chosen.
    #[error(
        "slave {slave}: frames cannot leave {:.1} us after Sync0: {reason}",
        us((*offset_ns).into())
    )]
    NotSchedulable {
        /// Slave index.
        slave: usize,
        /// Offset in nanoseconds.
        offset_ns: u32,
        /// Reason.
        reason: NotSchedulable,
    },
}

/// Something that works with little to spare.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PortWarning {
    /// On the EtherCAT side.
    #[error(transparent)]
    EtherCat(PlanWarning),
    /// Settings that lose frames, or may not match the bus.
    #[error(transparent)]
    Setting(SettingWarning),
    /// Frames arrive on a channel that only sends.
    #[error(
        "slave {slave}, channel {channel} only sends: frames from its bus do not reach the host. \
         Add it to the channel mask of the TxPDO (0x8010:04) to receive them"
    )]
    SendOnly {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
    },
    /// More than 70 % of the bus.
    #[error(
        "slave {slave}, channel {channel}: the frames take {least_percent} to {most_percent} % of \
         the bus: little is left for other frames and for repeats. Send fewer, lengthen the cycle, \
         or raise the bit rate"
    )]
    BusLoad {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
        /// Percent without a stuff bit.
        least_percent: u32,
        /// Percent with as many as possible.
        most_percent: u32,
    },
    /// The channel's budgets are set smaller than its traffic.
    #[error(
        "slave {slave}, channel {channel}: {received} received and {sent} sent frames per cycle, \
         but its budgets are {drain} and {serve} per service (0x802{}:05, :12): the gateway falls \
         behind and drops frames. Configure the channel for this traffic",
        channel + 1
    )]
    Budget {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
        /// Frames received per cycle, rounded up.
        received: u32,
        /// Frames sent per cycle, rounded up.
        sent: u32,
        /// Most frames that a service takes from the bus.
        drain: u8,
        /// Most frames that a service hands to the bus.
        serve: u8,
    },
    /// The fullest cycle exceeds an image.
    #[error(
        "slave {slave}: the fullest cycle has {packets} packets of together {bytes} bytes for its \
         {direction} image, which holds {area} bytes and {MAX_PACKETS} packets: frames wait for \
         the next one; {}, or spread the frames over cycles", size(*needed)
    )]
    ImagePeak {
        /// Slave index.
        slave: usize,
        /// The direction.
        direction: Direction,
        /// Packets in that cycle.
        packets: u64,
        /// Bytes in that cycle.
        bytes: u64,
        /// Bytes of the frame area.
        area: u64,
        /// Smallest N that carries them, if any does.
        needed: Option<u8>,
    },
    /// The fullest cycle exceeds a channel's share of an image, by the budget policy.
    #[error(
        "slave {slave}, channel {channel}: the fullest cycle has {bytes} bytes for the channel's \
         share of {share} bytes of the {direction} (manual 12): frames wait for the next image; {}, \
         or the budget policy SharedOnly", size(*needed)
    )]
    SharePeak {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
        /// The direction.
        direction: Direction,
        /// Bytes in that cycle.
        bytes: u64,
        /// Bytes of the share.
        share: u64,
        /// Smallest N that carries them, if any does.
        needed: Option<u8>,
    },
    /// A phase that is not surely reached, by the times of
    /// [`ScheduleConfig`](crate::ScheduleConfig).
    #[error(
        "slave {slave}: the margin of frames {:.1} us after Sync0 is short by {:.1} us: some may \
         be dropped, or leave a period late. Move the Sync0 shift away from the arrival of the \
         images, or enlarge the offset",
        us((*offset_ns).into()), us(*lacking_ns)
    )]
    NoMargin {
        /// Slave index.
        slave: usize,
        /// Offset in nanoseconds.
        offset_ns: u32,
        /// Missing margin, in nanoseconds.
        lacking_ns: u64,
    },
    /// A phase that is reached with little to spare.
    #[error(
        "slave {slave}: frames {:.1} us after Sync0 have little to spare, {margin}. Move the \
         Sync0 shift away from the arrival of the images, or enlarge the offset",
        us((*offset_ns).into())
    )]
    ThinMargin {
        /// Slave index.
        slave: usize,
        /// Offset in nanoseconds.
        offset_ns: u32,
        /// The margin.
        margin: ScheduleMargin,
    },
    /// An offset below what the manual recommends (13.8).
    #[error(
        "an offset of {:.1} us after Sync0 leaves the gateway little time; begin with {:.0} us \
         (manual 13.8)", us((*offset_ns).into()), us(RECOMMENDED_OFFSET_NS.into())
    )]
    SmallOffset {
        /// Offset in nanoseconds.
        offset_ns: u32,
    },
    /// More scheduled frames wait for one Sync0 pulse than a gateway holds.
    #[error(
        "slave {slave}: {frames} scheduled frames wait for one Sync0 pulse, a gateway holds about \
         {depth}: schedule fewer, or shorten the Sync0 period"
    )]
    ScheduleCrowded {
        /// Slave index.
        slave: usize,
        /// Frames of all cycles in a Sync0 period, on all channels.
        frames: u32,
        /// Assumed capacity of a gateway.
        depth: u32,
    },
    /// Scheduled frames are still on the bus when the next period begins.
    #[error(
        "slave {slave}, channel {channel}: the frames from {} us after Sync0 on take {} us of \
         the bus and run into the next period of {} us: use a smaller offset or fewer frames",
        offset_ns / 1000, frames_ns / 1000, sync0_ns / 1000
    )]
    ScheduleOverruns {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
        /// First offset of the channel, in nanoseconds.
        offset_ns: u32,
        /// Bus time of its scheduled frames, in nanoseconds.
        frames_ns: u64,
        /// Sync0 period, in nanoseconds.
        sync0_ns: u32,
    },
}

/// A warning about settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SettingWarning {
    /// Elements of the Message RAM that truncate CAN FD frames (manual 13.4).
    #[error(
        "slave {slave}, channel {channel}: {elements} hold {bytes} bytes of a frame; longer CAN FD \
         frames are truncated; raise `{}` in its table `ram`, or use the layout \"fd\"",
        .elements.key()
    )]
    ShortElements {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
        /// The elements.
        elements: Elements,
        /// Data bytes of one element.
        bytes: u8,
    },
    /// The largest frame of a channel does not fit its share of an image (manual 12).
    #[error(
        "slave {slave}, channel {channel}: the largest frame needs {frame_bytes} bytes of the \
         {direction}, the channel has {share_bytes}; such frames never pass; use a larger `n` or \
         the `budget` \"shared_only\""
    )]
    ShareBelowFrame {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
        /// Direction of the image.
        direction: Direction,
        /// Bytes of the frame in the frame area.
        frame_bytes: usize,
        /// Bytes of the frame area that the channel can use.
        share_bytes: usize,
    },
    /// The bit timing may not match the bus.
    #[error("slave {slave}, channel {channel}: {warning}")]
    BitTiming {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
        /// The part of the timing that may not match.
        warning: ChannelWarning,
    },
    /// An image below the size from which the manual begins with CAN FD (2).
    #[error(
        "slave {slave}: CAN FD with N = {multiplier} in the {direction}; the manual begins with \
         N = {FD_MULTIPLIER} (chapter 2): full frames of 64 bytes wait for later images"
    )]
    FdImageSize {
        /// Slave index.
        slave: usize,
        /// Direction of the image.
        direction: Direction,
        /// N.
        multiplier: u8,
    },
    /// Results of frames on a channel that only sends (manual 10).
    #[error(
        "slave {slave}, channel {channel} only sends: the gateway may report no TX_RESULT of it, \
         because the TxPDO does not carry the channel (ASSUMPTIONS.md, H45); scheduled frames without \
         a result count as unknown"
    )]
    ResultsOfSendOnly {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
    },
    /// Filters reject every frame.
    #[error(
        "slave {slave}, channel {channel}: no filter accepts a frame and those without a match are \
         rejected; the channel receives nothing; add a filter, or set `non_match_standard` or \
         `non_match_extended`"
    )]
    NothingReceived {
        /// Slave index.
        slave: usize,
        /// The channel.
        channel: u8,
    },
}

/// Elements of the Message RAM that hold frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Elements {
    /// RX FIFO0.
    RxFifo0,
    /// RX FIFO1.
    RxFifo1,
    /// Receive buffers.
    RxBuffers,
    /// Transmit FIFO, queue and buffers.
    Transmit,
}

impl Elements {
    /// The key with their size.
    fn key(self) -> &'static str {
        match self {
            Self::RxFifo0 => "rx_fifo0_data_bytes",
            Self::RxFifo1 => "rx_fifo1_data_bytes",
            Self::RxBuffers => "rx_buffer_data_bytes",
            Self::Transmit => "tx_data_bytes",
        }
    }
}

impl std::fmt::Display for Elements {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::RxFifo0 => "the elements of RX FIFO0",
            Self::RxFifo1 => "the elements of RX FIFO1",
            Self::RxBuffers => "the receive buffers",
            Self::Transmit => "the transmit elements",
        })
    }
}

/// The remedy of an image that is too small.
fn size(needed: Option<u8>) -> String {
    match needed {
        Some(multiplier) => format!("use N = {multiplier}"),
        None => format!("no N up to {MAX_MULTIPLIER} carries them: use several images"),
    }
}

/// Rejects what no budget could serve: more frames per cycle in the long run than 8 each way.
pub(crate) fn rejection(
    (slave, channel): (usize, u8),
    received: u32,
    sent: u32,
) -> Option<PortPlanError> {
    let most = u32::from(DATA_PATH_BUDGET_MAX);
    (received > most || sent > most).then_some(PortPlanError::Budget {
        slave,
        channel,
        received,
        sent,
    })
}

/// Warns of budgets that are set too small for the traffic, though larger ones would do.
pub(super) fn warning(
    (slave, channel): (usize, u8),
    received: u32,
    sent: u32,
    data_path: &DataPathConfig,
) -> Option<PortWarning> {
    let frames = |count: u32| u8::try_from(count).unwrap_or(u8::MAX);
    (!data_path.carries(frames(received), frames(sent))).then_some(PortWarning::Budget {
        slave,
        channel,
        received,
        sent,
        drain: data_path.rx_drain_max,
        serve: data_path.tx_budget_max,
    })
}
