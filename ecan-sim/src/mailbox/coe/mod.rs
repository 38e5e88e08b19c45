//! CAN application protocol over EtherCAT (ETG.1000.6): SDO, SDO information, emergencies.

mod abort;
mod complete_access;
mod descriptions;
mod entry_rights;
mod information;
mod object_lists;
mod sdo_server;
mod segments;
mod target;

use sdo_server::SdoServer;

use crate::gateway::{Emergency, Gateway};

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

const fn coe_header(service: u8) -> [u8; COE_HEADER_BYTES] {
    ((service as u16) << 12).to_le_bytes()
}

pub(super) fn emergency_message(emergency: Emergency) -> Vec<u8> {
    let Emergency { code, register, data } = emergency;
    let mut message = Vec::with_capacity(10);
    message.extend_from_slice(&coe_header(service::EMERGENCY));
    message.extend_from_slice(&code.to_le_bytes());
    message.push(register);
    message.extend_from_slice(&data);
    message
}

#[derive(Debug)]
pub(super) struct CoeServer {
    sdo: SdoServer,
}

impl CoeServer {
    pub(super) fn new() -> Self {
        Self { sdo: SdoServer::new() }
    }

    pub(super) fn request(
        &mut self,
        now: u64,
        body: &[u8],
        room: usize,
        gateway: &mut Gateway,
    ) -> Result<Vec<Vec<u8>>, MailboxError> {
        let (&[_, high], rest) =
            body.split_first_chunk::<COE_HEADER_BYTES>().ok_or(MailboxError::SizeTooShort)?;
        match high >> 4 {
            service::SDO_REQUEST => {
                Ok(self.sdo.request(now, rest, room, gateway)?.into_iter().collect())
            }
            service::SDO_INFORMATION => information::answer(rest, room, gateway),
            // services that only a slave sends, and process data outside the sync managers
            service::EMERGENCY
            | service::SDO_RESPONSE
            | service::TX_PDO..=service::RX_PDO_REMOTE_REQUEST => {
                Err(MailboxError::ServiceNotSupported)
            }
            _ => Err(MailboxError::InvalidHeader),
        }
    }
}
