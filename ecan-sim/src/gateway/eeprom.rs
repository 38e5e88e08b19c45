//! EEPROM of the slave controller, which the gateway emulates in its flash (manual 13.7, bit 6 of
//! the maintenance command). The slave controller interprets the words.

#[derive(Clone, Debug, Default)]
pub(super) struct Eeprom {
    pub(super) words: Vec<u16>,
    default: Vec<u16>,
}

impl Eeprom {
    /// Sets the contents of a rebuilt EEPROM; an empty one is rebuilt now.
    pub(super) fn install(&mut self, default: Vec<u16>) {
        self.default = default;
        self.start();
    }

    pub(super) fn write(&mut self, word: u16, value: u16) {
        if let Some(to) = self.words.get_mut(usize::from(word)) {
            *to = value;
        }
    }

    /// Start of the firmware: rebuilds an erased EEPROM.
    pub(super) fn start(&mut self) {
        if self.words.is_empty() {
            self.words.clone_from(&self.default);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn erased_eeprom_is_rebuilt_at_start() {
        let mut eeprom = Eeprom::default();
        eeprom.install(vec![1, 2]);
        eeprom.write(1, 9);
        eeprom.write(2, 9);
        eeprom.start();
        assert_eq!(eeprom.words, [1, 9]);
        eeprom.words.clear();
        assert!(eeprom.words.is_empty());
        eeprom.start();
        assert_eq!(eeprom.words, [1, 2]);
    }
}
