//! Threads beside the one that moves stepped time.
//!
//! What such a thread computes takes no simulated time: the clock stands still until it waits in a
//! blocking call, or ends. Otherwise the system's scheduler would decide in which cycle it asks for
//! the next thing, and no two runs were alike. This holds for a thread that says that it works beside
//! the cycle; of the others the clock waits only for those that look whether their call is done.

use std::cell::Cell;
use std::sync::atomic::{AtomicU64, Ordering};

thread_local! {
    /// The world beside whose cycle this thread works.
    static BESIDE: Cell<Option<u64>> = const { Cell::new(None) };
}

/// The threads of a world.
#[derive(Debug)]
pub(super) struct Threads {
    /// Which world, of all that the process has had.
    world: u64,
    /// Those that the clock stands still for.
    computing: usize,
    /// Those among them that did not get on: nobody waits for them a second time.
    given_up: usize,
    /// Those that wait for the clock to move.
    waiting: usize,
    moves: u64,
    /// A thread that is not beside moves the clock.
    pub(super) has_cycle: bool,
}

impl Threads {
    pub(super) fn new() -> Self {
        static WORLDS: AtomicU64 = AtomicU64::new(0);
        let world = WORLDS.fetch_add(1, Ordering::Relaxed);
        Self { world, computing: 0, given_up: 0, waiting: 0, moves: 0, has_cycle: false }
    }

    /// The calling thread works beside the cycle from now on, and beside no other.
    pub(super) fn enter(&mut self) {
        if !self.has_caller() {
            BESIDE.set(Some(self.world));
            self.computing += 1;
        }
    }

    /// The calling thread does so no longer.
    pub(super) fn leave(&mut self) {
        if self.has_caller() {
            BESIDE.set(None);
            self.rest();
        }
    }

    /// Whether the calling thread works beside the cycle.
    pub(super) fn has_caller(&self) -> bool {
        BESIDE.get() == Some(self.world)
    }

    /// Whether the clock may move.
    pub(super) fn is_settled(&self) -> bool {
        self.computing <= self.given_up
    }

    /// Those that compute were waited for long enough.
    pub(super) fn give_up(&mut self) {
        self.given_up = self.computing;
    }

    /// The clock has moved: all that wait are to look.
    pub(super) fn tell_moved(&mut self) {
        self.moves = self.moves.wrapping_add(1);
        self.computing += std::mem::take(&mut self.waiting);
    }

    /// One of those that compute does so no longer.
    fn rest(&mut self) {
        self.computing = self.computing.saturating_sub(1);
        self.given_up = self.given_up.min(self.computing);
    }
}

/// A thread in a blocking call.
#[derive(Debug)]
pub(super) struct Waiter {
    is_beside: bool,
    /// Whether it is among those that compute.
    is_computing: bool,
    /// Moves of the clock when it began to wait.
    moves: u64,
}

impl Waiter {
    /// A call of this thread begins.
    pub(super) fn new(threads: &Threads) -> Self {
        let is_beside = threads.has_caller();
        Self { is_beside, is_computing: is_beside, moves: 0 }
    }

    /// The clock may move, and with it what the call waits for.
    pub(super) fn begin(&mut self, threads: &mut Threads) {
        self.stand_aside(threads);
        threads.waiting += 1;
        self.moves = threads.moves;
    }

    /// Whether the clock has moved since.
    pub(super) fn is_over(&self, threads: &Threads) -> bool {
        threads.moves != self.moves
    }

    /// The thread looks again, since the clock has moved or it has lost patience.
    pub(super) fn end(&mut self, threads: &mut Threads) {
        self.is_computing = true;
        if !self.is_over(threads) {
            threads.waiting = threads.waiting.saturating_sub(1);
            threads.computing += 1;
        }
    }

    /// Nobody is to wait for the thread.
    pub(super) fn stand_aside(&mut self, threads: &mut Threads) {
        if std::mem::take(&mut self.is_computing) {
            threads.rest();
        }
    }

    /// The call is done.
    pub(super) fn leave(mut self, threads: &mut Threads) {
        if self.is_beside && !self.is_computing {
            threads.computing += 1;
        } else if !self.is_beside {
            self.stand_aside(threads);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clock_waits_for_who_computes_beside_it_and_not_for_who_waits() {
        let mut threads = Threads::new();
        std::thread::scope(|scope| {
            // On a thread of its own, which is what counts.
            let beside = scope.spawn(|| {
                threads.enter();
                threads.enter();
                let mut waiter = Waiter::new(&threads);
                waiter.begin(&mut threads);
                assert_eq!((threads.computing, threads.waiting), (0, 1));
                threads.tell_moved();
                assert!(waiter.is_over(&threads));
                waiter.end(&mut threads);
                // It looks once more, in vain, and then loses patience.
                waiter.begin(&mut threads);
                waiter.end(&mut threads);
                waiter.leave(&mut threads);
                assert_eq!((threads.computing, threads.waiting), (1, 0));
                threads.leave();
                threads.leave();
                assert_eq!(threads.computing, 0);
                threads.enter();
            });
            beside.join().unwrap();
        });
        assert!(!threads.is_settled(), "it has not left");
        threads.leave();
        assert!(!threads.is_settled(), "this thread is another");
        threads.give_up();
        assert!(threads.is_settled());
    }

    #[test]
    fn who_is_not_beside_counts_only_while_he_looks() {
        let mut threads = Threads::new();
        let mut waiter = Waiter::new(&threads);
        waiter.begin(&mut threads);
        assert!(threads.is_settled());
        threads.tell_moved();
        waiter.end(&mut threads);
        assert!(!threads.is_settled());
        waiter.leave(&mut threads);
        assert!(threads.is_settled());
    }
}
