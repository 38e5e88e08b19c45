//! Threads beside the one that moves stepped time.
//!
//! What such a thread computes takes no simulated time: the clock stands still until it waits in a
//! blocking call, or ends. Otherwise the system's scheduler would decide in which cycle it asks for
//! the next thing, and no two runs were alike. This holds for threads that say that they work beside
//! the cycle; of the others the clock waits only for those that look whether their call is done.

use std::cell::Cell;

thread_local! {
    /// The world beside whose cycle this thread works.
    static BESIDE: Cell<Option<usize>> = const { Cell::new(None) };
}

/// Takes the calling thread up as one that works beside the cycle of a world, or lets it go.
pub(super) fn set_beside(world: Option<usize>) {
    BESIDE.set(world);
}

/// Whether the calling thread works beside the cycle of this world.
pub(super) fn is_beside(world: usize) -> bool {
    BESIDE.get() == Some(world)
}

/// The threads of a world.
#[derive(Debug, Default)]
pub(super) struct Threads {
    /// Those for which the clock stands still.
    pub(super) computing: usize,
    /// Those that wait for the clock to move.
    waiting: usize,
    moves: u64,
}

/// Part of a thread that waits in a blocking call.
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
    pub(super) fn new(is_beside: bool) -> Self {
        Self { is_beside, is_computing: is_beside, moves: 0 }
    }

    /// The clock may move, and with it what the call waits for.
    pub(super) fn begin(&mut self, threads: &mut Threads) {
        threads.computing -= usize::from(self.is_computing);
        threads.waiting += 1;
        self.moves = threads.moves;
    }

    pub(super) fn is_over(&self, threads: &Threads) -> bool {
        threads.moves != self.moves
    }

    /// The thread looks again, since the clock has moved or it has lost patience.
    pub(super) fn end(&mut self, threads: &mut Threads) {
        self.is_computing = true;
        if !self.is_over(threads) {
            threads.waiting -= 1;
            threads.computing += 1;
        }
    }

    /// The call is done.
    pub(super) fn leave(self, threads: &mut Threads) {
        threads.computing -= usize::from(self.is_computing);
        threads.computing += usize::from(self.is_beside);
    }
}

impl Threads {
    /// The clock has moved: all that wait are to look.
    pub(super) fn tell_moved(&mut self) {
        self.moves = self.moves.wrapping_add(1);
        self.computing += std::mem::take(&mut self.waiting);
    }
}
