//! Threads in parallel with the one that moves stepped time.
//!
//! A worker is a thread that opens a master of its own while another thread runs the cycle. Its
//! computing takes no simulated time: the clock stops until the worker waits in a blocking call or
//! releases its master. Otherwise the system's scheduler would decide in which cycle the worker
//! makes its next request, and two runs would differ. For other threads the clock waits only while
//! they check whether their call is done.

use std::thread::{self, ThreadId};

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
