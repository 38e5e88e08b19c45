//! SDO server: expedited, normal and segmented transfers, of one entry or of a whole object. The
//! gateway checks the access.

use ecan_protocol::object::AbortCode;

use crate::gateway::Gateway;

use super::abort::abort_message;
use super::segments::{SMALLEST_SEGMENT, SegmentedDownload, SegmentedUpload};
use super::target::{COMPLETE_ACCESS, EXPEDITED, Target};
use super::{COE_HEADER_BYTES, MailboxError, coe_header, service};

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
#[derive(Debug)]
enum Transfer {
    Idle,
    Upload(SegmentedUpload),
    Download(SegmentedDownload),
}

#[derive(Debug)]
pub(super) struct SdoServer {
    transfer: Transfer,
}

impl SdoServer {
    pub(super) fn new() -> Self {
        Self { transfer: Transfer::Idle }
    }

    /// Returns the response or the abort. A request that begins a transfer ends the previous one.
    pub(super) fn request(
        &mut self,
        now: u64,
        body: &[u8],
        room: usize,
        gateway: &mut Gateway,
    ) -> Result<Option<Vec<u8>>, MailboxError> {
        let (&[command, i0, i1, subindex, d0, d1, d2, d3], rest) =
            body.split_first_chunk::<SDO_BYTES>().ok_or(MailboxError::SizeTooShort)?;
        let target = Target {
            index: u16::from_le_bytes([i0, i1]),
            subindex,
            is_complete: command & COMPLETE_ACCESS != 0,
        };
        let initiation = Initiation { command, target, data: [d0, d1, d2, d3], rest };
        let running = std::mem::replace(&mut self.transfer, Transfer::Idle);
        let (at, result) = match (command >> 5, running) {
            (request::UPLOAD, _) => (target, self.begin_upload(now, target, room, gateway)),
            (request::DOWNLOAD, _) => (target, self.begin_download(now, &initiation, gateway)),
            (request::UPLOAD_SEGMENT, Transfer::Upload(upload)) => {
                (upload.target, self.continue_upload(command, upload, room))
            }
            (request::DOWNLOAD_SEGMENT, Transfer::Download(download)) => {
                let at = download.target;
                (at, self.continue_download(now, body, download, gateway))
            }
            (request::ABORT, _) => return Ok(None),
            // a segment without transfer, or in the other direction
            (request::UPLOAD_SEGMENT | request::DOWNLOAD_SEGMENT, running) => {
                let nothing = Target { index: 0, subindex: 0, is_complete: false };
                let at = match running {
                    Transfer::Idle => nothing,
                    Transfer::Upload(upload) => upload.target,
                    Transfer::Download(download) => download.target,
                };
                (at, Err(AbortCode::COMMAND))
            }
            _ => (target, Err(AbortCode::COMMAND)),
        };
        let message = result.unwrap_or_else(|code| abort_message(at.index, at.subindex, code));
        Ok(Some(message))
    }

    fn begin_upload(
        &mut self,
        now: u64,
        target: Target,
        room: usize,
        gateway: &mut Gateway,
    ) -> Result<Vec<u8>, AbortCode> {
        let data = target.upload(now, gateway)?;
        let command = response::UPLOAD | target.complete_bit() | SIZE_INDICATED;
        if (1..=EXPEDITED).contains(&data.len()) {
            let unused = (EXPEDITED - data.len()) as u8;
            let mut four = [0; EXPEDITED];
            four.iter_mut().zip(&data).for_each(|(to, from)| *to = *from);
            return Ok(initiation_response(command | IS_EXPEDITED | unused << 2, target, four));
        }
        let size = u32::try_from(data.len()).map_err(|_| AbortCode::OUT_OF_MEMORY)?;
        let mut message = initiation_response(command, target, size.to_le_bytes());
        let first = data.len().min(room.saturating_sub(COE_HEADER_BYTES + SDO_BYTES));
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
        let mut message = Vec::with_capacity(COE_HEADER_BYTES + 1 + segment.len() + unused);
        message.extend_from_slice(&coe_header(service::SDO_RESPONSE));
        message.push(response::UPLOAD_SEGMENT | command & TOGGLE | (unused as u8) << 1 | last);
        message.extend_from_slice(segment);
        message.extend(std::iter::repeat_n(0, unused));
        if !is_last {
            self.transfer = Transfer::Upload(upload);
        }
        Ok(message)
    }

    fn begin_download(
        &mut self,
        now: u64,
        initiation: &Initiation<'_>,
        gateway: &mut Gateway,
    ) -> Result<Vec<u8>, AbortCode> {
        let &Initiation { command, target, data, rest } = initiation;
        let has_size = command & SIZE_INDICATED != 0;
        if command & IS_EXPEDITED != 0 {
            let size = match has_size {
                true => EXPEDITED - usize::from(command >> 2 & 0x03),
                false => target.expedited_size(),
            };
            target.download(now, data.get(..size).unwrap_or(&data), gateway)?;
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
                target.download(now, rest, gateway)?;
            } else {
                target.check_announced(announced)?;
                let download = SegmentedDownload::new(target, rest, announced);
                self.transfer = Transfer::Download(download);
            }
        }
        Ok(initiation_response(response::DOWNLOAD | target.complete_bit(), target, [0; EXPEDITED]))
    }

    fn continue_download(
        &mut self,
        now: u64,
        body: &[u8],
        mut download: SegmentedDownload,
        gateway: &mut Gateway,
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
            Some(all) => target.download(now, all, gateway)?,
            None => self.transfer = Transfer::Download(download),
        }
        let mut message = Vec::with_capacity(COE_HEADER_BYTES + SDO_BYTES);
        message.extend_from_slice(&coe_header(service::SDO_RESPONSE));
        message.push(response::DOWNLOAD_SEGMENT | command & TOGGLE);
        message.extend_from_slice(&[0; SMALLEST_SEGMENT]);
        Ok(message)
    }
}

fn initiation_response(command: u8, target: Target, data: [u8; EXPEDITED]) -> Vec<u8> {
    let mut message = Vec::with_capacity(COE_HEADER_BYTES + SDO_BYTES);
    message.extend_from_slice(&coe_header(service::SDO_RESPONSE));
    message.push(command);
    message.extend_from_slice(&target.index.to_le_bytes());
    message.push(target.subindex);
    message.extend_from_slice(&data);
    message
}
