//! File access over EtherCAT: upload and download of firmware (manual 15.3.1, ETG.1000.6).
//!
//! There is one file, `ecan_lite_app`, and one transfer at a time; a new request ends the previous
//! one. A data packet that does not fill the mailbox ends the file; a file that fills its last
//! packet is followed by an empty one. While the flash is busy, data packets are answered with
//! BUSY, and the master repeats the packet. The last packet is acknowledged after the whole file
//! was written and found valid.

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

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Transfer {
    Idle,
    /// The master writes; `expected` is the number of its next packet.
    Write {
        expected: u32,
    },
    /// The last packet was accepted and waits for its acknowledge.
    LastWritten {
        number: u32,
    },
    /// The master reads; packet `number` was sent, with the file from `offset` on.
    Read {
        number: u32,
        offset: usize,
        length: usize,
        is_last: bool,
    },
}

#[derive(Debug)]
pub(crate) struct FoeServer {
    transfer: Transfer,
}

impl FoeServer {
    pub(crate) fn new() -> Self {
        Self { transfer: Transfer::Idle }
    }

    /// Processes a request, given from its FoE header on. The response, from its FoE header on and
    /// at most `room` bytes, replaces `out`; it is empty if none is due or fits.
    pub(crate) fn request(
        &mut self,
        now: u64,
        request: &[u8],
        room: usize,
        out: &mut Vec<u8>,
        gateway: &mut Gateway,
    ) {
        out.clear();
        if room < HEADER_BYTES {
            return;
        }
        // FoE header and data as long as the mailbox that the master writes to allows
        let full = gateway
            .sync_manager(0)
            .map_or(room, |sm| usize::from(sm.length).saturating_sub(MAILBOX_HEADER_BYTES));
        if let Err(fault) = self.serve(now, request, room, full, out, gateway) {
            if matches!(self.transfer, Transfer::Write { .. } | Transfer::LastWritten { .. }) {
                gateway.abandon_firmware_update();
            }
            self.transfer = Transfer::Idle;
            answer_error(fault, room, out);
        }
    }

    fn serve(
        &mut self,
        now: u64,
        request: &[u8],
        room: usize,
        full: usize,
        out: &mut Vec<u8>,
        gateway: &mut Gateway,
    ) -> Result<(), Fault> {
        let Some((&[opcode, _, a, b, c, d], data)) = request.split_first_chunk::<HEADER_BYTES>()
        else {
            return Err(ILLEGAL);
        };
        let field = u32::from_le_bytes([a, b, c, d]);
        match opcode {
            opcode::READ => {
                self.end_write(gateway);
                check_file(field, data)?;
                self.send(1, 0, room, out, gateway)
            }
            opcode::WRITE => {
                self.end_write(gateway);
                check_file(field, data)?;
                gateway.begin_firmware_update(now)?;
                self.transfer = Transfer::Write { expected: 1 };
                answer(opcode::ACK, 0, out);
                Ok(())
            }
            opcode::DATA => self.take(now, field, data, full, out, gateway),
            opcode::ACK => self.acknowledged(field, room, out, gateway),
            opcode::BUSY => match self.transfer {
                Transfer::Read { number, offset, .. } => {
                    self.send(number, offset, room, out, gateway)
                }
                _ => Err(ILLEGAL),
            },
            // an error gets no response
            opcode::ERROR => {
                self.end_write(gateway);
                Ok(())
            }
            _ => Err(ILLEGAL),
        }
    }

    fn end_write(&mut self, gateway: &mut Gateway) {
        if matches!(self.transfer, Transfer::Write { .. } | Transfer::LastWritten { .. }) {
            gateway.abandon_firmware_update();
        }
        self.transfer = Transfer::Idle;
    }

    fn take(
        &mut self,
        now: u64,
        number: u32,
        data: &[u8],
        full: usize,
        out: &mut Vec<u8>,
        gateway: &mut Gateway,
    ) -> Result<(), Fault> {
        match self.transfer {
            Transfer::Write { expected } if number == expected => {
                if let FirmwareProgress::Busy { percent } = gateway.write_firmware(now, data)? {
                    answer_busy(percent, out);
                    return Ok(());
                }
                if HEADER_BYTES + data.len() >= full {
                    self.transfer = Transfer::Write { expected: expected.wrapping_add(1) };
                    answer(opcode::ACK, number, out);
                    return Ok(());
                }
                self.transfer = Transfer::LastWritten { number };
            }
            Transfer::LastWritten { number: last } if number == last => {}
            Transfer::Write { .. } | Transfer::LastWritten { .. } => return Err(PACKET_NUMBER),
            Transfer::Idle | Transfer::Read { .. } => return Err(ILLEGAL),
        }
        match gateway.finish_firmware_update(now)? {
            FirmwareProgress::Busy { percent } => answer_busy(percent, out),
            FirmwareProgress::Done => {
                self.transfer = Transfer::Idle;
                answer(opcode::ACK, number, out);
            }
        }
        Ok(())
    }

    fn acknowledged(
        &mut self,
        number: u32,
        room: usize,
        out: &mut Vec<u8>,
        gateway: &Gateway,
    ) -> Result<(), Fault> {
        match self.transfer {
            Transfer::Read { number: sent, .. } if number != sent => Err(PACKET_NUMBER),
            Transfer::Read { is_last: true, .. } => {
                self.transfer = Transfer::Idle;
                Ok(())
            }
            Transfer::Read { offset, length, .. } => {
                self.send(number.wrapping_add(1), offset + length, room, out, gateway)
            }
            _ => Err(ILLEGAL),
        }
    }

    fn send(
        &mut self,
        number: u32,
        offset: usize,
        room: usize,
        out: &mut Vec<u8>,
        gateway: &Gateway,
    ) -> Result<(), Fault> {
        let payload = room - HEADER_BYTES;
        // without space for data no file would end
        if payload == 0 {
            return Err(ILLEGAL);
        }
        let rest = gateway.running_firmware().get(offset..).unwrap_or_default();
        let data = rest.get(..payload).unwrap_or(rest);
        let is_last = data.len() < payload;
        self.transfer = Transfer::Read { number, offset, length: data.len(), is_last };
        answer(opcode::DATA, number, out);
        out.extend_from_slice(data);
        Ok(())
    }
}

fn check_file(password: u32, name: &[u8]) -> Result<(), Fault> {
    let end = name.iter().position(|&byte| byte == 0).unwrap_or(name.len());
    if name.get(..end) != Some(FILE_NAME) {
        return Err(NOT_FOUND);
    }
    if password != PASSWORD {
        return Err(PASSWORD_INVALID);
    }
    Ok(())
}

fn answer(opcode: u8, field: u32, out: &mut Vec<u8>) {
    out.extend_from_slice(&[opcode, 0]);
    out.extend_from_slice(&field.to_le_bytes());
}

fn answer_busy(percent: u8, out: &mut Vec<u8>) {
    answer(opcode::BUSY, u32::from(BUSY_ENTIRE) << 16 | u32::from(percent), out);
}

fn answer_error(fault: Fault, room: usize, out: &mut Vec<u8>) {
    out.clear();
    answer(opcode::ERROR, fault.code, out);
    let space = room.saturating_sub(HEADER_BYTES);
    out.extend(fault.text.bytes().take(space));
}

#[cfg(test)]
mod tests;
