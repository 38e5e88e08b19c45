//! Access to the slaves of a bus, directly or through another program.

use std::fmt;

use ecan_protocol::object::AbortCode;
use ecrt_sys::{Clock, Errno};

use crate::error::{Error, SdoDirection};
use crate::master::{AssignedPdo, LinkState, Master, MasterInfo, MasterState, SdoError, SlaveInfo};

/// State of a bus and blocking SDO transfers, each in one attempt. [`Diagnostics`] adds the
/// addresses of the slaves and the repetition.
///
/// Implemented by [`Master`]; a program that reaches a bus in another way implements it too. A
/// slave is its position on the bus, in the arguments and in the errors. Calls may block.
///
/// # Errors
/// [`Error::Sdo`] of a transfer, [`Error::Library`] of the other calls;
/// [`Error::NotPermitted`] and [`Error::Disconnected`] of an access through another program.
///
/// [`Diagnostics`]: crate::Diagnostics
pub trait SlaveAccess: fmt::Debug + Send {
    /// Clock for pauses and time limits.
    fn clock(&self) -> &dyn Clock;

    /// General information about the master.
    fn master_info(&self) -> Result<MasterInfo, Error>;

    /// Number of responding slaves, AL states present on the bus, link.
    fn master_state(&self) -> Result<MasterState, Error>;

    /// State of the main link (`device` = 0) or the redundant one (1).
    fn link_state(&self, device: u32) -> Result<LinkState, Error>;

    /// Information about a slave.
    fn slave_info(&self, position: u16) -> Result<SlaveInfo, Error>;

    /// PDOs that a sync manager of a slave has assigned; without SDO transfers.
    fn assigned_pdos(&self, position: u16, sync: u8) -> Result<Vec<AssignedPdo>, Error>;

    /// Uploads an object into `data` and returns its length; the bytes after it become 0.
    fn sdo_upload(
        &self,
        position: u16,
        index: u16,
        subindex: u8,
        data: &mut [u8],
    ) -> Result<usize, Error>;

    /// Downloads an object.
    fn sdo_download(
        &self,
        position: u16,
        index: u16,
        subindex: u8,
        data: &[u8],
    ) -> Result<(), Error>;

    /// Downloads an object by Complete Access, from subindex 0 on.
    fn sdo_download_complete(&self, position: u16, index: u16, data: &[u8]) -> Result<(), Error>;
}

impl SlaveAccess for Master {
    fn clock(&self) -> &dyn Clock {
        self.ecrt().clock().as_ref()
    }

    fn master_info(&self) -> Result<MasterInfo, Error> {
        self.info().map_err(failed("ecrt_master", None))
    }

    fn master_state(&self) -> Result<MasterState, Error> {
        self.state().map_err(failed("ecrt_master_state", None))
    }

    fn link_state(&self, device: u32) -> Result<LinkState, Error> {
        Master::link_state(self, device).map_err(failed("ecrt_master_link_state", None))
    }

    fn slave_info(&self, position: u16) -> Result<SlaveInfo, Error> {
        Master::slave_info(self, position).map_err(failed("ecrt_master_get_slave", Some(position)))
    }

    fn assigned_pdos(&self, position: u16, sync: u8) -> Result<Vec<AssignedPdo>, Error> {
        let call = "ecrt_master_get_sync_manager";
        Master::assigned_pdos(self, position, sync).map_err(failed(call, Some(position)))
    }

    fn sdo_upload(
        &self,
        position: u16,
        index: u16,
        subindex: u8,
        data: &mut [u8],
    ) -> Result<usize, Error> {
        let result = Master::sdo_upload(self, position, index, subindex, data);
        result.map_err(transfer_failed(position, SdoDirection::Upload, (index, subindex)))
    }

    fn sdo_download(
        &self,
        position: u16,
        index: u16,
        subindex: u8,
        data: &[u8],
    ) -> Result<(), Error> {
        let result = Master::sdo_download(self, position, index, subindex, data);
        result.map_err(transfer_failed(position, SdoDirection::Download, (index, subindex)))
    }

    fn sdo_download_complete(&self, position: u16, index: u16, data: &[u8]) -> Result<(), Error> {
        let result = Master::sdo_download_complete(self, position, index, data);
        result.map_err(transfer_failed(position, SdoDirection::Download, (index, 0)))
    }
}

fn failed(call: &'static str, position: Option<u16>) -> impl FnOnce(Errno) -> Error {
    move |errno| Error::library(call, position.map(usize::from), errno)
}

fn transfer_failed(
    position: u16,
    direction: SdoDirection,
    (index, subindex): (u16, u8),
) -> impl FnOnce(SdoError) -> Error {
    move |SdoError { errno, abort_code }| Error::Sdo {
        slave: position.into(),
        direction,
        index,
        subindex,
        errno,
        abort_code: abort_code.map(AbortCode),
        attempts: 1,
    }
}
