//! Counters of a Port, per slave and channel. They only grow, and wrap at 2^64.

use ecan_protocol::image::{ChannelState, ChannelStatus};
use ecan_protocol::mapping::CHANNELS;

/// Counters of one channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ChannelStatistics {
    /// Frames of RxPDO images that were published.
    pub frames_sent: u64,
    /// Frames of images whose delivery is confirmed.
    pub frames_delivered: u64,
    /// Frames of discarded images: by the application, after a lost session, or because their phase
    /// had passed.
    pub frames_discarded: u64,
    /// Frames taken out of TxPDO images.
    pub frames_received: u64,
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
pub struct SlaveStatistics {
    /// Cycles since the gateway was ready for the first time.
    pub cycles: u64,
    /// Those of them whose working counter was not complete.
    pub incomplete_cycles: u64,
    /// RxPDO images published with a new sequence.
    pub rxpdo_published: u64,
    /// Cycles in which an unconfirmed image was sent again.
    pub rxpdo_repeated: u64,
    /// RxPDO images with frames that were discarded.
    pub rxpdo_discarded: u64,
    /// TxPDO images with new content.
    pub txpdo_received: u64,
    /// Cycles without a new TxPDO image.
    pub txpdo_repeated: u64,
    /// TxPDO images that never arrived, by the gaps in the sequence.
    pub txpdo_lost: u64,
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
    /// Times that the gateway was lost while it was ready.
    pub sessions_lost: u64,
    /// Verifications that failed.
    pub verification_failures: u64,
    /// Per channel.
    pub channels: [ChannelStatistics; CHANNELS],
}

impl ChannelStatistics {
    /// Status of the channel in a new image.
    pub(crate) fn count_status(&mut self, status: ChannelStatus) {
        let is_bus_off = status.bus_off() || status.state() == ChannelState::BusOff;
        self.bus_off_images += u64::from(is_bus_off);
        let is_running = is_bus_off || status.state() == ChannelState::Run;
        self.not_running_images += u64::from(!is_running);
    }
}

impl SlaveStatistics {
    /// The packet codec has checked the channel number.
    pub(crate) fn channel(&mut self, channel: u8) -> &mut ChannelStatistics {
        &mut self.channels[usize::from(channel) % CHANNELS]
    }
}
