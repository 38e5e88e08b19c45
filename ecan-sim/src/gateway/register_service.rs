//! 0xA000..0xA003: reading and, in engineering mode, writing MCAN registers (manual 13.6).
//!
//! Offsets are those of the Bosch M_CAN core. Registers that the model does not have read as
//! 0. Writable are the ones whose write means something here, IR and TXBCR; the bit timing and
//! control registers are protected while the controller runs, as on the chip, so a write to
//! them answers "access denied".

use ecan_protocol::{CHANNELS, WRITABLE_REGISTERS};

use super::Gateway;
use super::controller::Controller;

/// Subindices of the service.
const OFFSET: u8 = 1;
const COMMAND: u8 = 2;
const STATUS: u8 = 3;
const WRITE_VALUE: u8 = 4;
const READ_VALUE: u8 = 5;
const TIMESTAMP_LOW: u8 = 6;
const TIMESTAMP_HIGH: u8 = 7;

const COMMAND_READ: u8 = 1;
const COMMAND_WRITE: u8 = 2;

const OK: u32 = 0;
const OFFSET_INVALID: u32 = 1;
const WRITE_DENIED: u32 = 2;
const ACCESS_DENIED: u32 = 4;

/// Register offsets.
mod offset {
    pub(super) const ENDIAN: u16 = 0x004;
    pub(super) const DBTP: u16 = 0x00C;
    pub(super) const CCCR: u16 = 0x018;
    pub(super) const NBTP: u16 = 0x01C;
    pub(super) const ECR: u16 = 0x040;
    pub(super) const PSR: u16 = 0x044;
    pub(super) const TDCR: u16 = 0x048;
    pub(super) const IR: u16 = 0x050;
    pub(super) const GFC: u16 = 0x080;
    pub(super) const XIDAM: u16 = 0x090;
    pub(super) const HPMS: u16 = 0x094;
    pub(super) const RXF0S: u16 = 0x0A4;
    pub(super) const RXF1S: u16 = 0x0B4;
    pub(super) const TXFQS: u16 = 0x0C4;
    pub(super) const TXBCR: u16 = 0x0D4;
    pub(super) const TXEFS: u16 = 0x0F4;
}

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
        let Some(channel) = self.channels.get_mut(number) else {
            return ACCESS_DENIED;
        };
        if command == COMMAND_READ {
            let value = read(&channel.controller, offset);
            self.values.set(index, READ_VALUE, value);
            return OK;
        }
        if !WRITABLE_REGISTERS.iter().any(|&(known, _)| known == offset) {
            return WRITE_DENIED;
        }
        if !self.maintenance.is_engineering() {
            return ACCESS_DENIED;
        }
        let value = self.values.get(index, WRITE_VALUE);
        match offset {
            offset::IR => channel.controller.clear_interrupts(value),
            // one bit per element; the model cancels all of them or none
            offset::TXBCR if value != 0 => {
                let dropped = channel.controller.flush_transmit();
                channel.transmit.note_stale(dropped);
                self.truth.transmit_losses.stale += dropped as u64;
            }
            offset::TXBCR => {}
            _ => return ACCESS_DENIED,
        }
        OK
    }
}

fn read(controller: &Controller, offset: u16) -> u32 {
    match offset {
        offset::ENDIAN => 0x8765_4321,
        offset::DBTP => controller.data_timing_register(),
        offset::CCCR => controller.control_register(),
        offset::NBTP => controller.nominal_timing_register(),
        offset::ECR => controller.error_counter_register(),
        offset::PSR => controller.protocol_status_register(),
        offset::TDCR => controller.delay_compensation_register(),
        offset::IR => controller.interrupt_register(),
        offset::GFC => controller.filter_register(),
        offset::XIDAM => controller.extended_mask_register(),
        offset::HPMS => controller.high_priority_register(),
        offset::RXF0S => controller.fifo0_register(),
        offset::RXF1S => controller.fifo1_register(),
        offset::TXFQS => controller.transmit_register(),
        offset::TXEFS => controller.event_register(),
        _ => 0,
    }
}
