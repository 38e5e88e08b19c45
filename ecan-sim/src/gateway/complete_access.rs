//! Complete access: the entries of an object as one block (ETG.1000.6).
//!
//! Subindex 0 takes 16 bits. The following entries have the size of their type, which is whole
//! bytes for every type of this dictionary, without gaps; a missing subindex takes no space. An
//! object of a single value is that value. A writable subindex 0 counts the entries in use, and an
//! upload ends with them.

use ecan_protocol::object::{AbortCode, Entry, Object, object};

use super::Gateway;

const COUNT_BYTES: usize = 2;

fn open(index: u16, first: u8) -> Result<&'static Object, AbortCode> {
    let object = object(index).ok_or(AbortCode::NO_OBJECT)?;
    if first > 1 {
        return Err(AbortCode::UNSUPPORTED_ACCESS);
    }
    if first > object.highest_subindex() {
        return Err(AbortCode::NO_SUBINDEX);
    }
    if object.entries.iter().any(|entry| entry.ty.size_bytes().is_none()) {
        return Err(AbortCode::NO_COMPLETE_ACCESS);
    }
    Ok(object)
}

fn block_bytes(object: &Object, entry: &Entry) -> usize {
    if entry.subindex == 0 && object.highest_subindex() > 0 {
        COUNT_BYTES
    } else {
        entry.ty.size_bytes().unwrap_or(0)
    }
}

impl Gateway {
    /// Uploads the entries from `first` on, 0 or 1. Write-only entries read as zeros.
    ///
    /// # Errors
    /// As [`sdo_upload`](Self::sdo_upload); without Complete Access 0x06010000.
    pub(crate) fn sdo_upload_complete(
        &mut self,
        now: u64,
        index: u16,
        first: u8,
    ) -> Result<Vec<u8>, AbortCode> {
        self.check_complete_access()?;
        upload(&mut Access { gateway: self, now }, index, first)
    }

    /// Downloads a block that begins with subindex `first`, 0 or 1, and can end after any entry. A
    /// count in subindex 0 is set to 0 before the entries are written, and to its value after them;
    /// a read-only one must match. The first rejected entry ends the download; entries written
    /// before it stay.
    ///
    /// # Errors
    /// As [`sdo_download`](Self::sdo_download); without Complete Access 0x06010000.
    pub(crate) fn sdo_download_complete(
        &mut self,
        now: u64,
        index: u16,
        first: u8,
        data: &[u8],
    ) -> Result<(), AbortCode> {
        self.check_complete_access()?;
        download(&mut Access { gateway: self, now }, index, first, data)
    }

    pub(crate) fn check_complete_access(&self) -> Result<(), AbortCode> {
        let has_it = self.config.complete_access;
        if has_it { Ok(()) } else { Err(AbortCode::UNSUPPORTED_ACCESS) }
    }
}

/// Single accesses at one time.
struct Access<'a> {
    gateway: &'a mut Gateway,
    now: u64,
}

impl Access<'_> {
    fn upload(&mut self, index: u16, subindex: u8) -> Result<Vec<u8>, AbortCode> {
        let mut data = Vec::new();
        self.gateway.sdo_upload(self.now, index, subindex, &mut data).map(|()| data)
    }

    fn download(&mut self, index: u16, subindex: u8, data: &[u8]) -> Result<(), AbortCode> {
        self.gateway.sdo_download(self.now, index, subindex, data)
    }
}

fn upload(access: &mut Access<'_>, index: u16, first: u8) -> Result<Vec<u8>, AbortCode> {
    let object = open(index, first)?;
    let has_writable_count = object.highest_subindex() > 0
        && object.entry(0).is_some_and(|entry| entry.access.can_write());
    let last = match has_writable_count {
        true => access.upload(index, 0)?.first().copied().unwrap_or(0),
        false => object.highest_subindex(),
    };
    let mut block = Vec::new();
    for entry in object.entries {
        if !(first..=last).contains(&entry.subindex) {
            continue;
        }
        let end = block.len() + block_bytes(object, entry);
        if entry.access.can_read() {
            block.extend(access.upload(index, entry.subindex)?);
        }
        block.resize(end, 0);
    }
    Ok(block)
}

fn download(access: &mut Access<'_>, index: u16, first: u8, data: &[u8]) -> Result<(), AbortCode> {
    let object = open(index, first)?;
    let parts = split(object, first, data)?;
    let mut count = None;
    for (entry, bytes) in parts {
        let subindex = entry.subindex;
        if subindex == 0 && object.highest_subindex() > 0 {
            let value = bytes.get(..1).unwrap_or_default();
            if entry.access.can_write() {
                access.download(index, 0, &[0])?;
                count = Some(value);
            } else if access.upload(index, 0)? != value {
                return Err(AbortCode::READ_ONLY);
            }
        } else {
            access.download(index, subindex, bytes)?;
        }
    }
    match count {
        Some(count) => access.download(index, 0, count),
        None => Ok(()),
    }
}

fn split<'a>(
    object: &Object,
    first: u8,
    data: &'a [u8],
) -> Result<Vec<(&'static Entry, &'a [u8])>, AbortCode> {
    if data.is_empty() {
        return Err(AbortCode::LENGTH);
    }
    let mut rest = data;
    let mut parts = Vec::new();
    for entry in object.entries.iter().filter(|entry| entry.subindex >= first) {
        if rest.is_empty() {
            break;
        }
        let (part, remaining) =
            rest.split_at_checked(block_bytes(object, entry)).ok_or(AbortCode::TOO_SHORT)?;
        parts.push((entry, part));
        rest = remaining;
    }
    if rest.is_empty() { Ok(parts) } else { Err(AbortCode::TOO_LONG) }
}
