//! Scheduled transmission: frames that wait for a phase of a Sync0 cycle
//! (manual 8.4 and 13.8).

use std::collections::VecDeque;

use ecan_protocol::can::CanFrame;

use crate::random::Random;

use super::transmit_path::Reference;

#[derive(Clone, Copy, Debug)]
pub(super) struct Scheduled {
    pub(super) due_ns: u64,
    pub(super) channel: usize,
    pub(super) frame: CanFrame,
    /// For a result when the phase has come.
    pub(super) reference: Option<Reference>,
}

/// Waiting frames in the order of their phases; equal phases keep PDO order.
#[derive(Clone, Debug)]
pub(super) struct ScheduleQueue {
    entries: VecDeque<Scheduled>,
    /// Largest number of waiting frames.
    depth: usize,
    /// Upper bound of the timer delay, and the seed of its random numbers.
    jitter_ns: u64,
    seed: u64,
}

impl ScheduleQueue {
    pub(super) fn new(depth: usize, jitter_ns: u64, seed: u64) -> Self {
        Self { entries: VecDeque::with_capacity(depth), depth, jitter_ns, seed }
    }

    /// Timer delay at a phase: random, equal for all frames of a phase.
    fn timer_delay(&self, due_ns: u64) -> u64 {
        match self.jitter_ns {
            0 => 0,
            jitter_ns => Random::new(self.seed ^ due_ns).below(jitter_ns + 1),
        }
    }

    /// Adds a frame; returns `false` if the queue is full.
    pub(super) fn insert(&mut self, entry: Scheduled) -> bool {
        if self.entries.len() >= self.depth {
            return false;
        }
        let index = self.entries.partition_point(|waiting| waiting.due_ns <= entry.due_ns);
        self.entries.insert(index, entry);
        true
    }

    /// When the next frame goes to its controller.
    pub(super) fn next_due(&self) -> Option<u64> {
        self.entries
            .front()
            .map(|entry| entry.due_ns.saturating_add(self.timer_delay(entry.due_ns)))
    }

    pub(super) fn pop_due(&mut self, now: u64) -> Option<Scheduled> {
        if self.next_due()? <= now { self.entries.pop_front() } else { None }
    }

    pub(super) fn waiting(&self, channel: usize) -> usize {
        self.entries.iter().filter(|entry| entry.channel == channel).count()
    }

    pub(super) fn flush(&mut self) -> usize {
        let dropped = self.entries.len();
        self.entries.clear();
        dropped
    }

    pub(super) fn flush_channel(&mut self, channel: usize) -> usize {
        let before = self.entries.len();
        self.entries.retain(|entry| entry.channel != channel);
        before - self.entries.len()
    }
}
