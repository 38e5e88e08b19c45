//! Ids of what was created from a master, and memory for the answers of the library.

use std::sync::atomic::{AtomicU64, Ordering};

macro_rules! id {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        ///
        /// Valid for the [`Master`](crate::Master) that created it, until that is deactivated or dropped; any
        /// other use returns `EBADF`.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub struct $name {
            pub(super) generation: u64,
            pub(super) index: usize,
        }
    };
}

id! {
    /// Names a domain.
    DomainId
}
id! {
    /// Names the configuration of a slave.
    SlaveConfigId
}
id! {
    /// Names an SDO request.
    SdoRequestId
}
id! {
    /// Names a register request.
    RegRequestId
}

/// Names a part of a domain's process image. After deactivation it names none, or one of the next
/// configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ImageId(pub(super) usize);

/// Distinguishes the handles of one configuration from those of every other, in all masters.
pub(super) fn next_generation() -> u64 {
    static GENERATION: AtomicU64 = AtomicU64::new(0);
    GENERATION.fetch_add(1, Ordering::Relaxed)
}

/// Memory for a result of the library, with a reserve: patched libraries have extended some
/// structures at the end without a new version.
#[repr(C)]
pub(super) struct Answer<T> {
    pub(super) value: T,
    _reserve: [u64; 16],
}

impl<T: Default> Answer<T> {
    pub(super) fn new() -> Self {
        Self { value: T::default(), _reserve: [0; 16] }
    }

    /// The library's pointer; valid for the whole `Answer`, reserve included.
    pub(super) fn target(&mut self) -> *mut T {
        std::ptr::from_mut(self).cast()
    }
}
