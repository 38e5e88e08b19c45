//! The lock of an object that contexts name.
//!
//! The thread that runs the cycle has priority: it waits for a call of another thread, which
//! inherits its priority, and never gets an error because of one. Other threads get an error while
//! a call is in progress or an image is open, and for long calls from the wait to the end of a cycle.

use std::cell::Cell;
#[cfg(not(loom))]
use std::cell::UnsafeCell;
#[cfg(not(loom))]
use std::mem::MaybeUninit;
use std::sync::atomic::Ordering;
#[cfg(not(loom))]
use std::sync::atomic::{AtomicBool, AtomicU64};
#[cfg(not(loom))]
use std::thread_local;

#[cfg(not(loom))]
use libc::{c_int, pthread_mutex_t};
#[cfg(loom)]
use loom::{
    sync::atomic::{AtomicBool, AtomicU64},
    thread_local,
};

#[cfg(loom)]
use self::interleaving_tests::RobustMutex;

/// Attempts of the cycle thread before it sleeps in the kernel: a call of another thread that runs
/// takes less than a microsecond.
const ATTEMPTS: u32 = 64;

/// A lock that an open image keeps between the calls of its thread.
pub(crate) struct Guard {
    mutex: RobustMutex,
    /// The thread that has locked the mutex; 0 for none. Only that thread finds its own number.
    holder: AtomicU64,
    /// A call of the holder is in progress.
    is_in_call: AtomicBool,
    /// An open cycle keeps the mutex.
    is_kept: AtomicBool,
    /// The thread that runs the cycle; 0 for none so far.
    cycle_thread: AtomicU64,
    /// The cycle thread waits for its next cycle, or is in it.
    is_in_cycle: AtomicBool,
    /// Locked by the cycle thread meanwhile. When that thread ends, it is free before a join of the
    /// thread returns, which no question to the kernel for the thread itself promises.
    cycle: RobustMutex,
}

/// Kind of a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Access {
    /// Real-time safe, so short enough to let the cycle wait for it.
    Short,
    /// Not real-time safe: in the thread of the cycle only, while a cycle runs.
    Long,
}

/// Reason why a call cannot use the object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Busy {
    /// Another thread is in a call, or has a cycle open.
    OtherThread,
    /// A call of this thread is in progress: in a callback or a signal handler.
    ThisThread,
    /// A long call, or one that runs the cycle, while another thread waits for its next cycle or is in
    /// it.
    CycleRuns,
}

impl Busy {
    pub(crate) fn text(self) -> &'static str {
        match self {
            Self::OtherThread => {
                "the context is in use by another thread, in a call or an open cycle; other threads than \
                 that of the cycle use an ecan_igh_observer_t"
            }
            Self::ThisThread => {
                "a call with this context is in progress in this thread; a callback or a signal \
                 handler cannot use the context"
            }
            Self::CycleRuns => {
                "another thread runs the cycle; call this function in that thread, or after its last \
                 cycle"
            }
        }
    }
}

/// Number of this thread: never 0 and, unlike the system's, not used again after the thread's end.
#[inline]
fn this_thread() -> u64 {
    #[cfg(not(loom))]
    thread_local!(static NUMBER: Cell<u64> = const { Cell::new(0) });
    #[cfg(loom)]
    thread_local!(static NUMBER: Cell<u64> = Cell::new(0));
    static LAST: std::sync::atomic::AtomicU64 = std::sync::atomic::AtomicU64::new(0);
    NUMBER.with(|number| {
        if number.get() == 0 {
            number.set(LAST.fetch_add(1, Ordering::Relaxed) + 1);
        }
        number.get()
    })
}

impl Guard {
    /// A guard that [`init`](Self::init) makes usable.
    pub(crate) fn new() -> Self {
        Self {
            mutex: RobustMutex::new(),
            holder: AtomicU64::new(0),
            is_in_call: AtomicBool::new(false),
            is_kept: AtomicBool::new(false),
            cycle_thread: AtomicU64::new(0),
            is_in_cycle: AtomicBool::new(false),
            cycle: RobustMutex::new(),
        }
    }

    /// Prepares the mutexes at their final address, once.
    pub(crate) fn init(&'static self) {
        self.mutex.init();
        self.cycle.init();
    }

    /// Starts a call of this thread.
    #[inline]
    pub(crate) fn enter(&self, access: Access) -> Result<(), Busy> {
        let thread = this_thread();
        if self.holder.load(Ordering::Relaxed) != thread {
            self.lock(thread, access)?;
        } else if self.is_in_call.load(Ordering::Relaxed) {
            return Err(Busy::ThisThread);
        }
        self.is_in_call.store(true, Ordering::Relaxed);
        Ok(())
    }

    /// Ends the call that [`enter`](Self::enter) started. `has_open_cycle` keeps the guard for this
    /// thread, if it began the cycle.
    #[inline]
    pub(crate) fn leave(&self, has_open_cycle: bool) {
        self.is_in_call.store(false, Ordering::Relaxed);
        if !(has_open_cycle && self.is_kept.load(Ordering::Relaxed)) {
            self.unlock();
        }
    }

    fn unlock(&self) {
        self.is_kept.store(false, Ordering::Relaxed);
        self.holder.store(0, Ordering::Relaxed);
        self.mutex.unlock();
    }

    fn lock(&self, thread: u64, access: Access) -> Result<(), Busy> {
        let mut locked = self.mutex.try_lock();
        if locked == Locked::No && self.cycle_thread.load(Ordering::Relaxed) == thread {
            locked = self.wait_for_visitor();
        }
        match locked {
            Locked::Yes => {}
            // Its thread ended in an open cycle, which is no obstacle.
            Locked::OwnerEnded => self.is_in_call.store(false, Ordering::Relaxed),
            Locked::No => return Err(Busy::OtherThread),
        }
        self.holder.store(thread, Ordering::Relaxed);
        self.is_kept.store(false, Ordering::Relaxed);
        if access == Access::Long && self.has_other_cycle(thread) {
            self.unlock();
            return Err(Busy::CycleRuns);
        }
        Ok(())
    }

    #[cold]
    fn wait_for_visitor(&self) -> Locked {
        for _ in 0..ATTEMPTS {
            std::hint::spin_loop();
            let locked = self.mutex.try_lock();
            if locked != Locked::No {
                return locked;
            }
        }
        self.mutex.lock()
    }

    /// Returns true while another thread waits for its next cycle or is in it. Ends the cycle of a
    /// thread that has ended.
    fn has_other_cycle(&self, thread: u64) -> bool {
        if !self.is_in_cycle.load(Ordering::Relaxed)
            || self.cycle_thread.load(Ordering::Relaxed) == thread
        {
            return false;
        }
        if self.cycle.try_lock() == Locked::No {
            return true;
        }
        self.cycle.unlock();
        self.is_in_cycle.store(false, Ordering::Relaxed);
        false
    }

    /// Begins a cycle of this thread, which is in a call, or the wait for one.
    #[inline]
    pub(crate) fn begin_cycle(&self) -> Result<(), Busy> {
        let thread = this_thread();
        if self.has_other_cycle(thread) {
            return Err(Busy::CycleRuns);
        }
        if !self.is_in_cycle.load(Ordering::Relaxed) {
            self.cycle.try_lock();
            self.cycle_thread.store(thread, Ordering::Relaxed);
            self.is_in_cycle.store(true, Ordering::Relaxed);
        }
        Ok(())
    }

    /// Ends the cycle of this thread, which is in a call: other threads may run the next one.
    #[inline]
    pub(crate) fn end_cycle(&self) -> Result<(), Busy> {
        if self.has_other_cycle(this_thread()) {
            return Err(Busy::CycleRuns);
        }
        if self.is_in_cycle.load(Ordering::Relaxed) {
            self.is_in_cycle.store(false, Ordering::Relaxed);
            self.cycle.unlock();
        }
        Ok(())
    }

    /// Keeps the guard after this call, while a cycle is open.
    #[inline]
    pub(crate) fn keep(&self) {
        self.is_kept.store(true, Ordering::Relaxed);
    }

    /// Frees the guard for a sleep of this thread, which is in a call and has begun its cycle.
    pub(crate) fn sleep<R>(&self, sleep: impl FnOnce() -> R) -> R {
        self.leave(false);
        let slept = sleep();
        let thread = this_thread();
        // It succeeds at once: no other thread can begin a cycle or keep the guard during the sleep.
        while self.lock(thread, Access::Short).is_err() {}
        self.is_in_call.store(true, Ordering::Relaxed);
        slept
    }
}

/// Unusable until [`init`](Self::init).
#[cfg(not(loom))]
pub(crate) struct RobustMutex(UnsafeCell<MaybeUninit<pthread_mutex_t>>);

// SAFETY: the mutex is made for several threads.
#[cfg(not(loom))]
unsafe impl Sync for RobustMutex {}
// SAFETY: it moves only before `init`.
#[cfg(not(loom))]
unsafe impl Send for RobustMutex {}

/// Result of an attempt to lock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Locked {
    Yes,
    /// Locked, and the last owner ended without unlocking.
    #[cfg_attr(loom, allow(dead_code, reason = "no owner ends in the model"))]
    OwnerEnded,
    No,
}

#[cfg(not(loom))]
impl RobustMutex {
    pub(crate) const fn new() -> Self {
        Self(UnsafeCell::new(MaybeUninit::uninit()))
    }

    /// Prepares the mutex at its final address, once. Its owner inherits the priority of a thread
    /// that waits for it, where the system can do this.
    pub(crate) fn init(&'static self) {
        let settings = [libc::PTHREAD_PRIO_INHERIT, libc::PTHREAD_PRIO_NONE];
        let is_ready = settings.into_iter().any(|protocol| {
            let mut attributes = MaybeUninit::uninit();
            let attributes = attributes.as_mut_ptr();
            // SAFETY: the attributes are initialised by the first call; the mutex does not move and
            // has no user yet.
            unsafe {
                libc::pthread_mutexattr_init(attributes);
                libc::pthread_mutexattr_settype(attributes, libc::PTHREAD_MUTEX_ERRORCHECK);
                // Miri has neither of them.
                if !cfg!(miri) {
                    libc::pthread_mutexattr_setrobust(attributes, libc::PTHREAD_MUTEX_ROBUST);
                    libc::pthread_mutexattr_setprotocol(attributes, protocol);
                }
                let code = libc::pthread_mutex_init(self.pointer(), attributes);
                libc::pthread_mutexattr_destroy(attributes);
                code == 0
            }
        });
        assert!(is_ready, "the system rejects a mutex");
    }

    fn pointer(&self) -> *mut pthread_mutex_t {
        self.0.get().cast()
    }

    /// Locks the mutex if it is free.
    #[inline]
    pub(crate) fn try_lock(&self) -> Locked {
        // SAFETY: the mutex is initialised.
        let code = unsafe { libc::pthread_mutex_trylock(self.pointer()) };
        self.note_lock(code)
    }

    /// Waits for the mutex. Fails in a signal handler that interrupts the lock itself.
    pub(crate) fn lock(&self) -> Locked {
        // SAFETY: the mutex is initialised.
        let code = unsafe { libc::pthread_mutex_lock(self.pointer()) };
        self.note_lock(code)
    }

    #[inline]
    fn note_lock(&self, code: c_int) -> Locked {
        match code {
            0 => Locked::Yes,
            libc::EOWNERDEAD => {
                // SAFETY: this thread has locked the mutex.
                unsafe { libc::pthread_mutex_consistent(self.pointer()) };
                Locked::OwnerEnded
            }
            _ => Locked::No,
        }
    }

    /// Unlocks the mutex, which this thread has locked; otherwise nothing happens.
    #[inline]
    pub(crate) fn unlock(&self) {
        // SAFETY: the mutex is initialised, and checks its owner.
        unsafe { libc::pthread_mutex_unlock(self.pointer()) };
    }
}

#[cfg(loom)]
mod interleaving_tests;
