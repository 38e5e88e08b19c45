//! The object access of a device that a sequence needs.

use core::fmt;
use core::time::Duration;

use crate::object::AbortCode;

/// State of the transfer that was started last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transfer {
    /// It is running.
    Busy,
    /// It succeeded; of an upload, the value without sign, of a download, any number.
    Done(u64),
    /// Its result is gone, because another part of the application used the client: the step
    /// starts again.
    Lost,
}

/// Object access of one device, by one client that executes one transfer at a time.
///
/// A blocking client executes the transfer in `start_…` and returns its result from
/// [`poll`](Self::poll).
pub trait ObjectAccess {
    /// Device-specific action of a step; [`NoAction`] if there are none.
    type Action: Copy;
    /// Cause of the failure of a transfer or an action.
    type Error;

    /// Starts a download. Returns `false` if the client is busy; the sequence then retries.
    ///
    /// # Errors
    /// The transfer cannot start, or failed.
    fn start_write(&mut self, index: u16, subindex: u8, data: &[u8]) -> Result<bool, Self::Error>;

    /// Starts an upload. Returns `false` if the client is busy; the sequence then retries.
    ///
    /// # Errors
    /// The transfer cannot start, or failed.
    fn start_read(&mut self, index: u16, subindex: u8) -> Result<bool, Self::Error>;

    /// Returns the state of the transfer that was started last.
    ///
    /// # Errors
    /// The transfer failed.
    fn poll(&mut self) -> Result<Transfer, Self::Error>;

    /// Executes a device-specific action, `elapsed` after its step began. Returns whether it is
    /// complete.
    ///
    /// # Errors
    /// The action failed.
    fn act(&mut self, action: &Self::Action, elapsed: Duration) -> Result<bool, Self::Error>;

    /// Returns the abort code of a transfer that the device aborted.
    fn abort_code(error: &Self::Error) -> Option<AbortCode>;
}

/// No device-specific action exists.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoAction {}

impl fmt::Display for NoAction {
    fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {}
    }
}
