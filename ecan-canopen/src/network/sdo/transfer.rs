//! State of the running transfer.

use ecan_host::SdoDirection;
use ecan_protocol::object::AbortCode;

pub(super) const SEGMENT: usize = 7;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Phase {
    /// Request for an upload.
    Upload,
    /// Request for the next segment.
    UploadSegment { toggle: bool },
    /// Request for a download, with the value if it is short.
    Download,
    /// The next segment.
    DownloadSegment { toggle: bool },
    /// Request for a block upload.
    BlockUpload,
    /// Permission to send the first block.
    BlockUploadStart,
    /// Segments of a block arrive; `last` is the last one received in order, 0 for none.
    BlockUploadSegments { last: u8, has_segment: bool },
    /// Acknowledgement of a block of which `received` segments arrived in order.
    BlockUploadAck { received: u8, is_last: bool },
    /// All blocks arrived; the server's closing frame is due.
    BlockUploadEnd,
    /// Acknowledgement of the closing frame.
    BlockUploadEndAck,
    /// Request for a block download.
    BlockDownload,
    /// Segments of a block are sent; `sent` is their number so far.
    BlockDownloadSegments { sent: u8 },
    /// Closing frame, after all blocks were acknowledged.
    BlockDownloadEnd,
}

/// Cause for which a transfer starts over or ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TransferFailure {
    /// No answer in time.
    Timeout,
    /// An answer that the protocol does not allow here.
    Violation(AbortCode),
    /// The server aborted.
    Abort(AbortCode),
    /// The value does not fit the buffer.
    TooLong,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Transfer {
    pub(super) direction: SdoDirection,
    pub(super) index: u16,
    pub(super) subindex: u8,
    /// True if block transfer is tried.
    pub(super) block: bool,
    pub(super) phase: Phase,
    /// Time after which the answer to the last frame is overdue; `None` while a frame is to be sent.
    pub(super) deadline_ns: Option<u64>,
    /// Transferred bytes; in block transfers, those of acknowledged blocks.
    pub(super) position: usize,
    /// Length of the value in bytes, if known.
    pub(super) size: Option<usize>,
    pub(super) attempts: u8,
    /// A frame of the transfer was sent.
    pub(super) is_known_to_node: bool,
    pub(super) block_size: u8,
    /// True if both sides check the CRC.
    pub(super) crc: bool,
    /// Blocks in a row without progress.
    pub(super) stalls: u8,
}

impl Transfer {
    pub(super) fn new(
        direction: SdoDirection,
        (index, subindex): (u16, u8),
        size: Option<usize>,
        block: bool,
    ) -> Self {
        let mut transfer = Self {
            direction,
            index,
            subindex,
            block,
            phase: Phase::Upload,
            deadline_ns: None,
            position: 0,
            size,
            attempts: 0,
            is_known_to_node: false,
            block_size: 1,
            crc: false,
            stalls: 0,
        };
        transfer.begin();
        transfer
    }

    pub(super) fn begin(&mut self) {
        self.phase = match (self.direction, self.block) {
            (SdoDirection::Upload, false) => Phase::Upload,
            (SdoDirection::Upload, true) => Phase::BlockUpload,
            (SdoDirection::Download, false) => Phase::Download,
            (SdoDirection::Download, true) => Phase::BlockDownload,
        };
        if self.direction == SdoDirection::Upload {
            self.size = None;
        }
        self.deadline_ns = None;
        self.is_known_to_node = false;
        self.position = 0;
        self.block_size = 1;
        self.crc = false;
        self.stalls = 0;
    }

    pub(super) fn go(&mut self, phase: Phase) {
        self.phase = phase;
        self.deadline_ns = None;
    }

    /// A block ended, of which `received` segments arrived in order.
    pub(super) fn block_arrived(&mut self, received: u8, is_last: bool) {
        self.position += usize::from(received) * SEGMENT;
        self.go(Phase::BlockUploadAck { received, is_last });
    }

    pub(super) fn is_about(&self, index: u16, subindex: u8) -> bool {
        (self.index, self.subindex) == (index, subindex)
    }

    /// Returns whether a frame of the server is due: after a request, or while a block is sent.
    pub(super) fn expects_answer(&self) -> bool {
        self.deadline_ns.is_some() || matches!(self.phase, Phase::BlockDownloadSegments { .. })
    }

    /// Returns whether the request that opens a block transfer is unanswered.
    pub(super) fn is_opening_block(&self) -> bool {
        matches!(self.phase, Phase::BlockUpload | Phase::BlockDownload)
    }
}
