//! Block transfers of the SDO server (CiA 301, 7.2.4.3.9 to 7.2.4.3.17).

use ecan_canopen::{BlockSegment, ClientFrame, MAX_BLOCK_SIZE, ServerFrame, block_crc};
use ecan_protocol::object::AbortCode;

use super::device::Device;
use super::dictionary::LONGEST;
use super::sdo_server::{Phase, SdoServer, TransferError};

const INVALID_BLOCK_SIZE: AbortCode = AbortCode(0x0504_0002);
const INVALID_SEQUENCE: AbortCode = AbortCode(0x0504_0003);
const CRC: AbortCode = AbortCode(0x0504_0004);

const SEGMENT: usize = 7;

impl SdoServer {
    pub(super) fn block_frame(
        &mut self,
        frame: ClientFrame,
        device: &mut Device,
    ) -> Result<Option<ServerFrame>, TransferError> {
        match frame {
            ClientFrame::BlockUpload { index, subindex, block_size, switch_threshold, crc } => {
                self.begin(index, subindex);
                self.begin_block_upload(block_size, switch_threshold, crc, device).map(Some)
            }
            ClientFrame::BlockUploadStart if self.phase == Phase::BlockUploadReady => {
                self.phase = Phase::BlockUpload { sequence: 1 };
                Ok(None)
            }
            ClientFrame::BlockUploadAck { received, block_size } => {
                self.block_upload_ack(received, block_size)
            }
            ClientFrame::BlockUploadEnd if self.phase == Phase::BlockUploadEnd => {
                self.phase = Phase::Idle;
                Ok(None)
            }
            ClientFrame::BlockDownload { index, subindex, size, crc } => {
                self.begin(index, subindex);
                if !self.has_block_transfer {
                    return Err(AbortCode::COMMAND.into());
                }
                device.begin_download(self.key, size.map(|size| size as usize))?;
                self.announced = size;
                self.with_crc = crc;
                self.block_size = MAX_BLOCK_SIZE;
                self.phase = Phase::BlockDownload { sequence: 0 };
                let block_size = self.block_size;
                Ok(Some(ServerFrame::BlockDownload { index, subindex, block_size, crc: true }))
            }
            ClientFrame::BlockDownloadEnd { unused, crc }
                if self.phase == Phase::BlockDownloadEnd =>
            {
                self.block_download_end(unused, crc, device).map(Some)
            }
            _ => Err(AbortCode::COMMAND.into()),
        }
    }

    fn begin_block_upload(
        &mut self,
        block_size: u8,
        switch_threshold: u8,
        crc: bool,
        device: &mut Device,
    ) -> Result<ServerFrame, TransferError> {
        if !self.has_block_transfer {
            return Err(AbortCode::COMMAND.into());
        }
        if !(1..=MAX_BLOCK_SIZE).contains(&block_size) {
            return Err(INVALID_BLOCK_SIZE.into());
        }
        device.upload(self.key, &mut self.buffer)?;
        let threshold = usize::from(switch_threshold);
        let is_short = threshold > 0 && self.buffer.len() <= threshold;
        if is_short || self.block_upload_falls_back {
            return Ok(self.upload_response());
        }
        self.with_crc = crc;
        self.block_size = block_size;
        self.phase = Phase::BlockUploadReady;
        let ((index, subindex), size) = (self.key, Some(self.buffer.len() as u32));
        Ok(ServerFrame::BlockUpload { index, subindex, size, crc: true })
    }

    /// The next segment of a block upload, if one is due. Each waits until the bus has sent the
    /// previous one, so that process data can be sent in between.
    pub(super) fn next_segment(&mut self) -> Option<[u8; 8]> {
        let Phase::BlockUpload { sequence } = self.phase else { return None };
        let from = self.position + usize::from(sequence - 1) * SEGMENT;
        let rest = self.buffer.get(from..).unwrap_or_default();
        let part = rest.get(..SEGMENT).unwrap_or(rest);
        let last = part.len() == rest.len();
        self.phase = if last || sequence >= self.block_size {
            Phase::BlockUploadWait { sent: sequence }
        } else {
            Phase::BlockUpload { sequence: sequence + 1 }
        };
        Some(BlockSegment::new(sequence, part, last).to_bytes())
    }

    fn block_upload_ack(
        &mut self,
        received: u8,
        block_size: u8,
    ) -> Result<Option<ServerFrame>, TransferError> {
        // A client that missed segments may acknowledge before the end of the block.
        let sent = match self.phase {
            Phase::BlockUploadWait { sent } => sent,
            Phase::BlockUpload { sequence } => sequence - 1,
            _ => return Err(AbortCode::COMMAND.into()),
        };
        if received > sent {
            return Err(INVALID_SEQUENCE.into());
        }
        if !(1..=MAX_BLOCK_SIZE).contains(&block_size) {
            return Err(INVALID_BLOCK_SIZE.into());
        }
        self.block_size = block_size;
        self.position += usize::from(received) * SEGMENT;
        // An empty value is one segment without bytes.
        let complete = self.position >= self.buffer.len() && received > 0;
        if !complete {
            self.phase = Phase::BlockUpload { sequence: 1 };
            return Ok(None);
        }
        self.phase = Phase::BlockUploadEnd;
        let segments = self.buffer.len().div_ceil(SEGMENT).max(1);
        let unused = (segments * SEGMENT - self.buffer.len()) as u8;
        let crc = if self.with_crc { block_crc(0, &self.buffer) } else { 0 };
        Ok(Some(ServerFrame::BlockUploadEnd { unused, crc }))
    }

    /// Receives a segment of a block download; `before` is the sequence number of the last one in
    /// order.
    pub(super) fn block_segment(&mut self, before: u8, segment: BlockSegment) -> Option<[u8; 8]> {
        let in_order = segment.sequence == before + 1;
        let received = if in_order {
            self.buffer.extend_from_slice(&segment.data);
            // The last segment is padded; the padding is removed at the end.
            let most = self.announced.map_or(LONGEST, |size| size as usize);
            if self.buffer.len() > most.div_ceil(SEGMENT).max(1).saturating_mul(SEGMENT) {
                return Some(self.abort(AbortCode::TOO_LONG));
            }
            segment.sequence
        } else {
            before
        };
        let is_last = in_order && segment.last;
        let ends = segment.last || segment.sequence >= self.block_size;
        if !ends {
            self.phase = Phase::BlockDownload { sequence: received };
            return None;
        }
        self.phase =
            if is_last { Phase::BlockDownloadEnd } else { Phase::BlockDownload { sequence: 0 } };
        let block_size = self.block_size;
        Some(ServerFrame::BlockDownloadAck { received, block_size }.to_bytes())
    }

    fn block_download_end(
        &mut self,
        unused: u8,
        crc: u16,
        device: &mut Device,
    ) -> Result<ServerFrame, TransferError> {
        let length = self.buffer.len().saturating_sub(usize::from(unused));
        self.buffer.truncate(length);
        self.check_length(self.announced, true)?;
        if self.with_crc && block_crc(0, &self.buffer) != crc {
            return Err(CRC.into());
        }
        self.phase = Phase::Idle;
        device.download(self.key, &self.buffer)?;
        Ok(ServerFrame::BlockDownloadEnd)
    }
}
