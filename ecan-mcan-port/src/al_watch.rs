//! AL state of a gateway, read from its register in the cycle.
//!
//! The working counter counts in SAFEOP as in OP, but in SAFEOP a gateway discards its RxPDO images,
//! and the slave state of the master lags by up to seconds. A read of the register AL status is a
//! datagram of the slave, not a mailbox transfer: it takes a few cycles.

use ecan_host::{Adapter, Error, RegRequestId, RequestState};
use ecan_protocol::device::AlState;

/// Register AL status (ETG.1000.4).
const AL_STATUS: u16 = 0x0130;
const AL_STATUS_BYTES: usize = 2;
/// Time from the start of a read to the start of the next one, in nanoseconds.
const INTERVAL_NS: u64 = 10_000_000;
/// Shortest time between two queries of a read, in nanoseconds.
const QUERY_NS: u64 = 1_000_000;

#[derive(Debug)]
pub(crate) struct AlWatch {
    slave: usize,
    request: RegRequestId,
    running: Option<Read>,
    next_ns: u64,
    is_below_op: bool,
    is_unnoticed: bool,
}

/// A read in progress.
#[derive(Debug, Clone, Copy)]
struct Read {
    mark: u64,
    begun_ns: u64,
    /// The state of the slave was OP for the master when the read began.
    is_op_for_master: bool,
}

impl AlWatch {
    /// Creates the request; the Adapter must be configured and not yet active.
    pub(crate) fn new(adapter: &mut Adapter, slave: usize) -> Result<Self, Error> {
        let request = adapter.create_register_request(slave, AL_STATUS_BYTES)?;
        Ok(Self {
            slave,
            request,
            running: None,
            next_ns: 0,
            is_below_op: false,
            is_unnoticed: false,
        })
    }

    /// Returns whether the gateway was below OP when its state was read last.
    pub(crate) fn is_below_op(&self) -> bool {
        self.is_below_op
    }

    /// Returns whether the gateway was below OP when its state was read last, and the master took it to
    /// be in OP: it polls no states while it reads the SDO dictionary of a slave.
    pub(crate) fn is_unnoticed(&self) -> bool {
        self.is_unnoticed
    }

    /// One step, once a cycle. Begins a read only while the gateway answers, since the master logs
    /// each one that fails. Returns the `mark` with which a read began that found OP: the gateway was
    /// in OP after that call.
    pub(crate) fn step(&mut self, adapter: &mut Adapter, answers: bool, mark: u64) -> Option<u64> {
        let now_ns = adapter.cycle_time_ns();
        if now_ns < self.next_ns {
            return None;
        }
        if self.running.is_none() && !answers {
            return None;
        }
        self.next_ns = now_ns.saturating_add(QUERY_NS);
        let Some(read) = self.running else {
            self.begin(adapter, mark, now_ns);
            return None;
        };
        let state = adapter.register_request_state(self.request);
        if state == Ok(RequestState::Busy) {
            return None;
        }
        self.running = None;
        self.next_ns = self.next_ns.max(read.begun_ns.saturating_add(INTERVAL_NS));
        let data = adapter.register_request_data(self.request);
        let (Ok(RequestState::Success), [low, ..]) = (state, data) else { return None };
        let is_op = AlState::from_status(u16::from(*low)) == Some(AlState::Op);
        self.is_below_op = !is_op;
        self.is_unnoticed = !is_op && read.is_op_for_master;
        is_op.then_some(read.mark)
    }

    fn begin(&mut self, adapter: &mut Adapter, mark: u64, now_ns: u64) {
        let state = adapter.slave_state(self.slave);
        let is_op_for_master = state.is_ok_and(|state| state.al_state == AlState::Op.raw());
        let begun = adapter.register_request_read(self.request, AL_STATUS, AL_STATUS_BYTES);
        self.running = begun.ok().map(|()| Read { mark, begun_ns: now_ns, is_op_for_master });
    }
}
