//! The values of 0xF000 of a gateway, read once (manual 13.8).

use ecan_protocol::device::Capabilities;

use super::diagnostics::Diagnostics;
use crate::error::Error;

/// Subindices of 0xF000, the unused ones included.
const ENTRIES: usize = 31;

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum CapabilityValue {
    #[default]
    NotRead,
    Reported(u32),
    /// The gateway does not have the entry; the value is assumed.
    Assumed(u32),
}

#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct CapabilityValues([CapabilityValue; ENTRIES]);

impl CapabilityValues {
    /// Subindices of the serial number, low half first.
    pub(crate) const SERIAL: [u8; 2] = [7, 8];

    fn value(&self, subindex: u8) -> CapabilityValue {
        self.0.get(usize::from(subindex)).copied().unwrap_or_default()
    }

    /// The value of a subindex, uploaded unless it is known; the assumed value if the gateway does not
    /// have it.
    pub(crate) fn read(
        &mut self,
        diagnostics: &Diagnostics,
        slave: usize,
        subindex: u8,
    ) -> Result<u32, Error> {
        if let CapabilityValue::Reported(value) | CapabilityValue::Assumed(value) =
            self.value(subindex)
        {
            return Ok(value);
        }
        let uploaded = diagnostics.sdo_upload_u32(slave, Capabilities::INDEX, subindex);
        let is_reported = uploaded.is_ok();
        let value = Error::or_assumed(uploaded, Capabilities::INDEX, subindex)?;
        if let Some(entry) = self.0.get_mut(usize::from(subindex)) {
            *entry = match is_reported {
                true => CapabilityValue::Reported(value),
                false => CapabilityValue::Assumed(value),
            };
        }
        Ok(value)
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

    /// Returns whether the entry was read and the gateway has it.
    pub(crate) fn is_reported(&self, subindex: u8) -> bool {
        matches!(self.value(subindex), CapabilityValue::Reported(_))
    }

    /// The two halves of the serial number, which the identification has read; 0 if it is not reported.
    pub(crate) fn serial(&self) -> [u32; 2] {
        Self::SERIAL.map(|half| match self.value(half) {
            CapabilityValue::Reported(value) => value,
            _ => 0,
        })
    }
}
