use std::ffi::CString;

use libloading::os::unix::Library;

/// A library whose functions are looked up.
pub(crate) struct SymbolSource<'a> {
    pub(crate) library: &'a Library,
    /// True if functions that return nothing in 1.5 return a status.
    pub(crate) reports_status: bool,
    /// Required names that the library lacks.
    pub(crate) missing: Vec<&'static str>,
}

impl SymbolSource<'_> {
    pub(crate) fn find<F: Copy>(&self, symbol: &'static str) -> Option<F> {
        let name = CString::new(symbol).ok()?;
        // SAFETY: the symbol is read as an optional function pointer, for which null is a
        // value. That it has the type F is the promise of `Functions::look_up`'s caller.
        let found = unsafe { self.library.get::<Option<F>>(name.as_bytes_with_nul()) };
        found.ok().and_then(|function| *function)
    }
}
