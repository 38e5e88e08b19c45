//! SDO requests in parallel with the cycle.

use super::Adapter;
use crate::error::{CycleError, Error};
use crate::master::{RequestState, SdoRequestId};
use crate::phase::Phase;

impl Adapter {
    /// Creates a request for objects of up to `size` bytes. Its object is chosen with each
    /// transfer, so one request serves many objects, one after the other.
    ///
    /// Only while [`Phase::Configured`]. Not for the cycle.
    pub fn create_sdo_request(&mut self, slave: usize, size: usize) -> Result<SdoRequestId, Error> {
        self.need_phase("create_sdo_request", Phase::Configured)?;
        let config = self.slave(slave)?.config;
        let call = "ecrt_slave_config_create_sdo_request";
        // The object is only a placeholder: each transfer names its own.
        self.master
            .create_sdo_request(config, 0xF000, 1, size)
            .map_err(|e| Error::library(call, Some(slave), e))
    }

    /// Sets how long a request may take, in milliseconds; 0 waits for ever. Real-time safe.
    pub fn sdo_request_timeout(
        &mut self,
        id: SdoRequestId,
        timeout_ms: u32,
    ) -> Result<(), CycleError> {
        self.master
            .sdo_request_timeout(id, timeout_ms)
            .map_err(CycleError::library("ecrt_sdo_request_timeout"))
    }

    /// Starts an upload. Real-time safe; the request must not be [`RequestState::Busy`].
    pub fn sdo_request_read(
        &mut self,
        id: SdoRequestId,
        index: u16,
        subindex: u8,
    ) -> Result<(), CycleError> {
        self.master
            .sdo_request_index(id, index, subindex)
            .map_err(CycleError::library("ecrt_sdo_request_index"))?;
        self.master.sdo_request_read(id).map_err(CycleError::library("ecrt_sdo_request_read"))
    }

    /// Starts a download of `data`, whose length must be the size that the request holds: the size
    /// it was created with, or that of the value it read last, since the library has no other
    /// way to set the length. So use one request for each size, and another one for reading.
    /// Real-time safe; the request must not be [`RequestState::Busy`].
    ///
    /// # Errors
    /// The library's error; `EMSGSIZE` for another length.
    pub fn sdo_request_write(
        &mut self,
        id: SdoRequestId,
        index: u16,
        subindex: u8,
        data: &[u8],
    ) -> Result<(), CycleError> {
        self.master
            .sdo_request_index(id, index, subindex)
            .map_err(CycleError::library("ecrt_sdo_request_index"))?;
        self.master
            .sdo_request_write(id, data)
            .map_err(CycleError::library("ecrt_sdo_request_write"))
    }

    /// State of a request. Real-time safe.
    pub fn sdo_request_state(&mut self, id: SdoRequestId) -> Result<RequestState, CycleError> {
        self.master.sdo_request_state(id).map_err(CycleError::library("ecrt_sdo_request_state"))
    }

    /// Data of an upload, once its state is [`RequestState::Success`]. Real-time safe.
    pub fn sdo_request_data(&self, id: SdoRequestId) -> &[u8] {
        self.master.sdo_request_data(id)
    }
}
