//! File access over EtherCAT: upload and download of firmware (manual 15.3.1, ETG.1000.6).
//!
//! There is one file, `ecan_lite_app`, and one transfer at a time; a new request ends the previous
//! one. A data packet that does not fill the mailbox ends the file; a file that fills its last
//! packet is followed by an empty one. While the flash is busy, data packets are answered with
//! BUSY, and the master repeats the packet. The last packet is acknowledged after the whole file
//! was written and found valid.

use super::messages::Context;
use crate::gateway::{FirmwareProgress, FirmwareUpdateError, Gateway};

const FILE_NAME: &[u8] = b"ecan_lite_app";
const PASSWORD: u32 = 0;
/// Header: opcode, a reserved byte, and a field that depends on the opcode.
const HEADER_BYTES: usize = 6;
const MAILBOX_HEADER_BYTES: usize = 6;
const BUSY_ENTIRE: u16 = 100;

mod opcode {
    pub(super) const READ: u8 = 1;
    pub(super) const WRITE: u8 = 2;
    pub(super) const DATA: u8 = 3;
    pub(super) const ACK: u8 = 4;
    pub(super) const ERROR: u8 = 5;
    pub(super) const BUSY: u8 = 6;
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Fault {
    code: u32,
    text: &'static str,
}

const NOT_FOUND: Fault = Fault { code: 0x8001, text: "File not found" };
const ILLEGAL: Fault = Fault { code: 0x8004, text: "Illegal operation" };
const PACKET_NUMBER: Fault = Fault { code: 0x8005, text: "Packet number wrong" };
const PASSWORD_INVALID: Fault = Fault { code: 0x800A, text: "Password invalid" };

impl From<FirmwareUpdateError> for Fault {
    fn from(error: FirmwareUpdateError) -> Self {
        Self { code: error.foe_code(), text: error.foe_text() }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Transfer {
    #[default]
    Idle,
    // The master writes; `expected` is the number of its next packet.
    Write {
        expected: u32,
    },
    // The last packet was accepted and waits for its acknowledge.
    LastWritten {
        number: u32,
    },
    // The master reads; packet `number` was sent, with the file from `offset` on.
    Read {
        number: u32,
        offset: usize,
        length: usize,
        is_last: bool,
    },
}

#[derive(Clone, Debug, Default)]
pub(super) struct FoeServer {
    transfer: Transfer,
}

impl FoeServer {
    /// Processes a request, given from its FoE header on; returns the response, from its FoE header
    /// on, unless none is due or fits.
    pub(super) fn request(&mut self, request: &[u8], context: &mut Context<'_>) -> Option<Vec<u8>> {
        let space = context.room.checked_sub(HEADER_BYTES)?;
        self.serve(request, context).unwrap_or_else(|fault| {
            self.end_transfer(context.gateway);
            let text = fault.text.as_bytes();
            Some(message(opcode::ERROR, fault.code, &text[..space.min(text.len())]))
        })
    }

    fn serve(
        &mut self,
        request: &[u8],
        context: &mut Context<'_>,
    ) -> Result<Option<Vec<u8>>, Fault> {
        let (&[opcode, _, a, b, c, d], data) =
            request.split_first_chunk::<HEADER_BYTES>().ok_or(ILLEGAL)?;
        let field = u32::from_le_bytes([a, b, c, d]);
        match opcode {
            opcode::READ => {
                self.end_transfer(context.gateway);
                check_file(field, data)?;
                self.send(1, 0, context).map(Some)
            }
            opcode::WRITE => {
                self.end_transfer(context.gateway);
                check_file(field, data)?;
                context.gateway.begin_firmware_update(context.now)?;
                self.transfer = Transfer::Write { expected: 1 };
                Ok(Some(message(opcode::ACK, 0, &[])))
            }
            opcode::DATA => self.take(field, data, context).map(Some),
            opcode::ACK => self.acknowledged(field, context),
            opcode::BUSY => match self.transfer {
                Transfer::Read { number, offset, .. } => {
                    self.send(number, offset, context).map(Some)
                }
                _ => Err(ILLEGAL),
            },
            // an error gets no response
            opcode::ERROR => {
                self.end_transfer(context.gateway);
                Ok(None)
            }
            _ => Err(ILLEGAL),
        }
    }

    fn end_transfer(&mut self, gateway: &mut Gateway) {
        if matches!(self.transfer, Transfer::Write { .. } | Transfer::LastWritten { .. }) {
            gateway.abandon_firmware_update();
        }
        self.transfer = Transfer::Idle;
    }

    fn take(
        &mut self,
        number: u32,
        data: &[u8],
        context: &mut Context<'_>,
    ) -> Result<Vec<u8>, Fault> {
        let Context { now, room, gateway } = context;
        match self.transfer {
            Transfer::Write { expected } if number == expected => {
                if let FirmwareProgress::Busy { percent } = gateway.write_firmware(*now, data)? {
                    return Ok(busy(percent));
                }
                // FoE header and data as long as the mailbox that the master writes to allows
                let full = gateway.sync_manager(0).map_or(*room, |sm| {
                    usize::from(sm.length).saturating_sub(MAILBOX_HEADER_BYTES)
                });
                if HEADER_BYTES + data.len() >= full {
                    self.transfer = Transfer::Write { expected: expected.wrapping_add(1) };
                    return Ok(message(opcode::ACK, number, &[]));
                }
                self.transfer = Transfer::LastWritten { number };
            }
            Transfer::LastWritten { number: last } if number == last => {}
            Transfer::Write { .. } | Transfer::LastWritten { .. } => return Err(PACKET_NUMBER),
            Transfer::Idle | Transfer::Read { .. } => return Err(ILLEGAL),
        }
        if let FirmwareProgress::Busy { percent } = gateway.finish_firmware_update(*now)? {
            return Ok(busy(percent));
        }
        self.transfer = Transfer::Idle;
        Ok(message(opcode::ACK, number, &[]))
    }

    fn acknowledged(
        &mut self,
        number: u32,
        context: &Context<'_>,
    ) -> Result<Option<Vec<u8>>, Fault> {
        match self.transfer {
            Transfer::Read { number: sent, .. } if number != sent => Err(PACKET_NUMBER),
            Transfer::Read { is_last: true, .. } => {
                self.transfer = Transfer::Idle;
                Ok(None)
            }
            Transfer::Read { offset, length, .. } => {
                self.send(number.wrapping_add(1), offset + length, context).map(Some)
            }
            _ => Err(ILLEGAL),
        }
    }

    fn send(
        &mut self,
        number: u32,
        offset: usize,
        context: &Context<'_>,
    ) -> Result<Vec<u8>, Fault> {
        let payload = context.room - HEADER_BYTES;
        // without space for data no file would end
        if payload == 0 {
            return Err(ILLEGAL);
        }
        let rest = context.gateway.running_firmware().get(offset..).unwrap_or_default();
        let data = rest.get(..payload).unwrap_or(rest);
        let is_last = data.len() < payload;
        self.transfer = Transfer::Read { number, offset, length: data.len(), is_last };
        Ok(message(opcode::DATA, number, data))
    }
}

fn check_file(password: u32, name: &[u8]) -> Result<(), Fault> {
    if name.split(|&byte| byte == 0).next() != Some(FILE_NAME) {
        return Err(NOT_FOUND);
    }
    if password != PASSWORD {
        return Err(PASSWORD_INVALID);
    }
    Ok(())
}

fn message(opcode: u8, field: u32, data: &[u8]) -> Vec<u8> {
    [&[opcode, 0], &field.to_le_bytes()[..], data].concat()
}

fn busy(percent: u8) -> Vec<u8> {
    message(opcode::BUSY, u32::from(BUSY_ENTIRE) << 16 | u32::from(percent), &[])
}

#[cfg(test)]
mod tests;
