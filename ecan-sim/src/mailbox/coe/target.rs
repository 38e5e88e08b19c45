use ecan_protocol::object::{AbortCode, object};

use super::Context;

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
            true => context.gateway.sdo_upload_complete(context.now, index, subindex),
            false => context.sdo_upload(index, subindex),
        }
    }

    pub(super) fn download(self, data: &[u8], context: &mut Context<'_>) -> Result<(), AbortCode> {
        let Self { index, subindex, is_complete } = self;
        match is_complete {
            true => context.gateway.sdo_download_complete(context.now, index, subindex, data),
            false => context.sdo_download(index, subindex, data),
        }
    }

    /// Checks a segmented download before its data arrive.
    pub(super) fn check_announced(
        self,
        size: usize,
        context: &Context<'_>,
    ) -> Result<(), AbortCode> {
        let (_, entry) = context.gateway.find_entry(self.index, self.subindex)?;
        if self.is_complete {
            return context.gateway.check_complete_access();
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
