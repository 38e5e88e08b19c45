//! Every order in which threads use the guard, by loom, with a model of its mutex: no owner ends.

use loom::sync::{Mutex, MutexGuard};
use loom::thread::{ThreadId, current, yield_now};

use super::Locked;

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

#[cfg(test)]
mod tests {
    use loom::cell::UnsafeCell;
    use loom::thread;

    use super::super::{Access, Busy, Guard};

    /// Explores all orders in which a thread is interrupted at most twice.
    fn explore(model: impl Fn() + Sync + Send + 'static) {
        let mut builder = loom::model::Builder::new();
        builder.preemption_bound = Some(2);
        builder.check(model);
    }

    struct Object {
        guard: Guard,
        content: UnsafeCell<u32>,
    }

    // SAFETY: the content is reached only by the thread that has entered the guard.
    unsafe impl Sync for Object {}

    impl Object {
        /// Lives to the end of the program, as slots do.
        fn new() -> &'static Self {
            Box::leak(Box::new(Self { guard: Guard::new(), content: UnsafeCell::new(0) }))
        }

        /// Changes the content in a call; loom finds a change in another thread meanwhile.
        fn call(&self, access: Access) -> Result<(), Busy> {
            self.guard.enter(access)?;
            self.change();
            self.guard.leave(false);
            Ok(())
        }

        fn change(&self) {
            // SAFETY: this thread has entered the guard.
            self.content.with_mut(|content| unsafe { *content += 1 });
        }

        /// A cycle of three calls, which keeps the object between its begin and its end.
        fn run_cycle(&self) {
            self.guard.enter(Access::Short).unwrap();
            self.guard.begin_cycle().unwrap();
            self.guard.keep();
            self.change();
            self.guard.leave(true);
            self.guard.enter(Access::Short).unwrap();
            self.change();
            self.guard.leave(true);
            self.guard.enter(Access::Short).unwrap();
            self.change();
            self.guard.end_cycle().unwrap();
            self.guard.leave(false);
        }
    }

    #[test]
    fn calls_of_two_threads_exclude_each_other() {
        explore(|| {
            let object = Object::new();
            let other = thread::spawn(|| object.call(Access::Short).is_ok());
            let is_first = object.call(Access::Long).is_ok();
            let is_second = other.join().unwrap();
            assert!(is_first || is_second);
            assert_eq!(object.call(Access::Short), Ok(()));
        });
    }

    #[test]
    fn cycle_thread_is_never_rejected() {
        explore(|| {
            let object = Object::new();
            // From the first cycle on this is the thread of the cycle.
            object.run_cycle();
            let other = thread::spawn(|| (object.call(Access::Short), object.call(Access::Long)));
            object.run_cycle();
            let (short, long) = other.join().unwrap();
            assert!([Ok(()), Err(Busy::OtherThread)].contains(&short), "{short:?}");
            assert_ne!(long, Err(Busy::ThisThread));
            assert_eq!(object.call(Access::Long), Ok(()));
        });
    }

    #[test]
    fn long_call_waits_for_the_end_of_the_cycle_of_another_thread() {
        explore(|| {
            let object = Object::new();
            object.guard.enter(Access::Short).unwrap();
            object.guard.begin_cycle().unwrap();
            let other = thread::spawn(|| (object.call(Access::Short), object.call(Access::Long)));
            object.guard.sleep(thread::yield_now);
            let (short, long) = other.join().unwrap();
            assert!([Ok(()), Err(Busy::OtherThread)].contains(&short), "{short:?}");
            assert!([Err(Busy::CycleRuns), Err(Busy::OtherThread)].contains(&long), "{long:?}");
            object.guard.end_cycle().unwrap();
            object.guard.leave(false);
            assert_eq!(object.call(Access::Long), Ok(()));
        });
    }
}
