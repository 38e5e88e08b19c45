//! Lookup of functions in a library.

use std::ffi::CString;

use libloading::os::unix::Library;

/// Required names that a library lacks.
#[derive(Debug)]
pub(crate) struct Missing(pub(crate) Vec<&'static str>);

/// A library whose functions are looked up, with the missing names.
pub(crate) struct SymbolSource<'a> {
    pub(crate) library: &'a Library,
    pub(crate) reports_status: bool,
    pub(crate) missing: Vec<&'static str>,
}

impl SymbolSource<'_> {
    /// Whether this release's functions return a status where 1.5 returned nothing.
    pub(crate) fn reports_status(&self) -> bool {
        self.reports_status
    }

    /// Looks up a function that may be absent.
    pub(crate) fn optional<F: Copy>(&self, symbol: &'static str) -> Option<F> {
        let name = CString::new(symbol).ok()?;
        // SAFETY: the symbol is read as an optional function pointer, for which null is a
        // value. That it has the type F is the promise of `Functions::look_up`'s caller.
        let found = unsafe { self.library.get::<Option<F>>(name.as_bytes_with_nul()) };
        found.ok().and_then(|function| *function)
    }

    /// Looks up a required function.
    pub(crate) fn required<F: Copy>(&mut self, symbol: &'static str) -> Option<F> {
        let found = self.optional(symbol);
        if found.is_none() {
            self.missing.push(symbol);
        }
        found
    }

    pub(crate) fn take_missing(&mut self) -> Missing {
        Missing(std::mem::take(&mut self.missing))
    }
}
