//! Transmit path: frames into RxPDO images, and their delivery.

pub(crate) mod error;
pub(crate) mod history;
pub(crate) mod options;
pub(crate) mod send;
pub(crate) mod transmitter;
pub(crate) mod unproven;
pub(crate) mod window;
pub(crate) mod withdrawn;
