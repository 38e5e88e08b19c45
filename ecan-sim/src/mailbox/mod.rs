//! Mailbox services of the firmware: the messages of SM0 and SM1 as bytes (ETG.1000.4 to
//! ETG.1000.6). The slave controller models the sync managers.
//!
//! A request is processed when it arrives; its response is ready
//! [`GatewayModelConfig::mailbox_delay_ns`](crate::GatewayModelConfig::mailbox_delay_ns) later.
//! Emergencies precede responses.

mod coe;
mod foe;
mod messages;
mod sdo_server;
mod server;
#[cfg(test)]
mod tests;

pub(crate) use server::MailboxServer;
