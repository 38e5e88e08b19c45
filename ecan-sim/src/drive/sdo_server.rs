//! SDO server (CiA 301, 7.2.4): expedited, segmented and block transfers.

use ecan_canopen::{
    BlockSegment, ClientFrame, Initiate, MAX_BLOCK_SIZE, Segment, ServerFrame, block_crc,
};
use ecan_protocol::object::AbortCode;

use super::config::DriveQuirks;
use super::device::Device;
use super::dictionary::{Key, LONGEST};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TransferError {
    Abort(AbortCode),
    /// The request gets no response.
    Silence,
}

impl From<AbortCode> for TransferError {
    fn from(code: AbortCode) -> Self {
        Self::Abort(code)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Phase {
    Idle,
    Upload { toggle: bool },
    Download { toggle: bool, announced: Option<u32> },
    BlockUploadReady,
    BlockUpload { sequence: u8 },
    BlockUploadWait { sent: u8 },
    BlockUploadEnd,
    BlockDownload { sequence: u8 },
    BlockDownloadEnd,
}

#[derive(Clone, Debug)]
pub(super) struct SdoServer {
    pub(super) has_block_transfer: bool,
    /// Block uploads are answered as segmented ones.
    pub(super) block_upload_falls_back: bool,
    pub(super) key: Key,
    pub(super) phase: Phase,
    pub(super) buffer: Vec<u8>,
    /// Number of sent bytes (acknowledged ones in a block upload).
    pub(super) position: usize,
    pub(super) with_crc: bool,
    pub(super) block_size: u8,
    /// Size that a block download announced.
    pub(super) announced: Option<u32>,
}

/// Initial capacity, so that ordinary transfers allocate no memory.
const BUFFER: usize = 1_024;

impl SdoServer {
    pub(super) fn new(quirks: &DriveQuirks) -> Self {
        Self {
            has_block_transfer: !quirks.no_block_transfer,
            block_upload_falls_back: quirks.block_upload_falls_back,
            key: (0, 0),
            phase: Phase::Idle,
            buffer: Vec::with_capacity(BUFFER),
            position: 0,
            with_crc: false,
            block_size: 0,
            announced: None,
        }
    }

    pub(super) fn restart(&mut self) {
        self.phase = Phase::Idle;
    }

    pub(super) fn receive(&mut self, data: &[u8], device: &mut Device) -> Option<[u8; 8]> {
        // Segments of a block download have no command specifier; the phase identifies them.
        if let Phase::BlockDownload { sequence } = self.phase
            && let Some(segment) = BlockSegment::parse(data)
        {
            return self.block_segment(sequence, segment);
        }
        let Ok(frame) = ClientFrame::parse(data) else {
            // A frame of the wrong length is ignored; an unknown command is aborted.
            return (data.len() == 8).then(|| self.abort(AbortCode::COMMAND));
        };
        match self.frame(frame, device) {
            Ok(response) => response.map(ServerFrame::to_bytes),
            Err(TransferError::Abort(code)) => Some(self.abort(code)),
            Err(TransferError::Silence) => {
                self.phase = Phase::Idle;
                None
            }
        }
    }

    fn frame(
        &mut self,
        frame: ClientFrame,
        device: &mut Device,
    ) -> Result<Option<ServerFrame>, TransferError> {
        Ok(match frame {
            ClientFrame::Upload { index, subindex } => {
                self.begin(index, subindex);
                device.upload(self.key, &mut self.buffer)?;
                Some(self.upload_response())
            }
            ClientFrame::UploadSegment { toggle } => Some(self.upload_segment(toggle)?),
            ClientFrame::Download { index, subindex, initiate } => {
                self.begin(index, subindex);
                self.begin_download(initiate, device)?;
                Some(ServerFrame::Download { index, subindex })
            }
            ClientFrame::DownloadSegment(segment) => Some(self.download_segment(segment, device)?),
            ClientFrame::Abort { .. } => {
                self.phase = Phase::Idle;
                None
            }
            block => return self.block_frame(block, device),
        })
    }

    /// Starts a transfer; one in progress is discarded.
    pub(super) fn begin(&mut self, index: u16, subindex: u8) {
        self.key = (index, subindex);
        self.phase = Phase::Idle;
        self.position = 0;
        self.buffer.clear();
    }

    pub(super) fn abort(&mut self, code: AbortCode) -> [u8; 8] {
        self.phase = Phase::Idle;
        let (index, subindex) = self.key;
        ServerFrame::Abort { index, subindex, code }.to_bytes()
    }

    /// Returns the value if it is short, otherwise its size.
    pub(super) fn upload_response(&mut self) -> ServerFrame {
        let initiate = Initiate::expedited(&self.buffer).unwrap_or_else(|| {
            self.phase = Phase::Upload { toggle: false };
            Initiate::Segmented { size: Some(self.buffer.len() as u32) }
        });
        let (index, subindex) = self.key;
        ServerFrame::Upload { index, subindex, initiate }
    }

    fn upload_segment(&mut self, toggle: bool) -> Result<ServerFrame, TransferError> {
        let Phase::Upload { toggle: expected } = self.phase else {
            return Err(AbortCode::COMMAND.into());
        };
        if toggle != expected {
            return Err(AbortCode::TOGGLE.into());
        }
        let rest = self.buffer.get(self.position..).unwrap_or_default();
        let part = rest.get(..7).unwrap_or(rest);
        let last = part.len() == rest.len();
        let segment = Segment::new(toggle, part, last);
        self.position += part.len();
        self.phase = if last { Phase::Idle } else { Phase::Upload { toggle: !toggle } };
        Ok(ServerFrame::UploadSegment(segment))
    }

    fn begin_download(
        &mut self,
        initiate: Initiate,
        device: &mut Device,
    ) -> Result<(), TransferError> {
        let key = self.key;
        match initiate {
            Initiate::Expedited { data, length } => {
                // Without a size that of the object's type counts.
                let length =
                    length.map_or_else(|| device.size(key).unwrap_or(4).min(4), usize::from);
                let value = data.get(..length).unwrap_or(&data);
                device.begin_download(key, Some(value.len()))?;
                device.download(key, value)
            }
            Initiate::Segmented { size } => {
                let length = size.map(|size| size as usize);
                device.begin_download(key, length)?;
                self.phase = Phase::Download { toggle: false, announced: size };
                Ok(())
            }
        }
    }

    fn download_segment(
        &mut self,
        segment: Segment,
        device: &mut Device,
    ) -> Result<ServerFrame, TransferError> {
        let Phase::Download { toggle, announced } = self.phase else {
            return Err(AbortCode::COMMAND.into());
        };
        if segment.toggle != toggle {
            return Err(AbortCode::TOGGLE.into());
        }
        self.buffer.extend_from_slice(segment.bytes());
        self.check_length(announced, segment.last)?;
        if segment.last {
            self.phase = Phase::Idle;
            device.download(self.key, &self.buffer)?;
        } else {
            self.phase = Phase::Download { toggle: !toggle, announced };
        }
        Ok(ServerFrame::DownloadSegment { toggle })
    }

    /// Checks the received length against the announced size.
    pub(super) fn check_length(
        &self,
        announced: Option<u32>,
        complete: bool,
    ) -> Result<(), TransferError> {
        let length = self.buffer.len();
        let most = announced.map_or(LONGEST, |size| size as usize);
        if length > most {
            Err(AbortCode::TOO_LONG.into())
        } else if complete && announced.is_some() && length < most {
            Err(AbortCode::TOO_SHORT.into())
        } else {
            Ok(())
        }
    }
}

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
