use ecan_protocol::object::AbortCode;

use super::{coe_header, service};

/// Command byte of an abort, in both directions.
const ABORT: u8 = 0x80;

/// The message that aborts a transfer. It is an SDO request, also from the slave.
pub(super) fn abort_message(index: u16, subindex: u8, code: AbortCode) -> Vec<u8> {
    let mut message = Vec::with_capacity(10);
    message.extend_from_slice(&coe_header(service::SDO_REQUEST));
    message.push(ABORT);
    message.extend_from_slice(&index.to_le_bytes());
    message.push(subindex);
    message.extend_from_slice(&code.0.to_le_bytes());
    message
}
