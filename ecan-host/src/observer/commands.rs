//! Commands of other threads to the cycle: numbers and flags.

use std::fmt;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};

use ecan_protocol::mapping::CHANNELS;
use thiserror::Error;

use crate::config::MAX_SLAVES;

/// Node-IDs of a CAN bus.
const NODE_IDS: usize = 127;
/// Most axes of a table: one per node-ID, channel and slave.
const MAX_AXES: usize = MAX_SLAVES * CHANNELS * NODE_IDS;
const BITS: usize = u64::BITS as usize;

/// Number of a command. The cycle has executed it as soon as a snapshot
/// [has it](crate::Snapshot::has_executed).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CommandTicket(pub(super) u64);

impl CommandTicket {
    /// The number, from 1 on; later commands have larger ones.
    pub fn number(self) -> u64 {
        self.0
    }
}

impl fmt::Display for CommandTicket {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// Error of a command to an axis that the table does not have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("axis index {axis} is out of range: {count} axes are in use")]
pub struct NoSuchAxis {
    /// The index.
    pub axis: usize,
    /// Number of axes.
    pub count: usize,
}

/// Pending commands. Only atomics, so that signal handlers can give commands.
///
/// A command is stored before its number is drawn; so the cycle finds every command with a number up
/// to the one that it reads first.
#[derive(Debug)]
pub(super) struct Commands {
    last_ticket: AtomicU64,
    stop_requested: AtomicBool,
    /// Commands to all axes.
    quick_stop_all: AtomicU64,
    /// A bit per axis.
    quick_stops: Box<[AtomicU64]>,
    /// Number of the table of axes that executes quick stops; 0 without one.
    axis_table: AtomicU64,
    last_table: AtomicU64,
    axis_count: AtomicUsize,
    /// Last number that the table has executed.
    executed: AtomicU64,
}

impl Default for Commands {
    fn default() -> Self {
        Self {
            last_ticket: AtomicU64::new(0),
            stop_requested: AtomicBool::new(false),
            quick_stop_all: AtomicU64::new(0),
            quick_stops: (0..MAX_AXES.div_ceil(BITS)).map(|_| AtomicU64::new(0)).collect(),
            axis_table: AtomicU64::new(0),
            last_table: AtomicU64::new(0),
            axis_count: AtomicUsize::new(0),
            executed: AtomicU64::new(0),
        }
    }
}

impl Commands {
    fn draw(&self) -> CommandTicket {
        CommandTicket(self.last_ticket.fetch_add(1, Ordering::AcqRel) + 1)
    }

    pub(super) fn request_stop(&self) -> CommandTicket {
        self.stop_requested.store(true, Ordering::Release);
        self.draw()
    }

    pub(super) fn clear_stop_request(&self) {
        self.stop_requested.store(false, Ordering::Release);
    }

    pub(super) fn is_stop_requested(&self) -> bool {
        self.stop_requested.load(Ordering::Acquire)
    }

    pub(super) fn quick_stop_all(&self) -> CommandTicket {
        self.quick_stop_all.fetch_add(1, Ordering::AcqRel);
        self.draw()
    }

    pub(super) fn quick_stop(&self, axis: usize) -> Result<CommandTicket, NoSuchAxis> {
        let count = self.axis_count();
        match self.quick_stops.get(axis / BITS) {
            Some(bits) if axis < count => {
                bits.fetch_or(1 << (axis % BITS), Ordering::AcqRel);
                Ok(self.draw())
            }
            _ => Err(NoSuchAxis { axis, count }),
        }
    }

    pub(super) fn axis_count(&self) -> usize {
        self.axis_count.load(Ordering::Acquire)
    }

    /// Number of the last command that the cycle has executed.
    pub(super) fn executed(&self) -> u64 {
        match self.axis_table.load(Ordering::Acquire) {
            0 => self.last_ticket.load(Ordering::Acquire),
            _ => self.executed.load(Ordering::Acquire),
        }
    }

    // The executing table

    /// Number of the table that executes the quick stops from now on.
    pub(super) fn register_table(&self, axis_count: usize) -> u64 {
        let table = self.last_table.fetch_add(1, Ordering::AcqRel) + 1;
        for bits in &self.quick_stops {
            bits.store(0, Ordering::Relaxed);
        }
        self.executed.store(self.last_ticket.load(Ordering::Acquire), Ordering::Release);
        self.axis_table.store(table, Ordering::Release);
        self.axis_count.store(axis_count.min(MAX_AXES), Ordering::Release);
        table
    }

    pub(super) fn remove_table(&self, table: u64) {
        if self.is_table(table) {
            self.axis_count.store(0, Ordering::Release);
            self.axis_table.store(0, Ordering::Release);
        }
    }

    pub(super) fn is_table(&self, table: u64) -> bool {
        self.axis_table.load(Ordering::Acquire) == table
    }

    pub(super) fn last_ticket(&self) -> u64 {
        self.last_ticket.load(Ordering::Acquire)
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

    pub(super) fn set_executed(&self, ticket: u64) {
        self.executed.store(ticket, Ordering::Release);
    }
}
