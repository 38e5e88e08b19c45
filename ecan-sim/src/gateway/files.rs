use super::Gateway;
use super::firmware_update::{FirmwareProgress, FirmwareUpdateError};

impl Gateway {
    /// Begins a firmware update: erases the free partition. An update in progress is abandoned.
    /// Not for the cycle: allocates.
    ///
    /// # Errors
    /// `NotReady` without supply, while booting and when a restart with another version is due;
    /// `Flash` if the partition could not be erased.
    pub fn begin_firmware_update(&mut self, now: u64) -> Result<(), FirmwareUpdateError> {
        self.advance(now);
        if !self.is_responding() {
            return Err(FirmwareUpdateError::NotReady);
        }
        self.firmware.begin(self.now, &mut self.faults)
    }

    /// Writes the next part of the file, of any length.
    ///
    /// # Errors
    /// `NotBegun`, `TooBig`, or `Flash`; the update has ended then.
    pub fn write_firmware(
        &mut self,
        now: u64,
        data: &[u8],
    ) -> Result<FirmwareProgress, FirmwareUpdateError> {
        self.advance(now);
        self.firmware.write(self.now, data, &mut self.faults)
    }

    /// The file is complete: writes the rest, checks the file, and restarts with the new version
    /// half a second later.
    ///
    /// # Errors
    /// `NotBegun`, `Flash`, or the fault of the file. The running version stays.
    pub fn finish_firmware_update(
        &mut self,
        now: u64,
    ) -> Result<FirmwareProgress, FirmwareUpdateError> {
        self.advance(now);
        self.firmware.finish(self.now, &mut self.faults)
    }

    /// Abandons an update; does nothing without one.
    pub fn abandon_firmware_update(&mut self) {
        self.firmware.abandon();
    }

    /// The package that runs.
    #[must_use]
    pub fn running_firmware(&self) -> &[u8] {
        &self.firmware.running_file
    }

    /// Sets the contents that the firmware gives an erased EEPROM. An empty EEPROM gets them now.
    pub fn install_eeprom(&mut self, default: Vec<u16>) {
        self.eeprom.install(default);
    }

    /// The words of the EEPROM; they survive power loss. Empty before
    /// [`install_eeprom`](Self::install_eeprom), and between an erasure and the end of the restart.
    #[must_use]
    pub fn eeprom(&self) -> &[u16] {
        &self.eeprom.words
    }

    /// Writes one word; does nothing outside the EEPROM. Does not allocate.
    pub fn write_eeprom(&mut self, word: u16, value: u16) {
        self.eeprom.write(word, value);
    }
}
