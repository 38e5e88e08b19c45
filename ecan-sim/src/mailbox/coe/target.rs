use ecan_protocol::object::{AbortCode, object};

use crate::gateway::Gateway;

use super::complete_access;

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
    pub(super) fn upload(self, now: u64, gateway: &mut Gateway) -> Result<Vec<u8>, AbortCode> {
        if self.is_complete {
            return complete_access::upload(now, self.index, self.subindex, gateway);
        }
        let mut data = Vec::new();
        gateway.sdo_upload(now, self.index, self.subindex, &mut data).map(|()| data)
    }

    pub(super) fn download(
        self,
        now: u64,
        data: &[u8],
        gateway: &mut Gateway,
    ) -> Result<(), AbortCode> {
        if self.is_complete {
            return complete_access::download(now, self.index, self.subindex, data, gateway);
        }
        gateway.sdo_download(now, self.index, self.subindex, data)
    }

    /// Checks a segmented download before its data arrive.
    pub(super) fn check_announced(self, size: usize) -> Result<(), AbortCode> {
        let object = object(self.index).ok_or(AbortCode::NO_OBJECT)?;
        let entry = object.entry(self.subindex).ok_or(AbortCode::NO_SUBINDEX)?;
        if self.is_complete {
            return Ok(());
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
