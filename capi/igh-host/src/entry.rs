//! Calls with a context of C: enter it, work on its layer, store the result.

use std::ffi::c_int;

use ecan_mcan_host::boundary::{Call, Opaque, Sealed, call, getter};
use ecan_mcan_host::common::result::ecan_result_t;

use crate::bus::Bus;
use crate::handle::Entered;

/// A context struct of C.
pub(crate) trait Context: Sized {
    /// The layer that calls with this context work on.
    type Layer<'a>;

    /// Enters the bus that a context names.
    ///
    /// # Safety
    /// `context` is NULL or valid for reading, with any content.
    unsafe fn enter(call: Call, context: *const Self) -> Result<Entered<Bus>, ecan_result_t>;

    fn layer(call: Call, bus: &mut Entered<Bus>) -> Result<Self::Layer<'_>, ecan_result_t>;
}

/// A call with a context, before it is entered; made by [`enter!`].
pub(crate) struct Entry<C> {
    function: &'static str,
    context: *const C,
}

impl<C: Context> Entry<C> {
    /// # Safety
    /// `context` is NULL or valid for reading as long as this lives, with any content.
    pub(crate) unsafe fn new(function: &'static str, context: *const C) -> Self {
        Self { function, context }
    }

    /// Works on the whole bus.
    #[inline(always)]
    pub(crate) fn on_bus(
        self,
        work: impl FnOnce(Call, &mut Entered<Bus>) -> Result<(), ecan_result_t>,
    ) -> c_int {
        call(self.function, |call| {
            // SAFETY: the promise of `new`.
            work(call, &mut unsafe { C::enter(call, self.context)? })
        })
    }

    /// Works on the context's layer.
    #[inline(always)]
    pub(crate) fn run(
        self,
        work: impl FnOnce(Call, C::Layer<'_>) -> Result<(), ecan_result_t>,
    ) -> c_int {
        self.on_bus(|call, bus| work(call, C::layer(call, bus)?))
    }

    /// Returns a number; `failed` is returned in its place after an error.
    #[inline(always)]
    pub(crate) fn get_or<R>(
        self,
        failed: R,
        work: impl FnOnce(Call, C::Layer<'_>) -> Result<R, ecan_result_t>,
    ) -> R {
        self.get_with(|_| failed, work)
    }

    /// Returns a number, or the code of an error.
    #[inline(always)]
    pub(crate) fn get(
        self,
        work: impl FnOnce(Call, C::Layer<'_>) -> Result<c_int, ecan_result_t>,
    ) -> c_int {
        self.get_with(ecan_result_t::code, work)
    }

    #[inline(always)]
    fn get_with<R>(
        self,
        failed: impl FnOnce(ecan_result_t) -> R,
        work: impl FnOnce(Call, C::Layer<'_>) -> Result<R, ecan_result_t>,
    ) -> R {
        getter(self.function, failed, |call| {
            // SAFETY: the promise of `new`.
            let mut bus = unsafe { C::enter(call, self.context)? };
            work(call, C::layer(call, &mut bus)?)
        })
    }
}

/// As [`Entry`], for a call that stores one result.
pub(crate) struct EntryInto<C, T> {
    entry: Entry<C>,
    name: &'static str,
    out: *mut T,
}

impl<C: Context, T> EntryInto<C, T> {
    /// # Safety
    /// As for [`Entry::new`]; `out` is NULL or valid for writing as long as this lives.
    pub(crate) unsafe fn new(entry: Entry<C>, name: &'static str, out: *mut T) -> Self {
        Self { entry, name, out }
    }

    /// Stores the result of the work on the context's layer.
    #[inline(always)]
    pub(crate) fn fill(
        self,
        work: impl FnOnce(Call, C::Layer<'_>) -> Result<T, ecan_result_t>,
    ) -> c_int {
        self.entry.on_bus(|call, bus| {
            // SAFETY: the promise of `new`.
            let out = unsafe { call.out(self.name, self.out)? };
            out.set(work(call, C::layer(call, bus)?)?);
            Ok(())
        })
    }
}

/// A call that changes a configuration of C; made by [`change!`].
pub(crate) struct Change<S> {
    function: &'static str,
    config: *mut S,
}

impl<S: Opaque> Change<S> {
    /// # Safety
    /// As for [`Sealed::change`], as long as this lives.
    pub(crate) unsafe fn new(function: &'static str, config: *mut S) -> Self {
        Self { function, config }
    }

    /// Changes the configuration.
    pub(crate) fn with(
        self,
        change: impl FnOnce(Call, &mut S::Value) -> Result<(), ecan_result_t>,
    ) -> c_int {
        call(self.function, |call| {
            // SAFETY: the promise of `new`.
            change(call, unsafe { Sealed::change(call, "config", self.config)? })
        })
    }

    /// Sets a field for which every value is allowed.
    pub(crate) fn set(self, set: impl FnOnce(&mut S::Value)) -> c_int {
        self.with(|_, config| {
            set(config);
            Ok(())
        })
    }
}

/// Begins an exported function that changes a configuration.
macro_rules! change {
    ($function:ident, $config:ident) => {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        unsafe { $crate::entry::Change::new(stringify!($function), $config) }
    };
}
pub(crate) use change;

/// Begins an exported function with its name, its context and, after `->`, its only result.
macro_rules! enter {
    ($function:ident, $context:ident) => {
        // SAFETY: the pointer is C's, valid or NULL as the header demands.
        unsafe { $crate::entry::Entry::new(stringify!($function), $context) }
    };
    ($function:ident, $context:ident -> $out:ident) => {
        // SAFETY: the pointers are C's, valid or NULL as the header demands.
        unsafe {
            let entry = $crate::entry::Entry::new(stringify!($function), $context);
            $crate::entry::EntryInto::new(entry, stringify!($out), $out)
        }
    };
}
pub(crate) use enter;
