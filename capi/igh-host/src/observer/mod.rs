//! Observers: `igh_observer.h`.

pub mod commands;
pub mod handle;
mod slot;
pub mod snapshot;
