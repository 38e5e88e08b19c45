//! The cycle's side: writes a version per cycle.

use std::sync::Arc;
use std::sync::PoisonError;
use std::sync::atomic::Ordering;

use super::commands::Executed;
use super::handle::{Observer, Shared};
use super::quick_stops::QuickStops;
use super::ring::Ring;
use super::section::{Section, SectionWriter};

/// Writes the snapshots of an Adapter.
#[derive(Debug)]
pub(crate) struct Publisher {
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

    pub(crate) fn quick_stops(&self, axis_count: usize) -> QuickStops {
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

    /// Sets the size of a section and its words that the cycle does not write. Returns a number that no
    /// other reservation has. Allocates; outside the cycle.
    pub(crate) fn reserve(&self, section: Section, initial: &[u64]) -> u64 {
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

    /// The writer of a section of the version that is begun.
    #[inline]
    pub(crate) fn section(&self, section: Section) -> Option<SectionWriter<'_>> {
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
