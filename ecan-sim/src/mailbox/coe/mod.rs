//! CAN application protocol over EtherCAT (ETG.1000.6): SDO, SDO information, emergencies.

mod descriptions;
mod entry_rights;
mod information;
mod object_lists;
mod sdo_server;
mod segments;
mod target;

pub(super) use sdo_server::SdoServer;

use crate::gateway::Emergency;

use super::Context;
use super::errors::MailboxError;

mod service {
    pub(super) const EMERGENCY: u8 = 1;
    pub(super) const SDO_REQUEST: u8 = 2;
    pub(super) const SDO_RESPONSE: u8 = 3;
    pub(super) const TX_PDO: u8 = 4;
    pub(super) const RX_PDO_REMOTE_REQUEST: u8 = 7;
    pub(super) const SDO_INFORMATION: u8 = 8;
}

const COE_HEADER_BYTES: usize = 2;

/// A message with the CoE header number 0.
fn message(service: u8, parts: &[&[u8]]) -> Vec<u8> {
    let header = (u16::from(service) << 12).to_le_bytes();
    [&header[..], &parts.concat()].concat()
}

pub(super) fn emergency_message(emergency: Emergency) -> Vec<u8> {
    message(service::EMERGENCY, &[&emergency.message()])
}

pub(super) fn request(
    sdo: &mut SdoServer,
    body: &[u8],
    context: &mut Context<'_>,
) -> Result<Vec<Vec<u8>>, MailboxError> {
    let (&[_, high], rest) =
        body.split_first_chunk::<COE_HEADER_BYTES>().ok_or(MailboxError::SizeTooShort)?;
    match high >> 4 {
        service::SDO_REQUEST => Ok(sdo.request(rest, context)?.into_iter().collect()),
        service::SDO_INFORMATION => information::answer(rest, context),
        // services that only a slave sends, and process data outside the sync managers
        service::EMERGENCY
        | service::SDO_RESPONSE
        | service::TX_PDO..=service::RX_PDO_REMOTE_REQUEST => {
            Err(MailboxError::ServiceNotSupported)
        }
        _ => Err(MailboxError::InvalidHeader),
    }
}
