//! Transmit path: frames into RxPDO images, and their delivery.

pub(crate) mod history;
pub(crate) mod options;
pub(crate) mod send;
pub(crate) mod transmitter;
pub(crate) mod window;
