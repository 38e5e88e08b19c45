//! Counters of a Port, per slave and channel. They only grow, except `frames_pending`, and wrap at
//! 2^64.
//!
//! # Accounts
//!
//! Each accepted frame is in exactly one of these columns of its channel:
//!
//! ```text
//! frames_accepted = frames_delivered + frames_lost + frames_discarded + frames_unknown + frames_pending
//! ```
//!
//! A complete working counter shows that the slave controller took an image, not that the gateway
//! parsed it: in SAFEOP it discards its images. Delivered frames therefore stay pending until a
//! transmit result (manual 10) of their image or a later one arrives, or until the gateway is found
//! in OP after it took the following image: the Port reads the register AL status every 10 ms. If
//! the session is lost before, they are unknown, as are the frames of an image whose delivery
//! is not known.
//!
//! The TxPDO header numbers the images (manual 6), so that those of the receive path are counted from
//! the first time that a gateway is ready:
//!
//! ```text
//! images read from the gateway = txpdo_received + txpdo_lost + txpdo_discarded + at most txpdo_unknown
//! ```
//!
//! The frames that the gateway put into images are `frames_received + frames_not_taken`, and those of
//! the images of `txpdo_lost` and `txpdo_unknown`. Their number cannot be known: the gateway counts
//! frames that it drops before it packs them (0x9000:13, 0x9020:05), but not those that it packs.

use ecan_protocol::image::{ChannelState, ChannelStatus};
use ecan_protocol::mapping::CHANNELS;

/// Counters of one channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ChannelStatistics {
    /// Frames that a send accepted.
    pub frames_accepted: u64,
    /// Frames of RxPDO images that were published.
    pub frames_sent: u64,
    /// Frames of images that the slave controller took, by the working counter: of those that are
    /// delivered, pending or unknown.
    pub frames_confirmed: u64,
    /// Frames that the gateway took in OP. It may have dropped some of them afterwards, see
    /// `results_failed`.
    pub frames_delivered: u64,
    /// Frames of published images that the gateway certainly did not take.
    pub frames_lost: u64,
    /// Frames that never left the host: discarded by the application or after a lost session, or
    /// withdrawn because their phase had passed.
    pub frames_discarded: u64,
    /// Frames that the gateway may have taken: of images whose delivery is not known, or that it may
    /// have taken outside OP.
    pub frames_unknown: u64,
    /// Frames without a known result so far; not a counter.
    pub frames_pending: u64,
    /// Frames taken out of TxPDO images.
    pub frames_received: u64,
    /// Frames that arrived and that the application did not take: left in their cycle, or while the
    /// gateway was not ready.
    pub frames_not_taken: u64,
    /// Frames rejected because the image was full.
    pub rejected_image_full: u64,
    /// Frames rejected because the gateway's transmit queue might not hold them.
    pub rejected_queue_full: u64,
    /// Frames rejected because the channel is bus-off.
    pub rejected_bus_off: u64,
    /// Transmit results that reported success: code 0 or 1 (manual 10).
    pub results_ok: u64,
    /// Transmit results that reported a failure. Results that no part of the application took are
    /// counted, too.
    pub results_failed: u64,
    /// TxPDO images that reported the channel as bus-off.
    pub bus_off_images: u64,
    /// TxPDO images that reported the channel as not running, without bus-off.
    pub not_running_images: u64,
}

/// Counters of one gateway.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SlaveStatistics {
    /// Cycles since the gateway was ready for the first time.
    pub cycles: u64,
    /// Those of them whose working counter was not complete.
    pub incomplete_cycles: u64,
    /// RxPDO images published with a new sequence.
    pub rxpdo_published: u64,
    /// Cycles in which an unconfirmed image was sent again.
    pub rxpdo_repeated: u64,
    /// RxPDO images with frames that were withdrawn before their delivery was confirmed.
    pub rxpdo_discarded: u64,
    /// TxPDO images with new content.
    pub txpdo_received: u64,
    /// Cycles without a new TxPDO image.
    pub txpdo_repeated: u64,
    /// TxPDO images that did not arrive, or damaged, by the gaps in the sequence.
    pub txpdo_lost: u64,
    /// TxPDO images that arrived while the gateway was not ready. Their frames are not handed out
    /// and count as `frames_not_taken`.
    pub txpdo_discarded: u64,
    /// Most TxPDO images that can have been lost in outages after which the gateway started its
    /// sequence again.
    pub txpdo_unknown: u64,
    /// TxPDO images that were being written while they were read.
    pub txpdo_torn: u64,
    /// TxPDO images that the gateway marked as incomplete: frames were left out or lost.
    pub txpdo_incomplete: u64,
    /// TxPDO images with another layout than the configured one.
    pub txpdo_layout_changes: u64,
    /// TxPDO images or packets with a fault: bad CRC, bad header, bad packet.
    pub parse_errors: u64,
    /// Transmit results that match no send.
    pub unmatched_results: u64,
    /// Times that the gateway became ready.
    pub sessions: u64,
    /// Times that the gateway was lost while it was ready; a loss during its verification is none.
    pub sessions_lost: u64,
    /// Verifications that failed.
    pub verification_failures: u64,
    /// Requests of another startup because the gateway stayed in one state below OP.
    pub startup_requests: u64,
    /// Per channel.
    pub channels: [ChannelStatistics; CHANNELS],
}

impl ChannelStatistics {
    /// Status of the channel in a new image; returns whether it is counted.
    pub(crate) fn count_status(&mut self, status: ChannelStatus) -> bool {
        let is_bus_off = status.bus_off() || status.state() == ChannelState::BusOff;
        self.bus_off_images += u64::from(is_bus_off);
        let is_running = is_bus_off || status.state() == ChannelState::Run;
        self.not_running_images += u64::from(!is_running);
        is_bus_off || !is_running
    }
}

impl SlaveStatistics {
    /// The packet codec has checked the channel number.
    pub(crate) fn channel(&mut self, channel: u8) -> &mut ChannelStatistics {
        &mut self.channels[usize::from(channel) % CHANNELS]
    }
}
