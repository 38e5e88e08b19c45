//! Error numbers of the system, as the library reports them.

use std::fmt;

use libc::c_int;

/// An error number of the system. `Copy`, so the cycle can return it.
///
/// Displays the system's text and the number: `Device or resource busy (os error 16)`.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Errno(i32);

impl Errno {
    /// Operation not permitted.
    pub const EPERM: Self = Self(libc::EPERM);
    /// No such file, device or object.
    pub const ENOENT: Self = Self(libc::ENOENT);
    /// Interrupted by a signal; the call may be repeated.
    pub const EINTR: Self = Self(libc::EINTR);
    /// Input/output error; for an SDO transfer, aborted or unanswered.
    pub const EIO: Self = Self(libc::EIO);
    /// No such device or address; for clock calls, no reference clock.
    pub const ENXIO: Self = Self(libc::ENXIO);
    /// An invalid handle; from a method of `Master`: an id of another master, or from before the
    /// last deactivation.
    pub const EBADF: Self = Self(libc::EBADF);
    /// Not yet: try again later.
    pub const EAGAIN: Self = Self(libc::EAGAIN);
    /// Out of memory.
    pub const ENOMEM: Self = Self(libc::ENOMEM);
    /// Permission denied.
    pub const EACCES: Self = Self(libc::EACCES);
    /// Busy.
    pub const EBUSY: Self = Self(libc::EBUSY);
    /// No such device.
    pub const ENODEV: Self = Self(libc::ENODEV);
    /// Invalid argument or state.
    pub const EINVAL: Self = Self(libc::EINVAL);
    /// The library does not have this function.
    pub const ENOSYS: Self = Self(libc::ENOSYS);
    /// Data of the wrong size.
    pub const EMSGSIZE: Self = Self(libc::EMSGSIZE);
    /// Value out of range.
    pub const ERANGE: Self = Self(libc::ERANGE);
    /// Larger than the buffer.
    pub const EOVERFLOW: Self = Self(libc::EOVERFLOW);
    /// The slave does not have the mailbox protocol.
    pub const EPROTONOSUPPORT: Self = Self(libc::EPROTONOSUPPORT);
    /// Timed out.
    pub const ETIMEDOUT: Self = Self(libc::ETIMEDOUT);

    /// The error with this (positive) number.
    #[must_use]
    pub const fn new(code: i32) -> Self {
        Self(code)
    }

    /// The number, positive.
    #[must_use]
    pub const fn code(self) -> i32 {
        self.0
    }

    /// The error number that the last failed call left on this thread.
    #[must_use]
    pub fn last() -> Self {
        Self(std::io::Error::last_os_error().raw_os_error().unwrap_or(0))
    }

    /// Leaves this error number on the thread, as a C function does before it returns NULL. For
    /// a simulated library.
    pub fn set_last(self) {
        // SAFETY: the address of this thread's errno is valid as long as the thread runs.
        unsafe { *libc::__errno_location() = self.0 }
    }

    /// Checks a status of the library.
    ///
    /// # Errors
    ///
    /// The error number of a negative status.
    pub const fn check(status: c_int) -> Result<(), Self> {
        if status < 0 { Err(Self(status.saturating_neg())) } else { Ok(()) }
    }

    /// The cause of a NULL that a call returned after [`Errno::clear_last`]; [`Errno::ENOMEM`] if
    /// the library left none.
    #[must_use]
    pub fn of_null() -> Self {
        match Self::last() {
            Self(0) => Self::ENOMEM,
            errno => errno,
        }
    }

    /// Status of a call that returns none, after [`Errno::clear_last`]: the negative error number
    /// that it left, or 0.
    #[must_use]
    pub fn last_as_status() -> c_int {
        Self::last().0.saturating_neg()
    }

    /// Clears the thread's error number, so that only a later failure sets it.
    pub fn clear_last() {
        Self(0).set_last();
    }
}

impl fmt::Display for Errno {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        std::io::Error::from_raw_os_error(self.0).fmt(f)
    }
}

impl fmt::Debug for Errno {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Errno({}: {self})", self.0)
    }
}

impl std::error::Error for Errno {}

impl From<Errno> for std::io::Error {
    fn from(errno: Errno) -> Self {
        Self::from_raw_os_error(errno.code())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn negative_statuses_are_errors() {
        assert_eq!(Errno::check(0), Ok(()));
        assert_eq!(Errno::check(17), Ok(()));
        assert_eq!(Errno::check(-16), Err(Errno::EBUSY));
        assert_eq!(Errno::check(c_int::MIN), Err(Errno::new(c_int::MAX)));
    }

    #[test]
    fn text_is_that_of_the_system() {
        assert_eq!(Errno::EBUSY.to_string(), "Device or resource busy (os error 16)");
    }

    #[test]
    fn thread_keeps_its_error_number() {
        Errno::ENODEV.set_last();
        assert_eq!(Errno::last(), Errno::ENODEV);
        assert_eq!(Errno::of_null(), Errno::ENODEV);
        assert_eq!(Errno::check(Errno::last_as_status()), Err(Errno::ENODEV));
        Errno::clear_last();
        assert_eq!(Errno::of_null(), Errno::ENOMEM);
        assert_eq!(Errno::check(Errno::last_as_status()), Ok(()));
    }
}
