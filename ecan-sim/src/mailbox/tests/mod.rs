//! Tests of the mailbox services, byte by byte and by property.

mod aborts;
mod bench;
mod complete_access;
mod emergencies;
mod golden;
mod information;
mod messages;
mod properties;
mod segments;
