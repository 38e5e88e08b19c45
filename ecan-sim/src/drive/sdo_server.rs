//! SDO server (CiA 301, 7.2.4): expedited and segmented transfers; block transfers stand in their
//! own file.

use ecan_canopen::{BlockSegment, ClientFrame, Initiate, Segment, ServerFrame};
use ecan_protocol::object::AbortCode;

use super::dictionary::LONGEST;

/// Bytes of a frame.
pub(super) type Bytes = [u8; 8];

/// Why a transfer does not take place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Refusal {
    /// It is aborted.
    Abort(AbortCode),
    /// It is not answered.
    Silence,
}

impl From<AbortCode> for Refusal {
    fn from(code: AbortCode) -> Self {
        Self::Abort(code)
    }
}

/// What the server reads and writes.
pub(super) trait Objects {
    /// The value of an object, into `out`.
    fn upload(&mut self, index: u16, subindex: u8, out: &mut Vec<u8>) -> Result<(), Refusal>;

    /// Whether a download of so many bytes may begin.
    fn begin_download(
        &mut self,
        index: u16,
        subindex: u8,
        length: Option<usize>,
    ) -> Result<(), Refusal>;

    /// Writes a value.
    fn download(&mut self, index: u16, subindex: u8, value: &[u8]) -> Result<(), Refusal>;

    /// Length of an object's type, for expedited downloads that do not tell theirs.
    fn size(&self, index: u16, subindex: u8) -> Option<usize>;
}

/// What the server can do beside segmented transfers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct BlockSupport {
    /// Block transfers are known.
    pub(super) known: bool,
    /// Uploads are answered as segmented ones.
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

/// The server, with the one transfer that it carries out at a time.
#[derive(Clone, Debug)]
pub(super) struct SdoServer {
    pub(super) support: BlockSupport,
    pub(super) index: u16,
    pub(super) subindex: u8,
    pub(super) phase: Phase,
    pub(super) buffer: Vec<u8>,
    /// Bytes of the buffer that have been sent (and acknowledged, in a block upload).
    pub(super) position: usize,
    pub(super) with_crc: bool,
    pub(super) block_size: u8,
    /// Bytes that a block download announced.
    pub(super) announced: Option<u32>,
}

/// Capacity that is there from the beginning, so that ordinary transfers allocate nothing.
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

    /// Forgets a transfer under way.
    pub(super) fn restart(&mut self) {
        self.phase = Phase::Idle;
    }

    /// A frame of the client; gives the answer, if there is one.
    pub(super) fn receive(&mut self, data: &[u8], objects: &mut dyn Objects) -> Option<Bytes> {
        // A block download's segments have no command, so they are told apart by the phase.
        if let Phase::BlockDownload { sequence } = self.phase
            && let Some(segment) = BlockSegment::parse(data)
        {
            return self.block_segment(sequence, segment);
        }
        let Ok(frame) = ClientFrame::parse(data) else {
            // A frame of the wrong length is none of ours; an unknown command is refused.
            return (data.len() == 8).then(|| self.abort(AbortCode::COMMAND));
        };
        let answer = self.frame(frame, objects);
        match answer {
            Ok(answer) => answer.map(ServerFrame::to_bytes),
            Err(Refusal::Abort(code)) => Some(self.abort(code)),
            Err(Refusal::Silence) => {
                self.phase = Phase::Idle;
                None
            }
        }
    }

    fn frame(
        &mut self,
        frame: ClientFrame,
        objects: &mut dyn Objects,
    ) -> Result<Option<ServerFrame>, Refusal> {
        Ok(match frame {
            ClientFrame::Upload { index, subindex } => {
                self.begin(index, subindex);
                objects.upload(index, subindex, &mut self.buffer)?;
                Some(self.answer_upload())
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

    /// A transfer begins; one under way is forgotten.
    pub(super) fn begin(&mut self, index: u16, subindex: u8) {
        self.index = index;
        self.subindex = subindex;
        self.phase = Phase::Idle;
        self.position = 0;
        self.buffer.clear();
    }

    /// Ends the transfer with an abort.
    pub(super) fn abort(&mut self, code: AbortCode) -> Bytes {
        self.phase = Phase::Idle;
        ServerFrame::Abort { index: self.index, subindex: self.subindex, code }.to_bytes()
    }

    /// The value itself if it is short, else its size with segments to follow.
    pub(super) fn answer_upload(&mut self) -> ServerFrame {
        let initiate = Initiate::expedited(&self.buffer).unwrap_or_else(|| {
            self.phase = Phase::Upload { toggle: false };
            Initiate::Segmented { size: Some(self.buffer.len() as u32) }
        });
        ServerFrame::Upload { index: self.index, subindex: self.subindex, initiate }
    }

    fn upload_segment(&mut self, toggle: bool) -> Result<ServerFrame, Refusal> {
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
    ) -> Result<(), Refusal> {
        let (index, subindex) = (self.index, self.subindex);
        match initiate {
            Initiate::Expedited { data, length } => {
                // Without a length the type's own counts.
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
    ) -> Result<ServerFrame, Refusal> {
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

    /// Whether what has been received goes with the size announced.
    pub(super) fn check_length(
        &self,
        announced: Option<u32>,
        complete: bool,
    ) -> Result<(), Refusal> {
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
