//! A value with its location in a file.

/// A value with its location.
#[derive(Clone, Debug)]
pub(crate) struct Located<T> {
    pub(crate) value: T,
    /// Offset in bytes.
    pub(crate) at: usize,
}

impl<T> Located<T> {
    pub(crate) fn new(value: T, at: usize) -> Self {
        Self { value, at }
    }
}
