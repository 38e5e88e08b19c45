//! Commands of other threads to the cycle: the handle that gives them, and the tickets by which a snapshot reports
//! them.

use std::fmt;
use std::sync::atomic::Ordering;
use std::sync::{Arc, PoisonError};
#[cfg(not(loom))]
use std::sync::{
    Mutex, MutexGuard,
    atomic::{AtomicBool, AtomicU64, AtomicUsize},
};

use ecan_protocol::mapping::CHANNELS;
#[cfg(loom)]
use loom::sync::{
    Mutex, MutexGuard,
    atomic::{AtomicBool, AtomicU64, AtomicUsize},
};
use thiserror::Error;

use super::ring::{Layout, Ring};
use crate::config::MAX_SLAVES;

/// Node-IDs of a CAN bus.
const NODE_IDS: usize = 127;
/// Most axes of a table: one per node-ID, channel and slave.
const MAX_AXES: usize = if cfg!(loom) { 2 } else { MAX_SLAVES * CHANNELS * NODE_IDS };
const BITS: usize = u64::BITS as usize;
/// Tables whose execution of commands to all axes is tracked.
const SLOTS: usize = if cfg!(loom) { 2 } else { 8 };
/// Terms whose executed commands are remembered.
const TERMS: u64 = if cfg!(loom) { 2 } else { 64 };
/// Content of a slot without a table.
const FREE: u64 = u64::MAX;

/// Error of a command to an axis that the table does not have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("axis index {axis} is out of range: {count} axes are in use")]
pub struct NoSuchAxis {
    /// The index.
    pub axis: usize,
    /// Number of axes.
    pub count: usize,
}

/// Last command of each kind that the cycle has executed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Executed {
    pub(crate) stop: u64,
    pub(crate) one: u64,
    pub(crate) all: u64,
}

/// A table of axes that lives.
#[derive(Debug)]
struct Table {
    number: u64,
    axis_count: usize,
    slot: Option<usize>,
}

/// Pending commands. Only atomics, so that signal handlers can give commands.
///
/// A term is the time between two changes of the tables. A ticket has the term that its giver saw
/// before it stored the command, so a command that a change of the tables dropped, or may have dropped,
/// is never reported as executed.
///
/// A command is stored before its number is drawn; so the cycle finds every command with a number up
/// to the one that it reads first.
#[derive(Debug)]
pub(super) struct Commands {
    stop_requested: AtomicBool,
    last_stop: AtomicU64,
    /// Last number of a quick stop.
    last_quick_stop: AtomicU64,
    /// Commands to all axes.
    quick_stop_all: AtomicU64,
    /// A bit per axis.
    quick_stops: Box<[AtomicU64]>,
    term: AtomicU64,
    /// Number of the table that takes commands to one axis; 0 without one.
    axis_table: AtomicU64,
    /// Number of the table that was registered last.
    last_table: AtomicU64,
    axis_count: AtomicUsize,
    /// Last number that each table has executed.
    seen: [AtomicU64; SLOTS],
    /// Tables without a slot.
    untracked: AtomicUsize,
    /// Last executed tickets of the last terms.
    executed_one: [AtomicU64; TERMS as usize],
    executed_all: [AtomicU64; TERMS as usize],
    /// In the order of registration. Locked outside the cycle only.
    tables: Mutex<Vec<Table>>,
}

impl Default for Commands {
    fn default() -> Self {
        let first = |kind| std::array::from_fn(|_| AtomicU64::new(kind_start(kind, 0)));
        Self {
            stop_requested: AtomicBool::new(false),
            last_stop: AtomicU64::new(0),
            last_quick_stop: AtomicU64::new(0),
            quick_stop_all: AtomicU64::new(0),
            quick_stops: (0..MAX_AXES.div_ceil(BITS)).map(|_| AtomicU64::new(0)).collect(),
            term: AtomicU64::new(0),
            axis_table: AtomicU64::new(0),
            last_table: AtomicU64::new(0),
            axis_count: AtomicUsize::new(0),
            seen: std::array::from_fn(|_| AtomicU64::new(FREE)),
            untracked: AtomicUsize::new(0),
            executed_one: first(Kind::One),
            executed_all: first(Kind::All),
            tables: Mutex::new(Vec::new()),
        }
    }
}

fn kind_start(kind: Kind, term: u64) -> u64 {
    CommandTicket::new(kind, term, 0).number()
}

fn of_term(words: &[AtomicU64; TERMS as usize], term: u64) -> &AtomicU64 {
    // infallible: the remainder is an index
    &words[(term % TERMS) as usize]
}

impl Commands {
    pub(super) fn request_stop(&self) -> CommandTicket {
        self.stop_requested.store(true, Ordering::Release);
        CommandTicket::new(Kind::Stop, 0, self.last_stop.fetch_add(1, Ordering::AcqRel) + 1)
    }

    pub(super) fn clear_stop_request(&self) {
        self.stop_requested.store(false, Ordering::Release);
    }

    pub(super) fn is_stop_requested(&self) -> bool {
        self.stop_requested.load(Ordering::Acquire)
    }

    fn draw(&self, kind: Kind, term: u64) -> CommandTicket {
        let number = self.last_quick_stop.fetch_add(1, Ordering::AcqRel) + 1;
        CommandTicket::new(kind, term, number)
    }

    fn term(&self) -> u64 {
        self.term.load(Ordering::Acquire)
    }

    pub(super) fn quick_stop_all(&self) -> CommandTicket {
        let term = self.term();
        self.quick_stop_all.fetch_add(1, Ordering::AcqRel);
        self.draw(Kind::All, term)
    }

    pub(super) fn quick_stop(&self, axis: usize) -> Result<CommandTicket, NoSuchAxis> {
        let term = self.term();
        let count = self.axis_count();
        match self.quick_stops.get(axis / BITS) {
            Some(bits) if axis < count => {
                bits.fetch_or(1 << (axis % BITS), Ordering::AcqRel);
                Ok(self.draw(Kind::One, term))
            }
            _ => Err(NoSuchAxis { axis, count }),
        }
    }

    pub(super) fn axis_count(&self) -> usize {
        self.axis_count.load(Ordering::Acquire)
    }

    /// The last commands that the cycle has executed. A request to stop takes effect at once; call
    /// before [`is_stop_requested`](Self::is_stop_requested).
    pub(super) fn executed(&self) -> Executed {
        let last_stop = self.last_stop.load(Ordering::Acquire);
        let term = self.term();
        Executed {
            stop: CommandTicket::new(Kind::Stop, 0, last_stop).number(),
            one: of_term(&self.executed_one, term).load(Ordering::Acquire),
            all: of_term(&self.executed_all, term).load(Ordering::Acquire),
        }
    }

    /// Returns whether a command is one that the cycle had executed when `executed` was read.
    pub(super) fn has_executed(&self, executed: &Executed, ticket: CommandTicket) -> bool {
        let (last, words) = match ticket.kind() {
            Some(Kind::Stop) => return CommandTicket::from_number(executed.stop).covers(ticket),
            Some(Kind::One) => (executed.one, &self.executed_one),
            Some(Kind::All) => (executed.all, &self.executed_all),
            None => return false,
        };
        let last = CommandTicket::from_number(last);
        if ticket.term() < last.term() {
            // A term that has ended before: its last ticket does not change.
            let word = of_term(words, ticket.term()).load(Ordering::Acquire);
            return CommandTicket::from_number(word).covers(ticket);
        }
        last.covers(ticket)
    }

    // The executing tables

    fn tables(&self) -> MutexGuard<'_, Vec<Table>> {
        self.tables.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a table, which takes the commands to one axis from now on; `ticket` is the last number that
    /// it need not execute. Returns the number and the slot of the table. Allocates.
    pub(super) fn register_table(&self, axis_count: usize, ticket: u64) -> (u64, Option<usize>) {
        let mut tables = self.tables();
        let number = self.last_table.fetch_add(1, Ordering::AcqRel) + 1;
        let slot = self.seen.iter().position(|seen| seen.load(Ordering::Acquire) == FREE);
        match slot.and_then(|slot| self.seen.get(slot)) {
            Some(seen) => seen.store(ticket, Ordering::Release),
            None => {
                self.untracked.fetch_add(1, Ordering::AcqRel);
            }
        }
        tables.push(Table { number, axis_count: axis_count.min(MAX_AXES), slot });
        self.begin_term(&tables);
        (number, slot)
    }

    /// Removes a table; the one registered before it takes the commands.
    pub(super) fn remove_table(&self, number: u64) {
        let mut tables = self.tables();
        let Some(at) = tables.iter().position(|table| table.number == number) else { return };
        let removed = tables.remove(at);
        self.begin_term(&tables);
        // After the new term: `acknowledge` looks at them in the other order.
        match removed.slot.and_then(|slot| self.seen.get(slot)) {
            Some(seen) => seen.store(FREE, Ordering::Release),
            None => {
                self.untracked.fetch_sub(1, Ordering::AcqRel);
            }
        }
    }

    fn begin_term(&self, tables: &[Table]) {
        let (number, count) = tables.last().map_or((0, 0), |last| (last.number, last.axis_count));
        if self.axis_table.load(Ordering::Acquire) != number {
            self.axis_count.store(0, Ordering::Release);
            self.axis_table.store(0, Ordering::Release);
            for bits in &self.quick_stops {
                bits.store(0, Ordering::Release);
            }
        }
        let term = CommandTicket::new(Kind::One, self.term() + 1, 0).term();
        of_term(&self.executed_one, term).store(kind_start(Kind::One, term), Ordering::Release);
        of_term(&self.executed_all, term).store(kind_start(Kind::All, term), Ordering::Release);
        self.term.store(term, Ordering::Release);
        self.axis_table.store(number, Ordering::Release);
        self.axis_count.store(count, Ordering::Release);
    }

    /// Returns whether a table takes the commands to one axis.
    pub(super) fn is_table(&self, table: u64) -> bool {
        self.axis_table.load(Ordering::Acquire) == table
    }

    /// Returns whether a table was registered last.
    pub(super) fn is_last_table(&self, table: u64) -> bool {
        self.last_table.load(Ordering::Acquire) == table
    }

    pub(super) fn last_quick_stop(&self) -> u64 {
        self.last_quick_stop.load(Ordering::Acquire)
    }

    pub(super) fn quick_stops_of_all(&self) -> u64 {
        self.quick_stop_all.load(Ordering::Acquire)
    }

    /// Takes the axes with a quick stop, in groups of 64: the first axis and the bits.
    pub(super) fn take_quick_stops(&self) -> impl Iterator<Item = (usize, u64)> {
        let groups = self.axis_count().div_ceil(BITS);
        let take =
            |(group, bits): (usize, &AtomicU64)| (group * BITS, bits.swap(0, Ordering::AcqRel));
        self.quick_stops.iter().take(groups).enumerate().map(take)
    }

    /// Has `execute` take all commands up to a number, and acknowledges them: to one axis if `execute`
    /// returns true, to all axes once every table has executed them.
    pub(super) fn acknowledge(
        &self,
        ticket: u64,
        slot: Option<usize>,
        execute: impl FnOnce() -> bool,
    ) {
        let term = self.term();
        // Another thread may end a later table at the same time, with its commands: a new term.
        if execute() && self.term() == term {
            let executed = CommandTicket::new(Kind::One, term, ticket);
            of_term(&self.executed_one, term).store(executed.number(), Ordering::Release);
        }
        if let Some(seen) = slot.and_then(|slot| self.seen.get(slot)) {
            seen.store(ticket, Ordering::Release);
        }
        let of_all = self.seen.iter().map(|seen| seen.load(Ordering::Acquire)).min();
        let is_tracked = self.untracked.load(Ordering::Acquire) == 0;
        let Some(of_all) = of_all.filter(|of_all| is_tracked && *of_all != FREE) else { return };
        // A table that was removed before the slots were read has begun a term.
        if self.term() == term {
            let executed = CommandTicket::new(Kind::All, term, of_all);
            of_term(&self.executed_all, term).store(executed.number(), Ordering::Release);
        }
    }
}

const NUMBER_BITS: u32 = 40;
const TERM_BITS: u32 = 22;
const NUMBER_MASK: u64 = (1 << NUMBER_BITS) - 1;
const TERM_MASK: u64 = (1 << TERM_BITS) - 1;

/// Kind of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Stop = 1,
    /// Quick stop of one axis.
    One = 2,
    /// Quick stop of all axes.
    All = 3,
}

/// Number of a command. The cycle has executed it as soon as a snapshot
/// [has it](crate::Snapshot::has_executed).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct CommandTicket(u64);

impl CommandTicket {
    pub(super) fn new(kind: Kind, term: u64, number: u64) -> Self {
        let number = number & NUMBER_MASK;
        Self(
            (kind as u64) << (TERM_BITS + NUMBER_BITS) | (term & TERM_MASK) << NUMBER_BITS | number,
        )
    }

    /// The ticket with a [`number`](Self::number). Of a number that no command returned, as 0, nothing
    /// is executed.
    pub fn from_number(number: u64) -> Self {
        Self(number)
    }

    /// The number: not 0, and different for each command of an Adapter.
    pub fn number(self) -> u64 {
        self.0
    }

    pub(super) fn kind(self) -> Option<Kind> {
        match self.0 >> (TERM_BITS + NUMBER_BITS) {
            1 => Some(Kind::Stop),
            2 => Some(Kind::One),
            3 => Some(Kind::All),
            _ => None,
        }
    }

    pub(super) fn term(self) -> u64 {
        self.0 >> NUMBER_BITS & TERM_MASK
    }

    /// Returns whether this ticket, if executed, says that another one is: of the same kind and term,
    /// and not later.
    pub(super) fn covers(self, other: Self) -> bool {
        self.0 >> NUMBER_BITS == other.0 >> NUMBER_BITS
            && (1..=self.0 & NUMBER_MASK).contains(&(other.0 & NUMBER_MASK))
    }
}

impl fmt::Display for CommandTicket {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// State that an Adapter shares with its observers.
#[derive(Debug)]
pub(super) struct Shared {
    pub(super) commands: Commands,
    /// The ring that the cycle writes, or an earlier one of the chain. Locked outside the cycle only; it
    /// keeps the rings alive that the cycle leaves.
    pub(super) first_ring: Mutex<Arc<Ring>>,
    /// Sections that were reserved so far.
    pub(super) reservations: AtomicU64,
    /// Observers and their snapshots.
    pub(super) observers: AtomicUsize,
    pub(super) is_closed: AtomicBool,
}

impl Default for Shared {
    fn default() -> Self {
        Self {
            commands: Commands::default(),
            first_ring: Mutex::new(Arc::new(Ring::new(Layout::default()))),
            reservations: AtomicU64::new(0),
            observers: AtomicUsize::new(0),
            is_closed: AtomicBool::new(false),
        }
    }
}

impl Shared {
    pub(super) fn first_ring(&self) -> Arc<Ring> {
        Arc::clone(&self.first_ring.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Handle for other threads than the cycle's: reads a [`Snapshot`](crate::Snapshot) of the last cycle, and gives commands
/// that the next cycle executes.
///
/// The cycle never waits for it: publishing takes neither lock nor system call nor memory, and a slow
/// reader only repeats its own read. While an Adapter has no observer its cycle publishes nothing.
///
/// The commands use atomics only: a signal handler may give them. Each returns a [`CommandTicket`];
/// [`Snapshot::has_executed`](crate::Snapshot::has_executed) reports that a cycle has given the command to
/// the axis. The state of the axis reports its effect.
///
/// ```no_run
/// # fn run(adapter: &ecan_host::Adapter) {
/// let observer = adapter.observer();
/// std::thread::spawn(move || {
///     let mut snapshot = observer.snapshot();
///     while snapshot.update().is_ok() {
///         println!("cycle {}: {} overruns", snapshot.cycle(), snapshot.overruns());
///         std::thread::sleep(std::time::Duration::from_millis(100));
///     }
/// });
/// # }
/// ```
#[derive(Debug)]
pub struct Observer {
    shared: Arc<Shared>,
}

impl Observer {
    pub(super) fn new(shared: Arc<Shared>) -> Self {
        shared.observers.fetch_add(1, Ordering::AcqRel);
        Self { shared }
    }

    pub(super) fn shared(&self) -> &Shared {
        &self.shared
    }

    /// Returns whether the Adapter is gone: there are no further snapshots, and commands have no effect.
    pub fn is_closed(&self) -> bool {
        self.shared.is_closed.load(Ordering::Acquire)
    }

    /// Number of axes that commands can name: those of the table that was created last, of those that
    /// exist.
    pub fn axis_count(&self) -> usize {
        self.shared.commands.axis_count()
    }

    /// Requests the application to stop: every call that waits by running the cycle ends with
    /// [`Error::Stopped`](crate::Error::Stopped), but not a shutdown;
    /// [`Adapter::is_stop_requested`](crate::Adapter::is_stop_requested) reports it to the application's own loop.
    /// The request stays in force until
    /// [`clear_stop_request`](crate::Adapter::clear_stop_request). It takes effect at once, and the next
    /// snapshot reports it as executed. Async-signal-safe.
    pub fn request_stop(&self) -> CommandTicket {
        self.shared.commands.request_stop()
    }

    /// Commands a quick stop to an axis, executed when the cycle next sends targets. It is dropped if
    /// the axes end before that, and then never reported as executed. Async-signal-safe.
    ///
    /// # Errors
    /// [`NoSuchAxis`].
    pub fn quick_stop(&self, axis: usize) -> Result<CommandTicket, NoSuchAxis> {
        self.shared.commands.quick_stop(axis)
    }

    /// Commands a quick stop to all axes of all tables, executed when the cycle next sends their targets,
    /// and reported as executed when every table has done so; never if a table was created or has ended
    /// before. Async-signal-safe.
    pub fn quick_stop_all(&self) -> CommandTicket {
        self.shared.commands.quick_stop_all()
    }
}

impl Clone for Observer {
    fn clone(&self) -> Self {
        Self::new(Arc::clone(&self.shared))
    }
}

impl Drop for Observer {
    fn drop(&mut self) {
        self.shared.observers.fetch_sub(1, Ordering::AcqRel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticket_covers_earlier_ones_of_its_kind_and_term() {
        let last = CommandTicket::new(Kind::One, 5, 7);
        assert_eq!((last.kind(), last.term()), (Some(Kind::One), 5));
        for (kind, term, number, is_covered) in [
            (Kind::One, 5, 7, true),
            (Kind::One, 5, 1, true),
            (Kind::One, 5, 0, false),
            (Kind::One, 5, 8, false),
            (Kind::One, 4, 7, false),
            (Kind::One, 6, 7, false),
            (Kind::All, 5, 7, false),
            (Kind::Stop, 5, 7, false),
        ] {
            let other = CommandTicket::new(kind, term, number);
            assert_eq!(last.covers(other), is_covered, "{kind:?} {term} {number}");
        }
        assert_eq!(CommandTicket::from_number(0).kind(), None);
    }
}
