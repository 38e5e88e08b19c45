//! The values of 0xF000 of a gateway, read once (manual 13.8).

use ecan_protocol::device::Capabilities;

use super::diagnostics::Diagnostics;
use crate::error::Error;

/// Subindices of 0xF000, the unused ones included.
const ENTRIES: usize = 31;

#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct CapabilityValues([Option<u32>; ENTRIES]);

impl CapabilityValues {
    /// Subindices of the serial number, low half first.
    pub(crate) const SERIAL: [u8; 2] = [7, 8];

    /// The value of a subindex, uploaded unless it is known.
    pub(crate) fn read(
        &mut self,
        diagnostics: &Diagnostics,
        slave: usize,
        subindex: u8,
    ) -> Result<u32, Error> {
        let upload = || diagnostics.sdo_upload_u32(slave, Capabilities::INDEX, subindex);
        match self.0.get_mut(usize::from(subindex)) {
            Some(Some(value)) => Ok(*value),
            Some(unknown) => Ok(*unknown.insert(upload()?)),
            None => upload(),
        }
    }

    /// Reads the fields of [`Capabilities`]. One that the gateway rejects stays unknown: its error
    /// is for the code that needs it.
    pub(crate) fn read_all(
        &mut self,
        diagnostics: &Diagnostics,
        slave: usize,
    ) -> Result<(), Error> {
        for subindex in Capabilities::fields() {
            let read = self.read(diagnostics, slave, *subindex);
            if let Err(error @ Error::Sdo { abort_code: None, .. }) = read {
                return Err(error);
            }
        }
        Ok(())
    }

    /// The two halves of the serial number, which the identification has read.
    pub(crate) fn serial(&self) -> [u32; 2] {
        Self::SERIAL.map(|half| self.0.get(usize::from(half)).copied().flatten().unwrap_or(0))
    }
}
