//! Frames that the SDO client sends.

use crate::{BlockSegment, ClientFrame, Initiate, Segment, block_crc};
use ecan_protocol::object::AbortCode;

use super::client::SdoClient;
use super::transfer::{Phase, SEGMENT, Transfer};

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
