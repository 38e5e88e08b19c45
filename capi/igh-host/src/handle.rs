//! Contexts of C: words that name an object in a table, checked before any access.
//!
//! The manual's fragments leave contexts uninitialised before `_init`, and a C program may copy
//! one, use it after its end or from two threads. So a context is sealed with its own address, the
//! slots that objects live in are never freed, and each has a generation that ends with its object.

use std::cell::UnsafeCell;
use std::ops::{Deref, DerefMut};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use ecan_mcan_host::boundary::Call;
use ecan_mcan_host::common::result::ecan_result_t;

/// Kind of a context, with the function that initialises it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Adapter,
    Port,
    Cia402,
    Diagnostics,
}

impl Kind {
    fn init(self) -> &'static str {
        match self {
            Self::Adapter => "ecan_igh_init",
            Self::Port => "igh_mcan_port_init",
            Self::Cia402 => "igh_cia402_context_init",
            Self::Diagnostics => "ecan_igh_diagnostics_open",
        }
    }
}

/// The words of a context.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Words {
    slot: usize,
    generation: u64,
    /// Number of the context among those of its kind that the object has had.
    serial: u64,
    seal: u64,
}

impl Words {
    /// A number that depends on everything, the context's own address included. Bytes that happen
    /// to lie there have it once in 2^64 times.
    #[inline]
    fn sealed(&self, address: usize, kind: Kind) -> u64 {
        let kind = 0x6563_616e_5f69_6768 ^ (kind as u64) << 56;
        kind ^ address as u64 ^ self.slot as u64 ^ self.generation ^ self.serial.rotate_left(32)
    }
}

/// Storage of an object. Never freed: a context may outlive its object.
pub(crate) struct Slot<T> {
    generation: AtomicU64,
    is_busy: AtomicBool,
    object: UnsafeCell<Option<T>>,
}

// SAFETY: the object is reached only by the thread that set `is_busy`.
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
        // SAFETY: this value has set `is_busy`, so no other reference exists; `enter` has seen
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
        self.slot.is_busy.store(false, Ordering::Release);
    }
}

impl<T: Pooled> Entered<T> {
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
        // SAFETY: this value has set `is_busy`.
        let object = unsafe { (*slot.object.get()).take() };
        slot.generation.fetch_add(1, Ordering::Release);
        drop(self);
        let mut slots = T::pool().slots();
        slots.living.retain(|(_, living)| !std::ptr::eq(*living, slot));
        slots.free.push(slot);
        object
    }
}

/// # Safety
/// `context` is valid for writing.
unsafe fn write(context: *mut Words, kind: Kind, slot: usize, generation: u64, serial: u64) {
    let mut words = Words { slot, generation, serial, seal: 0 };
    words.seal = words.sealed(context.addr(), kind);
    // SAFETY: the caller's promise.
    unsafe { context.write(words) };
}

/// Slot that a context names, if any.
///
/// # Safety
/// `context` is valid for reading and was last written to by this module if it bears its seal.
#[inline(always)]
unsafe fn find<T: Pooled>(context: *const Words, kind: Kind) -> Option<(&'static Slot<T>, Words)> {
    // SAFETY: the caller's promise; any bytes are good for integers.
    let words = unsafe { context.read() };
    if words.seal != words.sealed(context.addr(), kind) {
        return None;
    }
    // SAFETY: the seal says that the words are ours, and slots live for ever.
    let slot = unsafe { &*std::ptr::with_exposed_provenance::<Slot<T>>(words.slot) };
    (slot.generation.load(Ordering::Acquire) == words.generation).then_some((slot, words))
}

/// Stores an object in a slot and writes its first context. The old content of the context is
/// ignored; after an error it names nothing.
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
    if T::pool().slots().living.iter().any(|(living, _)| *living == address) {
        return Err(living(call));
    }
    // SAFETY: the caller's promise.
    unsafe { clear(context) };
    let object = object()?;
    let mut slots = T::pool().slots();
    let slot = slots.free.pop().unwrap_or_else(|| {
        let slot: &'static Slot<T> = Box::leak(Box::new(Slot {
            generation: AtomicU64::new(1),
            is_busy: AtomicBool::new(false),
            object: UnsafeCell::new(None),
        }));
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

/// # Safety
/// `context` is valid for writing.
pub(crate) unsafe fn clear(context: *mut Words) {
    // SAFETY: the caller's promise.
    unsafe { context.write(Words { slot: 0, generation: 0, serial: 0, seal: 0 }) };
}

/// The error of a context that names a living object already.
#[cold]
fn living(call: Call) -> ecan_result_t {
    let text = format_args!("the context is initialised already: deinit it first");
    call.fail(ecan_result_t::ECAN_ERR_ORDER, text)
}

/// Enters the object that a context names. Takes no lock and allocates nothing.
///
/// # Safety
/// `context` is NULL or valid for reading, with any content.
#[inline(always)]
pub(crate) unsafe fn enter<T: Pooled>(
    call: Call,
    context: *const Words,
    kind: Kind,
) -> Result<Entered<T>, ecan_result_t> {
    // SAFETY: the caller's promise.
    unsafe { call.read("context", context)? };
    // SAFETY: as above.
    let Some((slot, words)) = (unsafe { find::<T>(context, kind) }) else {
        return Err(not_initialised(call, kind));
    };
    if slot.is_busy.load(Ordering::Acquire) {
        let text = format_args!("the context is in use by another call");
        return Err(call.fail(ecan_result_t::ECAN_ERR_BUSY, text));
    }
    // No exchange, which would cost as much as the rest of a call: of two threads that come at the
    // very same instant, against the rules, both may pass.
    slot.is_busy.store(true, Ordering::Relaxed);
    Ok(Entered { slot, serial: words.serial })
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
        enter(call, context, kind).map(Some)
    }
}

/// The error of a context that names no object.
#[cold]
pub(crate) fn not_initialised(call: Call, kind: Kind) -> ecan_result_t {
    let text = format_args!(
        "the context is not initialised, is deinitialised, or was copied: call {} on it",
        kind.init()
    );
    call.fail(ecan_result_t::ECAN_ERR_NOT_INITIALISED, text)
}

#[cfg(test)]
mod tests {
    use std::ffi::c_int;
    use std::ptr::from_mut;

    use ecan_mcan_host::boundary::call;

    use super::*;

    struct Object(u32);

    static POOL: Pool<Object> = Pool::new();

    impl Pooled for Object {
        fn pool() -> &'static Pool<Self> {
            &POOL
        }
    }

    fn make(context: &mut Words, value: u32) -> c_int {
        // SAFETY: the context is valid.
        call("make", |call| unsafe {
            init(call, from_mut(context), Kind::Adapter, || Ok(Object(value)))
        })
    }

    fn value(context: &Words, kind: Kind) -> Result<u32, c_int> {
        let mut value = 0;
        let code = call("value", |call| {
            // SAFETY: the context is valid.
            value = unsafe { enter::<Object>(call, context, kind) }?.0;
            Ok(())
        });
        if code == 0 { Ok(value) } else { Err(code) }
    }

    fn end(context: &Words) -> c_int {
        call("end", |call| {
            // SAFETY: the context is valid.
            unsafe { enter::<Object>(call, context, Kind::Adapter) }?.leave();
            Ok(())
        })
    }

    const NONE: Result<u32, c_int> = Err(ecan_result_t::ECAN_ERR_NOT_INITIALISED.code());

    #[test]
    fn only_the_context_itself_names_the_object() {
        let mut context = Words { slot: 1, generation: 2, serial: 3, seal: 4 };
        assert_eq!(value(&context, Kind::Adapter), NONE);
        assert_eq!(make(&mut context, 7), 0);
        assert_eq!(value(&context, Kind::Adapter), Ok(7));
        assert_eq!(value(&context, Kind::Port), NONE, "of another kind");
        let copy = [context];
        assert_eq!(value(&copy[0], Kind::Adapter), NONE, "a copy elsewhere");
        assert_eq!(make(&mut context, 8), ecan_result_t::ECAN_ERR_ORDER.code());
        let saved = context;
        assert_eq!(end(&context), 0);
        assert_eq!(value(&context, Kind::Adapter), NONE);
        assert_eq!(end(&context), ecan_result_t::ECAN_ERR_NOT_INITIALISED.code());
        // The same place and the same slot, with another object in it.
        assert_eq!(make(&mut context, 9), 0);
        let now = context;
        context = saved;
        assert_eq!(value(&context, Kind::Adapter), NONE, "an old context");
        assert_eq!(make(&mut context, 8), ecan_result_t::ECAN_ERR_ORDER.code(), "at its place");
        context = now;
        assert_eq!(value(&context, Kind::Adapter), Ok(9));
        assert_eq!(end(&context), 0);
    }

    #[test]
    fn object_in_use_is_busy() {
        let mut context = Words { slot: 0, generation: 0, serial: 0, seal: 0 };
        assert_eq!(make(&mut context, 7), 0);
        let outer = call("outer", |call| {
            // SAFETY: the context is valid.
            let _inside = unsafe { enter::<Object>(call, &context, Kind::Adapter) }?;
            assert_eq!(value(&context, Kind::Adapter), Err(ecan_result_t::ECAN_ERR_BUSY.code()));
            Ok(())
        });
        assert_eq!(outer, 0);
        assert_eq!(value(&context, Kind::Adapter), Ok(7));
        assert_eq!(end(&context), 0);
    }
}
