//! AL state of a gateway, read from its register in the cycle.
//!
//! The working counter counts in SAFEOP as in OP, but in SAFEOP a gateway discards its RxPDO images,
//! and the slave state of the master lags by up to seconds. A read of the register AL status is a
//! datagram of the slave, not a mailbox transfer: it takes a few cycles.
//!
//! A library may never end a read that it was executing when the slave went away. The Adapter abandons
//! such a read, and the next one starts. While none succeeds, the state of the slave counts that the
//! master reports, and images stay unproven for a limited number of cycles.

use ecan_host::{Adapter, Error, RegRequestId, RequestState};
use ecan_protocol::device::AlState;

/// Register AL status (ETG.1000.4).
const AL_STATUS: u16 = 0x0130;
const AL_STATUS_BYTES: usize = 2;
/// Time from the start of a read to the start of the next one, in nanoseconds.
const INTERVAL_NS: u64 = 10_000_000;
/// Shortest time between two queries of a read, in nanoseconds.
const QUERY_NS: u64 = 1_000_000;
/// Reads in a row without a result after which the last result no longer counts.
const MAX_FAILED_READS: u32 = 3;
/// Cycles after which images count as unproven for good if no read has found OP. A scan of the bus, during
/// which the master executes no reads, takes at most 7000 cycles per gateway.
const UNPROVEN_CYCLES: u64 = 10_000;

/// Result of a step about the images up to this number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Proof {
    /// The gateway was in OP when it took the images.
    Proven(u64),
    /// No read shows the state in which the gateway took the images.
    Unproven(u64),
}

#[derive(Debug)]
pub(crate) struct AlWatch {
    slave: usize,
    request: RegRequestId,
    running: Option<Read>,
    next_ns: u64,
    is_below_op: bool,
    is_unnoticed: bool,
    /// Reads in a row that failed or were abandoned.
    failed_reads: u32,
    /// Mark of a read that was abandoned. The library may still execute it, and its result may end the next
    /// read.
    abandoned: Option<u64>,
    cycles: u64,
    /// Mark and cycle from which no read has found OP.
    unproven: Option<(u64, u64)>,
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
        let request = adapter.requests().create_register(slave, AL_STATUS_BYTES)?;
        Ok(Self {
            slave,
            request,
            running: None,
            next_ns: 0,
            is_below_op: false,
            is_unnoticed: false,
            failed_reads: 0,
            abandoned: None,
            cycles: 0,
            unproven: None,
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
    /// each one that fails. `mark`: the last image that a gateway which is in OP from now on has parsed.
    pub(crate) fn step(
        &mut self,
        adapter: &mut Adapter,
        answers: bool,
        mark: u64,
    ) -> Option<Proof> {
        self.cycles += 1;
        let (unproven_mark, since) = *self.unproven.get_or_insert((mark, self.cycles));
        if self.cycles - since >= UNPROVEN_CYCLES {
            self.unproven = None;
            return Some(Proof::Unproven(unproven_mark));
        }
        let now_ns = adapter.cycle_time_ns();
        if now_ns < self.next_ns {
            return None;
        }
        let Some(read) = self.running else {
            if answers {
                self.next_ns = now_ns.saturating_add(QUERY_NS);
                self.begin(adapter, mark, now_ns);
            }
            return None;
        };
        self.next_ns = now_ns.saturating_add(QUERY_NS);
        let state = adapter.requests().register_state(self.request);
        if state == Ok(RequestState::Busy) {
            return None;
        }
        self.running = None;
        self.next_ns = self.next_ns.max(read.begun_ns.saturating_add(INTERVAL_NS));
        let data = adapter.requests().register_data(self.request);
        let (Ok(RequestState::Success), [low, ..]) = (state, data) else {
            self.note_failure(read.mark);
            return None;
        };
        let is_op = AlState::from_status(u16::from(*low)) == Some(AlState::Op);
        (self.failed_reads, self.abandoned) = (0, None);
        self.is_below_op = !is_op;
        self.is_unnoticed = !is_op && read.is_op_for_master;
        if !is_op {
            return None;
        }
        self.unproven = None;
        Some(Proof::Proven(read.mark))
    }

    fn note_failure(&mut self, mark: u64) {
        self.abandoned = Some(mark);
        self.failed_reads += 1;
        if self.failed_reads >= MAX_FAILED_READS {
            (self.is_below_op, self.is_unnoticed) = (false, false);
        }
    }

    /// Begins a read, unless the master has no slave for the configuration: it scans the bus.
    fn begin(&mut self, adapter: &mut Adapter, mark: u64, now_ns: u64) {
        let state = adapter.slave_state(self.slave).ok();
        if state.is_some_and(|state| !state.online) {
            return;
        }
        let is_op_for_master = state.is_some_and(|state| state.al_state == AlState::Op.raw());
        let mark = self.abandoned.unwrap_or(mark);
        match adapter.requests().register_read(self.request, AL_STATUS, AL_STATUS_BYTES) {
            Ok(()) => self.running = Some(Read { mark, begun_ns: now_ns, is_op_for_master }),
            Err(_) => {
                self.next_ns = now_ns.saturating_add(INTERVAL_NS);
                self.note_failure(mark);
            }
        }
    }
}
