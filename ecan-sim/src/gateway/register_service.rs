//! 0xA000..0xA003: reading and, in engineering mode, writing MCAN registers (manual 13.6).
//!
//! Offsets and bits are those of the Bosch M_CAN core. A register that the model does not have
//! reads as 0. All registers of the whitelist are writable in engineering and factory mode; the
//! controller decides what a write does, and ignores writes to protected registers while CCCR.INIT
//! and CCE are not set. "Access denied" means that the mode is missing. The service is never busy.

use ecan_protocol::object::WRITABLE_REGISTERS;

use super::data_path::DataPath;
use super::dictionary_values::DictionaryValues;
use super::maintenance::SYSTEM;
use super::mcan_registers::FramesDropped;
use super::variant::ProtectedRegister;

const FIRST_SERVICE: u16 = 0xA000;

const OFFSET: u8 = 1;
const COMMAND: u8 = 2;
const STATUS: u8 = 3;
const WRITE_VALUE: u8 = 4;
const READ_VALUE: u8 = 5;
const TIMESTAMP_LOW: u8 = 6;
const TIMESTAMP_HIGH: u8 = 7;

/// 0x8000:6, source clock of MCAN0; the others follow.
const FIRST_CLOCK: u8 = 6;

const COMMAND_READ: u8 = 1;
const COMMAND_WRITE: u8 = 2;

const OK: u32 = 0;
const OFFSET_INVALID: u32 = 1;
const WRITE_DENIED: u32 = 2;
const ACCESS_DENIED: u32 = 4;

pub(super) struct RegisterService<'a> {
    pub(super) number: usize,
    pub(super) values: &'a mut DictionaryValues,
    pub(super) data_path: &'a mut DataPath,
    pub(super) is_engineering: bool,
}

impl RegisterService<'_> {
    fn index(&self) -> u16 {
        FIRST_SERVICE + self.number as u16
    }

    pub(super) fn execute(&mut self, now: u64) {
        let index = self.index();
        let status = match self.values.get_u8(index, COMMAND) {
            0 => return,
            command @ (COMMAND_READ | COMMAND_WRITE) => self.access(command),
            _ => ACCESS_DENIED,
        };
        self.values.set(index, STATUS, status);
        let [low, high] = [now as u32, (now >> 32) as u32];
        self.values.set(index, TIMESTAMP_LOW, low);
        self.values.set(index, TIMESTAMP_HIGH, high);
    }

    fn access(&mut self, command: u8) -> u32 {
        let (number, index) = (self.number, self.index());
        let offset = self.values.get(index, OFFSET);
        let Some(offset) = u16::try_from(offset)
            .ok()
            .filter(|offset| (0x0004..=0x0404).contains(offset) && offset % 4 == 0)
        else {
            return OFFSET_INVALID;
        };
        let clock_hz = self.values.get(SYSTEM, FIRST_CLOCK + number as u8);
        let denies_locked =
            self.data_path.variant().protected_register == ProtectedRegister::Rejected;
        let DataPath { channels, counters, .. } = &mut *self.data_path;
        let channel = &mut channels[number];
        if command == COMMAND_READ {
            self.values.set(index, READ_VALUE, channel.controller.read_register(offset));
            return OK;
        }
        if !WRITABLE_REGISTERS.iter().any(|&(known, _)| known == offset) {
            return WRITE_DENIED;
        }
        if !self.is_engineering {
            return ACCESS_DENIED;
        }
        if denies_locked && channel.controller.is_locked(offset) {
            return WRITE_DENIED;
        }
        let value = self.values.get(index, WRITE_VALUE);
        let FramesDropped { transmit, receive } =
            channel.controller.write_register(offset, value, clock_hz);
        channel.transmit.note_stale(transmit);
        counters.transmit_losses.stale += transmit as u64;
        counters.receive_losses.flushed += receive as u64;
        OK
    }
}
