//! Saving, loading and restoring the configuration, as a whole (0xB000:04) and by channel
//! (0x8001..0x8004:03), with the commands about firmware images and the EEPROM that share their
//! time (manual 13.4, 13.7).
//!
//! A command takes its time, and is over when the status shows its result and the sequence has
//! counted. What it does happens at its end; a save takes the values of its beginning. Only one
//! runs at a time. Loading puts values back and, for a channel that runs or ran when it was
//! saved, applies them; the same happens with the saved configuration when the gateway starts.
//! A factory reset also erases what was saved.

use ecan_protocol::config::{ApplyStatus, DataPathGlobal};
use ecan_protocol::device::{AlState, MaintenanceStatus};
use ecan_protocol::mapping::CHANNELS;

use super::channel_control::{self, FIRST_CHANNEL_OBJECT};
use super::configuration_image::{ConfigurationImage, CrcError};
use super::firmware_package::FirmwarePackageError;
use super::firmware_update::FirmwareUpdateError;
use super::maintenance::command;
use super::{Gateway, NS_PER_MS};

/// Erasing and writing the configuration's sector.
const WRITE_NS: u64 = 20 * NS_PER_MS;
/// Reading and applying it.
const LOAD_NS: u64 = NS_PER_MS;
/// Checking a firmware image.
const VALIDATE_NS: u64 = 5 * NS_PER_MS;

/// Bits of the channel's flash command; they are those of 0xB000:04.
mod channel_command {
    pub(super) const SAVE: u32 = 1 << 0;
    pub(super) const LOAD: u32 = 1 << 1;
    pub(super) const FACTORY: u32 = 1 << 2;
}

#[derive(Clone, Copy, Debug)]
enum Scope {
    Device,
    Channel(usize),
}

/// A command under way.
#[derive(Debug)]
pub(super) struct FlashJob {
    done_at: u64,
    scope: Scope,
    bits: u32,
    /// What a save saves.
    image: ConfigurationImage,
}

impl FlashJob {
    pub(super) fn done_at(&self) -> u64 {
        self.done_at
    }
}

impl Gateway {
    /// The configuration as a save would store it now.
    pub(super) fn configuration(&self) -> ConfigurationImage {
        let mut runs = [false; CHANNELS];
        for (runs, channel) in runs.iter_mut().zip(&self.channels) {
            *runs = channel.controller.config().is_some();
        }
        ConfigurationImage::collect(&self.values, &self.filters, runs)
    }

    /// Begins a maintenance command of bits 0 to 4 or bit 6, already allowed.
    pub(super) fn begin_maintenance(&mut self, bits: u32) {
        let mut duration = 0;
        for (bit, time) in [
            (command::SAVE, WRITE_NS),
            (command::LOAD, LOAD_NS),
            (command::FACTORY, WRITE_NS),
            (command::VALIDATE, VALIDATE_NS),
            (command::ACTIVATE, VALIDATE_NS),
            (command::REBUILD_EEPROM, WRITE_NS),
        ] {
            if bits & bit != 0 {
                duration += time;
            }
        }
        self.maintenance.begin();
        self.begin_job(Scope::Device, bits, duration);
    }

    /// The flash command of a channel.
    pub(super) fn channel_flash_command(&mut self, number: usize, bits: u32) {
        use channel_command::{FACTORY, LOAD, SAVE};
        let refused = if self.state == AlState::Op || self.flash_job.is_some() {
            Some(ApplyStatus::Fail)
        } else if bits & SAVE != 0 {
            // what cannot be built is not worth keeping
            self.filters.get(number).and_then(|filters| {
                channel_control::build(&self.values, number as u8, filters).err()
            })
        } else {
            None
        };
        if let Some(status) = refused {
            self.finish_channel_flash(number, status);
            return;
        }
        let writes = u64::from((bits & SAVE).count_ones() + (bits & FACTORY).count_ones());
        let loads = u64::from((bits & LOAD).count_ones());
        self.begin_job(Scope::Channel(number), bits, writes * WRITE_NS + loads * LOAD_NS);
    }

    fn begin_job(&mut self, scope: Scope, bits: u32, duration: u64) {
        let mut image = self.configuration();
        if let Scope::Channel(number) = scope {
            // the other channels stay as they are stored
            let current = std::mem::replace(&mut image, self.stored_or_factory());
            image.replace_channel(number, &current);
        }
        if bits & (command::SAVE | command::FACTORY) != 0 {
            self.flash.begin_change();
        }
        self.flash_job = Some(FlashJob { done_at: self.now + duration, scope, bits, image });
    }

    fn stored_or_factory(&self) -> ConfigurationImage {
        match self.flash.read() {
            Ok(Some(image)) => image,
            Ok(None) | Err(CrcError) => ConfigurationImage::factory(),
        }
    }

    /// The time of the command under way is over.
    pub(super) fn finish_flash_job(&mut self) {
        let Some(job) = self.flash_job.take() else {
            return;
        };
        match job.scope {
            Scope::Device => {
                let status = self.execute(&job).err().unwrap_or(MaintenanceStatus::Ok);
                self.maintenance.finish(status);
                if job.bits & command::REBUILD_EEPROM != 0 {
                    self.eeprom.erase();
                    self.boot();
                }
            }
            Scope::Channel(number) => {
                let status = self.execute_for_channel(number, &job);
                self.finish_channel_flash(number, status);
            }
        }
    }

    /// Bits 0 to 4 in ascending order, up to the first that fails.
    fn execute(&mut self, job: &FlashJob) -> Result<(), MaintenanceStatus> {
        let has = |bit| job.bits & bit != 0;
        if has(command::SAVE) {
            self.store(&job.image)?;
        }
        let changes = has(command::LOAD) || has(command::FACTORY) || has(command::ACTIVATE);
        if changes && self.state == AlState::Op {
            return Err(MaintenanceStatus::Denied);
        }
        if has(command::LOAD) {
            match self.flash.read() {
                Ok(Some(image)) => self.restore(&image)?,
                Ok(None) => return Err(MaintenanceStatus::ImageInvalid),
                Err(CrcError) => return Err(MaintenanceStatus::CrcError),
            }
        }
        if has(command::FACTORY) {
            if self.faults.take_flash_failure() {
                return Err(MaintenanceStatus::FlashError);
            }
            self.flash.erase();
            self.restore(&ConfigurationImage::factory())?;
        }
        if has(command::VALIDATE) {
            self.firmware.validate().map_err(image_status)?;
        }
        if has(command::ACTIVATE) {
            self.firmware.activate(self.now).map_err(image_status)?;
        }
        Ok(())
    }

    fn store(&mut self, image: &ConfigurationImage) -> Result<(), MaintenanceStatus> {
        if self.faults.take_flash_failure() {
            return Err(MaintenanceStatus::FlashError);
        }
        self.flash.store(image);
        Ok(())
    }

    fn execute_for_channel(&mut self, number: usize, job: &FlashJob) -> ApplyStatus {
        use channel_command::{FACTORY, LOAD, SAVE};
        let has = |bit| job.bits & bit != 0;
        let mut image = job.image.clone();
        if has(SAVE) && self.store(&image).is_err() {
            return ApplyStatus::Fail;
        }
        if (has(LOAD) || has(FACTORY)) && self.state == AlState::Op {
            return ApplyStatus::Fail;
        }
        if has(LOAD) {
            let Ok(Some(stored)) = self.flash.read() else {
                return ApplyStatus::Fail;
            };
            let status = self.restore_channel(number, &stored);
            if status != ApplyStatus::Ok {
                return status;
            }
        }
        if has(FACTORY) {
            image.replace_channel(number, &ConfigurationImage::factory());
            if self.store(&image).is_err() {
                return ApplyStatus::Fail;
            }
            return self.restore_channel(number, &image);
        }
        ApplyStatus::Ok
    }

    fn finish_channel_flash(&mut self, number: usize, status: ApplyStatus) {
        let index = FIRST_CHANNEL_OBJECT + number as u16;
        self.finish_channel_command(index, channel_control::subindex::FLASH_STATUS, status);
    }

    /// Puts a configuration back and in force, as far as it goes without the master.
    fn restore(&mut self, image: &ConfigurationImage) -> Result<(), MaintenanceStatus> {
        self.restore_common(image);
        let Self { profiles, values, .. } = self;
        for profile in profiles {
            profile.note_request(values);
        }
        let mut verdict = Ok(());
        for number in 0..CHANNELS {
            if self.restore_channel(number, image) != ApplyStatus::Ok {
                verdict = Err(MaintenanceStatus::ImageInvalid);
            }
        }
        verdict
    }

    fn restore_common(&mut self, image: &ConfigurationImage) {
        image.restore_common(&mut self.values);
        self.apply_stored_rotation();
        self.data_path = DataPathGlobal::default();
        self.apply_global_data_path();
        for (number, index) in (0..CHANNELS).zip(0x8021..) {
            self.apply_data_path(number, index);
        }
    }

    /// A channel that runs, or ran when it was saved, is applied.
    fn restore_channel(&mut self, number: usize, image: &ConfigurationImage) -> ApplyStatus {
        let Self { values, filters, channels, .. } = self;
        let (Some(lists), Some(channel)) = (filters.get_mut(number), channels.get(number)) else {
            return ApplyStatus::Fail;
        };
        let runs = channel.controller.config().is_some();
        if !image.restore_channel(number, values, lists) && !runs {
            return ApplyStatus::Ok;
        }
        let status = self.apply_channel(number);
        let index = FIRST_CHANNEL_OBJECT + number as u16;
        self.values.set(index, channel_control::subindex::APPLY_STATUS, u32::from(status.raw()));
        status
    }

    /// The firmware starts: the saved configuration, if there is a sound one, comes back.
    pub(super) fn load_at_start(&mut self) {
        if let Ok(Some(image)) = self.flash.read() {
            self.restore_common(&image);
            for number in 0..CHANNELS {
                self.restore_channel(number, &image);
            }
        }
    }
}

fn image_status(error: FirmwareUpdateError) -> MaintenanceStatus {
    match error {
        FirmwareUpdateError::Package(FirmwarePackageError::PayloadCheck { .. }) => {
            MaintenanceStatus::CrcError
        }
        _ => MaintenanceStatus::ImageInvalid,
    }
}
