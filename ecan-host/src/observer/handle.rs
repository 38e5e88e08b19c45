//! What the cycle shares with other threads: their handle, and the publisher of the cycle.

use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use super::commands::{CommandTicket, Commands, Executed, NoSuchAxis};
use super::quick_stops::QuickStops;
use super::ring::{Layout, Ring, Section, SectionWriter};

/// What an Adapter shares with its observers.
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
    /// It stays in force until
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

/// Writes the snapshots of an Adapter, one version per cycle. Its methods are for the layers of the SDK.
#[derive(Debug)]
pub struct Publisher {
    shared: Arc<Shared>,
    ring: Arc<Ring>,
    /// Of the last version that was begun.
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
}

impl Drop for Publisher {
    fn drop(&mut self) {
        self.shared.is_closed.store(true, Ordering::Release);
    }
}
