//! SDO server (CiA 301, 7.2.4): expedited and segmented transfers; for block transfers see
//! `sdo_block`.

use ecan_canopen::{BlockSegment, ClientFrame, Initiate, Segment, ServerFrame};
use ecan_protocol::object::AbortCode;

use super::dictionary::LONGEST;

/// Data of an SDO frame.
pub(super) type Bytes = [u8; 8];

/// Reason for ending a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TransferError {
    /// The transfer is aborted.
    Abort(AbortCode),
    /// The request gets no response.
    Silence,
}

impl From<AbortCode> for TransferError {
    fn from(code: AbortCode) -> Self {
        Self::Abort(code)
    }
}

/// The objects that the server reads and writes.
pub(super) trait Objects {
    /// Reads an object into `out`.
    fn upload(&mut self, index: u16, subindex: u8, out: &mut Vec<u8>) -> Result<(), TransferError>;

    /// Checks whether a download of `length` bytes may start.
    fn begin_download(
        &mut self,
        index: u16,
        subindex: u8,
        length: Option<usize>,
    ) -> Result<(), TransferError>;

    /// Writes a value.
    fn download(&mut self, index: u16, subindex: u8, value: &[u8]) -> Result<(), TransferError>;

    /// Size of an object's type, for expedited downloads without size.
    fn size(&self, index: u16, subindex: u8) -> Option<usize>;
}

/// Support of block transfers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct BlockSupport {
    /// Block transfers are supported.
    pub(super) known: bool,
    /// Block uploads are answered as segmented ones.
    pub(super) upload_falls_back: bool,
}

/// Phase of a transfer.
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

/// The server with its one transfer.
#[derive(Clone, Debug)]
pub(super) struct SdoServer {
    pub(super) support: BlockSupport,
    pub(super) index: u16,
    pub(super) subindex: u8,
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
    pub(super) fn new(support: BlockSupport) -> Self {
        Self {
            support,
            index: 0,
            subindex: 0,
            phase: Phase::Idle,
            buffer: Vec::with_capacity(BUFFER),
            position: 0,
            with_crc: false,
            block_size: 0,
            announced: None,
        }
    }

    /// Discards a transfer in progress.
    pub(super) fn restart(&mut self) {
        self.phase = Phase::Idle;
    }

    /// Receives a client frame; returns the response, if any.
    pub(super) fn receive(&mut self, data: &[u8], objects: &mut dyn Objects) -> Option<Bytes> {
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
        let response = self.frame(frame, objects);
        match response {
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
        objects: &mut dyn Objects,
    ) -> Result<Option<ServerFrame>, TransferError> {
        Ok(match frame {
            ClientFrame::Upload { index, subindex } => {
                self.begin(index, subindex);
                objects.upload(index, subindex, &mut self.buffer)?;
                Some(self.upload_response())
            }
            ClientFrame::UploadSegment { toggle } => Some(self.upload_segment(toggle)?),
            ClientFrame::Download { index, subindex, initiate } => {
                self.begin(index, subindex);
                self.begin_download(initiate, objects)?;
                Some(ServerFrame::Download { index, subindex })
            }
            ClientFrame::DownloadSegment(segment) => Some(self.download_segment(segment, objects)?),
            ClientFrame::Abort { .. } => {
                self.phase = Phase::Idle;
                None
            }
            block => return self.block_frame(block, objects),
        })
    }

    /// Starts a transfer; one in progress is discarded.
    pub(super) fn begin(&mut self, index: u16, subindex: u8) {
        self.index = index;
        self.subindex = subindex;
        self.phase = Phase::Idle;
        self.position = 0;
        self.buffer.clear();
    }

    /// Aborts the transfer.
    pub(super) fn abort(&mut self, code: AbortCode) -> Bytes {
        self.phase = Phase::Idle;
        ServerFrame::Abort { index: self.index, subindex: self.subindex, code }.to_bytes()
    }

    /// Returns the value if it is short, otherwise its size.
    pub(super) fn upload_response(&mut self) -> ServerFrame {
        let initiate = Initiate::expedited(&self.buffer).unwrap_or_else(|| {
            self.phase = Phase::Upload { toggle: false };
            Initiate::Segmented { size: Some(self.buffer.len() as u32) }
        });
        ServerFrame::Upload { index: self.index, subindex: self.subindex, initiate }
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
        objects: &mut dyn Objects,
    ) -> Result<(), TransferError> {
        let (index, subindex) = (self.index, self.subindex);
        match initiate {
            Initiate::Expedited { data, length } => {
                // Without a size that of the object's type counts.
                let length = length
                    .map_or_else(|| objects.size(index, subindex).unwrap_or(4).min(4), usize::from);
                let value = data.get(..length).unwrap_or(&data);
                objects.begin_download(index, subindex, Some(value.len()))?;
                objects.download(index, subindex, value)
            }
            Initiate::Segmented { size } => {
                let length = size.map(|size| size as usize);
                objects.begin_download(index, subindex, length)?;
                self.phase = Phase::Download { toggle: false, announced: size };
                Ok(())
            }
        }
    }

    fn download_segment(
        &mut self,
        segment: Segment,
        objects: &mut dyn Objects,
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
            objects.download(self.index, self.subindex, &self.buffer)?;
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
