//! SDO transfers of a gateway while no cycle runs, and registers of its CAN controllers by the register service
//! (manual 13.6).

use ecan_host::{CanController, Diagnostics, Error};
use ecan_protocol::device::ControllerMode;
use ecan_protocol::object::{SdoWrite, describe, lookup};

use super::outcome::{Result, unavailable};

/// Result of an upload that the gateway may abort.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Upload {
    Value(u32),
    /// Abort code.
    Aborted(u32),
}

/// Number of bytes of an object.
pub(crate) fn size_of(index: u16, subindex: u8) -> usize {
    let entry = lookup(index, subindex).map(|(_, entry)| entry);
    entry.and_then(|entry| entry.ty.size_bytes()).unwrap_or(4).min(4)
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Sdo<'a> {
    pub(crate) diagnostics: &'a Diagnostics,
    pub(crate) slave: usize,
}

impl Sdo<'_> {
    pub(crate) fn try_read(&self, index: u16, subindex: u8) -> Result<Upload> {
        match self.diagnostics.sdo_upload_u32(self.slave, index, subindex) {
            Ok(value) => Ok(Upload::Value(value)),
            Err(Error::Sdo { abort_code: Some(code), .. }) => Ok(Upload::Aborted(code.0)),
            Err(error) => Err(error.into()),
        }
    }

    pub(crate) fn read(&self, index: u16, subindex: u8) -> Result<u32> {
        match self.try_read(index, subindex)? {
            Upload::Value(value) => Ok(value),
            Upload::Aborted(code) => unavailable(format!(
                "upload of {} aborts with 0x{code:08X}",
                describe(index, subindex)
            )),
        }
    }

    /// Returns the abort code of a rejected download.
    pub(crate) fn try_write(&self, index: u16, subindex: u8, value: u32) -> Result<Option<u32>> {
        let bytes = value.to_le_bytes();
        let data = bytes.get(..size_of(index, subindex)).unwrap_or(&bytes);
        match self.diagnostics.sdo_download(self.slave, index, subindex, data) {
            Ok(()) => Ok(None),
            Err(Error::Sdo { abort_code: Some(code), .. }) => Ok(Some(code.0)),
            Err(error) => Err(error.into()),
        }
    }

    pub(crate) fn write(&self, index: u16, subindex: u8, value: u32) -> Result {
        match self.try_write(index, subindex, value)? {
            None => Ok(()),
            Some(code) => unavailable(format!(
                "download of {} aborts with 0x{code:08X}",
                describe(index, subindex)
            )),
        }
    }

    pub(crate) fn write_all(&self, writes: impl IntoIterator<Item = SdoWrite>) -> Result {
        writes
            .into_iter()
            .try_for_each(|write| self.write(write.index, write.subindex, write.value))
    }
}

pub(crate) const ENDN: u16 = 0x04;
pub(crate) const DBTP: u16 = 0x0C;
pub(crate) const NBTP: u16 = 0x1C;

/// Reads a register; requests engineering mode only if the gateway demands it, and restores the mode.
pub(crate) fn read_register(sdo: Sdo<'_>, channel: u8, offset: u16) -> Result<u32> {
    Ok(CanController::new(sdo.diagnostics, sdo.slave, channel).read(offset)?)
}

/// Reads the mode of a controller.
pub(crate) fn controller_mode(sdo: Sdo<'_>, channel: u8) -> Result<ControllerMode> {
    Ok(CanController::new(sdo.diagnostics, sdo.slave, channel).mode()?)
}

/// Sample point in 0.1 % of a value of NBTP, or of DBTP if `is_data`.
pub(crate) fn sample_point(value: u32, is_data: bool) -> u32 {
    let (tseg1, tseg2) = match is_data {
        false => ((value >> 8 & 0xFF) + 1, (value & 0x7F) + 1),
        true => ((value >> 8 & 0x1F) + 1, (value >> 4 & 0x0F) + 1),
    };
    (1 + tseg1) * 1000 / (1 + tseg1 + tseg2)
}
