//! Frames of the SDO client: those that it sends, and its processing of those of the server.

use ecan_protocol::object::AbortCode;

use super::client::{Phase, SEGMENT, SdoClient, Transfer, TransferFailure};
use crate::network::error::SdoStray;
use crate::{BlockSegment, ClientFrame, Initiate, MAX_BLOCK_SIZE, Segment, ServerFrame, block_crc};

/// Below this number of bytes a server may answer a block upload with a segmented transfer: two segments.
const SWITCH_THRESHOLD: u8 = 14;

impl SdoClient {
    /// The frame to send next; `None` while an answer is due, and without a transfer. The call changes nothing.
    pub fn frame(&self) -> Option<[u8; 8]> {
        if self.abort.is_some() {
            return self.abort;
        }
        let transfer = self.transfer.as_ref()?;
        if transfer.deadline_ns.is_some() {
            return None;
        }
        let Transfer { index, subindex, .. } = *transfer;
        let frame = match transfer.phase {
            Phase::Upload => ClientFrame::Upload { index, subindex },
            Phase::UploadSegment { toggle } => ClientFrame::UploadSegment { toggle },
            Phase::Download => {
                ClientFrame::Download { index, subindex, initiate: self.initiate(transfer) }
            }
            Phase::DownloadSegment { toggle } => {
                let (bytes, is_last) = self.segment_at(transfer, transfer.position);
                ClientFrame::DownloadSegment(Segment::new(toggle, bytes, is_last))
            }
            Phase::BlockUpload => ClientFrame::BlockUpload {
                index,
                subindex,
                block_size: self.block_size(),
                switch_threshold: SWITCH_THRESHOLD,
                crc: true,
            },
            Phase::BlockUploadStart => ClientFrame::BlockUploadStart,
            Phase::BlockUploadAck { received, .. } => {
                ClientFrame::BlockUploadAck { received, block_size: self.block_size() }
            }
            Phase::BlockUploadEndAck => ClientFrame::BlockUploadEnd,
            Phase::BlockDownload => {
                let size = transfer.size.and_then(|size| u32::try_from(size).ok());
                ClientFrame::BlockDownload { index, subindex, size, crc: true }
            }
            Phase::BlockDownloadSegments { sent } => {
                let at = transfer.position + usize::from(sent) * SEGMENT;
                let (bytes, is_last) = self.segment_at(transfer, at);
                return Some(BlockSegment::new(sent + 1, bytes, is_last).to_bytes());
            }
            Phase::BlockDownloadEnd => self.closing(transfer),
            Phase::BlockUploadSegments { .. } | Phase::BlockUploadEnd => return None,
        };
        Some(frame.to_bytes())
    }

    /// Takes note that the frame of [`frame`](Self::frame) was sent at `now_ns`.
    pub fn sent(&mut self, now_ns: u64) {
        if self.abort.take().is_some() {
            return;
        }
        let deadline = self.deadline(now_ns);
        let Some(transfer) = &mut self.transfer else { return };
        transfer.is_known_to_node = true;
        transfer.deadline_ns = Some(deadline);
        match transfer.phase {
            Phase::BlockUploadStart | Phase::BlockUploadAck { is_last: false, .. } => {
                transfer.phase = Phase::BlockUploadSegments { last: 0, has_segment: false };
            }
            Phase::BlockUploadAck { is_last: true, .. } => transfer.phase = Phase::BlockUploadEnd,
            Phase::BlockUploadEndAck => {
                let length = transfer.position;
                self.succeed(length);
            }
            Phase::BlockDownloadSegments { sent } => {
                let sent = sent.saturating_add(1);
                transfer.phase = Phase::BlockDownloadSegments { sent };
                let end = transfer.position + usize::from(sent) * SEGMENT;
                if sent < transfer.block_size && transfer.size.is_some_and(|size| end < size) {
                    transfer.deadline_ns = None;
                }
            }
            _ => {}
        }
    }

    fn initiate(&self, transfer: &Transfer) -> Initiate {
        let size = transfer.size.unwrap_or_default();
        let value = self.buffer.get(..size).unwrap_or_default();
        Initiate::expedited(value).unwrap_or(Initiate::Segmented { size: u32::try_from(size).ok() })
    }

    /// Segment of a download that begins at a byte, and whether it is the last.
    fn segment_at(&self, transfer: &Transfer, at: usize) -> (&[u8], bool) {
        let size = transfer.size.unwrap_or_default();
        let end = size.min(at.saturating_add(SEGMENT));
        (self.buffer.get(at..end).unwrap_or_default(), end >= size)
    }

    fn closing(&self, transfer: &Transfer) -> ClientFrame {
        let size = transfer.size.unwrap_or_default();
        let value = self.buffer.get(..size).unwrap_or_default();
        let unused = (SEGMENT - size % SEGMENT) % SEGMENT;
        ClientFrame::BlockDownloadEnd {
            unused: unused as u8,
            crc: if transfer.crc { block_crc(0, value) } else { 0 },
        }
    }

    pub(super) fn queue_abort(&mut self, code: AbortCode) {
        if let Some(Transfer { is_known_to_node: true, index, subindex, .. }) = self.transfer {
            self.abort = Some(ClientFrame::Abort { index, subindex, code }.to_bytes());
        }
    }
}

const INVALID_BLOCK_SIZE: AbortCode = AbortCode(0x0504_0002);
const INVALID_SEQUENCE: AbortCode = AbortCode(0x0504_0003);
const CRC_ERROR: AbortCode = AbortCode(0x0504_0004);

impl SdoClient {
    /// Processes the data of a frame of the server that arrived at `now_ns`. Fewer than 8 bytes count if they have the
    /// whole content.
    pub fn receive(&mut self, data: &[u8], now_ns: u64) {
        let mut bytes = [0; 8];
        bytes.iter_mut().zip(data).for_each(|(to, from)| *to = *from);
        let frame = &bytes;
        let Some(transfer) = &self.transfer else { return self.stray(SdoStray::Unexpected) };
        if data.len() < content_bytes(frame, transfer.phase) {
            return self.stray(SdoStray::Short { bytes: data.len() });
        }
        if !transfer.is_known_to_node {
            // No request was sent: the frame belongs to an earlier attempt.
            return self.stray(SdoStray::Unexpected);
        }
        let answer = ServerFrame::parse(frame);
        if let Some(segment) = BlockSegment::parse(frame) {
            // The answer to an earlier request for the same object looks like a segment.
            let is_answer = matches!(
                answer,
                Ok(ServerFrame::BlockUpload { index, subindex, .. }
                    | ServerFrame::Upload { index, subindex, .. })
                    if transfer.is_about(index, subindex)
            );
            let is_surplus = !is_answer && segment.sequence > self.block_size();
            match transfer.phase {
                Phase::BlockUploadSegments { .. }
                | Phase::BlockUploadAck { is_last: false, .. }
                    if is_surplus =>
                {
                    // A server that sends more segments than the block has would continue after them.
                    return self.handle_failure(TransferFailure::Violation(INVALID_SEQUENCE));
                }
                Phase::BlockUploadSegments { last, .. } => {
                    if is_answer && segment.sequence != last + 1 {
                        return self.stray(SdoStray::Unexpected);
                    }
                    return self.block_segment(segment, last, now_ns);
                }
                _ => {}
            }
        }
        match answer {
            Ok(ServerFrame::Abort { index, subindex, code }) => {
                // Some servers do not name the object of the running transfer.
                if transfer.is_about(index, subindex) || (index, subindex) == (0, 0) {
                    self.handle_failure(TransferFailure::Abort(code));
                } else {
                    self.stray(SdoStray::OtherObject { index, subindex });
                }
            }
            Ok(answer) if transfer.expects_answer() => self.answer(answer),
            _ => self.stray(SdoStray::Unexpected),
        }
    }

    fn answer(&mut self, answer: ServerFrame) {
        let Some(transfer) = &mut self.transfer else { return };
        if let Some((index, subindex)) = subject(&answer)
            && !transfer.is_about(index, subindex)
        {
            return self.stray(SdoStray::OtherObject { index, subindex });
        }
        match (transfer.phase, answer) {
            (Phase::Upload | Phase::BlockUpload, ServerFrame::Upload { initiate, .. }) => {
                self.upload_begins(initiate)
            }
            (Phase::UploadSegment { toggle }, ServerFrame::UploadSegment(segment)) => {
                self.upload_segment(&segment, toggle);
            }
            (Phase::Download, ServerFrame::Download { .. }) => {
                let size = transfer.size.unwrap_or_default();
                if (1..=4).contains(&size) {
                    self.succeed(size);
                } else {
                    transfer.go(Phase::DownloadSegment { toggle: false });
                }
            }
            (
                Phase::DownloadSegment { toggle },
                ServerFrame::DownloadSegment { toggle: answered },
            ) => {
                if answered != toggle {
                    return self.handle_failure(TransferFailure::Violation(AbortCode::TOGGLE));
                }
                let size = transfer.size.unwrap_or_default();
                transfer.position = size.min(transfer.position + SEGMENT);
                if transfer.position >= size {
                    self.succeed(size);
                } else {
                    transfer.go(Phase::DownloadSegment { toggle: !toggle });
                }
            }
            (Phase::BlockUpload, ServerFrame::BlockUpload { size, crc, .. }) => {
                transfer.crc = crc;
                if self.announce(size) {
                    self.go(Phase::BlockUploadStart);
                }
            }
            (Phase::BlockUploadEnd, ServerFrame::BlockUploadEnd { unused, crc }) => {
                self.block_upload_ends(unused, crc);
            }
            (Phase::BlockDownload, ServerFrame::BlockDownload { block_size, crc, .. }) => {
                transfer.crc = crc;
                self.next_block(block_size);
            }
            (
                Phase::BlockDownloadSegments { sent },
                ServerFrame::BlockDownloadAck { received, block_size },
            ) => self.block_acknowledged(sent, received, block_size),
            (Phase::BlockDownloadEnd, ServerFrame::BlockDownloadEnd) => {
                let size = transfer.size.unwrap_or_default();
                self.succeed(size);
            }
            // Another service than requested, for the same object.
            (
                Phase::Upload | Phase::BlockUpload | Phase::Download | Phase::BlockDownload,
                ServerFrame::Upload { .. }
                | ServerFrame::Download { .. }
                | ServerFrame::BlockUpload { .. }
                | ServerFrame::BlockDownload { .. },
            ) => self.handle_failure(TransferFailure::Violation(AbortCode::COMMAND)),
            // A late answer to an earlier attempt.
            _ => self.stray(SdoStray::Unexpected),
        }
    }

    fn go(&mut self, phase: Phase) {
        if let Some(transfer) = &mut self.transfer {
            transfer.go(phase);
        }
    }

    /// Stores the size that the server announces; returns whether the value fits.
    fn announce(&mut self, size: Option<u32>) -> bool {
        let capacity = self.capacity();
        let Some(transfer) = &mut self.transfer else { return false };
        transfer.size = size.map(|size| usize::try_from(size).unwrap_or(usize::MAX));
        if transfer.size.is_some_and(|size| size > capacity) {
            self.handle_failure(TransferFailure::TooLong);
            return false;
        }
        true
    }

    fn upload_begins(&mut self, initiate: Initiate) {
        match initiate {
            Initiate::Expedited { data, length } => {
                let length = usize::from(length.unwrap_or(4)).min(data.len());
                if length > self.capacity() {
                    return self.handle_failure(TransferFailure::TooLong);
                }
                self.store(0, data.get(..length).unwrap_or_default());
                self.succeed(length);
            }
            Initiate::Segmented { size } => {
                if self.announce(size) {
                    self.go(Phase::UploadSegment { toggle: false });
                }
            }
        }
    }

    fn upload_segment(&mut self, segment: &Segment, toggle: bool) {
        if segment.toggle != toggle {
            return self.handle_failure(TransferFailure::Violation(AbortCode::TOGGLE));
        }
        let capacity = self.capacity();
        let Some(transfer) = &mut self.transfer else { return };
        let (at, size) = (transfer.position, transfer.size);
        let end = at + segment.bytes().len();
        transfer.position = end;
        transfer.go(Phase::UploadSegment { toggle: !toggle });
        if end > capacity {
            return self.handle_failure(TransferFailure::TooLong);
        }
        self.store(at, segment.bytes());
        if let Some(transfer) = &mut self.transfer {
            let is_stalled = segment.bytes().is_empty() && !segment.last;
            transfer.stalls = if is_stalled { transfer.stalls.saturating_add(1) } else { 0 };
            if transfer.stalls > self.retries() {
                return self.handle_failure(TransferFailure::Endless);
            }
        }
        let is_whole = size.is_none_or(|size| size == end);
        let is_too_much = size.is_some_and(|size| end > size);
        if is_too_much || segment.last && !is_whole {
            self.handle_failure(TransferFailure::Violation(AbortCode::LENGTH));
        } else if segment.last {
            self.succeed(end);
        }
    }

    /// Processes a segment of a block; `last` is the last one received in order.
    fn block_segment(&mut self, segment: BlockSegment, last: u8, now_ns: u64) {
        let deadline = self.deadline(now_ns);
        let (block_size, limit) = (self.block_size(), self.buffer.len());
        let Some(transfer) = &mut self.transfer else { return };
        let in_order = segment.sequence == last + 1;
        let last = if in_order { segment.sequence } else { last };
        let at = transfer.position + usize::from(segment.sequence - 1) * SEGMENT;
        transfer.phase = Phase::BlockUploadSegments { last, has_segment: true };
        transfer.deadline_ns = Some(deadline);
        let ends_value = in_order && segment.last;
        if ends_value || segment.last || segment.sequence >= block_size {
            transfer.stalls = if last == 0 { transfer.stalls.saturating_add(1) } else { 0 };
            transfer.block_arrived(last, ends_value);
        }
        if in_order {
            if at + SEGMENT > limit {
                return self.handle_failure(TransferFailure::TooLong);
            }
            self.store(at, &segment.data);
        }
        self.check_stalls();
    }

    fn block_upload_ends(&mut self, unused: u8, crc: u16) {
        let capacity = self.capacity();
        let Some(transfer) = &mut self.transfer else { return };
        let length = transfer.position.saturating_sub(usize::from(unused));
        transfer.position = length;
        let (size, checks) = (transfer.size, transfer.crc);
        if length > capacity {
            return self.handle_failure(TransferFailure::TooLong);
        }
        if size.is_some_and(|size| size != length) {
            return self.handle_failure(TransferFailure::Violation(AbortCode::LENGTH));
        }
        let value = self.buffer.get(..length).unwrap_or_default();
        if checks && block_crc(0, value) != crc {
            return self.handle_failure(TransferFailure::Violation(CRC_ERROR));
        }
        self.go(Phase::BlockUploadEndAck);
    }

    fn next_block(&mut self, block_size: u8) {
        if !(1..=MAX_BLOCK_SIZE).contains(&block_size) {
            return self.handle_failure(TransferFailure::Violation(INVALID_BLOCK_SIZE));
        }
        if let Some(transfer) = &mut self.transfer {
            transfer.block_size = block_size;
            transfer.go(Phase::BlockDownloadSegments { sent: 0 });
        }
    }

    /// The server has received `received` of the `sent` segments of the block.
    fn block_acknowledged(&mut self, sent: u8, received: u8, block_size: u8) {
        let Some(transfer) = &mut self.transfer else { return };
        if received > sent {
            return self.handle_failure(TransferFailure::Violation(INVALID_SEQUENCE));
        }
        let size = transfer.size.unwrap_or_default();
        transfer.position = size.min(transfer.position + usize::from(received) * SEGMENT);
        transfer.stalls = if received == 0 { transfer.stalls.saturating_add(1) } else { 0 };
        if transfer.position >= size {
            transfer.go(Phase::BlockDownloadEnd);
        } else {
            self.next_block(block_size);
            self.check_stalls();
        }
    }

    /// Ends a transfer after too many blocks without progress.
    fn check_stalls(&mut self) {
        let limit = self.retries();
        if self.transfer.is_some_and(|transfer| transfer.stalls > limit) {
            self.handle_failure(TransferFailure::Violation(INVALID_SEQUENCE));
        }
    }

    fn store(&mut self, at: usize, bytes: &[u8]) {
        for (to, from) in self.buffer.iter_mut().skip(at).zip(bytes) {
            *to = *from;
        }
    }
}

/// Bytes of a frame that have a content: the first byte states it (CiA 301, 7.2.4.3).
fn content_bytes(frame: &[u8; 8], phase: Phase) -> usize {
    match (phase, frame[0]) {
        // An expedited value whose size is stated.
        (Phase::Upload | Phase::BlockUpload, first @ (0x43 | 0x47 | 0x4B | 0x4F)) => {
            8 - usize::from(first >> 2 & 3)
        }
        (Phase::UploadSegment { .. }, first @ 0x00..=0x1F) => 8 - usize::from(first >> 1 & 7),
        (Phase::Download, 0x60) => 4,
        (Phase::DownloadSegment { .. }, 0x20 | 0x30) => 1,
        _ => 8,
    }
}

/// Object that an answer names.
fn subject(answer: &ServerFrame) -> Option<(u16, u8)> {
    match *answer {
        ServerFrame::Upload { index, subindex, .. }
        | ServerFrame::Download { index, subindex }
        | ServerFrame::BlockUpload { index, subindex, .. }
        | ServerFrame::BlockDownload { index, subindex, .. }
        | ServerFrame::Abort { index, subindex, .. } => Some((index, subindex)),
        _ => None,
    }
}
