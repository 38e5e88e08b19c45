//! What the master does at a time: the handle that has reserved it, the pace of its state machines, the poll or
//! scan of the bus, the turn of the requests, those of blocking calls included, and the kernel log about it.

use std::collections::VecDeque;

use ecan_protocol::object::{AbortCode, describe};

use crate::ecrt::sdo_transfer::{MailboxTransfer, Pace, SdoFailure, SdoObject, TransferOwner};
use crate::ecrt::slaves::{Configs, RequestProgress, SlaveView};
use crate::ecrt::timing::{POLL_STEP_NS, THREAD_GAP_NS, TICK_NS};
use crate::scenario::MasterBehaviour;
use crate::world::Slot;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Phase {
    #[default]
    Idle,
    Reserved,
    /// Activated: the master's datagrams travel with the application's sends.
    Active,
}

/// The handles of the master, and the one that has reserved it.
#[derive(Debug, Default)]
pub(crate) struct Reservation {
    /// Another program has reserved the master.
    is_held_elsewhere: bool,
    phase: Phase,
    owner: Option<u64>,
    clients: u64,
}

impl Reservation {
    pub(super) fn new(is_held_elsewhere: bool) -> Self {
        Self { is_held_elsewhere, ..Self::default() }
    }

    /// Number of a new handle.
    pub(crate) fn new_client(&mut self) -> u64 {
        self.clients += 1;
        self.clients
    }

    pub(crate) fn phase(&self) -> Phase {
        self.phase
    }

    pub(crate) fn is_active(&self) -> bool {
        self.phase == Phase::Active
    }

    pub(crate) fn is_free(&self) -> bool {
        !self.is_held_elsewhere && self.owner.is_none()
    }

    pub(super) fn is_owner(&self, client: u64) -> bool {
        self.owner == Some(client)
    }

    pub(super) fn reserve(&mut self, client: u64) {
        (self.owner, self.phase) = (Some(client), Phase::Reserved);
    }

    pub(super) fn release(&mut self) {
        (self.owner, self.phase) = (None, Phase::Idle);
    }

    pub(super) fn activate(&mut self) {
        self.phase = Phase::Active;
    }

    pub(super) fn deactivate(&mut self) {
        if self.is_active() {
            self.phase = Phase::Reserved;
        }
    }

    /// Returns whether this handle can configure: it has reserved the master, which is not active.
    pub(crate) fn may_configure(&self, client: u64) -> Result<(), i32> {
        self.may_exchange(client)?;
        if self.is_active() { Err(libc::EBUSY) } else { Ok(()) }
    }

    pub(crate) fn may_exchange(&self, client: u64) -> Result<(), i32> {
        if self.is_owner(client) { Ok(()) } else { Err(libc::EPERM) }
    }
}

/// Steps of the master's state machines, which the application's sends advance in the operation phase.
#[derive(Debug, Default)]
pub(crate) struct Pacing {
    needs_gap: bool,
    idle_step_us: u32,
    /// Steps of the state machines in the operation phase.
    steps: u64,
    /// Every second send without a gap advances the state machines.
    has_half_step: bool,
    received_at: u64,
    sent_at: u64,
    /// Time between the last two sends.
    send_interval_ns: u64,
}

impl Pacing {
    pub(super) fn new(behaviour: &MasterBehaviour) -> Self {
        let MasterBehaviour { needs_gap, idle_step_us, .. } = *behaviour;
        Self { needs_gap, idle_step_us, ..Self::default() }
    }

    pub(super) fn steps(&self) -> u64 {
        self.steps
    }

    pub(super) fn note_receive(&mut self, now: u64) {
        self.received_at = now;
    }

    /// Returns whether the master's thread does not run between the last receive and a send now.
    fn lacks_gap(&self, now: u64) -> bool {
        self.needs_gap && now.saturating_sub(self.received_at) < THREAD_GAP_NS
    }

    /// Counts a send in the operation phase; returns whether the state machines advance with it.
    pub(super) fn advance_with_send(&mut self, now: u64) -> bool {
        self.send_interval_ns = now.saturating_sub(self.sent_at);
        self.sent_at = now;
        let advances = !self.lacks_gap(now) || self.has_half_step;
        self.has_half_step = !advances;
        self.steps = self.steps.wrapping_add(u64::from(advances));
        advances
    }

    /// Error of a clock that is written now. IgH adds whole ticks for the time since it read the slave's clock;
    /// without a gap between receive and send it has read it one interval ago.
    pub(super) fn clock_error_ns(&self, now: u64) -> u64 {
        if self.lacks_gap(now) { self.send_interval_ns % TICK_NS } else { 0 }
    }

    pub(super) fn begin_transfer(&self, now: u64) -> MailboxTransfer {
        MailboxTransfer::begin(now, self.steps)
    }

    pub(super) fn idle_step_ns(&self) -> u64 {
        u64::from(self.idle_step_us) * 1_000
    }

    pub(super) fn pace(&self, phase: Phase) -> Pace {
        match phase {
            Phase::Active => Pace::Sends(self.steps),
            Phase::Idle | Phase::Reserved => Pace::Timed(self.idle_step_ns()),
        }
    }
}

/// One round of state polling: a broadcast, and one read per slave.
pub(super) fn polling_round_ns(slaves: usize) -> u64 {
    (1 + slaves as u64) * POLL_STEP_NS
}

#[derive(Debug)]
pub(super) struct Scan {
    /// Slaves that responded at the begin of the scan.
    pub(super) slots: Vec<Slot>,
    pub(super) at: usize,
    pub(super) prepared: bool,
    /// The present slave was in INIT.
    pub(super) was_in_init: bool,
    /// The step in which the scan of a slave ends, in the operation phase.
    pub(super) until_step: u64,
}

/// Polling of the slaves, and the scan of the bus after a change.
#[derive(Debug, Default)]
pub(crate) struct BusScan {
    pub(super) scan: Option<Scan>,
    pub(super) poll_due: u64,
    /// A slave did not respond: the bus must be scanned when that is allowed.
    pub(super) is_required: bool,
    pub(super) responding: u32,
    pub(super) al_states: u8,
    /// The master was released: it scans the bus when it is idle.
    pub(super) scans_when_idle: bool,
}

impl BusScan {
    pub(crate) fn is_running(&self) -> bool {
        self.scan.is_some()
    }

    /// Number of slaves of the running scan.
    pub(crate) fn slave_count(&self) -> Option<usize> {
        self.scan.as_ref().map(|scan| scan.slots.len())
    }

    /// Number of slaves that responded to the last poll, and their AL states.
    pub(crate) fn responses(&self) -> (u32, u8) {
        (self.responding, self.al_states)
    }

    pub(super) fn poll_due(&self) -> u64 {
        self.poll_due
    }

    pub(super) fn poll_at(&mut self, time: u64) {
        self.poll_due = time;
    }

    pub(super) fn set_scan_when_idle(&mut self, scans: bool) {
        self.scans_when_idle = scans;
    }
}

/// A transfer that a blocking call waits for.
#[derive(Debug)]
pub(super) struct BlockingSdo {
    pub(super) id: u64,
    pub(super) position: usize,
    pub(super) object: SdoObject,
    /// Data to write; `None` reads.
    pub(super) download: Option<Vec<u8>>,
    /// Data read.
    pub(super) upload: Vec<u8>,
    pub(super) taken: bool,
    pub(super) result: Option<Result<(), SdoFailure>>,
}

/// Transfers of blocking calls, and the turn of the requests of configurations.
#[derive(Debug, Default)]
pub(crate) struct Requests {
    pub(super) blocking: Vec<BlockingSdo>,
    pub(super) next_blocking: u64,
    /// When the present round of state polling ends, after which internal requests are served.
    pub(super) round_ends: u64,
    /// The step in which the last internal request ended: the next one follows in the same.
    pub(super) last_ended: Option<u64>,
}

impl Requests {
    /// Queues a transfer for the slave at a position; returns its ID.
    pub(crate) fn queue_blocking(
        &mut self,
        slaves: &mut [SlaveView],
        position: usize,
        object: SdoObject,
        download: Option<Vec<u8>>,
        now: u64,
    ) -> Result<u64, SdoFailure> {
        let slave = slaves.get_mut(position).ok_or(SdoFailure::NO_SLAVE)?;
        slave.due = slave.due.min(now);
        self.next_blocking += 1;
        let id = self.next_blocking;
        self.blocking.push(BlockingSdo {
            id,
            position,
            object,
            download,
            upload: Vec::new(),
            taken: false,
            result: None,
        });
        Ok(id)
    }

    pub(crate) fn take_blocking(&mut self, id: u64) -> Option<Result<Vec<u8>, SdoFailure>> {
        let index = self.blocking.iter().position(|sdo| sdo.id == id)?;
        if self.blocking.get(index).is_some_and(|sdo| sdo.result.is_none()) {
            return None;
        }
        let BlockingSdo { result, upload, .. } = self.blocking.swap_remove(index);
        result.map(|result| result.map(|()| upload))
    }

    pub(crate) fn cancel_blocking(&mut self, id: u64) {
        self.blocking.retain(|sdo| sdo.id != id);
    }

    /// Lets the waiting transfers of blocking calls begin again.
    pub(super) fn restart(&mut self) {
        for sdo in &mut self.blocking {
            sdo.taken = false;
        }
    }

    /// Fails the running transfers of all slaves and waiting blocking transfers: the slave list
    /// will be cleared. Waiting requests belong to a configuration and stay. A register request that
    /// is being executed stays busy: as in IgH, the state machine of the slave is the only one that
    /// ends it, and a configuration that loses its slave takes the request from that state machine.
    pub(super) fn fail_all(
        &mut self,
        slaves: &mut [SlaveView],
        configs: &mut Configs,
        keeps_lost_requests: bool,
    ) {
        for sdo in &mut self.blocking {
            sdo.result.get_or_insert(Err(SdoFailure::UNANSWERED));
        }
        for slave in slaves {
            match slave.transfer.take().map(|transfer| transfer.owner) {
                Some(TransferOwner::Request(id)) => {
                    if let Some(entry) = configs.request(id) {
                        entry.progress = RequestProgress::Failure;
                    }
                }
                Some(TransferOwner::Register(_) | TransferOwner::Blocking(_)) | None => {}
            }
        }
        if keeps_lost_requests {
            let requests = configs.iter_mut().flat_map(|config| &mut config.reg_requests);
            for entry in requests.filter(|entry| entry.progress == RequestProgress::Queued) {
                entry.progress = RequestProgress::Busy;
            }
        }
    }

    pub(super) fn finish(
        &mut self,
        owner: TransferOwner,
        result: Result<(), SdoFailure>,
        configs: &mut Configs,
    ) {
        match owner {
            TransferOwner::Register(_) => {}
            TransferOwner::Blocking(id) => {
                if let Some(sdo) = self.blocking.iter_mut().find(|sdo| sdo.id == id) {
                    sdo.result = Some(result);
                }
            }
            TransferOwner::Request(id) => {
                if let Some(entry) = configs.request(id) {
                    entry.unfetched = result.is_ok() && !entry.writes;
                    entry.progress = if result.is_ok() {
                        RequestProgress::Success
                    } else {
                        RequestProgress::Failure
                    };
                }
            }
        }
    }
}

/// Lines that the kernel log keeps.
const LOG_LINES: usize = 1000;

/// The last lines that the master wrote to the kernel log.
#[derive(Debug, Default)]
pub(crate) struct KernelLog {
    lines: VecDeque<String>,
}

impl KernelLog {
    pub(crate) fn push(&mut self, line: String) {
        if self.lines.len() == LOG_LINES {
            self.lines.pop_front();
        }
        self.lines.push_back(line);
    }

    /// Writes a line about a slave.
    pub(crate) fn push_slave(&mut self, slave: usize, text: &str) {
        self.push(format!("EtherCAT 0-{slave}: {text}"));
    }

    /// Writes the failure of an SDO download to a slave.
    pub(crate) fn push_sdo(
        &mut self,
        slave: usize,
        what: &str,
        object: SdoObject,
        failure: SdoFailure,
    ) {
        let object = describe(object.index, object.subindex);
        let text = if failure == SdoFailure::NO_COE {
            format!("{what} {object}: the slave does not support CoE")
        } else if failure.abort_code == 0 {
            format!("{what} {object}: no response")
        } else {
            format!("{what} {object} aborted: {}", AbortCode(failure.abort_code))
        };
        self.push_slave(slave, &text);
    }

    /// The lines, oldest first.
    pub(crate) fn lines(&self) -> impl Iterator<Item = &str> {
        self.lines.iter().map(String::as_str)
    }
}
