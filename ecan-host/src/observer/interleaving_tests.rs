//! Every order in which two or three threads access the snapshot and the commands, by loom.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use loom::thread;

use super::commands::{CommandTicket, Shared};
use super::quick_stops::{QuickStop, QuickStops};
use super::ring::{Layout, Ring, Section};

/// Explores all orders in which a thread is interrupted at most `preemptions` times.
fn explore(preemptions: usize, model: impl Fn() + Sync + Send + 'static) {
    let mut builder = loom::model::Builder::new();
    builder.preemption_bound = Some(preemptions);
    builder.check(model);
}

fn publish(ring: &Ring, number: u64) {
    ring.begin(number);
    for word in ring.section(number, Section::Adapter) {
        word.store(number, Ordering::Relaxed);
    }
    ring.complete(number);
}

fn read(ring: &Ring) -> Option<u64> {
    let mut words = vec![0; ring.layout().initial.len()];
    let number = ring.read(&mut words)?;
    assert!(words[ring.layout().range(Section::Adapter)].iter().all(|word| *word == number));
    Some(number)
}

#[test]
fn snapshot_has_the_words_of_one_version() {
    explore(3, || {
        let ring = Arc::new(Ring::new(Layout::default().with(Section::Adapter, &[0])));
        let writer = thread::spawn({
            let ring = Arc::clone(&ring);
            move || (1..=3).for_each(|number| publish(&ring, number))
        });
        let first = read(&ring);
        let second = read(&ring);
        assert!(first <= second, "{second:?} after {first:?}");
        writer.join().unwrap();
        assert_eq!(read(&ring), Some(3));
    });
}

#[test]
fn reader_finds_a_version_of_a_larger_ring() {
    explore(3, || {
        let first = Arc::new(Ring::new(Layout::default().with(Section::Adapter, &[0])));
        publish(&first, 1);
        first.append(Layout::default().with(Section::Adapter, &[0, 0]));
        let writer = thread::spawn({
            let last = Arc::clone(first.last());
            move || publish(&last, 2)
        });
        let ring = first.last_written();
        let number = read(ring);
        assert_eq!(number, Some(if Arc::ptr_eq(ring, &first) { 1 } else { 2 }));
        writer.join().unwrap();
        assert!(Arc::ptr_eq(first.last_written(), first.last()));
    });
}

/// A table of two axes, and the stops that it has executed.
struct Table {
    stops: QuickStops,
    executed: Vec<QuickStop>,
}

impl Table {
    fn new(shared: &Arc<Shared>) -> Self {
        Self { stops: QuickStops::new(Arc::clone(shared), 2), executed: Vec::new() }
    }

    fn run(&mut self) {
        self.stops.execute(|stop| self.executed.push(stop));
    }
}

fn has_executed(shared: &Shared, ticket: CommandTicket) -> bool {
    shared.commands.has_executed(&shared.commands.executed(), ticket)
}

#[test]
fn reported_quick_stop_was_executed() {
    explore(3, || {
        let shared = Arc::new(Shared::default());
        let mut table = Table::new(&shared);
        let giver = thread::spawn({
            let shared = Arc::clone(&shared);
            move || {
                let one = shared.commands.quick_stop(1).unwrap();
                (one, shared.commands.quick_stop_all())
            }
        });
        table.run();
        let reported = shared.commands.executed();
        let before = table.executed.clone();
        let (one, all) = giver.join().unwrap();
        for (ticket, stop) in [(one, QuickStop::Axis(1)), (all, QuickStop::All)] {
            let is_reported = shared.commands.has_executed(&reported, ticket);
            assert!(!is_reported || before.contains(&stop), "{stop:?}");
        }
        table.run();
        assert!(has_executed(&shared, one) && has_executed(&shared, all));
        for stop in [QuickStop::Axis(1), QuickStop::All] {
            assert_eq!(
                table.executed.iter().filter(|other| **other == stop).count(),
                1,
                "{stop:?}"
            );
        }
    });
}

#[test]
fn quick_stop_that_ends_with_its_table_is_not_reported() {
    explore(3, || {
        let shared = Arc::new(Shared::default());
        let mut first = Table::new(&shared);
        let giver = thread::spawn({
            let shared = Arc::clone(&shared);
            move || (shared.commands.quick_stop(1).ok(), shared.commands.quick_stop_all())
        });
        first.run();
        let mut executed = first.executed;
        drop(first.stops);
        let mut second = Table::new(&shared);
        second.run();
        let (one, all) = giver.join().unwrap();
        second.run();
        executed.extend(second.executed);
        for (ticket, stop) in [(one, QuickStop::Axis(1)), (Some(all), QuickStop::All)] {
            let is_reported = ticket.is_some_and(|ticket| has_executed(&shared, ticket));
            assert!(!is_reported || executed.contains(&stop), "{stop:?}");
        }
    });
}

/// Tables of a Port run in its cycle, one after the other.
#[test]
fn quick_stop_of_all_is_reported_when_each_table_has_executed_it() {
    explore(3, || {
        let shared = Arc::new(Shared::default());
        let mut tables = [Table::new(&shared), Table::new(&shared)];
        let giver = thread::spawn({
            let shared = Arc::clone(&shared);
            move || shared.commands.quick_stop_all()
        });
        let mut reports = Vec::new();
        for nth in 0..2 {
            tables[nth].run();
            let has_stopped = tables.iter().all(|table| table.executed.contains(&QuickStop::All));
            reports.push((shared.commands.executed(), has_stopped));
        }
        let ticket = giver.join().unwrap();
        for (reported, has_stopped) in reports {
            assert!(has_stopped || !shared.commands.has_executed(&reported, ticket));
        }
        for table in &mut tables {
            table.run();
            assert_eq!(table.executed, [QuickStop::All]);
        }
        assert!(has_executed(&shared, ticket));
    });
}

/// Another thread may end a table.
#[test]
fn end_of_another_table_reports_no_quick_stop_too_early() {
    explore(3, || {
        let shared = Arc::new(Shared::default());
        let mut first = Table::new(&shared);
        let second = Table::new(&shared);
        let giver = thread::spawn({
            let shared = Arc::clone(&shared);
            move || (shared.commands.quick_stop(1).ok(), shared.commands.quick_stop_all())
        });
        let end = thread::spawn(move || drop(second.stops));
        first.run();
        let reported = shared.commands.executed();
        let executed = first.executed.clone();
        let (one, all) = giver.join().unwrap();
        end.join().unwrap();
        for (ticket, stop) in [(one, QuickStop::Axis(1)), (Some(all), QuickStop::All)] {
            let is_reported =
                ticket.is_some_and(|ticket| shared.commands.has_executed(&reported, ticket));
            assert!(!is_reported || executed.contains(&stop), "{stop:?}");
        }
        first.run();
        assert!(first.executed.contains(&QuickStop::All));
        let later = shared.commands.quick_stop_all();
        first.run();
        assert!(has_executed(&shared, later));
    });
}
