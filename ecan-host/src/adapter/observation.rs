//! Snapshots of the cycle for observers, and their commands.

use super::Adapter;
use crate::observer::{CycleRecord, Observer, QuickStops, Section, SectionWriter};

/// Counters of the cycle since the Adapter was opened.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct CycleCounts {
    cycles: u64,
    overruns: u64,
    skipped: u64,
    /// The running cycle began with a wait.
    has_start: bool,
}

impl Adapter {
    /// A handle for other threads: reads snapshots of the cycle, and gives commands. Allocates; not for
    /// the cycle.
    pub fn observer(&self) -> Observer {
        self.publisher.observer()
    }

    /// Number of the running cycle, or of the last one: [`receive`](Self::receive) counts from 1.
    /// Real-time safe.
    pub fn cycle_number(&self) -> u64 {
        self.counts.cycles
    }

    /// Returns whether an observer requested the application to stop
    /// ([`Observer::request_stop`]); also [`should_stop`](Self::should_stop) returns true then.
    /// Real-time safe.
    pub fn is_stop_requested(&self) -> bool {
        self.publisher.is_stop_requested()
    }

    /// Ends a request to stop: calls wait again. Real-time safe.
    pub fn clear_stop_request(&self) {
        self.publisher.clear_stop_request();
    }

    /// The quick stops that observers command, for a table of axes that executes them from now on. For
    /// the layers of the SDK. Allocates; not for the cycle.
    pub fn quick_stops(&self, axis_count: usize) -> QuickStops {
        self.publisher.quick_stops(axis_count)
    }

    /// Reserves a section of the snapshots, with the words that the cycle does not write. Returns a
    /// number that no other reservation has. For the layers of the SDK. Allocates; not for the cycle.
    pub fn reserve_section(&self, section: Section, initial: &[u64]) -> u64 {
        self.publisher.reserve(section, initial)
    }

    /// The writer of a section in the snapshot of this cycle; `None` without an observer. For the
    /// layers of the SDK. Real-time safe.
    #[inline]
    pub fn section_writer(&self, section: Section) -> Option<SectionWriter<'_>> {
        self.publisher.section(section)
    }

    /// Call before `start_cycle`, which takes the deadline.
    pub(super) fn begin_observed_cycle(&mut self) {
        // The cycles after the last one of the application are not for observers.
        if self.is_leaving_op {
            return;
        }
        let has_start = self.cycle_due_ns.is_some();
        let counts = &mut self.counts;
        counts.cycles += 1;
        counts.has_start = has_start;
        if has_start {
            counts.overruns += u64::from(self.cycle_start.has_overrun);
            counts.skipped += self.cycle_start.skipped;
        }
        self.publisher.begin();
    }

    /// Call after `end_cycle`, which notes the time.
    pub(super) fn publish_cycle(&mut self) {
        if self.is_leaving_op {
            return;
        }
        // A send without a cycle: the images of the last one were repeated.
        self.publisher.begin();
        let CycleCounts { cycles, overruns, skipped, has_start } = self.counts;
        let start = has_start.then_some(self.cycle_start);
        let begun_ns = start.map_or(self.cycle_time_ns, |start| start.begun_ns());
        let record = CycleRecord {
            cycle: cycles,
            time_ns: self.cycle_time_ns,
            start,
            run_time_ns: self.sent_ns.saturating_sub(begun_ns),
            overruns,
            skipped,
            executed: self.publisher.executed(),
            is_stop_requested: self.publisher.is_stop_requested(),
        };
        self.publisher.publish(&record, self.slaves.iter().map(|slave| &slave.report));
    }
}
