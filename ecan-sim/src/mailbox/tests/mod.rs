//! Tests of the mailbox services, byte by byte and by property.

mod aborts;
mod complete_access;
mod emergencies;
mod fixture;
mod golden;
mod information;
mod messages;
mod properties;
