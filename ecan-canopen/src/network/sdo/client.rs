//! The state machine of an SDO client: frames and time in, frames and results out. Its transfers, and the turns of
//! the parts of an application that share one client.

use std::fmt;

use ecan_host::SdoDirection;
use ecan_protocol::object::AbortCode;

use crate::network::config::SdoConfig;
use crate::network::error::{SdoFault, SdoStartError, SdoStray};
use crate::network::producers::nanoseconds;
use crate::{MAX_BLOCK_SIZE, object};

/// Bytes after the longest value, for the padding of the last segment of a block.
const PADDING: usize = 7;

/// State of a node's SDO client.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Sdo {
    /// No transfer was started yet.
    #[default]
    Idle,
    /// A transfer is running.
    Busy,
    /// The last transfer succeeded.
    Done {
        /// Bytes of the value.
        len: usize,
    },
    /// The last transfer failed.
    Failed(SdoFault),
}

impl fmt::Display for Sdo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Idle => f.write_str("idle"),
            Self::Busy => f.write_str("busy"),
            Self::Done { len } => write!(f, "done, {len} bytes"),
            Self::Failed(fault) => write!(f, "failed: {fault}"),
        }
    }
}

/// SDO client of one node, without a bus: its owner transports its frames.
///
/// ```text
/// start_upload, start_download     begin a transfer
/// frame                            the frame to send next, if any
/// sent                             it was sent: the time for the answer runs
/// receive                          the server sent a frame
/// tick                             time passed
/// state, data                      state of the transfer, and the value
/// ```
///
/// A frame that finds no space stays the next frame; the owner retries in a later cycle. After a missing or
/// damaged answer the client sends an abort and starts the transfer over, at most [`SdoConfig::retries`] times.
/// It ignores answers about another object, and segments of an earlier attempt. It cannot distinguish the answer to
/// an earlier request for the same object: after a timeout a value may be as old as all attempts together. Do not
/// transfer values by SDO that must be recent.
///
/// A value is complete or the transfer fails: the client compares the received bytes with the announced size and the
/// CRC, if the server sends them. Real-time safe; only [`new`](Self::new) allocates memory.
#[derive(Debug)]
pub struct SdoClient {
    pub(super) buffer: Box<[u8]>,
    pub(super) transfer: Option<Transfer>,
    config: SdoConfig,
    outcome: Sdo,
    /// Direction and object of the outcome.
    subject: (SdoDirection, u16, u8),
    /// Abort to send before any other frame.
    pub(super) abort: Option<[u8; 8]>,
    /// The server has rejected block transfer, for uploads and for downloads.
    rejects_block: (bool, bool),
    generation: u64,
    strays: u64,
    /// The last one since the transfer began.
    last_stray: Option<SdoStray>,
    silences: u64,
}

impl SdoClient {
    /// Creates a client for one server. Allocates the buffer for the value.
    pub fn new(config: SdoConfig) -> Self {
        let length = config.buffer_bytes.saturating_add(PADDING);
        Self {
            buffer: vec![0; length].into_boxed_slice(),
            transfer: None,
            config,
            outcome: Sdo::Idle,
            subject: (SdoDirection::Upload, 0, 0),
            abort: None,
            rejects_block: (false, false),
            generation: 0,
            strays: 0,
            last_stray: None,
            silences: 0,
        }
    }

    /// Length of the longest value in bytes.
    pub fn capacity(&self) -> usize {
        self.buffer.len() - PADDING
    }

    /// State of the last transfer.
    pub fn state(&self) -> Sdo {
        if self.transfer.is_some() { Sdo::Busy } else { self.outcome }
    }

    /// Value of the last successful transfer; empty in every other state.
    pub fn data(&self) -> &[u8] {
        match self.state() {
            Sdo::Done { len } => self.buffer.get(..len).unwrap_or_default(),
            _ => &[],
        }
    }

    /// Direction, index and subindex of the last transfer.
    pub fn subject(&self) -> (SdoDirection, u16, u8) {
        self.subject
    }

    /// Number of the last transfer started, from 1.
    pub fn generation(&self) -> u64 {
        self.generation
    }

    /// Number of frames of the server that fitted no transfer.
    pub fn strays(&self) -> u64 {
        self.strays
    }

    /// Number of timeouts, including those after which a repetition succeeded.
    pub fn silences(&self) -> u64 {
        self.silences
    }

    /// Starts to upload an object, by block transfer if [`BlockTransferConfig::upload`](crate::BlockTransferConfig) is set.
    ///
    /// # Errors
    /// [`SdoStartError::Busy`].
    pub fn start_upload(&mut self, index: u16, subindex: u8) -> Result<(), SdoStartError> {
        let block = self.config.block.upload && !self.rejects_block.0;
        self.start(Transfer::new(SdoDirection::Upload, (index, subindex), None, block))
    }

    /// Starts to upload an object by block transfer, independently of the configuration. If the server rejects it, the
    /// client requests a segmented transfer.
    ///
    /// # Errors
    /// [`SdoStartError::Busy`].
    pub fn start_block_upload(&mut self, index: u16, subindex: u8) -> Result<(), SdoStartError> {
        self.start(Transfer::new(SdoDirection::Upload, (index, subindex), None, true))
    }

    /// Starts to download a value to an object. The bytes are copied.
    ///
    /// # Errors
    /// [`SdoStartError::Busy`], or [`SdoStartError::TooLong`].
    pub fn start_download(
        &mut self,
        index: u16,
        subindex: u8,
        data: &[u8],
    ) -> Result<(), SdoStartError> {
        if self.transfer.is_some() {
            return Err(SdoStartError::Busy);
        }
        let (length, capacity) = (data.len(), self.capacity());
        if length > capacity || u32::try_from(length).is_err() {
            return Err(SdoStartError::TooLong { length, capacity });
        }
        for (to, from) in self.buffer.iter_mut().zip(data) {
            *to = *from;
        }
        let from = self.config.block.download_from;
        let block =
            length > 4 && !self.rejects_block.1 && from.is_some_and(|least| length >= least);
        let subject = (index, subindex);
        self.start(Transfer::new(SdoDirection::Download, subject, Some(length), block))
    }

    fn start(&mut self, mut transfer: Transfer) -> Result<(), SdoStartError> {
        if self.transfer.is_some() {
            return Err(SdoStartError::Busy);
        }
        transfer.attempts = 1;
        self.subject = (transfer.direction, transfer.index, transfer.subindex);
        self.transfer = Some(transfer);
        self.last_stray = None;
        self.generation += 1;
        Ok(())
    }

    /// Cancels the running transfer and sends the server an abort.
    pub fn cancel(&mut self) {
        self.queue_abort(AbortCode::GENERAL);
        self.fail(SdoFault::Cancelled);
    }

    /// Ends the running transfer without an abort, if the server no longer has it.
    pub fn drop_transfer(&mut self, fault: SdoFault) {
        self.abort = None;
        self.fail(fault);
    }

    /// Returns whether a frame of the running transfer was sent.
    pub fn is_known_to_node(&self) -> bool {
        self.transfer.is_some_and(|transfer| transfer.is_known_to_node)
    }

    /// Checks the waiting time: an overdue answer counts as lost.
    pub fn tick(&mut self, now_ns: u64) {
        let Some(transfer) = &mut self.transfer else { return };
        if transfer.deadline_ns.is_none_or(|deadline| now_ns <= deadline) {
            return;
        }
        self.silences += 1;
        if let Phase::BlockUploadSegments { last, has_segment: true } = transfer.phase
            && transfer.stalls < self.config.retries
            && (transfer.crc || transfer.size.is_some())
        {
            // The end of a block was lost: the server repeats the segments that are not acknowledged. If it was
            // only late, segments arrive twice, which the CRC or the size reveals.
            transfer.stalls = transfer.stalls.saturating_add(1);
            transfer.block_arrived(last, false);
            return;
        }
        self.handle_failure(TransferFailure::Timeout);
    }

    /// Starts the transfer over, or ends it.
    pub(super) fn handle_failure(&mut self, failure: TransferFailure) {
        let Some(transfer) = &mut self.transfer else { return };
        let opening_block = transfer.is_opening_block();
        let attempts = transfer.attempts;
        let has_attempts = attempts <= self.config.retries && attempts < u8::MAX;
        let (code, fault, again) = match failure {
            TransferFailure::Abort(code) if opening_block && is_block_rejection(code) => {
                let for_good = matches!(code, AbortCode::COMMAND | AbortCode::UNSUPPORTED_ACCESS);
                match transfer.direction {
                    SdoDirection::Upload => self.rejects_block.0 |= for_good,
                    SdoDirection::Download => self.rejects_block.1 |= for_good,
                }
                transfer.block = false;
                transfer.begin();
                return;
            }
            TransferFailure::Abort(code) => {
                (None, SdoFault::Aborted(code), has_attempts && is_transmission_fault(code))
            }
            TransferFailure::Timeout => {
                let fault = SdoFault::TimedOut { attempts, stray: self.last_stray };
                (Some(AbortCode::TIMEOUT), fault, has_attempts)
            }
            TransferFailure::Violation(code) => {
                (Some(code), SdoFault::Violated(code), has_attempts)
            }
            TransferFailure::Endless => {
                let bytes = transfer.position;
                (Some(AbortCode::GENERAL), SdoFault::Endless { bytes }, false)
            }
            TransferFailure::TooLong => {
                let capacity = self.buffer.len() - PADDING;
                (Some(AbortCode::OUT_OF_MEMORY), SdoFault::TooLong { capacity }, false)
            }
        };
        if again {
            // A server without block transfer may not respond at all.
            transfer.block &= !opening_block;
            transfer.attempts += 1;
            let mut restarted = *transfer;
            restarted.begin();
            if let Some(code) = code {
                self.queue_abort(code);
            }
            self.transfer = Some(restarted);
        } else {
            if let Some(code) = code {
                self.queue_abort(code);
            }
            self.fail(fault);
        }
    }

    fn fail(&mut self, fault: SdoFault) {
        if self.transfer.take().is_some() {
            self.outcome = Sdo::Failed(fault);
        }
    }

    pub(super) fn succeed(&mut self, len: usize) {
        if self.transfer.take().is_some() {
            self.outcome = Sdo::Done { len };
        }
    }

    pub(super) fn stray(&mut self, stray: SdoStray) {
        self.strays += 1;
        self.last_stray = Some(stray);
    }

    pub(super) fn block_size(&self) -> u8 {
        self.config.block.segments.clamp(1, MAX_BLOCK_SIZE)
    }

    pub(super) fn retries(&self) -> u8 {
        self.config.retries
    }

    pub(super) fn deadline(&self, now_ns: u64) -> u64 {
        let SdoConfig { timeout, storage_timeout, .. } = self.config;
        let is_storage = self.transfer.is_some_and(|transfer| {
            transfer.direction == SdoDirection::Download
                && matches!(transfer.index, object::STORE_PARAMETERS | object::RESTORE_PARAMETERS)
        });
        let wait = if is_storage { timeout.max(storage_timeout) } else { timeout };
        now_ns.saturating_add(nanoseconds(wait))
    }
}

/// Codes with which servers reject block transfer; they may support segmented transfer.
fn is_block_rejection(code: AbortCode) -> bool {
    const INVALID_BLOCK_SIZE: AbortCode = AbortCode(0x0504_0002);
    matches!(
        code,
        AbortCode::COMMAND
            | INVALID_BLOCK_SIZE
            | AbortCode::OUT_OF_MEMORY
            | AbortCode::UNSUPPORTED_ACCESS
            | AbortCode::GENERAL
    )
}

/// Codes that report lost or damaged frames, not an error of the object.
fn is_transmission_fault(code: AbortCode) -> bool {
    const INVALID_SEQUENCE: AbortCode = AbortCode(0x0504_0003);
    const CRC: AbortCode = AbortCode(0x0504_0004);
    matches!(code, AbortCode::TOGGLE | AbortCode::TIMEOUT | INVALID_SEQUENCE | CRC)
}

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
    /// Segments without bytes, one after the other.
    Endless,
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
    /// Blocks or segments in a row without progress.
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

/// State of the transfer that was started last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::network) enum TurnState {
    Busy,
    /// The value is in [`SdoClient::data`].
    Done,
    /// Another part of the application has used the client since: start again.
    Lost,
    Failed(SdoFault),
}

/// One transfer of a part of the application that shares the SDO client of a node. Start it, then poll it until
/// it has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(in crate::network) struct SdoTurn {
    /// Number of the transfer in the client.
    generation: u64,
}

impl SdoTurn {
    /// Starts an upload. Returns `false` if the client is busy.
    pub(in crate::network) fn upload(
        &mut self,
        client: &mut SdoClient,
        (index, subindex): (u16, u8),
    ) -> Result<bool, SdoStartError> {
        let started = client.start_upload(index, subindex);
        self.note_start(client, started)
    }

    /// Starts a download. Returns `false` if the client is busy.
    pub(in crate::network) fn download(
        &mut self,
        client: &mut SdoClient,
        (index, subindex): (u16, u8),
        data: &[u8],
    ) -> Result<bool, SdoStartError> {
        let started = client.start_download(index, subindex, data);
        self.note_start(client, started)
    }

    fn note_start(
        &mut self,
        client: &SdoClient,
        started: Result<(), SdoStartError>,
    ) -> Result<bool, SdoStartError> {
        match started {
            Ok(()) => {
                self.generation = client.generation();
                Ok(true)
            }
            Err(SdoStartError::Busy) => Ok(false),
            Err(error) => Err(error),
        }
    }

    /// Returns whether no other part of the application has used the client since.
    pub(in crate::network) fn is_current(&self, client: &SdoClient) -> bool {
        client.generation() == self.generation
    }

    pub(in crate::network) fn poll(&self, client: &SdoClient) -> TurnState {
        if !self.is_current(client) {
            return TurnState::Lost;
        }
        match client.state() {
            Sdo::Busy => TurnState::Busy,
            Sdo::Done { .. } => TurnState::Done,
            Sdo::Failed(fault) => TurnState::Failed(fault),
            Sdo::Idle => TurnState::Failed(SdoFault::Cancelled),
        }
    }
}
