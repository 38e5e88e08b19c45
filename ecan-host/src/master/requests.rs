//! SDO requests: transfers in parallel with the cycle.

use std::ptr::NonNull;

use ecrt_sys::{
    EC_REQUEST_BUSY, EC_REQUEST_SUCCESS, EC_REQUEST_UNUSED, Errno, ec_request_state_t,
    ec_sdo_request_t, status,
};

use super::{Master, SdoRequestId, SlaveConfigId};

/// State of an SDO or register request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RequestState {
    /// Never started.
    Unused,
    /// Under way.
    Busy,
    /// Done; after a read the data is there.
    Success,
    /// Failed; why is in the kernel log only.
    Error,
}

impl RequestState {
    pub(super) fn from_raw(state: ec_request_state_t) -> Self {
        match state {
            EC_REQUEST_UNUSED => Self::Unused,
            EC_REQUEST_BUSY => Self::Busy,
            EC_REQUEST_SUCCESS => Self::Success,
            _ => Self::Error,
        }
    }
}

/// A request, and whether it may be running.
pub(super) struct SdoRequest {
    raw: NonNull<ec_sdo_request_t>,
    busy: bool,
}

impl SdoRequest {
    /// The request for use, unless it is in progress: the library must not be disturbed then.
    fn idle(&self) -> Result<*mut ec_sdo_request_t, Errno> {
        if self.busy { Err(Errno::EBUSY) } else { Ok(self.raw.as_ptr()) }
    }
}

impl Master {
    /// Creates a request for an object of `size` bytes. Before activation.
    ///
    /// A write always has the size that the request holds: the `size` given here, and after a
    /// read the size that was read. So make one request for each size that is to be written.
    pub fn create_sdo_request(
        &mut self,
        config: SlaveConfigId,
        index: u16,
        subindex: u8,
        size: usize,
    ) -> Result<SdoRequestId, Errno> {
        let config = self.slave_config_raw(config)?;
        Errno::clear_last();
        // SAFETY: the configuration belongs to this master and is current, so it is valid.
        let raw = unsafe {
            (self.ecrt.functions().slave_config_create_sdo_request)(config, index, subindex, size)
        };
        let raw = NonNull::new(raw).ok_or_else(Errno::of_null)?;
        let functions = self.ecrt.functions();
        // SAFETY: the request was just made.
        let (data, held) = unsafe {
            (
                (functions.sdo_request_data)(raw.as_ptr()),
                (functions.sdo_request_data_size)(raw.as_ptr()),
            )
        };
        if !data.is_null() {
            // SAFETY: the request holds `held` bytes there, which nobody uses yet. The library
            // leaves them as the allocator gave them; zeroed, they may be read.
            unsafe { std::ptr::write_bytes(data, 0, held) };
        }
        let id = SdoRequestId { generation: self.generation, index: self.sdo_requests.len() };
        self.sdo_requests.push(SdoRequest { raw, busy: false });
        Ok(id)
    }

    /// Sets the time that the request may take, ms; 0 for no limit. Real-time safe.
    ///
    /// # Errors
    /// `EBUSY` while it is running.
    pub fn sdo_request_timeout(&mut self, id: SdoRequestId, timeout_ms: u32) -> Result<(), Errno> {
        let raw = self.sdo_request(id)?.idle()?;
        // SAFETY: the request belongs to this master and is current, so it is valid.
        Errno::check(unsafe { status!(self.ecrt.functions().sdo_request_timeout, raw, timeout_ms) })
    }

    /// Points the request at another object. Real-time safe.
    ///
    /// # Errors
    /// `EBUSY` while it is running.
    pub fn sdo_request_index(
        &mut self,
        id: SdoRequestId,
        index: u16,
        subindex: u8,
    ) -> Result<(), Errno> {
        let raw = self.sdo_request(id)?.idle()?;
        // SAFETY: as in `sdo_request_timeout`.
        Errno::check(unsafe {
            status!(self.ecrt.functions().sdo_request_index, raw, index, subindex)
        })
    }

    /// Starts reading the object. Real-time safe.
    ///
    /// # Errors
    /// `EBUSY` while it is running.
    pub fn sdo_request_read(&mut self, id: SdoRequestId) -> Result<(), Errno> {
        let raw = self.sdo_request(id)?.idle()?;
        // SAFETY: as in `sdo_request_timeout`.
        Errno::check(unsafe { status!(self.ecrt.functions().sdo_request_read, raw) })?;
        self.sdo_request_mut(id)?.busy = true;
        Ok(())
    }

    /// Starts writing `data` to the object. Real-time safe.
    ///
    /// # Errors
    /// `EBUSY` while it is running, `EMSGSIZE` when `data` has not exactly the size that the
    /// request holds.
    pub fn sdo_request_write(&mut self, id: SdoRequestId, data: &[u8]) -> Result<(), Errno> {
        let raw = self.sdo_request(id)?.idle()?;
        let functions = self.ecrt.functions();
        // SAFETY: as in `sdo_request_timeout`.
        let (target, size) =
            unsafe { ((functions.sdo_request_data)(raw), (functions.sdo_request_data_size)(raw)) };
        if target.is_null() || size != data.len() {
            return Err(Errno::EMSGSIZE);
        }
        // SAFETY: the request holds `size` bytes there, as many as `data` has; it is not in
        // progress, so nobody else uses them, and `data` is not part of them, since a slice of them
        // borrows `self`.
        unsafe { std::ptr::copy_nonoverlapping(data.as_ptr(), target, size) };
        // SAFETY: as in `sdo_request_timeout`.
        Errno::check(unsafe { status!(functions.sdo_request_write, raw) })?;
        self.sdo_request_mut(id)?.busy = true;
        Ok(())
    }

    /// State of the request; fetches the data of a finished read. Real-time safe.
    pub fn sdo_request_state(&mut self, id: SdoRequestId) -> Result<RequestState, Errno> {
        let raw = self.sdo_request(id)?.raw.as_ptr();
        // SAFETY: as in `sdo_request_timeout`; `self` is borrowed mutably, so no slice of the
        // data that the call may overwrite is alive.
        let state = unsafe { (self.ecrt.functions().sdo_request_state)(raw) };
        let state = RequestState::from_raw(state);
        self.sdo_request_mut(id)?.busy = state == RequestState::Busy;
        Ok(state)
    }

    /// Data of the request: after a successful read the value of the object. Empty for a
    /// stale id. Real-time safe.
    pub fn sdo_request_data(&self, id: SdoRequestId) -> &[u8] {
        let Ok(request) = self.sdo_request(id) else {
            return &[];
        };
        let functions = self.ecrt.functions();
        let raw = request.raw.as_ptr();
        // SAFETY: as in `sdo_request_timeout`.
        let (data, size) =
            unsafe { ((functions.sdo_request_data)(raw), (functions.sdo_request_data_size)(raw)) };
        if data.is_null() || size > isize::MAX as usize {
            return &[];
        }
        // SAFETY: the request holds `size` bytes there; they change only in calls that borrow
        // `self` mutably.
        unsafe { std::slice::from_raw_parts(data, size) }
    }
}
