//! Object of an SDO transfer, and its failure.

/// Failure of a transfer: error number (positive) and abort code, 0 without one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SdoFailure {
    pub(crate) errno: i32,
    pub(crate) abort_code: u32,
}

impl SdoFailure {
    /// The slave did not respond or is in the wrong state.
    pub(crate) const UNANSWERED: Self = Self { errno: libc::EIO, abort_code: 0 };
    /// The SII of the slave has no CoE.
    pub(crate) const NO_COE: Self = Self { errno: libc::EPROTONOSUPPORT, abort_code: 0 };
    pub(crate) const NO_SLAVE: Self = Self { errno: libc::EINVAL, abort_code: 0 };
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SdoObject {
    pub(crate) index: u16,
    pub(crate) subindex: u8,
    /// Complete Access: all subindices at once.
    pub(crate) complete: bool,
}

impl SdoObject {
    pub(crate) const fn entry(index: u16, subindex: u8) -> Self {
        Self { index, subindex, complete: false }
    }

    pub(crate) const fn whole(index: u16) -> Self {
        Self { index, subindex: 0, complete: true }
    }
}
