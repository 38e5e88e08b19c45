//! A mutex of the system that survives its owner, and lends it the priority of a waiting thread.

use std::cell::UnsafeCell;
use std::mem::MaybeUninit;

use libc::{c_int, pthread_mutex_t};

/// Result of an attempt to lock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Locked {
    Yes,
    /// Locked, and the last owner ended without unlocking.
    OwnerEnded,
    No,
}

/// Unusable until [`init`](Self::init).
pub(crate) struct RobustMutex(UnsafeCell<MaybeUninit<pthread_mutex_t>>);

// SAFETY: the mutex is made for several threads.
unsafe impl Sync for RobustMutex {}
// SAFETY: it moves only before `init`.
unsafe impl Send for RobustMutex {}

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
