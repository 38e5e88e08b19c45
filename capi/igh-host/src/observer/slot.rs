//! Storage of observers, which several threads and signal handlers use at the same time.

use std::cell::UnsafeCell;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

use ecan_c_boundary::Call;
use ecan_c_boundary::result::ecan_result_t;
use ecan_host::{Observer, Snapshot};

use crate::handle::{self, Kind, Words};

/// Pause of a deinit while calls of other threads end.
const PAUSE: Duration = Duration::from_micros(20);

/// Storage of an observer. Never freed: a handle may outlive its observer.
pub(crate) struct Slot {
    /// Ends with the observer.
    generation: AtomicU64,
    /// Calls that may use the observer.
    calls: AtomicUsize,
    observer: UnsafeCell<Option<Observer>>,
    snapshot: Mutex<Option<Snapshot>>,
}

// SAFETY: `observer` is replaced only while no handle has the generation of the slot and no call is
// in progress; otherwise it is shared.
unsafe impl Sync for Slot {}

/// Free slots, and used ones with the address of their handle.
static SLOTS: Mutex<Slots> = Mutex::new(Slots { free: Vec::new(), living: Vec::new() });

struct Slots {
    free: Vec<&'static Slot>,
    living: Vec<(usize, &'static Slot)>,
}

fn slots() -> MutexGuard<'static, Slots> {
    SLOTS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A call in progress.
pub(crate) struct Entered(&'static Slot);

impl Drop for Entered {
    fn drop(&mut self) {
        self.0.calls.fetch_sub(1, Ordering::SeqCst);
    }
}

impl Entered {
    /// Atomics only.
    pub(crate) fn observer(&self) -> Option<&Observer> {
        // SAFETY: this call is counted, and has seen the generation of its handle afterwards: the
        // observer stays until it ends.
        unsafe { (*self.0.observer.get()).as_ref() }
    }

    /// The snapshot of the handle; `None` while another call uses it.
    pub(crate) fn snapshot(&self) -> Option<MutexGuard<'_, Option<Snapshot>>> {
        match self.0.snapshot.try_lock() {
            Ok(snapshot) => Some(snapshot),
            Err(std::sync::TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
            Err(std::sync::TryLockError::WouldBlock) => None,
        }
    }
}

/// Slot that a handle names, if any, with the generation of the handle.
///
/// # Safety
/// `handle` is valid for reading, with any content.
unsafe fn find(handle: *const Words) -> Option<(&'static Slot, u64)> {
    // SAFETY: the caller's promise.
    let words = unsafe { handle::sealed_words(handle, Kind::Observer) }?;
    // SAFETY: the seal says that the words are ours, and slots live for ever.
    let slot = unsafe { &*std::ptr::with_exposed_provenance::<Slot>(words.slot) };
    Some((slot, words.generation))
}

/// Starts a call; `None` for a handle that names no observer. Atomics only: for signal handlers.
///
/// # Safety
/// `handle` is valid for reading, with any content.
pub(crate) unsafe fn enter(handle: *const Words) -> Option<Entered> {
    // SAFETY: the caller's promise.
    let (slot, generation) = unsafe { find(handle) }?;
    // Before the generation: `end` looks at them in the other order.
    slot.calls.fetch_add(1, Ordering::SeqCst);
    let entered = Entered(slot);
    (slot.generation.load(Ordering::SeqCst) == generation).then_some(entered)
}

/// Stores an observer and writes its handle.
///
/// # Safety
/// `handle` is valid for writing; its content is ignored.
pub(crate) unsafe fn init(
    call: Call,
    handle: *mut Words,
    observer: Observer,
) -> Result<(), ecan_result_t> {
    let address = handle.addr();
    let found = slots().living.iter().find(|(living, _)| *living == address).copied();
    if let Some((_, slot)) = found {
        let generation = slot.generation.load(Ordering::SeqCst);
        // SAFETY: the caller's promise. Only memory that was a handle is read.
        let named = unsafe { find(handle) };
        if named.is_some_and(|(it, its)| std::ptr::eq(it, slot) && its == generation) {
            return Err(handle::living(call));
        }
        // The handle was overwritten.
        end(slot, generation);
    }
    let snapshot = observer.snapshot();
    let mut slots = slots();
    let slot = slots.free.pop().unwrap_or_else(|| {
        let slot: &'static Slot = Box::leak(Box::new(Slot {
            generation: AtomicU64::new(1),
            calls: AtomicUsize::new(0),
            observer: UnsafeCell::new(None),
            snapshot: Mutex::new(None),
        }));
        std::ptr::from_ref(slot).expose_provenance();
        slot
    });
    slots.living.push((address, slot));
    // SAFETY: no handle has the generation of a free slot, so no call uses the observer.
    unsafe { *slot.observer.get() = Some(observer) };
    *slot.snapshot.lock().unwrap_or_else(PoisonError::into_inner) = Some(snapshot);
    let generation = slot.generation.load(Ordering::SeqCst);
    let address = std::ptr::from_ref(slot).addr();
    // SAFETY: the caller's promise.
    unsafe { handle::write(handle, Kind::Observer, address, generation, 0) };
    Ok(())
}

/// Ends the observer of a handle, if any, after the calls that are in progress.
///
/// # Safety
/// `handle` is valid for reading, with any content.
pub(crate) unsafe fn deinit(handle: *const Words) {
    // SAFETY: the caller's promise.
    if let Some((slot, generation)) = unsafe { find(handle) } {
        end(slot, generation);
    }
}

fn end(slot: &'static Slot, generation: u64) {
    let (now, order) = (generation.wrapping_add(1), Ordering::SeqCst);
    // One of several calls ends it.
    if slot.generation.compare_exchange(generation, now, order, order).is_err() {
        return;
    }
    // A call that comes now sees the new generation and does not touch the observer.
    while slot.calls.load(Ordering::SeqCst) != 0 {
        thread::sleep(PAUSE);
    }
    // SAFETY: no call uses the observer, and no handle has the generation.
    let observer = unsafe { (*slot.observer.get()).take() };
    let snapshot = slot.snapshot.lock().unwrap_or_else(PoisonError::into_inner).take();
    drop((observer, snapshot));
    let mut slots = slots();
    slots.living.retain(|(_, living)| !std::ptr::eq(*living, slot));
    slots.free.push(slot);
}
