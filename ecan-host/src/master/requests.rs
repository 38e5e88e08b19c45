//! SDO and register requests: transfers in parallel with the cycle.

use std::ptr::NonNull;

use ecrt_sys::{
    EC_REQUEST_BUSY, EC_REQUEST_SUCCESS, EC_REQUEST_UNUSED, Errno, Functions, ec_reg_request_t,
    ec_request_state_t, ec_sdo_request_t, ec_slave_config_state_t, ec_slave_config_t, status,
};

use super::raw::{Answer, RegRequestId, SdoRequestId};

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
    fn from_raw(state: ec_request_state_t) -> Self {
        match state {
            EC_REQUEST_UNUSED => Self::Unused,
            EC_REQUEST_BUSY => Self::Busy,
            EC_REQUEST_SUCCESS => Self::Success,
            _ => Self::Error,
        }
    }
}

/// An SDO request, and whether it may be running.
struct SdoRequest {
    raw: NonNull<ec_sdo_request_t>,
    busy: bool,
}

impl SdoRequest {
    /// Returns the request for use, unless it is running: the library must not be disturbed then.
    fn idle(&self) -> Result<*mut ec_sdo_request_t, Errno> {
        if self.busy { Err(Errno::EBUSY) } else { Ok(self.raw.as_ptr()) }
    }
}

/// Cycles after which a request that the library reports as busy is abandoned. A slave in OP answers
/// within a few; while the master configures the slave, the request waits, and is only started again.
const BUSY_CYCLES: u64 = 1_000;

/// A register request of a slave configuration.
///
/// IgH (1.5.2 to 1.6.2) reports a request as busy for ever if its configuration loses the slave while
/// the request is executed: the state machine of the slave forgets the request, and nothing else ends
/// it. Starting such a request again queues it for the slave that is attached next.
struct RegRequest {
    raw: NonNull<ec_reg_request_t>,
    config: *mut ec_slave_config_t,
    size: usize,
    /// The request was started, and neither ended nor was abandoned.
    busy: bool,
    /// Cycle of the last start.
    started: u64,
}

impl RegRequest {
    /// Returns the request for use with `size` bytes, unless it is running.
    fn idle(&self, size: usize) -> Result<*mut ec_reg_request_t, Errno> {
        match size {
            _ if self.busy => Err(Errno::EBUSY),
            _ if size > self.size => Err(Errno::EMSGSIZE),
            _ => Ok(self.raw.as_ptr()),
        }
    }

    /// Returns whether a slave is attached to the configuration.
    fn is_online(&self, functions: &Functions) -> Result<bool, Errno> {
        let mut answer = Answer::<ec_slave_config_state_t>::new();
        // SAFETY: the configuration belongs to the master of the request and is current, so it is
        // valid; the target is writable.
        let status = unsafe { status!(functions.slave_config_state, self.config, answer.target()) };
        Errno::check(status).map(|()| answer.value.online() != 0)
    }
}

/// The requests that were created from a master, and the cycles in which they can be executed.
#[derive(Default)]
pub(super) struct RequestTable {
    /// Cycles of the application; see [`RegRequest`].
    cycles: u64,
    sdo: Vec<SdoRequest>,
    registers: Vec<RegRequest>,
}

impl RequestTable {
    pub(super) fn clear(&mut self) {
        self.sdo.clear();
        self.registers.clear();
    }

    /// Counts a cycle of the application, in which the library can execute requests.
    pub(super) fn count_cycle(&mut self) {
        self.cycles = self.cycles.wrapping_add(1);
    }

    /// Number of SDO and of register requests.
    pub(super) fn counts(&self) -> (usize, usize) {
        (self.sdo.len(), self.registers.len())
    }

    pub(super) fn add_sdo(
        &mut self,
        generation: u64,
        raw: NonNull<ec_sdo_request_t>,
    ) -> SdoRequestId {
        let id = SdoRequestId { generation, index: self.sdo.len() };
        self.sdo.push(SdoRequest { raw, busy: false });
        id
    }

    pub(super) fn add_register(
        &mut self,
        generation: u64,
        raw: NonNull<ec_reg_request_t>,
        config: *mut ec_slave_config_t,
        size: usize,
    ) -> RegRequestId {
        let id = RegRequestId { generation, index: self.registers.len() };
        self.registers.push(RegRequest { raw, config, size, busy: false, started: 0 });
        id
    }
}

/// Access to the requests that were created from a master, from [`Master::requests`].
///
/// [`Master::requests`]: crate::Master::requests
pub struct MasterRequests<'a> {
    pub(super) table: &'a mut RequestTable,
    pub(super) functions: &'a Functions,
    pub(super) generation: u64,
}

impl<'a> MasterRequests<'a> {
    fn sdo(&mut self, id: SdoRequestId) -> Result<&mut SdoRequest, Errno> {
        if id.generation != self.generation {
            return Err(Errno::EBADF);
        }
        self.table.sdo.get_mut(id.index).ok_or(Errno::EBADF)
    }

    /// Sets the time that the request may take, ms; 0 for no limit. Real-time safe.
    ///
    /// # Errors
    /// `EBUSY` while it is running.
    pub fn sdo_timeout(&mut self, id: SdoRequestId, timeout_ms: u32) -> Result<(), Errno> {
        let raw = self.sdo(id)?.idle()?;
        // SAFETY: the request belongs to this master and is current, so it is valid.
        Errno::check(unsafe { status!(self.functions.sdo_request_timeout, raw, timeout_ms) })
    }

    /// Points the request at another object. Real-time safe.
    ///
    /// # Errors
    /// `EBUSY` while it is running.
    pub fn sdo_index(&mut self, id: SdoRequestId, index: u16, subindex: u8) -> Result<(), Errno> {
        let raw = self.sdo(id)?.idle()?;
        // SAFETY: as in `sdo_timeout`.
        Errno::check(unsafe { status!(self.functions.sdo_request_index, raw, index, subindex) })
    }

    /// Starts reading the object. Real-time safe.
    ///
    /// # Errors
    /// `EBUSY` while it is running.
    pub fn sdo_read(&mut self, id: SdoRequestId) -> Result<(), Errno> {
        let raw = self.sdo(id)?.idle()?;
        // SAFETY: as in `sdo_timeout`.
        Errno::check(unsafe { status!(self.functions.sdo_request_read, raw) })?;
        self.sdo(id)?.busy = true;
        Ok(())
    }

    /// Starts writing `data` to the object. Real-time safe.
    ///
    /// # Errors
    /// `EBUSY` while it is running, `EMSGSIZE` when `data` has not exactly the size that the
    /// request holds.
    pub fn sdo_write(&mut self, id: SdoRequestId, data: &[u8]) -> Result<(), Errno> {
        let raw = self.sdo(id)?.idle()?;
        let functions = self.functions;
        // SAFETY: as in `sdo_timeout`.
        let (target, size) =
            unsafe { ((functions.sdo_request_data)(raw), (functions.sdo_request_data_size)(raw)) };
        if target.is_null() || size != data.len() {
            return Err(Errno::EMSGSIZE);
        }
        // SAFETY: the request holds `size` bytes there, as many as `data` has; it is not in
        // progress, so nobody else uses them, and `data` is not part of them, since a slice of them
        // borrows the master.
        unsafe { std::ptr::copy_nonoverlapping(data.as_ptr(), target, size) };
        // SAFETY: as in `sdo_timeout`.
        Errno::check(unsafe { status!(functions.sdo_request_write, raw) })?;
        self.sdo(id)?.busy = true;
        Ok(())
    }

    /// State of the request; fetches the data of a finished read. Real-time safe.
    pub fn sdo_state(&mut self, id: SdoRequestId) -> Result<RequestState, Errno> {
        let functions = self.functions;
        let request = self.sdo(id)?;
        // SAFETY: as in `sdo_timeout`; the master is borrowed mutably, so no slice of the data that the
        // call may overwrite is alive.
        let state = unsafe { (functions.sdo_request_state)(request.raw.as_ptr()) };
        let state = RequestState::from_raw(state);
        request.busy = state == RequestState::Busy;
        Ok(state)
    }

    /// Data of the request: after a successful read the value of the object. Empty for a
    /// stale id. Real-time safe.
    pub fn sdo_data(mut self, id: SdoRequestId) -> &'a [u8] {
        let functions = self.functions;
        let Ok(request) = self.sdo(id) else {
            return &[];
        };
        let raw = request.raw.as_ptr();
        // SAFETY: as in `sdo_timeout`.
        let (data, size) =
            unsafe { ((functions.sdo_request_data)(raw), (functions.sdo_request_data_size)(raw)) };
        if data.is_null() || size > isize::MAX as usize {
            return &[];
        }
        // SAFETY: the request holds `size` bytes there; they change only in calls that borrow
        // the master mutably, as the slice does.
        unsafe { std::slice::from_raw_parts(data, size) }
    }

    fn register(&mut self, id: RegRequestId) -> Result<&mut RegRequest, Errno> {
        if id.generation != self.generation {
            return Err(Errno::EBADF);
        }
        self.table.registers.get_mut(id.index).ok_or(Errno::EBADF)
    }

    fn note_register_start(&mut self, id: RegRequestId) -> Result<(), Errno> {
        let cycle = self.table.cycles;
        let request = self.register(id)?;
        (request.busy, request.started) = (true, cycle);
        Ok(())
    }

    /// Starts reading `size` bytes from register `address` on. Real-time safe.
    ///
    /// # Errors
    /// `EBUSY` while it is running, `EMSGSIZE` for more than the request holds.
    pub fn register_read(
        &mut self,
        id: RegRequestId,
        address: u16,
        size: usize,
    ) -> Result<(), Errno> {
        let raw = self.register(id)?.idle(size)?;
        // SAFETY: the request belongs to this master and is current, so it is valid, and it has
        // room for `size` bytes.
        Errno::check(unsafe { status!(self.functions.reg_request_read, raw, address, size) })?;
        self.note_register_start(id)
    }

    /// Starts writing `data` to the registers from `address` on. Real-time safe.
    ///
    /// # Errors
    /// `EBUSY` while it is running, `EMSGSIZE` for more than the request holds.
    pub fn register_write(
        &mut self,
        id: RegRequestId,
        address: u16,
        data: &[u8],
    ) -> Result<(), Errno> {
        let raw = self.register(id)?.idle(data.len())?;
        let functions = self.functions;
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
        self.note_register_start(id)
    }

    /// State of the request; fetches the data of a finished read. Real-time safe.
    pub fn register_state(&mut self, id: RegRequestId) -> Result<RequestState, Errno> {
        let functions = self.functions;
        let request = self.register(id)?;
        // SAFETY: the request is valid as in `register_read`; the master is borrowed mutably, so
        // no slice of the data that the call may overwrite is alive.
        let state = unsafe { (functions.reg_request_state)(request.raw.as_ptr()) };
        let state = RequestState::from_raw(state);
        if state != RequestState::Busy {
            request.busy = false;
        }
        Ok(state)
    }

    /// Lets a request be started again that the library reports as busy, because its configuration lost
    /// the slave. Real-time safe.
    ///
    /// # Errors
    /// `EBADF` for a stale id.
    pub fn abandon_register(&mut self, id: RegRequestId) -> Result<(), Errno> {
        self.register(id)?.busy = false;
        Ok(())
    }

    /// State of the request, which is abandoned if the library cannot end it: its slave is not attached,
    /// or it has been busy for [`BUSY_CYCLES`]. An abandoned request counts as failed and can be started
    /// again. Real-time safe.
    pub(crate) fn register_result(&mut self, id: RegRequestId) -> Result<RequestState, Errno> {
        let state = self.register_state(id)?;
        if state != RequestState::Busy {
            return Ok(state);
        }
        let (functions, cycles) = (self.functions, self.table.cycles);
        let request = self.register(id)?;
        let is_overdue = cycles.saturating_sub(request.started) >= BUSY_CYCLES;
        if request.busy && !is_overdue && request.is_online(functions)? {
            return Ok(state);
        }
        self.abandon_register(id)?;
        Ok(RequestState::Error)
    }

    /// All bytes that the request has room for; after a successful read the first of them are
    /// the registers, lowest address first. Empty for a stale id. Real-time safe.
    pub fn register_data(mut self, id: RegRequestId) -> &'a [u8] {
        let functions = self.functions;
        let Ok(request) = self.register(id) else {
            return &[];
        };
        // SAFETY: the request is valid as in `register_read`.
        let data = unsafe { (functions.reg_request_data)(request.raw.as_ptr()) };
        if data.is_null() {
            return &[];
        }
        // SAFETY: the request holds `size` bytes there, written when it was made; they change
        // only in calls that borrow the master mutably, as the slice does.
        unsafe { std::slice::from_raw_parts(data, request.size) }
    }
}
