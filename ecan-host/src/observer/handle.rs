//! Handle of other threads to the cycle, and what the cycle shares with it.

use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use super::commands::{CommandTicket, Commands, NoSuchAxis};
use super::ring::{Layout, Ring};

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
