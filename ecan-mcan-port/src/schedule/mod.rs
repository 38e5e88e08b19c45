//! Scheduled transmission at a phase of Sync0 (manual 8.4, 13.8, 13.9).

pub(crate) mod account;
pub(crate) mod diagnostics;
pub(crate) mod margin;
pub(crate) mod watch;
