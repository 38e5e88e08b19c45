//! SDO information: the object dictionary of the device (ETG.1000.6).

use ecan_protocol::object::AbortCode;

use crate::gateway::Gateway;
use crate::gateway::variant::SdoInformation;

use super::descriptions::{describe_entry, describe_object};
use super::object_lists::object_list;
use super::{COE_HEADER_BYTES, Context, MailboxError, message, service};

const INFO_HEADER_BYTES: usize = 4;

/// Services in the SDO information header.
mod opcode {
    pub(super) const LIST_REQUEST: u8 = 1;
    pub(super) const LIST: u8 = 2;
    pub(super) const OBJECT_REQUEST: u8 = 3;
    pub(super) const OBJECT: u8 = 4;
    pub(super) const ENTRY_REQUEST: u8 = 5;
    pub(super) const ENTRY: u8 = 6;
    pub(super) const ERROR: u8 = 7;
    /// More fragments follow.
    pub(super) const INCOMPLETE: u8 = 0x80;
}

pub(super) fn answer(request: &[u8], context: &Context<'_>) -> Result<Vec<Vec<u8>>, MailboxError> {
    if context.gateway.config().variant.sdo_information == SdoInformation::Absent {
        return Err(MailboxError::ServiceNotSupported);
    }
    let (&[service, ..], body) =
        request.split_first_chunk::<INFO_HEADER_BYTES>().ok_or(MailboxError::SizeTooShort)?;
    let (opcode, result) = match service & !opcode::INCOMPLETE {
        opcode::LIST_REQUEST => {
            let &[t0, t1] = parameters(body)?;
            (opcode::LIST, list(u16::from_le_bytes([t0, t1]), context.gateway))
        }
        opcode::OBJECT_REQUEST => {
            let &[i0, i1] = parameters(body)?;
            (opcode::OBJECT, describe_object(u16::from_le_bytes([i0, i1]), context.gateway))
        }
        opcode::ENTRY_REQUEST => {
            let &[i0, i1, subindex, requested] = parameters(body)?;
            let index = u16::from_le_bytes([i0, i1]);
            (opcode::ENTRY, describe_entry(index, subindex, requested, context.gateway))
        }
        _ => (opcode::ERROR, Err(AbortCode::COMMAND)),
    };
    Ok(match result {
        Ok(body) => fragments(opcode, &body, context.room),
        Err(code) => fragments(opcode::ERROR, &code.0.to_le_bytes(), context.room),
    })
}

fn parameters<const N: usize>(body: &[u8]) -> Result<&[u8; N], MailboxError> {
    body.first_chunk().ok_or(MailboxError::SizeTooShort)
}

/// An object list: its type, then its indices or the lengths.
fn list(list_type: u16, gateway: &Gateway) -> Result<Vec<u8>, AbortCode> {
    let list = object_list(list_type, &gateway.config().variant)?;
    Ok(std::iter::once(list_type).chain(list).flat_map(u16::to_le_bytes).collect())
}

/// Divides a response into fragments; none ends within an index of a list.
fn fragments(opcode: u8, body: &[u8], room: usize) -> Vec<Vec<u8>> {
    let bytes = room.saturating_sub(COE_HEADER_BYTES + INFO_HEADER_BYTES) & !1;
    let parts = body.chunks(bytes.max(2));
    let count = parts.len();
    parts
        .enumerate()
        .map(|(number, part)| {
            let left = count - 1 - number;
            let more = if left > 0 { opcode::INCOMPLETE } else { 0 };
            let header = [opcode | more, 0];
            message(service::SDO_INFORMATION, &[&header, &(left as u16).to_le_bytes(), part])
        })
        .collect()
}
