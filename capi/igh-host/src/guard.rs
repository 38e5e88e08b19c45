//! The lock of an object that contexts name.
//!
//! The thread that runs the cycle has priority: it waits for a call of another thread, which
//! inherits its priority, and never gets an error because of one. Other threads get an error while
//! a call is in progress or an image is open, and for long calls from the wait to the end of a cycle.

use std::cell::Cell;
use std::sync::atomic::Ordering;
#[cfg(not(loom))]
use std::sync::atomic::{AtomicBool, AtomicU64};
#[cfg(not(loom))]
use std::thread_local;

#[cfg(loom)]
use loom::{
    sync::atomic::{AtomicBool, AtomicU64},
    thread_local,
};

use self::robust_mutex::{Locked, RobustMutex};

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

#[cfg(all(test, loom))]
mod interleaving_tests;
#[cfg_attr(loom, path = "guard/model_mutex.rs")]
mod robust_mutex;
