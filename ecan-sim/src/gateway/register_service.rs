//! 0xA000..0xA003: reading and, in engineering mode, writing MCAN registers (manual 13.6).
//!
//! Offsets and bits are those of the Bosch M_CAN core. A register that the model does not have
//! reads as 0. All of the whitelist can be written in engineering and factory mode; what a write
//! does, and that protected registers keep their value while CCCR.INIT and CCE are not set, is the
//! controller's affair. "Access denied" means that the mode is missing. The service is never busy.

use ecan_protocol::mapping::CHANNELS;
use ecan_protocol::object::WRITABLE_REGISTERS;

use super::Gateway;
use super::controller::FramesDropped;

/// Subindices of the service.
const OFFSET: u8 = 1;
const COMMAND: u8 = 2;
const STATUS: u8 = 3;
const WRITE_VALUE: u8 = 4;
const READ_VALUE: u8 = 5;
const TIMESTAMP_LOW: u8 = 6;
const TIMESTAMP_HIGH: u8 = 7;

/// 0x8000:6, source clock of MCAN0; the others follow.
const SYSTEM: u16 = 0x8000;
const FIRST_CLOCK: u8 = 6;

const COMMAND_READ: u8 = 1;
const COMMAND_WRITE: u8 = 2;

const OK: u32 = 0;
const OFFSET_INVALID: u32 = 1;
const WRITE_DENIED: u32 = 2;
const ACCESS_DENIED: u32 = 4;

impl Gateway {
    /// The command at subindex 2 was written.
    pub(super) fn register_command(&mut self, number: usize, index: u16) {
        let command = self.values.get_u8(index, COMMAND);
        let status = match command {
            0 => return,
            COMMAND_READ | COMMAND_WRITE if number < CHANNELS => {
                self.access_register(number, index, command)
            }
            _ => ACCESS_DENIED,
        };
        self.values.set(index, STATUS, status);
        let [low, high] = [self.now as u32, (self.now >> 32) as u32];
        self.values.set(index, TIMESTAMP_LOW, low);
        self.values.set(index, TIMESTAMP_HIGH, high);
    }

    fn access_register(&mut self, number: usize, index: u16, command: u8) -> u32 {
        let offset = self.values.get(index, OFFSET);
        let Some(offset) = u16::try_from(offset)
            .ok()
            .filter(|offset| (0x0004..=0x0404).contains(offset) && offset % 4 == 0)
        else {
            return OFFSET_INVALID;
        };
        let clock_hz = self.values.get(SYSTEM, FIRST_CLOCK + number as u8);
        let Self { channels, values, counters, maintenance, .. } = self;
        let Some(channel) = channels.get_mut(number) else {
            return ACCESS_DENIED;
        };
        if command == COMMAND_READ {
            values.set(index, READ_VALUE, channel.controller.read_register(offset));
            return OK;
        }
        if !WRITABLE_REGISTERS.iter().any(|&(known, _)| known == offset) {
            return WRITE_DENIED;
        }
        if !maintenance.is_engineering() {
            return ACCESS_DENIED;
        }
        let value = values.get(index, WRITE_VALUE);
        let FramesDropped { transmit, receive } =
            channel.controller.write_register(offset, value, clock_hz);
        channel.transmit.note_stale(transmit);
        counters.transmit_losses.stale += transmit as u64;
        counters.receive_losses.flushed += receive as u64;
        OK
    }
}
