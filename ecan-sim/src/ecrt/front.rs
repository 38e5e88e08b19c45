//! The world and its master behind one lock, and how time passes for them.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use ecrt_sys::{Clock as _, MonotonicClock};

use crate::backend::BackendError;
use crate::ecrt::master::{MasterModel, Phase};
use crate::ecrt::sdo::SdoFailure;
use crate::ecrt::timing::{BLOCKED_GIVE_UP_NS, SCAN_BASE_NS, SCAN_SLAVE_NS};
use crate::scenario::{ClockKind, EcrtVersion, Scenario};
use crate::world::{EPOCH_NS, World};

/// Longest step of a blocking call, so that it sees what other threads do.
const WAIT_STEP_NS: u64 = 10_000_000;
/// How long a blocking call waits in wall-clock time for another thread to run the cycle.
const PATIENCE: Duration = Duration::from_secs(1);
/// Time after power-on and scan in which the slaves reach PREOP.
const SETTLE_NS: u64 = 1_000_000_000;

/// The world and its master.
pub(crate) struct State {
    pub(crate) world: World,
    pub(crate) master: MasterModel,
}

impl State {
    /// When the master's state machines go on without a send of the application, if they do.
    ///
    /// In the operation phase they move with the sends, unless `forced`; behind a blocked send
    /// queue they do not move at all.
    fn machines_due(&self, forced: bool) -> u64 {
        match self.master.phase {
            Phase::Active if !forced || self.master.blocked => u64::MAX,
            _ => self.master.next_due(),
        }
    }

    /// Lets time pass up to `to`.
    fn run_until(&mut self, to: u64, forced: bool) {
        loop {
            let due = self.machines_due(forced).max(self.world.now_ns());
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
    kind: ClockKind,
    version: EcrtVersion,
    /// Simulated time of the stepped clock, readable without the lock.
    now: AtomicU64,
    state: Mutex<State>,
    /// Told whenever the stepped clock was moved.
    moved: Condvar,
}

impl Shared {
    /// Builds the world, and lets it live until its gateways have booted and are scanned.
    pub(crate) fn new(scenario: &Scenario, kind: ClockKind) -> Result<Self, BackendError> {
        let gateways = scenario.gateways.iter();
        let boot_ms = gateways.map(|gateway| gateway.settings.boot_ms).max().unwrap_or(0);
        let scans = SCAN_BASE_NS + SCAN_SLAVE_NS * scenario.gateways.len() as u64;
        let life = u64::from(boot_ms) * 1_000_000 + 2 * scans + SETTLE_NS;
        let birth = match kind {
            ClockKind::Stepped => EPOCH_NS,
            ClockKind::Real => MonotonicClock.now_ns().saturating_sub(life),
        };
        let mut state =
            State { world: World::new(scenario, birth)?, master: MasterModel::new(scenario) };
        state.run_until(birth + life, false);
        state.world.begin(&scenario.faults);
        Ok(Self {
            kind,
            version: scenario.version,
            now: AtomicU64::new(state.world.now_ns()),
            state: Mutex::new(state),
            moved: Condvar::new(),
        })
    }

    pub(crate) fn clock_kind(&self) -> ClockKind {
        self.kind
    }

    pub(crate) fn version(&self) -> EcrtVersion {
        self.version
    }

    /// Simulated time.
    pub(crate) fn now_ns(&self) -> u64 {
        match self.kind {
            ClockKind::Stepped => self.now.load(Ordering::Acquire),
            ClockKind::Real => MonotonicClock.now_ns(),
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The world as it is now. With the real clock it catches up first; the stepped one stands
    /// still.
    pub(crate) fn with<R>(&self, action: impl FnOnce(&mut State) -> R) -> R {
        let mut state = self.lock();
        if self.kind == ClockKind::Real {
            state.run_until(MonotonicClock.now_ns(), false);
        }
        action(&mut state)
    }

    /// Sleeps until a time. This is what moves the stepped clock.
    pub(crate) fn sleep_until(&self, deadline: u64) {
        match self.kind {
            ClockKind::Real => MonotonicClock.sleep_until_ns(deadline),
            ClockKind::Stepped => {
                self.step_to(&mut self.lock(), deadline, false);
                self.moved.notify_all();
            }
        }
    }

    fn step_to(&self, state: &mut State, to: u64, forced: bool) {
        state.run_until(to, forced);
        self.now.store(state.world.now_ns(), Ordering::Release);
    }

    /// Blocks until `poll` gives something, while simulated time passes and the master works.
    ///
    /// On an active bus in stepped time it is up to another thread to run the cycle; only when
    /// none does, the call moves time itself.
    pub(crate) fn wait<R>(&self, mut poll: impl FnMut(&mut State) -> Option<R>) -> R {
        let mut is_alone = false;
        loop {
            let mut state = self.lock();
            if self.kind == ClockKind::Real {
                state.run_until(MonotonicClock.now_ns(), true);
            }
            if let Some(result) = poll(&mut state) {
                return result;
            }
            if self.kind == ClockKind::Stepped && state.master.phase == Phase::Active && !is_alone {
                let sends = state.master.sends;
                let idle = |state: &mut State| {
                    state.master.sends == sends && state.master.phase == Phase::Active
                };
                let waited = self.moved.wait_timeout_while(state, PATIENCE, idle);
                is_alone = waited.unwrap_or_else(PoisonError::into_inner).1.timed_out();
                continue;
            }
            let now = state.world.now_ns();
            let until = state.machines_due(true).clamp(now + 1, now + WAIT_STEP_NS);
            match self.kind {
                ClockKind::Stepped => self.step_to(&mut state, until, true),
                ClockKind::Real => {
                    drop(state);
                    MonotonicClock.sleep_until_ns(until);
                }
            }
        }
    }

    /// A blocking SDO transfer.
    pub(crate) fn transfer(
        &self,
        position: u16,
        index: u16,
        subindex: u8,
        download: Option<Vec<u8>>,
    ) -> Result<Vec<u8>, SdoFailure> {
        let (id, begun, sends) = self.with(|state| {
            let now = state.world.now_ns();
            let id = state.master.queue_blocking(
                usize::from(position),
                index,
                subindex,
                download,
                now,
            )?;
            Ok((id, now, state.master.sends))
        })?;
        self.wait(|state| {
            if let Some(result) = state.master.take_blocking(id) {
                if state.master.phase == Phase::Active && state.master.sends == sends {
                    state.master.log_line(format!(
                        "simulator: a blocking transfer of slave {position} ended without a send \
                         of the application; on a real master it would have waited for one"
                    ));
                }
                return Some(result);
            }
            // Behind a blocked send queue the mailbox datagrams never leave.
            let waited = state.world.now_ns().saturating_sub(begun);
            if state.master.blocked && waited > BLOCKED_GIVE_UP_NS {
                state.master.forget_blocking(id);
                return Some(Err(SdoFailure { errno: libc::ETIMEDOUT, abort_code: 0 }));
            }
            None
        })
    }

    /// Reserves the master, after a scan and the slaves' way to PREOP have ended.
    pub(crate) fn request(&self) -> Result<u64, i32> {
        let claim = |state: &mut State| {
            if !state.master.is_free() {
                return Some(Err(libc::EBUSY));
            }
            if !state.master.is_settled() {
                return None;
            }
            let client = state.master.new_client();
            state.master.reserve(client);
            Some(Ok(client))
        };
        self.wait(claim)
    }
}
