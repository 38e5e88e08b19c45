//! Scheduled transmission: frames that wait for a phase of a Sync0 cycle
//! (manual 8.4 and 13.8).

use std::collections::VecDeque;

use ecan_protocol::can::CanFrame;

use super::dc_clock::LinearClock;
use super::settings::Sync0;
use crate::random::Random;

/// Frames that may wait at once; the manual names no size, so the size of a TX ring.
const SCHEDULE_DEPTH: usize = 64;

/// Pulse train of Sync0: even in the slave's system time, told in simulated time.
#[derive(Clone, Copy, Debug)]
pub(super) struct PulseTrain {
    /// In system time; none where the start had gone by when the train was armed: it never comes.
    first_system_ns: Option<u64>,
    cycle_ns: u64,
    line: LinearClock,
}

impl PulseTrain {
    pub(super) fn new(sync0: Sync0, line: LinearClock, now: u64) -> Self {
        let first = sync0.start_ns.saturating_add_signed(i64::from(sync0.shift_ns));
        Self {
            first_system_ns: (first >= line.system(now)).then_some(first),
            cycle_ns: u64::from(sync0.cycle_ns).max(1),
            line,
        }
    }

    /// The slave's clock was corrected, or set; what it jumps over before the first pulse never comes.
    pub(super) fn set_line(&mut self, line: LinearClock, now: u64) {
        let has_begun = self.pulses_until(now) > 0;
        self.line = line;
        let is_jumped_over =
            !has_begun && self.first_system_ns.is_some_and(|first| first < line.system(now));
        if is_jumped_over {
            self.first_system_ns = None;
        }
    }

    pub(super) fn first_ns(self) -> u64 {
        self.first_system_ns.map_or(u64::MAX, |first| self.line.simulated(first))
    }

    pub(super) fn cycle_ns(self) -> u64 {
        self.cycle_ns
    }

    /// The first pulse strictly after `now`.
    pub(super) fn next_after(self, now: u64) -> u64 {
        self.next_system_after(now).map_or(u64::MAX, |next| self.line.simulated(next))
    }

    /// The same in system time; none if it never comes.
    pub(super) fn next_system_after(self, now: u64) -> Option<u64> {
        let passed = self.pulses_until(now).checked_mul(self.cycle_ns)?;
        self.first_system_ns?.checked_add(passed)
    }

    /// Time since the first pulse; none before it.
    fn since_first(self, now: u64) -> Option<u64> {
        self.line.system(now).checked_sub(self.first_system_ns?)
    }

    /// Number of pulses from the first one up to and including `now`.
    pub(super) fn pulses_until(self, now: u64) -> u64 {
        self.since_first(now).map_or(0, |ns| (ns / self.cycle_ns).saturating_add(1))
    }

    /// Distance from the last pulse at or before `now`; 0 before the first one.
    pub(super) fn phase(self, now: u64) -> u64 {
        self.since_first(now).map_or(0, |ns| ns % self.cycle_ns)
    }
}

/// A frame that waits for its phase.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scheduled {
    pub(super) due_ns: u64,
    pub(super) channel: usize,
    pub(super) frame: CanFrame,
}

/// Waiting frames in the order of their phases; equal phases keep PDO order.
#[derive(Debug)]
pub(super) struct ScheduleQueue {
    entries: VecDeque<Scheduled>,
    /// Bound of the delay of the timer, and what its draws start from.
    jitter_ns: u64,
    seed: u64,
}

impl ScheduleQueue {
    pub(super) fn new(jitter_ns: u64, seed: u64) -> Self {
        Self { entries: VecDeque::with_capacity(SCHEDULE_DEPTH), jitter_ns, seed }
    }

    /// How late the timer is at a phase: drawn anew for each, the same for all frames of one.
    fn timer_delay(&self, due_ns: u64) -> u64 {
        match self.jitter_ns {
            0 => 0,
            jitter_ns => Random::new(self.seed ^ due_ns).below(jitter_ns + 1),
        }
    }

    /// Takes a frame in; `false` when the queue is full.
    pub(super) fn insert(&mut self, entry: Scheduled) -> bool {
        if self.entries.len() >= SCHEDULE_DEPTH {
            return false;
        }
        let place = self.entries.partition_point(|waiting| waiting.due_ns <= entry.due_ns);
        self.entries.insert(place, entry);
        true
    }

    /// When the next frame is handed to its controller.
    pub(super) fn next_due(&self) -> Option<u64> {
        self.entries
            .front()
            .map(|entry| entry.due_ns.saturating_add(self.timer_delay(entry.due_ns)))
    }

    /// Takes out the first frame whose phase has come.
    pub(super) fn pop_due(&mut self, now: u64) -> Option<Scheduled> {
        if self.next_due()? <= now { self.entries.pop_front() } else { None }
    }

    /// Waiting frames of one channel.
    pub(super) fn waiting(&self, channel: usize) -> usize {
        self.entries.iter().filter(|entry| entry.channel == channel).count()
    }

    /// Drops everything and says how many frames that were.
    pub(super) fn flush(&mut self) -> usize {
        let dropped = self.entries.len();
        self.entries.clear();
        dropped
    }

    /// Drops the frames of one channel and says how many that were.
    pub(super) fn flush_channel(&mut self, channel: usize) -> usize {
        let before = self.entries.len();
        self.entries.retain(|entry| entry.channel != channel);
        before - self.entries.len()
    }
}
