//! Snapshot of one cycle: its publisher, its reader, and the Adapter's part of it.

use std::sync::atomic::Ordering;
use std::sync::{Arc, PoisonError};

use thiserror::Error;

use super::commands::{CommandTicket, Executed, Observer, Shared};
use super::ring::{Ring, Section, SectionWriter};
use crate::cycle_timing::CycleStart;
use crate::exchange::{Delivery, DomainReport};
use crate::master::WcState;
use crate::observer::quick_stops::QuickStops;

/// Words of the cycle, and of each slave.
const CYCLE_WORDS: usize = 12;
const SLAVE_WORDS: usize = 2;

/// Error of [`Snapshot::update`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum ObserverError {
    /// No cycle has run since the first observer.
    #[error("no cycle has been published yet; retry after the next cycle")]
    NoCycle,
    /// The Adapter is gone; the snapshot is that of its last cycle.
    #[error("the Adapter is closed; no further cycle is published")]
    Closed,
}

/// Times of a cycle in a snapshot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct CycleRecord {
    pub(crate) cycle: u64,
    pub(crate) time_ns: u64,
    pub(crate) start: Option<CycleStart>,
    pub(crate) run_time_ns: u64,
    pub(crate) overruns: u64,
    pub(crate) skipped: u64,
    pub(crate) executed: Executed,
    pub(crate) is_stop_requested: bool,
}

const HAS_START: u64 = 1;
const HAS_OVERRUN: u64 = 2;
const STOP_REQUESTED: u64 = 4;

impl CycleRecord {
    #[inline(always)]
    fn words(&self) -> [u64; CYCLE_WORDS] {
        let start = self.start.unwrap_or_default();
        let flag = |is_set: bool, bit: u64| if is_set { bit } else { 0 };
        let flags = flag(self.start.is_some(), HAS_START)
            | flag(start.has_overrun, HAS_OVERRUN)
            | flag(self.is_stop_requested, STOP_REQUESTED);
        let Self { cycle, time_ns, run_time_ns, overruns, skipped, executed, .. } = *self;
        let CycleStart { deadline_ns, late_ns, skipped: skipped_before, .. } = start;
        [
            cycle,
            time_ns,
            deadline_ns,
            late_ns,
            skipped_before,
            run_time_ns,
            overruns,
            skipped,
            executed.stop,
            executed.one,
            executed.all,
            flags,
        ]
    }

    fn of(words: [u64; CYCLE_WORDS]) -> Self {
        let [
            cycle,
            time_ns,
            deadline_ns,
            late_ns,
            skipped_before,
            run_time_ns,
            overruns,
            skipped,
            stop,
            one,
            all,
            flags,
        ] = words;
        let has_overrun = flags & HAS_OVERRUN != 0;
        let start = CycleStart { deadline_ns, late_ns, skipped: skipped_before, has_overrun };
        Self {
            cycle,
            time_ns,
            start: (flags & HAS_START != 0).then_some(start),
            run_time_ns,
            overruns,
            skipped,
            executed: Executed { stop, one, all },
            is_stop_requested: flags & STOP_REQUESTED != 0,
        }
    }
}

#[inline(always)]
fn report_words(report: &DomainReport) -> [u64; SLAVE_WORDS] {
    let counters =
        u64::from(report.working_counter) | u64::from(report.expected_working_counter) << 32;
    let state = match report.wc_state {
        WcState::Zero => 0,
        WcState::Incomplete => 1,
        WcState::Complete => 2,
    };
    let delivery = |delivery| match delivery {
        Delivery::None => 0,
        Delivery::Confirmed => 1,
        Delivery::Missed => 2,
        Delivery::Unknown => 3,
    };
    [counters, state | delivery(report.outputs) << 8 | delivery(report.inputs) << 16]
}

fn report_of([counters, states]: [u64; SLAVE_WORDS]) -> DomainReport {
    let delivery = |code| match code & 0xFF {
        1 => Delivery::Confirmed,
        2 => Delivery::Missed,
        3 => Delivery::Unknown,
        _ => Delivery::None,
    };
    DomainReport {
        working_counter: counters as u32,
        expected_working_counter: (counters >> 32) as u32,
        wc_state: match states & 0xFF {
            1 => WcState::Incomplete,
            2 => WcState::Complete,
            _ => WcState::Zero,
        },
        outputs: delivery(states >> 8),
        inputs: delivery(states >> 16),
    }
}

/// Snapshot of one cycle: everything in it belongs to the same cycle.
///
/// [`update`](Self::update) replaces it by that of the last cycle. This crate's part is what the
/// methods return; the layers above read theirs with `PortSnapshot` and `AxesSnapshot`.
#[derive(Debug)]
pub struct Snapshot {
    observer: Observer,
    ring: Arc<Ring>,
    /// Number of the version; 0 before the first.
    number: u64,
    words: Vec<u64>,
}

impl Observer {
    /// Memory for snapshots, empty until its first [`update`](Snapshot::update). Allocates.
    pub fn snapshot(&self) -> Snapshot {
        let first = self.shared().first_ring();
        let ring = Arc::clone(first.last_written());
        // Room for what is reserved already.
        let words = Vec::with_capacity(first.last().layout().initial.len());
        Snapshot { observer: self.clone(), ring, number: 0, words }
    }
}

impl Snapshot {
    /// Reads the snapshot of the last cycle. Repeats the read while the cycle overtakes it; takes no
    /// lock, and memory only after a layer was opened or reconfigured.
    ///
    /// # Errors
    /// [`ObserverError`]. After [`Closed`](ObserverError::Closed) the snapshot is that of the last
    /// cycle.
    pub fn update(&mut self) -> Result<(), ObserverError> {
        // Before the read: the last snapshot is complete if it is set.
        let is_closed = self.observer.is_closed();
        let ring = self.ring.last_written();
        if !Arc::ptr_eq(ring, &self.ring) {
            self.ring = Arc::clone(ring);
        }
        self.words.resize(self.ring.layout().initial.len(), 0);
        let number = self.ring.read(&mut self.words);
        self.number = number.unwrap_or(0);
        match number {
            _ if is_closed => Err(ObserverError::Closed),
            Some(_) => Ok(()),
            None => Err(ObserverError::NoCycle),
        }
    }

    /// The observer of this snapshot.
    pub fn observer(&self) -> &Observer {
        &self.observer
    }

    /// Words of a section, without its number; `None` if the cycle did not write it. For the layers of
    /// the SDK.
    pub fn section(&self, section: Section) -> Option<&[u64]> {
        let words = self.words.get(self.ring.layout().range(section))?;
        match words.split_first() {
            Some((number, rest)) if *number == self.number && self.number != 0 => Some(rest),
            _ => None,
        }
    }

    fn record(&self) -> CycleRecord {
        let words = self.section(Section::Adapter).and_then(<[u64]>::first_chunk);
        words.map_or_else(CycleRecord::default, |words| CycleRecord::of(*words))
    }

    /// Number of the cycle, counted from 1 by [`Adapter::receive`](crate::Adapter::receive); 0 before
    /// the first snapshot.
    pub fn cycle(&self) -> u64 {
        self.record().cycle
    }

    /// Time of the cycle: see [`Adapter::cycle_time_ns`](crate::Adapter::cycle_time_ns).
    pub fn time_ns(&self) -> u64 {
        self.record().time_ns
    }

    /// Deadline, delay and skipped deadlines of the cycle; `None` if it began without
    /// [`Adapter::wait_next_cycle`](crate::Adapter::wait_next_cycle).
    pub fn cycle_start(&self) -> Option<CycleStart> {
        self.record().start
    }

    /// Time from the start of the cycle to the end of its [`send`](crate::Adapter::send), in nanoseconds.
    pub fn run_time_ns(&self) -> u64 {
        self.record().run_time_ns
    }

    /// Cycles that missed a deadline, since the Adapter was opened.
    pub fn overruns(&self) -> u64 {
        self.record().overruns
    }

    /// Deadlines that were skipped, since the Adapter was opened.
    pub fn skipped(&self) -> u64 {
        self.record().skipped
    }

    /// Number of slaves.
    pub fn slave_count(&self) -> usize {
        let words = self.section(Section::Adapter).unwrap_or_default();
        words.len().saturating_sub(CYCLE_WORDS) / SLAVE_WORDS
    }

    /// Exchange with a slave in this cycle; `None` for an index out of range.
    pub fn domain_report(&self, slave: usize) -> Option<DomainReport> {
        let words = self.section(Section::Adapter)?.get(CYCLE_WORDS..)?;
        words.as_chunks().0.get(slave).copied().map(report_of)
    }

    /// Returns whether this cycle or an earlier one has executed a command: a quick stop was given to
    /// the axes, whose state reports its effect. A quick stop that was dropped, because the axes ended or
    /// others were created before a cycle executed it, is never executed; an executed one is forgotten
    /// after 63 such changes.
    pub fn has_executed(&self, ticket: CommandTicket) -> bool {
        self.observer.shared().commands.has_executed(&self.record().executed, ticket)
    }

    /// Returns whether the application was requested to stop.
    pub fn is_stop_requested(&self) -> bool {
        self.record().is_stop_requested
    }
}

/// Writes the snapshots of an Adapter, one version per cycle. Its methods are for the layers of the SDK.
#[derive(Debug)]
pub struct Publisher {
    shared: Arc<Shared>,
    ring: Arc<Ring>,
    /// Number of the last version that was begun.
    number: u64,
    is_begun: bool,
}

impl Default for Publisher {
    fn default() -> Self {
        let shared = Arc::new(Shared::default());
        Self { ring: shared.first_ring(), shared, number: 0, is_begun: false }
    }
}

impl Publisher {
    pub(crate) fn observer(&self) -> Observer {
        Observer::new(Arc::clone(&self.shared))
    }

    /// The quick stops that observers command, for a table of axes that executes them from now on.
    /// Allocates; not for the cycle.
    pub fn quick_stops(&self, axis_count: usize) -> QuickStops {
        QuickStops::new(Arc::clone(&self.shared), axis_count)
    }

    pub(crate) fn is_stop_requested(&self) -> bool {
        self.shared.commands.is_stop_requested()
    }

    pub(crate) fn clear_stop_request(&self) {
        self.shared.commands.clear_stop_request();
    }

    pub(crate) fn executed(&self) -> Executed {
        self.shared.commands.executed()
    }

    /// Reserves a section of the snapshots, with the words that the cycle does not write. Returns a
    /// number that no other reservation has. Allocates; not for the cycle.
    pub fn reserve(&self, section: Section, initial: &[u64]) -> u64 {
        let mut first = self.shared.first_ring.lock().unwrap_or_else(PoisonError::into_inner);
        let last = self.ring.last();
        if last.layout().initial_of(section) != initial {
            last.append(last.layout().with(section, initial));
        }
        // Earlier rings end here, if no snapshot uses them.
        *first = Arc::clone(&self.ring);
        self.shared.reservations.fetch_add(1, Ordering::Relaxed) + 1
    }

    /// Begins a version unless one is begun; nothing without an observer.
    pub(crate) fn begin(&mut self) {
        if self.is_begun || self.shared.observers.load(Ordering::Relaxed) == 0 {
            return;
        }
        while let Some(next) = self.ring.next() {
            // The earlier one stays alive in `first_ring`: nothing is freed here.
            self.ring = Arc::clone(next);
        }
        self.number += 1;
        self.ring.begin(self.number);
        self.is_begun = true;
    }

    /// The writer of a section in the snapshot of this cycle; `None` without an observer. Real-time safe.
    #[inline]
    pub fn section(&self, section: Section) -> Option<SectionWriter<'_>> {
        if !self.is_begun {
            return None;
        }
        let (number, words) = self.ring.section(self.number, section).split_first()?;
        number.store(self.number, Ordering::Relaxed);
        Some(SectionWriter::new(words))
    }

    pub(crate) fn complete(&mut self) {
        if std::mem::take(&mut self.is_begun) {
            self.ring.complete(self.number);
        }
    }

    pub(crate) fn reserve_cycle(&self, slave_count: usize) {
        self.reserve(Section::Adapter, &vec![0; CYCLE_WORDS + slave_count * SLAVE_WORDS]);
    }

    /// Writes the Adapter's section, with the commands that the cycle has executed, and completes the
    /// version.
    #[inline(always)]
    pub(crate) fn publish_cycle<'a>(
        &mut self,
        mut record: CycleRecord,
        reports: impl Iterator<Item = &'a DomainReport>,
    ) {
        record.executed = self.executed();
        record.is_stop_requested = self.is_stop_requested();
        self.publish(&record, reports);
    }

    #[inline(always)]
    fn publish<'a>(
        &mut self,
        record: &CycleRecord,
        reports: impl Iterator<Item = &'a DomainReport>,
    ) {
        if let Some(mut writer) = self.section(Section::Adapter) {
            write(&mut writer, record, reports);
            self.complete();
        }
    }
}

impl Drop for Publisher {
    fn drop(&mut self) {
        self.shared.is_closed.store(true, Ordering::Release);
    }
}

#[inline(always)]
fn write<'a>(
    writer: &mut SectionWriter<'_>,
    record: &CycleRecord,
    reports: impl Iterator<Item = &'a DomainReport>,
) {
    writer.write(record.words());
    for report in reports {
        writer.write(report_words(report));
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn report() -> impl Strategy<Value = DomainReport> {
        let delivery = prop::sample::select(vec![
            Delivery::None,
            Delivery::Confirmed,
            Delivery::Missed,
            Delivery::Unknown,
        ]);
        let state =
            prop::sample::select(vec![WcState::Zero, WcState::Incomplete, WcState::Complete]);
        let parts = (any::<u32>(), any::<u32>(), state, delivery.clone(), delivery);
        parts.prop_map(|(working_counter, expected_working_counter, wc_state, outputs, inputs)| {
            DomainReport { working_counter, expected_working_counter, wc_state, outputs, inputs }
        })
    }

    proptest! {
        #[test]
        fn snapshot_returns_what_the_cycle_published(
            numbers in any::<[u64; 8]>(),
            start in prop::option::of((any::<u64>(), any::<u64>(), any::<u64>(), any::<bool>())),
            is_stop_requested in any::<bool>(),
            reports in prop::collection::vec(report(), 0..5),
        ) {
            let [cycle, time_ns, run_time_ns, overruns, skipped, stop, one, all] = numbers;
            let executed = Executed { stop, one, all };
            let start = start.map(|(deadline_ns, late_ns, skipped, has_overrun)| {
                CycleStart { deadline_ns, late_ns, skipped, has_overrun }
            });
            let record = CycleRecord {
                cycle, time_ns, start, run_time_ns, overruns, skipped, executed, is_stop_requested,
            };
            let mut publisher = Publisher::default();
            publisher.reserve_cycle(reports.len());
            let mut snapshot = publisher.observer().snapshot();
            prop_assert_eq!(snapshot.update(), Err(ObserverError::NoCycle));
            publisher.begin();
            publisher.publish(&record, reports.iter());
            prop_assert_eq!(snapshot.update(), Ok(()));
            prop_assert_eq!(snapshot.record(), record);
            prop_assert_eq!(snapshot.slave_count(), reports.len());
            for (slave, report) in reports.iter().enumerate() {
                prop_assert_eq!(snapshot.domain_report(slave), Some(*report));
            }
            prop_assert_eq!(snapshot.domain_report(reports.len()), None);
            drop(publisher);
            prop_assert_eq!(snapshot.update(), Err(ObserverError::Closed));
            prop_assert_eq!(snapshot.record(), record);
        }
    }

    #[test]
    fn section_of_another_cycle_is_not_returned() {
        let mut publisher = Publisher::default();
        publisher.reserve_cycle(1);
        let mut snapshot = publisher.observer().snapshot();
        // Reserved after the snapshot was created.
        publisher.reserve(Section::Port, &[9, 0]);
        let record = CycleRecord { cycle: 1, ..CycleRecord::default() };
        for cycle in 1..20 {
            publisher.begin();
            let is_written = cycle % 3 == 0;
            if is_written {
                let mut writer = publisher.section(Section::Port).unwrap();
                writer.skip(1);
                writer.write([cycle]);
            }
            publisher.publish(&record, [].into_iter());
            snapshot.update().unwrap();
            let expected: &[u64] = &[9, cycle];
            assert_eq!(snapshot.section(Section::Port), is_written.then_some(expected));
            assert_eq!(snapshot.cycle(), 1);
        }
    }

    #[test]
    fn nothing_is_published_without_an_observer() {
        let mut publisher = Publisher::default();
        publisher.reserve_cycle(1);
        publisher.begin();
        assert!(publisher.section(Section::Adapter).is_none());
        let observer = publisher.observer();
        publisher.begin();
        assert!(publisher.section(Section::Adapter).is_some());
        publisher.publish(&CycleRecord::default(), [].into_iter());
        drop(observer);
        publisher.begin();
        assert!(publisher.section(Section::Adapter).is_none());
    }
}
