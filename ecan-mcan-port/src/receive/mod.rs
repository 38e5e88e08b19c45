//! Receive path: TxPDO images to frames and transmit results.

pub(crate) mod items;
pub(crate) mod numbering;
pub(crate) mod received;
pub(crate) mod receiver;
pub(crate) mod report;
