//! Contexts of C: words that name an object in a table, checked before any access.
//!
//! The manual's fragments leave contexts uninitialised before `_init`, and a C program may copy
//! one, use it after its end or from two threads. So a context is sealed with its own address, the
//! slots that objects live in are never freed, and each has a generation that ends with its object.

use std::cell::UnsafeCell;
use std::ops::{Deref, DerefMut};
#[cfg(not(loom))]
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering;
use std::sync::{Mutex, MutexGuard, PoisonError};

use ecan_c_boundary::Call;
use ecan_c_boundary::result::ecan_result_t;
#[cfg(loom)]
use loom::sync::atomic::AtomicU64;

use crate::guard::{Access, Busy, Guard};

/// Kind of a context, with the function that initialises it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Adapter,
    Port,
    Cia402,
    Diagnostics,
    Observer,
}

impl Kind {
    fn init(self) -> &'static str {
        match self {
            Self::Adapter => "ecan_igh_init",
            Self::Port => "igh_mcan_port_init",
            Self::Cia402 => "igh_cia402_context_init",
            Self::Diagnostics => "ecan_igh_diagnostics_open",
            Self::Observer => "ecan_igh_observer_init",
        }
    }
}

/// The words of a context.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Words {
    pub(crate) slot: usize,
    pub(crate) generation: u64,
    /// Number of the context among those of its kind that the object has had.
    serial: u64,
    seal: u64,
}

impl Words {
    /// A number that depends on everything, the context's own address included. Bytes that happen
    /// to lie there have it once in 2^64 times.
    #[inline]
    fn seal_at(&self, address: usize, kind: Kind) -> u64 {
        let kind = 0x6563_616e_5f69_6768 ^ (kind as u64) << 56;
        kind ^ address as u64 ^ self.slot as u64 ^ self.generation ^ self.serial.rotate_left(32)
    }
}

/// Storage of an object. Never freed: a context may outlive its object.
pub(crate) struct Slot<T> {
    generation: AtomicU64,
    guard: Guard,
    object: UnsafeCell<Option<T>>,
}

// SAFETY: the object is reached only by the thread that has entered the guard.
unsafe impl<T: Send> Sync for Slot<T> {}

/// The slots of a type: free ones, and used ones with the address of the context that was
/// initialised for each.
pub(crate) struct Pool<T: 'static>(Mutex<Slots<T>>);

struct Slots<T: 'static> {
    free: Vec<&'static Slot<T>>,
    living: Vec<(usize, &'static Slot<T>)>,
}

impl<T> Pool<T> {
    pub(crate) const fn new() -> Self {
        Self(Mutex::new(Slots { free: Vec::new(), living: Vec::new() }))
    }

    fn slots(&self) -> MutexGuard<'_, Slots<T>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

pub(crate) trait Pooled: Sized + Send + 'static {
    fn pool() -> &'static Pool<Self>;

    /// Returns true while a cycle is open, which belongs to the thread that began it.
    #[inline]
    fn has_open_cycle(&self) -> bool {
        false
    }
}

/// An object in use by this call.
pub(crate) struct Entered<T: Pooled> {
    slot: &'static Slot<T>,
    /// Serial of the context through which it was entered.
    pub(crate) serial: u64,
}

impl<T: Pooled> Deref for Entered<T> {
    type Target = T;

    #[inline]
    fn deref(&self) -> &T {
        // SAFETY: this value has entered the guard, so no other reference exists; `enter` has seen
        // the object's generation, which ends when `leave` takes it out.
        unsafe { (*self.slot.object.get()).as_ref().unwrap_unchecked() }
    }
}

impl<T: Pooled> DerefMut for Entered<T> {
    #[inline]
    fn deref_mut(&mut self) -> &mut T {
        // SAFETY: as above.
        unsafe { (*self.slot.object.get()).as_mut().unwrap_unchecked() }
    }
}

impl<T: Pooled> Drop for Entered<T> {
    #[inline]
    fn drop(&mut self) {
        // SAFETY: this value has entered the guard.
        let object = unsafe { (*self.slot.object.get()).as_ref() };
        self.slot.guard.leave(object.is_some_and(T::has_open_cycle));
    }
}

impl<T: Pooled> Entered<T> {
    /// Begins a cycle of this thread, or the wait for one.
    #[inline]
    pub(crate) fn begin_cycle(&self, call: Call) -> Result<(), ecan_result_t> {
        self.slot.guard.begin_cycle().map_err(|reason| busy(call, reason))
    }

    /// Ends the cycle of this thread, if any: other threads may run the next one.
    #[inline]
    pub(crate) fn end_cycle(&self, call: Call) -> Result<(), ecan_result_t> {
        self.slot.guard.end_cycle().map_err(|reason| busy(call, reason))
    }

    /// Keeps the object for this thread until the cycle that it has opened ends.
    #[inline]
    pub(crate) fn keep(&self) {
        self.slot.guard.keep();
    }

    /// Lets other threads use the object during a sleep of the thread that runs the cycle.
    pub(crate) fn sleep<R>(&mut self, sleep: impl FnOnce() -> R) -> R {
        self.slot.guard.sleep(sleep)
    }

    /// Writes another context of the same object.
    ///
    /// # Safety
    /// `context` is valid for writing.
    pub(crate) unsafe fn add_context(&self, context: *mut Words, kind: Kind, serial: u64) {
        let generation = self.slot.generation.load(Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { write(context, kind, std::ptr::from_ref(self.slot).addr(), generation, serial) };
    }

    /// Takes the object out of its slot; its contexts name nothing afterwards.
    pub(crate) fn leave(self) -> Option<T> {
        let slot = self.slot;
        // SAFETY: this value has entered the guard.
        let object = unsafe { (*slot.object.get()).take() };
        slot.generation.fetch_add(1, Ordering::Release);
        // Not the next object in this slot. A cycle of another thread has ended: `enter` was long.
        let _ = slot.guard.end_cycle();
        drop(self);
        let mut slots = T::pool().slots();
        slots.living.retain(|(_, living)| !std::ptr::eq(*living, slot));
        slots.free.push(slot);
        object
    }
}

/// # Safety
/// `context` is valid for writing.
pub(crate) unsafe fn write(
    context: *mut Words,
    kind: Kind,
    slot: usize,
    generation: u64,
    serial: u64,
) {
    let mut words = Words { slot, generation, serial, seal: 0 };
    words.seal = words.seal_at(context.addr(), kind);
    // SAFETY: the caller's promise.
    unsafe { context.write(words) };
}

/// Words of a context that bears its seal.
///
/// # Safety
/// `context` is valid for reading, with any content.
#[inline(always)]
pub(crate) unsafe fn sealed_words(context: *const Words, kind: Kind) -> Option<Words> {
    // SAFETY: the caller's promise; any bytes are good for integers.
    let words = unsafe { context.read() };
    (words.seal == words.seal_at(context.addr(), kind)).then_some(words)
}

/// Slot that a context names, if any.
///
/// # Safety
/// `context` is valid for reading and was last written to by this module if it bears its seal.
#[inline(always)]
unsafe fn find<T: Pooled>(context: *const Words, kind: Kind) -> Option<(&'static Slot<T>, Words)> {
    // SAFETY: the caller's promise.
    let words = unsafe { sealed_words(context, kind) }?;
    // SAFETY: the seal says that the words are ours, and slots live for ever.
    let slot = unsafe { &*std::ptr::with_exposed_provenance::<Slot<T>>(words.slot) };
    (slot.generation.load(Ordering::Acquire) == words.generation).then_some((slot, words))
}

/// Stores an object in a slot and writes its first context. The old content of the context is
/// ignored; after an error it names nothing. An object whose context was overwritten ends.
///
/// # Errors
/// The context names a living object already, which stays.
///
/// # Safety
/// `context` is valid for writing.
pub(crate) unsafe fn init<T: Pooled>(
    call: Call,
    context: *mut Words,
    kind: Kind,
    object: impl FnOnce() -> Result<T, ecan_result_t>,
) -> Result<(), ecan_result_t> {
    let address = context.addr();
    let found = T::pool().slots().living.iter().find(|(living, _)| *living == address).copied();
    if let Some((_, slot)) = found {
        // SAFETY: the caller's promise. Only memory that was a context is read.
        if unsafe { find::<T>(context, kind) }.is_some() {
            return Err(reject_living(call));
        }
        slot.guard.enter(Access::Long).map_err(|reason| busy(call, reason))?;
        Entered { slot, serial: 0 }.leave();
    }
    // SAFETY: the caller's promise.
    unsafe { clear(context) };
    let object = object()?;
    let mut slots = T::pool().slots();
    let slot = slots.free.pop().unwrap_or_else(|| {
        let slot: &'static Slot<T> = Box::leak(Box::new(Slot {
            generation: AtomicU64::new(1),
            guard: Guard::new(),
            object: UnsafeCell::new(None),
        }));
        slot.guard.init();
        std::ptr::from_ref(slot).expose_provenance();
        slot
    });
    slots.living.push((address, slot));
    // SAFETY: a free slot has no user: no context has its generation.
    unsafe { *slot.object.get() = Some(object) };
    let generation = slot.generation.load(Ordering::Relaxed);
    // SAFETY: the caller's promise.
    unsafe { write(context, kind, std::ptr::from_ref(slot).addr(), generation, 0) };
    Ok(())
}

/// Serial of a context that names an object; `None` for memory with other content.
///
/// # Safety
/// `context` is valid for reading, with any content.
pub(crate) unsafe fn serial<T: Pooled>(context: *const Words, kind: Kind) -> Option<u64> {
    // SAFETY: the caller's promise.
    unsafe { find::<T>(context, kind) }.map(|(_, words)| words.serial)
}

/// # Safety
/// `context` is valid for writing.
pub(crate) unsafe fn clear(context: *mut Words) {
    // SAFETY: the caller's promise.
    unsafe { context.write(Words { slot: 0, generation: 0, serial: 0, seal: 0 }) };
}

/// The error of a context that names a living object already.
#[cold]
pub(crate) fn reject_living(call: Call) -> ecan_result_t {
    let text = format_args!("the context is initialised already: deinit it first");
    call.fail(ecan_result_t::ECAN_ERR_ORDER, text)
}

/// Enters the object that a context names. Allocates nothing.
///
/// # Safety
/// `context` is NULL or valid for reading, with any content.
#[inline(always)]
pub(crate) unsafe fn enter<T: Pooled>(
    call: Call,
    context: *const Words,
    kind: Kind,
    access: Access,
) -> Result<Entered<T>, ecan_result_t> {
    // SAFETY: the caller's promise.
    unsafe { call.read("context", context)? };
    // SAFETY: as above.
    let Some((slot, words)) = (unsafe { find::<T>(context, kind) }) else {
        return Err(not_initialised(call, kind));
    };
    slot.guard.enter(access).map_err(|reason| busy(call, reason))?;
    // Another thread may have ended the object before this one entered the guard.
    if slot.generation.load(Ordering::Acquire) != words.generation {
        slot.guard.leave(false);
        return Err(not_initialised(call, kind));
    }
    Ok(Entered { slot, serial: words.serial })
}

#[cold]
fn busy(call: Call, reason: Busy) -> ecan_result_t {
    call.fail(ecan_result_t::ECAN_ERR_BUSY, format_args!("{}", reason.text()))
}

/// As [`enter`]; `None` for a context that names no object.
///
/// # Safety
/// As for [`enter`].
pub(crate) unsafe fn enter_to_end<T: Pooled>(
    call: Call,
    context: *const Words,
    kind: Kind,
) -> Result<Option<Entered<T>>, ecan_result_t> {
    // SAFETY: the caller's promise.
    unsafe {
        call.read("context", context)?;
        if find::<T>(context, kind).is_none() {
            return Ok(None);
        }
        enter(call, context, kind, Access::Long).map(Some)
    }
}

/// The error of a context that names no object.
#[cold]
pub(crate) fn not_initialised(call: Call, kind: Kind) -> ecan_result_t {
    let init = kind.init();
    let text = format_args!(
        "the context is not initialised, is deinitialised, or was copied: call {init} on it"
    );
    call.fail(ecan_result_t::ECAN_ERR_NOT_INITIALISED, text)
}

pub(crate) trait Context: Sized {
    /// The object that it names.
    type Object: Pooled;
    const KIND: Kind;
    /// The layer that calls with this context work on.
    type Layer<'a>;

    /// Returns false for a context that outlived its part of the object.
    fn is_current(_: &Entered<Self::Object>) -> bool {
        true
    }

    fn layer(
        call: Call,
        object: &mut Entered<Self::Object>,
    ) -> Result<Self::Layer<'_>, ecan_result_t>;
}

/// Enters the object that a context names.
///
/// # Safety
/// `context` is NULL or valid for reading, with any content.
#[inline(always)]
pub(crate) unsafe fn enter_context<C: Context>(
    call: Call,
    context: *const C,
    access: Access,
) -> Result<Entered<C::Object>, ecan_result_t> {
    const { assert!(size_of::<Words>() == size_of::<C>()) };
    // SAFETY: the caller's promise.
    let object = unsafe { enter(call, context.cast(), C::KIND, access)? };
    if !C::is_current(&object) {
        return Err(not_initialised(call, C::KIND));
    }
    Ok(object)
}

/// The layer that calls with a context work on.
#[inline(always)]
pub(crate) fn layer_of<C: Context>(
    _: *const C,
    call: Call,
    object: &mut Entered<C::Object>,
) -> Result<C::Layer<'_>, ecan_result_t> {
    C::layer(call, object)
}

/// Enters the object that a context names, if any.
///
/// # Safety
/// As for [`enter_context`].
pub(crate) unsafe fn enter_context_to_end<C: Context>(
    call: Call,
    context: *const C,
) -> Result<Option<Entered<C::Object>>, ecan_result_t> {
    // SAFETY: the caller's promise.
    let object = unsafe { enter_to_end(call, context.cast(), C::KIND)? };
    Ok(object.filter(C::is_current))
}

#[cfg(all(test, loom))]
mod interleaving_tests;
#[cfg(all(test, not(loom)))]
mod tests;
