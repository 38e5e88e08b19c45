//! What really happened inside a gateway, beside what its own diagnostics admit.

/// Why frames from RxPDO images never reached the CAN bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TransmitLosses {
    /// The channel could not send: not applied, listening, or FD frame on a classic channel.
    pub invalid_channel: u64,
    /// The channel was bus-off.
    pub bus_off: u64,
    /// The TX ring was full and the overflow policy refused the new frame.
    pub ring_full: u64,
    /// A queued frame gave way to a newer one, or went stale by bus-off, restart or leaving OP.
    pub stale: u64,
    /// Scheduled frame whose target phase had passed.
    pub late: u64,
    /// Scheduled frame that found the schedule queue full.
    pub schedule_full: u64,
    /// Scheduled frame that the controller refused at its phase, or whose Sync0 went away.
    pub schedule_failed: u64,
    /// Skipped by a bypass option or a test policy of 0x8030.
    pub bypassed: u64,
    /// Given up by the controller because automatic retransmission is off.
    pub not_retransmitted: u64,
}

/// Why frames from the CAN bus never reached a TxPDO image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReceiveLosses {
    /// Rejected by a filter, a non-match rule or a remote rule.
    pub filtered: u64,
    /// The controller's FIFO or buffer was full.
    pub controller_full: u64,
    /// Dropped by the overflow policy of the RX cache.
    pub cache_full: u64,
    /// Too big for the channel's share of any image.
    pub oversized: u64,
    /// Channel outside the TxPDO channel mask.
    pub masked: u64,
    /// Flushed by a restart of the channel or by power loss.
    pub flushed: u64,
}

/// Counters of what really happened in a gateway since it was made; they survive power
/// cycles and every clear command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GatewayCounters {
    /// Complete SM2 writes accepted from the master.
    pub images_written: u64,
    /// SM2 writes refused because the buffer was still full.
    pub writes_rejected: u64,
    /// Images parsed without fault.
    pub images_parsed: u64,
    /// Images whose sequence was that of the image before.
    pub images_repeated: u64,
    /// Images with a fault anywhere.
    pub images_faulty: u64,
    /// Frames found in RxPDO images (good ones).
    pub frames_parsed: u64,
    /// Frames handed to a CAN controller.
    pub frames_to_controller: u64,
    /// Frames that went out on a bus.
    pub frames_on_bus: u64,
    /// Frames accepted into the schedule queue.
    pub frames_scheduled: u64,
    /// Scheduled frames released at their phase.
    pub frames_released: u64,
    /// Frames lost on the way out.
    pub transmit_losses: TransmitLosses,
    /// Frames that controllers took from their buses.
    pub frames_from_bus: u64,
    /// Frames packed into TxPDO images.
    pub frames_to_master: u64,
    /// Frames lost on the way in.
    pub receive_losses: ReceiveLosses,
    /// TX_RESULT packets packed into TxPDO images.
    pub results_to_master: u64,
    /// TX_RESULT packets lost because too many were waiting.
    pub results_lost: u64,
    /// TxPDO images published in SM3.
    pub images_published: u64,
    /// TxPDO images that the master has read.
    pub images_read: u64,
    /// SM3 reads refused because the buffer was empty.
    pub reads_rejected: u64,
    /// Data-path services run.
    pub services: u64,
    /// Drops out of OP that the gateway itself decided.
    pub al_errors: u64,
}
