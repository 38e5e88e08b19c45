//! SII EEPROM interface: commands, errors and their duration (ETG.1000.4).

use crate::sii::{CONFIGURATION_WORDS, checksum};

/// Bytes of 0x0502 to 0x050F.
pub(super) const INTERFACE_BYTES: usize = 14;

const WRITE_ENABLE: u16 = 1 << 0;
/// The firmware emulates the EEPROM, four bytes at a time.
const EMULATED: u16 = 1 << 5;
const TWO_ADDRESS_BYTES: u16 = 1 << 7;
const COMMAND: u16 = 0x0700;
const READ: u16 = 0x0100;
const WRITE: u16 = 0x0200;
const RELOAD: u16 = 0x0400;
const CHECKSUM_ERROR: u16 = 1 << 11;
const COMMAND_ERROR: u16 = 1 << 13;
const WRITE_ENABLE_ERROR: u16 = 1 << 14;
const BUSY: u16 = 1 << 15;

const READ_NS: u64 = 20_000;
const WRITE_NS: u64 = 500_000;
const RELOAD_NS: u64 = 200_000;

/// EEPROM interface; the words belong to the gateway.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct EepromInterface {
    address: u32,
    data: [u8; 4],
    errors: u16,
    busy_until: u64,
    /// The last command, reported while it runs.
    command: u16,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Effect {
    Nothing,
    Write { word: u16, value: u16 },
    Reload,
}

impl EepromInterface {
    pub(super) fn check(&mut self, words: &[u16]) {
        let is_good = words.len() >= CONFIGURATION_WORDS && checksum(words) == words[7] as u8;
        self.errors = if is_good { 0 } else { CHECKSUM_ERROR };
    }

    pub(super) fn show(&self, now: u64) -> [u8; INTERFACE_BYTES] {
        let busy = if now < self.busy_until { BUSY | self.command } else { 0 };
        let status = EMULATED | TWO_ADDRESS_BYTES | self.errors | busy;
        let mut registers = [0; INTERFACE_BYTES];
        registers[..2].copy_from_slice(&status.to_le_bytes());
        registers[2..6].copy_from_slice(&self.address.to_le_bytes());
        registers[6..10].copy_from_slice(&self.data);
        registers
    }

    /// `registers` are the values after the master's write; `has_command`: it wrote the command.
    pub(super) fn written(
        &mut self,
        now: u64,
        registers: &[u8; INTERFACE_BYTES],
        has_command: bool,
        words: &[u16],
    ) -> Effect {
        if now < self.busy_until {
            return Effect::Nothing;
        }
        let [c0, c1, a0, a1, a2, a3, d0, d1, d2, d3, ..] = *registers;
        self.address = u32::from_le_bytes([a0, a1, a2, a3]);
        self.data = [d0, d1, d2, d3];
        if !has_command {
            return Effect::Nothing;
        }
        let control = u16::from_le_bytes([c0, c1]);
        self.errors &= CHECKSUM_ERROR;
        self.command = control & COMMAND;
        let at = self.address as usize;
        match self.command {
            0 => Effect::Nothing,
            READ => {
                self.busy_until = now + READ_NS;
                // beyond the end, as in an erased EEPROM
                let word = |at: usize| words.get(at).copied().unwrap_or(0xFFFF_u16).to_le_bytes();
                let ([a, b], [c, d]) = (word(at), word(at.saturating_add(1)));
                self.data = [a, b, c, d];
                Effect::Nothing
            }
            WRITE if control & WRITE_ENABLE == 0 => {
                self.errors |= WRITE_ENABLE_ERROR;
                Effect::Nothing
            }
            WRITE if at < words.len() => {
                self.busy_until = now + WRITE_NS;
                Effect::Write { word: at as u16, value: u16::from_le_bytes([d0, d1]) }
            }
            RELOAD => {
                self.busy_until = now + RELOAD_NS;
                self.check(words);
                Effect::Reload
            }
            _ => {
                self.errors |= COMMAND_ERROR;
                Effect::Nothing
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn interface(command: u16, address: u32, value: u16) -> [u8; INTERFACE_BYTES] {
        let mut registers = [0; INTERFACE_BYTES];
        registers[..2].copy_from_slice(&command.to_le_bytes());
        registers[2..6].copy_from_slice(&address.to_le_bytes());
        registers[6..8].copy_from_slice(&value.to_le_bytes());
        registers
    }

    fn words() -> Vec<u16> {
        let mut words: Vec<u16> = (0..64).map(|word| word * 3).collect();
        words[7] = checksum(&words).into();
        words
    }

    #[test]
    fn eeprom_read_takes_time_and_gives_two_words() {
        let (mut eeprom, words) = (EepromInterface::default(), words());
        eeprom.written(100, &interface(READ, 8, 0), true, &words);
        assert_eq!(eeprom.show(101)[1] & 0x81, 0x81, "busy, reading");
        let shown = eeprom.show(100 + READ_NS);
        assert_eq!(shown[..2], [0xA0, 0]);
        assert_eq!(shown[6..10], [24, 0, 27, 0]);
        eeprom.written(200_000, &interface(READ, 63, 0), true, &words);
        assert_eq!(eeprom.show(300_000)[6..10], [189, 0, 0xFF, 0xFF]);
    }

    #[test]
    fn eeprom_write_needs_enable_and_valid_address() {
        let (mut eeprom, words) = (EepromInterface::default(), words());
        let write = |enable: u16, at| interface(WRITE | enable, at, 0x1234);
        assert_eq!(eeprom.written(0, &write(0, 4), true, &words), Effect::Nothing);
        assert_eq!(eeprom.show(0)[1], 0x40);
        let effect = eeprom.written(0, &write(1, 4), true, &words);
        assert_eq!(effect, Effect::Write { word: 4, value: 0x1234 });
        assert_eq!(eeprom.written(10, &write(1, 5), true, &words), Effect::Nothing, "busy");
        assert_eq!(eeprom.written(WRITE_NS, &write(1, 64), true, &words), Effect::Nothing);
        assert_eq!(eeprom.show(WRITE_NS)[1], 0x20);
    }

    #[test]
    fn checksum_is_the_one_of_real_devices() {
        assert_eq!(checksum(&[0x0D00, 0, 0, 0, 0, 0, 0]), 0x46);
        let words = [0x0104, 0, 0, 0x00FF, 0, 0, 0, 0x00E2];
        let mut eeprom = EepromInterface::default();
        eeprom.check(&words);
        assert_eq!(eeprom.show(0)[1], 0);
        eeprom.check(&[0x0104, 0, 0, 0x00FE, 0, 0, 0, 0x00E2]);
        assert_eq!(eeprom.show(0)[1], 0x08, "a wrong checksum shows");
    }
}
