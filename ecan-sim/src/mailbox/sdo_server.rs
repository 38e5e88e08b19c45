//! SDO server: expedited, normal and segmented transfers, of one entry or of a whole object. The
//! gateway checks the access.

use ecan_protocol::object::{AbortCode, object};

use super::messages::{COE_HEADER_BYTES, Context, MailboxError, coe_message, service};
use crate::gateway::{check_complete_access, find_entry};

/// Bytes of an SDO message after the CoE header, before the data of a normal transfer.
const SDO_BYTES: usize = 8;
/// Longest accepted download; the longest object is far shorter.
const LONGEST_DOWNLOAD: usize = 1024;

/// Command specifiers of the client, bits 5..7 of the command byte.
mod request {
    pub(super) const DOWNLOAD_SEGMENT: u8 = 0;
    pub(super) const DOWNLOAD: u8 = 1;
    pub(super) const UPLOAD: u8 = 2;
    pub(super) const UPLOAD_SEGMENT: u8 = 3;
    pub(super) const ABORT: u8 = 4;
}

mod response {
    pub(super) const UPLOAD_SEGMENT: u8 = 0 << 5;
    pub(super) const DOWNLOAD_SEGMENT: u8 = 1 << 5;
    pub(super) const UPLOAD: u8 = 2 << 5;
    pub(super) const DOWNLOAD: u8 = 3 << 5;
    pub(super) const ABORT: u8 = 4 << 5;
}

/// Bits of the command byte that begins a transfer.
const SIZE_INDICATED: u8 = 0x01;
const IS_EXPEDITED: u8 = 0x02;
/// Bits of a segment's command byte.
const LAST_SEGMENT: u8 = 0x01;
const TOGGLE: u8 = 0x10;

struct Initiation<'a> {
    command: u8,
    target: Target,
    data: [u8; EXPEDITED],
    rest: &'a [u8],
}

/// State between two messages.
#[derive(Clone, Debug, Default)]
enum Transfer {
    #[default]
    Idle,
    Upload(SegmentedUpload),
    Download(SegmentedDownload),
}

#[derive(Clone, Debug, Default)]
pub(in crate::mailbox) struct SdoServer {
    transfer: Transfer,
}

impl SdoServer {
    /// Returns the response or the abort. A request that begins a transfer ends the previous one.
    pub(super) fn request(
        &mut self,
        body: &[u8],
        context: &mut Context<'_>,
    ) -> Result<Option<Vec<u8>>, MailboxError> {
        let (&[command, i0, i1, subindex, d0, d1, d2, d3], rest) =
            body.split_first_chunk::<SDO_BYTES>().ok_or(MailboxError::SizeTooShort)?;
        let target = Target {
            index: u16::from_le_bytes([i0, i1]),
            subindex,
            is_complete: command & COMPLETE_ACCESS != 0,
        };
        let request = Initiation { command, target, data: [d0, d1, d2, d3], rest };
        let running = std::mem::take(&mut self.transfer);
        let (at, result) = match (command >> 5, running) {
            (request::UPLOAD, _) => (target, self.begin_upload(target, context)),
            (request::DOWNLOAD, _) => (target, self.begin_download(&request, context)),
            (request::UPLOAD_SEGMENT, Transfer::Upload(upload)) => {
                (upload.target, self.continue_upload(command, upload, context.room))
            }
            (request::DOWNLOAD_SEGMENT, Transfer::Download(download)) => {
                let at = download.target;
                (at, self.continue_download(body, download, context))
            }
            (request::ABORT, _) => return Ok(None),
            // a segment without transfer, or in the other direction
            (request::UPLOAD_SEGMENT | request::DOWNLOAD_SEGMENT, running) => {
                let at = match running {
                    Transfer::Idle => Target { index: 0, subindex: 0, is_complete: false },
                    Transfer::Upload(upload) => upload.target,
                    Transfer::Download(download) => download.target,
                };
                (at, Err(AbortCode::COMMAND))
            }
            _ => (target, Err(AbortCode::COMMAND)),
        };
        // an abort is an SDO request, also from the slave
        Ok(Some(result.unwrap_or_else(|code| {
            initiation(service::SDO_REQUEST, response::ABORT, at, code.0.to_le_bytes())
        })))
    }

    fn begin_upload(
        &mut self,
        target: Target,
        context: &mut Context<'_>,
    ) -> Result<Vec<u8>, AbortCode> {
        let data = target.upload(context)?;
        let command = response::UPLOAD | target.complete_bit() | SIZE_INDICATED;
        if (1..=EXPEDITED).contains(&data.len()) {
            let unused = (EXPEDITED - data.len()) as u8;
            let mut four = [0; EXPEDITED];
            four[..data.len()].copy_from_slice(&data);
            let command = command | IS_EXPEDITED | unused << 2;
            return Ok(initiation(service::SDO_RESPONSE, command, target, four));
        }
        let size = u32::try_from(data.len()).map_err(|_| AbortCode::OUT_OF_MEMORY)?;
        let mut message = initiation(service::SDO_RESPONSE, command, target, size.to_le_bytes());
        let first = data.len().min(context.room.saturating_sub(COE_HEADER_BYTES + SDO_BYTES));
        message.extend_from_slice(data.get(..first).unwrap_or_default());
        if first < data.len() {
            self.transfer = Transfer::Upload(SegmentedUpload::new(target, data, first));
        }
        Ok(message)
    }

    fn continue_upload(
        &mut self,
        command: u8,
        mut upload: SegmentedUpload,
        room: usize,
    ) -> Result<Vec<u8>, AbortCode> {
        let (segment, is_last) =
            upload.next(command & TOGGLE != 0, room.saturating_sub(COE_HEADER_BYTES + 1))?;
        let unused = SMALLEST_SEGMENT.saturating_sub(segment.len());
        let last = if is_last { LAST_SEGMENT } else { 0 };
        let command = response::UPLOAD_SEGMENT | command & TOGGLE | (unused as u8) << 1 | last;
        let parts: [&[u8]; 3] = [&[command], segment, &[0; SMALLEST_SEGMENT][..unused]];
        let message = coe_message(service::SDO_RESPONSE, &parts);
        if !is_last {
            self.transfer = Transfer::Upload(upload);
        }
        Ok(message)
    }

    fn begin_download(
        &mut self,
        request: &Initiation<'_>,
        context: &mut Context<'_>,
    ) -> Result<Vec<u8>, AbortCode> {
        let &Initiation { command, target, data, rest } = request;
        let has_size = command & SIZE_INDICATED != 0;
        if command & IS_EXPEDITED != 0 {
            let size = match has_size {
                true => EXPEDITED - usize::from(command >> 2 & 0x03),
                false => target.expedited_size(),
            };
            target.download(data.get(..size).unwrap_or(&data), context)?;
        } else {
            // a normal transfer needs its size
            if !has_size {
                return Err(AbortCode::COMMAND);
            }
            let announced = usize::try_from(u32::from_le_bytes(data))
                .ok()
                .filter(|&size| size <= LONGEST_DOWNLOAD)
                .ok_or(AbortCode::OUT_OF_MEMORY)?;
            if rest.len() > announced {
                return Err(AbortCode::TOO_LONG);
            }
            if rest.len() == announced {
                target.download(rest, context)?;
            } else {
                target.check_announced(announced, context)?;
                let download = SegmentedDownload::new(target, rest, announced);
                self.transfer = Transfer::Download(download);
            }
        }
        let command = response::DOWNLOAD | target.complete_bit();
        Ok(initiation(service::SDO_RESPONSE, command, target, [0; EXPEDITED]))
    }

    fn continue_download(
        &mut self,
        body: &[u8],
        mut download: SegmentedDownload,
        context: &mut Context<'_>,
    ) -> Result<Vec<u8>, AbortCode> {
        let (&command, data) = body.split_first().ok_or(AbortCode::COMMAND)?;
        // only the smallest segment may have unused bytes
        let unused = match data.len() {
            SMALLEST_SEGMENT => usize::from(command >> 1 & 0x07),
            _ => 0,
        };
        let segment = data.get(..data.len() - unused).unwrap_or_default();
        let target = download.target;
        match download.take(command & TOGGLE != 0, segment, command & LAST_SEGMENT != 0)? {
            Some(all) => target.download(all, context)?,
            None => self.transfer = Transfer::Download(download),
        }
        let command = response::DOWNLOAD_SEGMENT | command & TOGGLE;
        Ok(coe_message(service::SDO_RESPONSE, &[&[command], &[0; SMALLEST_SEGMENT]]))
    }
}

/// A message with the object of a transfer.
fn initiation(service: u8, command: u8, target: Target, data: [u8; EXPEDITED]) -> Vec<u8> {
    let Target { index, subindex, .. } = target;
    coe_message(service, &[&[command], &index.to_le_bytes(), &[subindex], &data])
}

pub(super) const SMALLEST_SEGMENT: usize = 7;

#[derive(Clone, Debug)]
pub(super) struct SegmentedUpload {
    pub(super) target: Target,
    data: Vec<u8>,
    sent: usize,
    toggle: bool,
}

impl SegmentedUpload {
    pub(super) fn new(target: Target, data: Vec<u8>, sent: usize) -> Self {
        Self { target, data, sent, toggle: false }
    }

    /// The next segment of up to `room` bytes, and whether it is the last.
    pub(super) fn next(&mut self, toggle: bool, room: usize) -> Result<(&[u8], bool), AbortCode> {
        if toggle != self.toggle {
            return Err(AbortCode::TOGGLE);
        }
        self.toggle = !toggle;
        let from = self.sent;
        self.sent = self.data.len().min(from + room.max(SMALLEST_SEGMENT));
        let is_last = self.sent == self.data.len();
        Ok((self.data.get(from..self.sent).unwrap_or_default(), is_last))
    }
}

#[derive(Clone, Debug)]
pub(super) struct SegmentedDownload {
    pub(super) target: Target,
    data: Vec<u8>,
    announced: usize,
    toggle: bool,
}

impl SegmentedDownload {
    pub(super) fn new(target: Target, first: &[u8], announced: usize) -> Self {
        Self { target, data: first.to_vec(), announced, toggle: false }
    }

    /// Adds a segment; returns all the data after the last one.
    pub(super) fn take(
        &mut self,
        toggle: bool,
        segment: &[u8],
        is_last: bool,
    ) -> Result<Option<&[u8]>, AbortCode> {
        if toggle != self.toggle {
            return Err(AbortCode::TOGGLE);
        }
        self.toggle = !toggle;
        if self.data.len() + segment.len() > self.announced {
            return Err(AbortCode::TOO_LONG);
        }
        self.data.extend_from_slice(segment);
        match is_last {
            true if self.data.len() < self.announced => Err(AbortCode::TOO_SHORT),
            true => Ok(Some(&self.data)),
            false => Ok(None),
        }
    }
}

/// Data bytes of an expedited transfer.
pub(super) const EXPEDITED: usize = 4;
/// Bit of the command byte that begins a Complete Access.
pub(super) const COMPLETE_ACCESS: u8 = 0x10;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Target {
    pub(super) index: u16,
    pub(super) subindex: u8,
    /// The whole object from the subindex on.
    pub(super) is_complete: bool,
}

impl Target {
    pub(super) fn upload(self, context: &mut Context<'_>) -> Result<Vec<u8>, AbortCode> {
        let Self { index, subindex, is_complete } = self;
        match is_complete {
            true => context.objects().upload_complete(index, subindex),
            false => context.sdo_upload(index, subindex),
        }
    }

    pub(super) fn download(self, data: &[u8], context: &mut Context<'_>) -> Result<(), AbortCode> {
        let Self { index, subindex, is_complete } = self;
        match is_complete {
            true => context.objects().download_complete(index, subindex, data),
            false => context.sdo_download(index, subindex, data),
        }
    }

    /// Checks a segmented download before its data arrive.
    pub(super) fn check_announced(
        self,
        size: usize,
        context: &Context<'_>,
    ) -> Result<(), AbortCode> {
        let (_, entry) = find_entry(context.variant(), self.index, self.subindex)?;
        if self.is_complete {
            return check_complete_access(context.gateway.config());
        }
        if !entry.access.can_write() {
            return Err(AbortCode::READ_ONLY);
        }
        match entry.ty.size_bytes() {
            Some(longest) if size > longest => Err(AbortCode::TOO_LONG),
            _ => Ok(()),
        }
    }

    /// Size of an expedited download without size indication.
    pub(super) fn expedited_size(self) -> usize {
        object(self.index)
            .filter(|_| !self.is_complete)
            .and_then(|object| object.entry(self.subindex)?.ty.size_bytes())
            .map_or(EXPEDITED, |size| size.min(EXPEDITED))
    }

    pub(super) fn complete_bit(self) -> u8 {
        if self.is_complete { COMPLETE_ACCESS } else { 0 }
    }
}
