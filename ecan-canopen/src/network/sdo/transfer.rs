//! The transfer under way: what it is about and how far it is.

use ecan_host::SdoDirection;
use ecan_protocol::object::AbortCode;

pub(super) const SEGMENT: usize = 7;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Phase {
    /// Request for an upload.
    Upload,
    /// Request for the next segment.
    UploadSegment { toggle: bool },
    /// Request for a download; with the data where they are short.
    Download,
    /// The next segment.
    DownloadSegment { toggle: bool },
    /// Request for a block upload.
    BlockUpload,
    /// Permission to send the first block.
    BlockUploadStart,
    /// Blocks come in; `last` segments of the block under way are here.
    BlockUploadSegments { last: u8, seen: bool },
    /// Acknowledgement of a block of which `received` segments are here.
    BlockUploadAck { received: u8, is_last: bool },
    /// All blocks are here, the server's closing frame is to come.
    BlockUploadEnd,
    /// Acknowledgement of the whole.
    BlockUploadEndAck,
    /// Request for a block download.
    BlockDownload,
    /// Segments of a block go out; `sent` are out.
    BlockDownloadSegments { sent: u8 },
    /// All blocks are out and acknowledged, the closing frame is next.
    BlockDownloadEnd,
}

/// Cause for which a transfer starts over or ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TransferFailure {
    Silence,
    /// An answer that the protocol does not allow here.
    Violation(AbortCode),
    Abort(AbortCode),
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
    /// When the answer to the frame sent last is overdue; `None` while a frame is to be sent.
    pub(super) deadline_ns: Option<u64>,
    /// Bytes that have been transferred; of block transfers, acknowledged blocks.
    pub(super) position: usize,
    /// Bytes in all, as far as known.
    pub(super) size: Option<usize>,
    pub(super) attempts: u8,
    /// A frame of it has been sent.
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

    /// `received` segments of the block of the present upload are here in order.
    pub(super) fn block_arrived(&mut self, received: u8, is_last: bool) {
        self.position += usize::from(received) * SEGMENT;
        self.go(Phase::BlockUploadAck { received, is_last });
    }

    pub(super) fn is_about(&self, index: u16, subindex: u8) -> bool {
        (self.index, self.subindex) == (index, subindex)
    }

    /// Returns whether a frame of the server may come now: one was asked for, or a block goes out.
    pub(super) fn expects_answer(&self) -> bool {
        self.deadline_ns.is_some() || matches!(self.phase, Phase::BlockDownloadSegments { .. })
    }

    /// Returns whether the request that opens a block transfer is unanswered.
    pub(super) fn is_opening_block(&self) -> bool {
        matches!(self.phase, Phase::BlockUpload | Phase::BlockDownload)
    }
}
