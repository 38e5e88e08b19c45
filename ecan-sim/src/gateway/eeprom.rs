//! The slave controller's EEPROM, which this gateway emulates in its flash (manual 13.7, bit 6 of
//! the maintenance command). What the words mean is the slave controller's affair.

use super::Gateway;

/// Words of the emulated EEPROM and what a rebuild puts there.
#[derive(Debug, Default)]
pub(super) struct Eeprom {
    words: Vec<u16>,
    default: Vec<u16>,
}

impl Eeprom {
    pub(super) fn erase(&mut self) {
        self.words.clear();
    }

    /// The firmware starts: an erased EEPROM is built anew.
    pub(super) fn start(&mut self) {
        if self.words.is_empty() {
            self.words.clone_from(&self.default);
        }
    }
}

impl Gateway {
    /// Sets the EEPROM that the firmware builds where it finds an erased one, and fills it with
    /// that now if it is empty.
    pub fn install_eeprom(&mut self, default: Vec<u16>) {
        self.eeprom.default = default;
        self.eeprom.start();
    }

    /// The EEPROM's words; they survive power loss. Empty before
    /// [`install_eeprom`](Self::install_eeprom), and between an erasure and the end of the restart.
    #[must_use]
    pub fn eeprom(&self) -> &[u16] {
        &self.eeprom.words
    }

    /// Writes one word; outside the EEPROM nothing happens. Does not allocate.
    pub fn write_eeprom(&mut self, word: u16, value: u16) {
        if let Some(to) = self.eeprom.words.get_mut(usize::from(word)) {
            *to = value;
        }
    }

    /// Erases the EEPROM and restarts the firmware, which builds it anew, as bit 6 of the
    /// maintenance command does. Nothing happens without supply.
    pub fn rebuild_eeprom(&mut self, now: u64) {
        self.advance(now);
        if self.is_responding() {
            self.eeprom.erase();
            self.boot();
        }
    }
}
