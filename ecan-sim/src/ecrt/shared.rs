//! The world and its master under one lock, the passing of time, and threads in parallel with the one that moves
//! stepped time.
//!
//! A worker is a thread that opens a master of its own while another thread runs the cycle. Its
//! computing takes no simulated time: the clock stops until the worker waits in a blocking call or
//! releases its master. Otherwise the system's scheduler would decide in which cycle the worker
//! makes its next request, and two runs would differ. For other threads the clock waits only while
//! they check whether their call is done.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::thread::ThreadId;
use std::time::Duration;

use ecrt_sys::{Clock as _, MonotonicClock};

use super::master::{MasterModel, dictionary_ns};
use super::sdo_transfer::{SdoFailure, SdoObject};
use super::timing::{BLOCKED_GIVE_UP_NS, DICTIONARY_WAIT_NS, SCAN_BASE_NS, SCAN_SLAVE_NS};
use crate::backend_error::BackendError;
use crate::node::BridgeFactory;
use crate::random::WakeUps;
use crate::scenario::{ClockKind, EcrtVersion, Scenario};
use crate::world::{EPOCH_NS, World};

/// Longest step of a blocking call, to notice other threads.
const WAIT_STEP_NS: u64 = 10_000_000;
/// The same on an active bus, where another thread must run the cycle.
const ACTIVE_WAIT_STEP_NS: u64 = 1_000_000;
/// Longest wait in wall-clock time of a blocking call for another thread to run the cycle, and of
/// the stepped clock for a worker that computes.
const PATIENCE: Duration = Duration::from_secs(3);
/// The same with a blocked send queue.
const BLOCKED_PATIENCE: Duration = Duration::from_millis(500);
/// Time after power-on and scan in which the slaves reach PREOP.
const SETTLE_NS: u64 = 1_000_000_000;

pub(crate) struct State {
    pub(crate) world: World,
    pub(crate) master: MasterModel,
    threads: Threads,
}

impl State {
    /// When the master's state machines continue without a send of the application: never in the
    /// operation phase.
    fn machines_due(&self) -> u64 {
        if self.master.reservation.is_active() { u64::MAX } else { self.master.next_due() }
    }

    fn run_until(&mut self, to: u64) {
        loop {
            let due = self.machines_due().max(self.world.now_ns());
            if due > to {
                break;
            }
            self.world.advance(due);
            self.master.step(&mut self.world);
        }
        self.world.advance(to);
    }
}

/// A simulated master and its world, shared by every handle.
pub(crate) struct Shared {
    pub(crate) kind: ClockKind,
    pub(crate) version: EcrtVersion,
    /// Simulated time of the stepped clock, readable without the lock.
    now: AtomicU64,
    state: Mutex<State>,
    wake_ups: Mutex<Option<WakeUps>>,
    /// Notified when the stepped clock was moved.
    moved: Condvar,
    /// Notified when a thread that the stepped clock waits for stops computing.
    settled: Condvar,
}

impl Shared {
    /// Builds the world, and runs it until its gateways have booted and are scanned.
    pub(crate) fn new(
        scenario: &Scenario,
        kind: ClockKind,
        bridges: Option<BridgeFactory>,
    ) -> Result<Self, BackendError> {
        let gateways = scenario.gateways.iter().map(|gateway| gateway.config.boot_ms);
        let ios = scenario.ios.iter().map(|io| io.boot_ms);
        let boot_ms = gateways.chain(ios).max().unwrap_or(0);
        let slaves = scenario.gateways.len() + scenario.ios.len();
        let scans = SCAN_BASE_NS + SCAN_SLAVE_NS * slaves as u64;
        // the dictionaries have been fetched as well
        let fetches = match scenario.master.fetches_dictionary {
            true => DICTIONARY_WAIT_NS + dictionary_ns(scenario.gateways.len() as u64),
            false => 0,
        };
        let life = u64::from(boot_ms) * 1_000_000 + 2 * scans + fetches + SETTLE_NS;
        let birth = match kind {
            ClockKind::Stepped => EPOCH_NS,
            ClockKind::Real => MonotonicClock.now_ns().saturating_sub(life),
        };
        let mut state = State {
            world: World::new(scenario, birth, bridges)?,
            master: MasterModel::new(scenario),
            threads: Threads::default(),
        };
        state.run_until(birth + life);
        state.world.begin(&scenario.faults);
        Ok(Self {
            kind,
            version: scenario.version,
            now: AtomicU64::new(state.world.now_ns()),
            state: Mutex::new(state),
            wake_ups: Mutex::new(scenario.wake_up.map(|d| WakeUps::new(d, scenario.seed))),
            moved: Condvar::new(),
            settled: Condvar::new(),
        })
    }

    pub(crate) fn now_ns(&self) -> u64 {
        match self.kind {
            ClockKind::Stepped => self.now.load(Ordering::Acquire),
            ClockKind::Real => MonotonicClock.now_ns(),
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Accesses the world at the present time. With the real clock it catches up first.
    pub(crate) fn with<R>(&self, action: impl FnOnce(&mut State) -> R) -> R {
        let mut state = self.lock();
        if self.kind == ClockKind::Real {
            state.run_until(MonotonicClock.now_ns());
        }
        action(&mut state)
    }

    /// Sleeps until a time; this moves the stepped clock.
    pub(crate) fn sleep_until(&self, deadline: u64) {
        match self.kind {
            ClockKind::Real => MonotonicClock.sleep_until_ns(deadline),
            ClockKind::Stepped => {
                let is_worker = self.lock().threads.has_caller();
                if is_worker && self.sleep_as_worker(deadline) {
                    return;
                }
                let mut state = self.lock();
                if !is_worker {
                    state.threads.enter_cycle();
                }
                let mut waiter = Waiter::new(&state.threads);
                self.release_clock(&mut waiter, &mut state);
                let mut state = self.settle(state);
                self.step_to(&mut state, deadline);
                let mut state = self.settle(state);
                waiter.leave(&mut state.threads);
            }
        }
    }

    /// A worker lets the cycle's thread move the clock; false without such a thread.
    fn sleep_as_worker(&self, deadline: u64) -> bool {
        self.wait(|state, is_alone| {
            let is_over = state.world.now_ns() >= deadline;
            state.threads.has_cycle &= !is_alone;
            let has_cycle = state.threads.has_cycle && state.master.reservation.is_active();
            (is_over || !has_cycle).then_some(is_over)
        })
    }

    /// This thread moves the clock: no thread waits for it.
    fn release_clock(&self, waiter: &mut Waiter, state: &mut State) {
        waiter.release_clock(&mut state.threads);
        self.notify_settled(state);
    }

    /// Wakes the threads that wait in [`settle`](Self::settle). Without one it makes no system call,
    /// which notifying a condition variable always does.
    fn notify_settled(&self, state: &State) {
        if state.threads.settling > 0 {
            self.settled.notify_all();
        }
    }

    /// Waits until no thread computes that stepped time waits for, with a time limit.
    fn settle<'a>(&self, mut state: MutexGuard<'a, State>) -> MutexGuard<'a, State> {
        if state.threads.is_settled() {
            return state;
        }
        state.threads.settling += 1;
        let computes = |state: &mut State| !state.threads.is_settled();
        let settled = self.settled.wait_timeout_while(state, PATIENCE, computes);
        let (mut state, timeout) = settled.unwrap_or_else(PoisonError::into_inner);
        state.threads.settling -= 1;
        if timeout.timed_out() {
            state.threads.stop_waiting();
        }
        state
    }

    /// The calling thread opens a master: a new client. In stepped time it may be a worker from now
    /// on, see [`Threads`].
    pub(crate) fn open_client(&self) -> u64 {
        self.with(|state| {
            let client = state.master.reservation.new_client();
            if self.kind == ClockKind::Stepped && state.master.reservation.is_active() {
                state.threads.open(client);
            }
            client
        })
    }

    pub(crate) fn release_client(&self, client: u64) {
        self.with(|state| {
            state.master.release(client, &state.world);
            state.threads.release(client);
            self.notify_settled(state);
        });
    }

    /// Sleeps for the application: it wakes up late by the scenario's delay, reduced by a spin of
    /// `spin_ns` before the deadline.
    pub(crate) fn sleep_as_application(&self, deadline: u64, spin_ns: u64) {
        if self.kind == ClockKind::Real {
            return MonotonicClock.sleep_and_spin_until_ns(deadline, spin_ns);
        }
        let wakes_at = deadline.saturating_sub(spin_ns);
        let late = match &mut *self.wake_ups.lock().unwrap_or_else(PoisonError::into_inner) {
            Some(wake_ups) if wakes_at > self.now_ns() => wake_ups.next_ns(),
            _ => 0,
        };
        self.sleep_until(deadline.max(wakes_at.saturating_add(late)));
    }

    fn step_to(&self, state: &mut State, to: u64) {
        state.run_until(to);
        self.now.store(state.world.now_ns(), Ordering::Release);
        if state.threads.notify_moved() {
            self.moved.notify_all();
        }
    }

    /// Blocks until `poll` returns a result, while simulated time passes and the master works.
    ///
    /// On an active bus another thread must run the cycle, and in stepped time move the clock.
    /// `poll` gets `true` if none does.
    pub(crate) fn wait<R>(&self, mut poll: impl FnMut(&mut State, bool) -> Option<R>) -> R {
        let mut is_alone = false;
        let mut waiter = Waiter::new(&self.lock().threads);
        loop {
            let mut state = self.lock();
            if self.kind == ClockKind::Real {
                state.run_until(MonotonicClock.now_ns());
            }
            if let Some(result) = poll(&mut state, is_alone) {
                waiter.leave(&mut state.threads);
                self.notify_settled(&state);
                return result;
            }
            let active = state.master.reservation.is_active();
            if self.kind == ClockKind::Stepped && active {
                waiter.begin(&mut state.threads);
                self.notify_settled(&state);
                // a blocked queue needs no patience
                let patience =
                    if state.master.transport.is_blocked() { BLOCKED_PATIENCE } else { PATIENCE };
                let idle = |state: &mut State| !waiter.is_over(&state.threads);
                let waited = self.moved.wait_timeout_while(state, patience, idle);
                let (mut state, timeout) = waited.unwrap_or_else(PoisonError::into_inner);
                waiter.end(&mut state.threads);
                is_alone = timeout.timed_out();
                continue;
            }
            is_alone = false;
            let now = state.world.now_ns();
            let longest = if active { ACTIVE_WAIT_STEP_NS } else { WAIT_STEP_NS };
            let until = state.machines_due().clamp(now + 1, now + longest);
            match self.kind {
                ClockKind::Stepped => {
                    self.release_clock(&mut waiter, &mut state);
                    self.step_to(&mut state, until);
                }
                ClockKind::Real => {
                    drop(state);
                    MonotonicClock.sleep_until_ns(until);
                }
            }
        }
    }

    pub(crate) fn transfer(
        &self,
        position: u16,
        object: SdoObject,
        download: Option<Vec<u8>>,
    ) -> Result<Vec<u8>, SdoFailure> {
        let (id, mut moved_at, mut sends) = self.with(|state| {
            let now = state.world.now_ns();
            let (slaves, position) = (&mut state.master.slaves, usize::from(position));
            let id =
                state.master.requests.queue_blocking(slaves, position, object, download, now)?;
            Ok((id, now, state.master.transport.sends()))
        })?;
        self.wait(|state, is_alone| {
            let result = state.master.requests.take_blocking(id);
            if result.is_some() || !state.master.reservation.is_active() {
                return result;
            }
            // a blocked send queue never sends the mailbox datagrams
            if state.master.transport.sends() != sends && !state.master.transport.is_blocked() {
                (moved_at, sends) = (state.world.now_ns(), state.master.transport.sends());
            }
            let waited = state.world.now_ns().saturating_sub(moved_at);
            if !is_alone && waited <= BLOCKED_GIVE_UP_NS {
                return None;
            }
            state.master.requests.cancel_blocking(id);
            if !state.master.transport.is_blocked() {
                state.master.log.push(format!(
                    "simulator: cancelled a blocking transfer of slave {position} because the \
                     application does not send; a real master waits for ever"
                ));
            }
            Some(Err(SdoFailure { errno: libc::ETIMEDOUT, abort_code: 0 }))
        })
    }

    /// Reserves the master for a handle, after the scan and the slaves' transition to PREOP.
    pub(crate) fn reserve(&self, client: u64) -> Result<(), i32> {
        let claim = |state: &mut State, _| {
            if !state.master.reservation.is_free() {
                return Some(Err(libc::EBUSY));
            }
            if !state.master.is_settled() {
                return None;
            }
            state.master.reserve(client);
            Some(Ok(()))
        };
        self.wait(claim)
    }
}

#[derive(Debug, Default)]
pub(super) struct Threads {
    /// Thread and master handle of each worker.
    workers: Vec<(ThreadId, u64)>,
    /// The thread that moved the clock last and is no worker.
    cycle: Option<ThreadId>,
    /// True if that thread still does so.
    pub(super) has_cycle: bool,
    /// Threads that the clock waits for.
    computing: usize,
    /// Those among them that took too long: the clock does not wait for them a second time.
    overdue: usize,
    /// Threads that wait for the clock to move.
    waiting: usize,
    /// Threads that move the clock and wait for those that compute.
    pub(super) settling: usize,
    moves: u64,
}

impl Threads {
    /// The calling thread, no worker, moves the clock.
    pub(super) fn enter_cycle(&mut self) {
        self.cycle = Some(thread::current().id());
        self.has_cycle = true;
    }

    /// The calling thread has opened the master handle `client`; that makes it a worker if another
    /// thread runs the cycle.
    pub(super) fn open(&mut self, client: u64) {
        let caller = thread::current().id();
        if self.cycle.is_none_or(|cycle| cycle == caller) {
            return;
        }
        if !self.is_worker(caller) {
            self.computing += 1;
        }
        self.workers.push((caller, client));
    }

    /// A master handle is released, by whichever thread.
    pub(super) fn release(&mut self, client: u64) {
        let Some(at) = self.workers.iter().position(|worker| worker.1 == client) else { return };
        let (thread, _) = self.workers.swap_remove(at);
        if !self.is_worker(thread) {
            self.rest();
        }
    }

    fn is_worker(&self, thread: ThreadId) -> bool {
        self.workers.iter().any(|worker| worker.0 == thread)
    }

    pub(super) fn has_caller(&self) -> bool {
        !self.workers.is_empty() && self.is_worker(thread::current().id())
    }

    pub(super) fn is_settled(&self) -> bool {
        self.computing <= self.overdue
    }

    /// The clock has waited long enough for the threads that compute.
    pub(super) fn stop_waiting(&mut self) {
        self.overdue = self.computing;
    }

    /// The clock has moved: every waiting thread checks its call. Returns whether there is one.
    pub(super) fn notify_moved(&mut self) -> bool {
        self.moves = self.moves.wrapping_add(1);
        let waiting = std::mem::take(&mut self.waiting);
        self.computing += waiting;
        waiting > 0
    }

    /// One thread stops computing.
    fn rest(&mut self) {
        self.computing = self.computing.saturating_sub(1);
        self.overdue = self.overdue.min(self.computing);
    }
}

/// A thread in a blocking call.
#[derive(Debug)]
pub(super) struct Waiter {
    is_worker: bool,
    /// True if it is counted among those that compute.
    is_computing: bool,
    /// Moves of the clock when it began to wait.
    moves: u64,
}

impl Waiter {
    /// A call of the calling thread begins.
    pub(super) fn new(threads: &Threads) -> Self {
        let is_worker = threads.has_caller();
        Self { is_worker, is_computing: is_worker, moves: 0 }
    }

    /// Waits until the clock moves, and with it the state of the call.
    pub(super) fn begin(&mut self, threads: &mut Threads) {
        self.release_clock(threads);
        threads.waiting += 1;
        self.moves = threads.moves;
    }

    /// Returns whether the clock has moved since.
    pub(super) fn is_over(&self, threads: &Threads) -> bool {
        threads.moves != self.moves
    }

    /// The thread checks its call again, because the clock has moved or the wait timed out.
    pub(super) fn end(&mut self, threads: &mut Threads) {
        self.is_computing = true;
        if !self.is_over(threads) {
            threads.waiting = threads.waiting.saturating_sub(1);
            threads.computing += 1;
        }
    }

    /// The clock does not wait for the thread.
    pub(super) fn release_clock(&mut self, threads: &mut Threads) {
        if std::mem::take(&mut self.is_computing) {
            threads.rest();
        }
    }

    /// The call is done.
    pub(super) fn leave(mut self, threads: &mut Threads) {
        if self.is_worker && !self.is_computing {
            threads.computing += 1;
        } else if !self.is_worker {
            self.release_clock(threads);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clock_waits_for_a_computing_worker_only() {
        let mut threads = Threads::default();
        threads.enter_cycle();
        std::thread::scope(|scope| {
            let worker = scope.spawn(|| {
                threads.open(1);
                threads.open(2);
                assert!(threads.has_caller());
                let mut waiter = Waiter::new(&threads);
                waiter.begin(&mut threads);
                assert_eq!((threads.computing, threads.waiting), (0, 1));
                assert!(threads.notify_moved() && !threads.notify_moved());
                assert!(waiter.is_over(&threads));
                waiter.end(&mut threads);
                // The second check finds nothing, and the wait times out.
                waiter.begin(&mut threads);
                waiter.end(&mut threads);
                waiter.leave(&mut threads);
                assert_eq!((threads.computing, threads.waiting), (1, 0));
                threads.release(1);
                assert_eq!(threads.computing, 1, "it has another handle");
                threads.release(2);
                threads.release(2);
                assert_eq!(threads.computing, 0);
                threads.open(3);
            });
            worker.join().unwrap();
        });
        assert!(!threads.is_settled(), "handle 3 is open");
        assert!(!threads.has_caller(), "this thread runs the cycle");
        threads.stop_waiting();
        assert!(threads.is_settled());
        threads.release(3);
        assert_eq!((threads.computing, threads.overdue), (0, 0));
    }

    #[test]
    fn thread_without_a_worker_counts_only_while_it_checks() {
        let mut threads = Threads::default();
        threads.open(1);
        assert!(!threads.has_caller(), "no thread runs a cycle");
        threads.enter_cycle();
        threads.open(2);
        assert!(!threads.has_caller(), "it runs the cycle itself");
        let mut waiter = Waiter::new(&threads);
        waiter.begin(&mut threads);
        assert!(threads.is_settled());
        threads.notify_moved();
        waiter.end(&mut threads);
        assert!(!threads.is_settled());
        waiter.leave(&mut threads);
        assert!(threads.is_settled());
    }
}
