//! SDO and register requests in parallel with the cycle.

use ecan_protocol::device::AlState;
use ecrt_sys::Errno;

use super::slave::Slave;
use crate::error::Error;
use crate::exchange::{CycleError, Phase};
use crate::master::{Master, RegRequestId, RequestState, SdoRequestId};

/// ESC register AL control.
const AL_CONTROL: u16 = 0x0120;
/// Acknowledges an error.
const ACKNOWLEDGE: u16 = 1 << 4;

/// Requests to the slaves, executed by the master in parallel with the cycle; from
/// [`Adapter::requests`](crate::Adapter::requests).
#[derive(Debug)]
pub struct Requests<'a> {
    pub(super) master: &'a mut Master,
    pub(super) slaves: &'a [Slave],
    pub(super) phase: Phase,
}

impl<'a> Requests<'a> {
    /// Creates a request for objects of up to `size` bytes. Its object is chosen with each
    /// transfer, so one request serves many objects, one after the other.
    ///
    /// Only while [`Phase::Configured`]. Not for the cycle.
    pub fn create_sdo(&mut self, slave: usize, size: usize) -> Result<SdoRequestId, Error> {
        self.phase.need("create_sdo_request", Phase::Configured)?;
        let config = find_slave(self.slaves, slave)?.config();
        let call = "ecrt_slave_config_create_sdo_request";
        // The object is only a placeholder: each transfer names its own.
        self.master
            .create_sdo_request(config, 0xF000, 1, size)
            .map_err(|e| Error::library(call, Some(slave), e))
    }

    /// Sets how long a request may take, in milliseconds; 0 waits for ever. Real-time safe.
    pub fn sdo_timeout(&mut self, id: SdoRequestId, timeout_ms: u32) -> Result<(), CycleError> {
        self.master
            .requests()
            .sdo_timeout(id, timeout_ms)
            .map_err(CycleError::library("ecrt_sdo_request_timeout"))
    }

    /// Starts an upload. Real-time safe; the request must not be [`RequestState::Busy`].
    pub fn sdo_read(
        &mut self,
        id: SdoRequestId,
        index: u16,
        subindex: u8,
    ) -> Result<(), CycleError> {
        self.master
            .requests()
            .sdo_index(id, index, subindex)
            .map_err(CycleError::library("ecrt_sdo_request_index"))?;
        self.master.requests().sdo_read(id).map_err(CycleError::library("ecrt_sdo_request_read"))
    }

    /// Starts a download of `data`, whose length must be the size that the request holds: the size
    /// it was created with, or that of the value it read last, since the library has no other
    /// way to set the length. So use one request for each size, and another one for reading.
    /// Real-time safe; the request must not be [`RequestState::Busy`].
    ///
    /// # Errors
    /// The library's error; `EMSGSIZE` for another length.
    pub fn sdo_write(
        &mut self,
        id: SdoRequestId,
        index: u16,
        subindex: u8,
        data: &[u8],
    ) -> Result<(), CycleError> {
        self.master
            .requests()
            .sdo_index(id, index, subindex)
            .map_err(CycleError::library("ecrt_sdo_request_index"))?;
        self.master
            .requests()
            .sdo_write(id, data)
            .map_err(CycleError::library("ecrt_sdo_request_write"))
    }

    /// State of a request. Real-time safe.
    pub fn sdo_state(&mut self, id: SdoRequestId) -> Result<RequestState, CycleError> {
        self.master.requests().sdo_state(id).map_err(CycleError::library("ecrt_sdo_request_state"))
    }

    /// Data of an upload, once its state is [`RequestState::Success`]. Real-time safe.
    pub fn sdo_data(self, id: SdoRequestId) -> &'a [u8] {
        self.master.requests().sdo_data(id)
    }

    /// Creates a request for registers of the slave controller, up to `size` bytes.
    ///
    /// Only while [`Phase::Configured`]. Not for the cycle.
    ///
    /// # Errors
    /// [`Error::Phase`], [`Error::SlaveIndex`], or the library's error.
    pub fn create_register(&mut self, slave: usize, size: usize) -> Result<RegRequestId, Error> {
        self.phase.need("create_register_request", Phase::Configured)?;
        let config = find_slave(self.slaves, slave)?.config();
        let call = "ecrt_slave_config_create_reg_request";
        self.master
            .create_reg_request(config, size)
            .map_err(|e| Error::library(call, Some(slave), e))
    }

    /// Starts reading `size` bytes of registers from `address`; at most the size that the request was
    /// created with. Real-time safe; the request must not be [`RequestState::Busy`].
    ///
    /// # Errors
    /// The library's error.
    pub fn register_read(
        &mut self,
        id: RegRequestId,
        address: u16,
        size: usize,
    ) -> Result<(), CycleError> {
        self.master
            .requests()
            .register_read(id, address, size)
            .map_err(CycleError::library("ecrt_reg_request_read"))
    }

    /// State of a register request; [`RequestState::Error`] also for one that was abandoned, because
    /// its slave went away or because it was busy for 1000 cycles: IgH does not end a request that it
    /// was executing when the slave went away. It can be started again. Real-time safe.
    ///
    /// # Errors
    /// The library's error.
    pub fn register_state(&mut self, id: RegRequestId) -> Result<RequestState, CycleError> {
        self.master
            .requests()
            .register_result(id)
            .map_err(CycleError::library("ecrt_reg_request_state"))
    }

    /// Registers that a request has read, once its state is [`RequestState::Success`]. Real-time
    /// safe.
    pub fn register_data(self, id: RegRequestId) -> &'a [u8] {
        self.master.requests().register_data(id)
    }

    /// Takes a slave out of OP by its register AL control, so that the master configures it again:
    /// for a slave in OP with another slave's process data. Its process data stop at once. Takes
    /// effect in later cycles; a slave that does not answer keeps its state. Real-time safe.
    ///
    /// # Errors
    /// The library's error; `EBUSY` while an earlier call has not taken effect.
    pub fn reconfigure(&mut self, slave: usize) -> Result<(), CycleError> {
        self.write_al_control(slave, u16::from(AlState::PreOp.raw()))
    }

    /// Requests OP of a slave in SAFEOP by its register AL control, and acknowledges its error: for a slave that
    /// rejected OP and whose cause was repaired there. The master does not request a state again that was
    /// rejected, and configures the slave from the beginning when it is asked to. Takes effect in later
    /// cycles. Real-time safe.
    ///
    /// # Errors
    /// The library's error; `EBUSY` while an earlier call has not taken effect.
    pub fn enter_op(&mut self, slave: usize) -> Result<(), CycleError> {
        self.write_al_control(slave, u16::from(AlState::Op.raw()) | ACKNOWLEDGE)
    }

    /// State of the last [`reconfigure`](Self::reconfigure).
    pub(super) fn reconfiguration_state(
        &mut self,
        slave: usize,
    ) -> Result<RequestState, CycleError> {
        let failed = CycleError::of_slave("ecrt_reg_request_state", slave);
        match self.slaves.get(slave).map(Slave::al_control) {
            Some(request) => self.master.requests().register_result(request).map_err(failed),
            None => Err(failed(Errno::EINVAL)),
        }
    }

    fn write_al_control(&mut self, slave: usize, value: u16) -> Result<(), CycleError> {
        let call = "ecrt_reg_request_write";
        let request = self.slaves.get(slave).map(Slave::al_control);
        let request = request.ok_or(CycleError::of_slave(call, slave)(Errno::EINVAL))?;
        // Ends the request of an earlier call.
        let _ = self.master.requests().register_result(request);
        self.master
            .requests()
            .register_write(request, AL_CONTROL, &value.to_le_bytes())
            .map_err(CycleError::of_slave(call, slave))
    }
}

/// Returns a slave by its index.
pub(super) fn find_slave(slaves: &[Slave], slave: usize) -> Result<&Slave, Error> {
    slaves.get(slave).ok_or(Error::SlaveIndex { slave, count: slaves.len() })
}
