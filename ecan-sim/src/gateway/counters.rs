/// Frames from RxPDO images that never reached the CAN bus, by cause.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TransmitLosses {
    /// The channel could not send: not applied, listening, or FD frame on a classic channel.
    pub invalid_channel: u64,
    /// The channel was bus-off.
    pub bus_off: u64,
    /// The TX ring was full and the overflow policy rejected the new frame.
    pub ring_full: u64,
    /// A queued frame was replaced by a newer one, or became stale by bus-off, restart or leaving
    /// OP.
    pub stale: u64,
    /// Scheduled frame whose phase had passed.
    pub late: u64,
    /// Scheduled frame for a full schedule queue.
    pub schedule_full: u64,
    /// Scheduled frame that the controller rejected at its phase, or whose Sync0 stopped.
    pub schedule_failed: u64,
    /// Skipped by a bypass option or a test policy of 0x8030.
    pub bypassed: u64,
    /// Beyond the budget of the channel in the image, if the variant applies it.
    pub over_budget: u64,
    /// Abandoned by the controller because automatic retransmission is off.
    pub not_retransmitted: u64,
}

/// Frames from the CAN bus that never reached a TxPDO image, by cause.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReceiveLosses {
    /// Rejected by a filter, a non-match rule or a remote rule.
    pub filtered: u64,
    /// The controller's FIFO or buffer was full.
    pub controller_full: u64,
    /// Dropped by the overflow policy of the RX cache.
    pub cache_full: u64,
    /// Too large for the channel's share of any image.
    pub oversized: u64,
    /// Channel outside the TxPDO channel mask.
    pub masked: u64,
    /// Flushed by a restart of the channel or by power loss.
    pub flushed: u64,
}

/// Counters of a gateway since its creation; they survive power cycles and every clear command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GatewayCounters {
    /// Complete SM2 writes accepted from the master.
    pub images_written: u64,
    /// Images among them that arrived within the window around a Sync0 pulse
    /// ([`Sync0Window`](crate::Sync0Window)): the firmware read them only after the next write was
    /// rejected.
    pub outputs_missed: u64,
    /// SM2 writes rejected, for example because the buffer was full.
    pub writes_rejected: u64,
    /// Images parsed without error.
    pub images_parsed: u64,
    /// Repeated images.
    pub images_repeated: u64,
    /// Invalid images.
    pub images_faulty: u64,
    /// Valid frames in RxPDO images.
    pub frames_parsed: u64,
    /// Frames handed to a CAN controller.
    pub frames_to_controller: u64,
    /// Frames sent on a bus.
    pub frames_on_bus: u64,
    /// Frames accepted into the schedule queue.
    pub frames_scheduled: u64,
    /// Scheduled frames released at their phase.
    pub frames_released: u64,
    /// Frames lost towards the bus.
    pub transmit_losses: TransmitLosses,
    /// Frames received by the controllers.
    pub frames_from_bus: u64,
    /// Frames packed into TxPDO images.
    pub frames_to_master: u64,
    /// Frames lost towards the master.
    pub receive_losses: ReceiveLosses,
    /// TX_RESULT packets packed into TxPDO images.
    pub results_to_master: u64,
    /// TX_RESULT packets lost in a full queue.
    pub results_lost: u64,
    /// TxPDO images published in SM3.
    pub images_published: u64,
    /// TxPDO images that the master has read.
    pub images_read: u64,
    /// SM3 reads rejected, for example because the buffer was empty.
    pub reads_rejected: u64,
    /// Data-path services run.
    pub services: u64,
    /// Transitions out of OP by the gateway itself.
    pub al_errors: u64,
}
