//! Mailbox services of the gateway (ETG.1000.6).

pub(crate) mod foe;
