//! Register requests: reading ESC registers in parallel with the cycle.

use std::ptr::NonNull;

use ecrt_sys::{Errno, ec_reg_request_t, status};

use super::{Master, RegRequestId, RequestState, SlaveConfigId};

/// Cycles after which a request that the library reports as busy is abandoned. A slave in OP answers
/// within a few; while the master configures the slave, the request waits, and is only started again.
const BUSY_CYCLES: u64 = 1_000;

/// A register request of a slave configuration.
///
/// IgH (1.5.2 to 1.6.2) reports a request as busy for ever if its configuration loses the slave while
/// the request is executed: the state machine of the slave forgets the request, and nothing else ends
/// it. Starting such a request again queues it for the slave that is attached next.
pub(super) struct RegRequest {
    raw: NonNull<ec_reg_request_t>,
    config: SlaveConfigId,
    size: usize,
    /// The request was started, and neither ended nor was abandoned.
    busy: bool,
    /// Cycle of the last start.
    started: u64,
}

impl Master {
    /// Creates a request for registers of the slave, up to `size` bytes. Before activation.
    pub fn create_reg_request(
        &mut self,
        config: SlaveConfigId,
        size: usize,
    ) -> Result<RegRequestId, Errno> {
        let raw_config = self.slave_config_raw(config)?;
        let functions = self.ecrt.functions();
        Errno::clear_last();
        // SAFETY: the configuration belongs to this master and is current, so it is valid.
        let raw = unsafe { (functions.slave_config_create_reg_request)(raw_config, size) };
        let raw = NonNull::new(raw).ok_or_else(Errno::of_null)?;
        // SAFETY: the request was just made.
        let data = unsafe { (functions.reg_request_data)(raw.as_ptr()) };
        if !data.is_null() {
            // SAFETY: the request holds `size` bytes there, which nobody uses yet. The library
            // leaves them as the allocator gave them; zeroed, they may be read.
            unsafe { std::ptr::write_bytes(data, 0, size) };
        }
        let id = RegRequestId { generation: self.generation, index: self.reg_requests.len() };
        self.reg_requests.push(RegRequest { raw, config, size, busy: false, started: 0 });
        Ok(id)
    }

    /// Starts reading `size` bytes from register `address` on. Real-time safe.
    ///
    /// # Errors
    /// `EBUSY` while it is running, `EMSGSIZE` for more than the request holds.
    pub fn reg_request_read(
        &mut self,
        id: RegRequestId,
        address: u16,
        size: usize,
    ) -> Result<(), Errno> {
        let request = self.reg_request(id)?;
        if request.busy {
            return Err(Errno::EBUSY);
        }
        if size > request.size {
            return Err(Errno::EMSGSIZE);
        }
        let raw = request.raw.as_ptr();
        // SAFETY: the request belongs to this master and is current, so it is valid, and it has
        // room for `size` bytes.
        Errno::check(unsafe {
            status!(self.ecrt.functions().reg_request_read, raw, address, size)
        })?;
        self.note_reg_request_start(id)
    }

    /// Starts writing `data` to the registers from `address` on. Real-time safe.
    ///
    /// # Errors
    /// `EBUSY` while it is running, `EMSGSIZE` for more than the request holds.
    pub fn reg_request_write(
        &mut self,
        id: RegRequestId,
        address: u16,
        data: &[u8],
    ) -> Result<(), Errno> {
        let request = self.reg_request(id)?;
        if request.busy {
            return Err(Errno::EBUSY);
        }
        if data.len() > request.size {
            return Err(Errno::EMSGSIZE);
        }
        let raw = request.raw.as_ptr();
        let functions = self.ecrt.functions();
        // SAFETY: the request belongs to this master and is current, so it is valid; it is not
        // running, so that nobody else uses its memory.
        unsafe {
            let memory = (functions.reg_request_data)(raw);
            if memory.is_null() {
                return Err(Errno::EINVAL);
            }
            // It has room for the data, which cannot overlap it: it is borrowed from elsewhere.
            std::ptr::copy(data.as_ptr(), memory, data.len());
            Errno::check(status!(functions.reg_request_write, raw, address, data.len()))?;
        }
        self.note_reg_request_start(id)
    }

    /// State of the request; fetches the data of a finished read. Real-time safe.
    pub fn reg_request_state(&mut self, id: RegRequestId) -> Result<RequestState, Errno> {
        let raw = self.reg_request(id)?.raw.as_ptr();
        // SAFETY: the request is valid as in `reg_request_read`; `self` is borrowed mutably, so
        // no slice of the data that the call may overwrite is alive.
        let state =
            RequestState::from_raw(unsafe { (self.ecrt.functions().reg_request_state)(raw) });
        if state != RequestState::Busy {
            self.reg_request_mut(id)?.busy = false;
        }
        Ok(state)
    }

    fn note_reg_request_start(&mut self, id: RegRequestId) -> Result<(), Errno> {
        let cycle = self.cycles;
        let request = self.reg_request_mut(id)?;
        (request.busy, request.started) = (true, cycle);
        Ok(())
    }

    /// Lets a request be started again that the library reports as busy, because its configuration lost
    /// the slave. Real-time safe.
    ///
    /// # Errors
    /// `EBADF` for a stale id.
    pub fn abandon_reg_request(&mut self, id: RegRequestId) -> Result<(), Errno> {
        self.reg_request_mut(id)?.busy = false;
        Ok(())
    }

    /// State of the request, which is abandoned if the library cannot end it: its slave is not attached,
    /// or it has been busy for [`BUSY_CYCLES`]. An abandoned request counts as failed and can be started
    /// again. Real-time safe.
    pub(crate) fn reg_request_result(&mut self, id: RegRequestId) -> Result<RequestState, Errno> {
        let state = self.reg_request_state(id)?;
        let request = self.reg_request(id)?;
        if state != RequestState::Busy {
            return Ok(state);
        }
        let is_overdue = self.cycles.saturating_sub(request.started) >= BUSY_CYCLES;
        if request.busy && !is_overdue && self.config_state(request.config)?.online {
            return Ok(state);
        }
        self.abandon_reg_request(id)?;
        Ok(RequestState::Error)
    }

    /// Counts a cycle of the application, in which the library can execute requests.
    pub(crate) fn count_cycle(&mut self) {
        self.cycles = self.cycles.wrapping_add(1);
    }

    /// All bytes that the request has room for; after a successful read the first of them are
    /// the registers, lowest address first. Empty for a stale id. Real-time safe.
    pub fn reg_request_data(&self, id: RegRequestId) -> &[u8] {
        let Ok(request) = self.reg_request(id) else {
            return &[];
        };
        // SAFETY: the request is valid as in `reg_request_read`.
        let data = unsafe { (self.ecrt.functions().reg_request_data)(request.raw.as_ptr()) };
        if data.is_null() {
            return &[];
        }
        // SAFETY: the request holds `size` bytes there, written when it was made; they change
        // only in calls that borrow `self` mutably.
        unsafe { std::slice::from_raw_parts(data, request.size) }
    }
}
