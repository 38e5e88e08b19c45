//! The mutex as loom sees it: no owner ends.

use loom::sync::{Mutex, MutexGuard};
use loom::thread::{ThreadId, current, yield_now};

/// Result of an attempt to lock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Locked {
    Yes,
    #[allow(dead_code)]
    OwnerEnded,
    No,
}

/// The thread that has locked it.
pub(crate) struct RobustMutex(Mutex<Option<ThreadId>>);

impl RobustMutex {
    pub(crate) fn new() -> Self {
        Self(Mutex::new(None))
    }

    pub(crate) fn init(&'static self) {}

    fn owner(&self) -> MutexGuard<'_, Option<ThreadId>> {
        // infallible: no thread panics while it has the owner
        self.0.lock().unwrap()
    }

    pub(crate) fn try_lock(&self) -> Locked {
        let mut owner = self.owner();
        if owner.is_some() {
            return Locked::No;
        }
        *owner = Some(current().id());
        Locked::Yes
    }

    pub(crate) fn lock(&self) -> Locked {
        while self.try_lock() == Locked::No {
            yield_now();
        }
        Locked::Yes
    }

    pub(crate) fn unlock(&self) {
        let mut owner = self.owner();
        if *owner == Some(current().id()) {
            *owner = None;
        }
    }
}
