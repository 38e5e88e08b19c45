//! Saving, loading and restoring the configuration, as a whole (0xB000:04) and by channel
//! (0x8001..0x8004:03), with the commands for firmware images and the EEPROM that share their time
//! (manual 13.4, 13.7).
//!
//! A command takes time. When it is complete, the status has its result and the sequence has
//! counted. A command acts at its end; a save stores the values of its beginning. One command runs
//! at a time. Loading restores values and applies each channel that runs, or ran when it was saved;
//! the same happens with the saved configuration at the start of the gateway. A factory reset also
//! erases the saved configuration. An interrupted write leaves bytes with an invalid CRC.
//!
//! Saved configuration: values of the saved objects and the filter lists, without commands, editing
//! windows and runtime state (manual 13.3, 13.4, 13.7).
//!
//! The manual gives no format, only a CRC32 over the image. This format is: the letters `ECFG`, a
//! format number, the common objects, the four channels, the CRC32 of all that, all little endian.
//! A channel is saved with the information whether its controller runs, so that it runs again after
//! a load.

use ecan_protocol::config::ApplyStatus;
use ecan_protocol::device::{AlState, MaintenanceStatus};

use super::NS_PER_MS;
use super::application::Application;
use super::configuration_image::ConfigurationImage;
use super::fault::PendingFaults;
use super::firmware_update::{FirmwarePackageError, FirmwareUpdate, FirmwareUpdateError};
use super::maintenance::command;

/// Erasing and writing the sector of the configuration.
const WRITE_NS: u64 = 20 * NS_PER_MS;
const LOAD_NS: u64 = NS_PER_MS;
const VALIDATE_NS: u64 = 5 * NS_PER_MS;

#[derive(Clone, Copy, Debug)]
enum Scope {
    Device,
    Channel(usize),
}

#[derive(Clone, Debug)]
struct Job {
    done_at: u64,
    scope: Scope,
    bits: u32,
    /// Configuration that a save stores.
    image: ConfigurationImage,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Completion {
    Device { status: MaintenanceStatus, rebuilds_eeprom: bool },
    Channel { number: usize, status: ApplyStatus },
}

pub(super) struct Target<'a> {
    pub(super) application: &'a mut Application,
    pub(super) firmware: &'a mut FirmwareUpdate,
    pub(super) faults: &'a mut PendingFaults,
    pub(super) state: AlState,
    pub(super) now: u64,
}

#[derive(Clone, Debug, Default)]
pub(super) struct ConfigurationStore {
    /// Flash sector, empty if erased; survives power loss.
    flash: Vec<u8>,
    job: Option<Job>,
}

impl ConfigurationStore {
    pub(super) fn is_busy(&self) -> bool {
        self.job.is_some()
    }

    pub(super) fn done_at(&self) -> Option<u64> {
        self.job.as_ref().map(|job| job.done_at)
    }

    pub(super) fn cancel(&mut self) {
        self.job = None;
    }

    /// CRC32 of the saved configuration, 0 without a valid one.
    pub(super) fn stored_crc(&self) -> u32 {
        self.saved().map_or(0, |image| image.crc())
    }

    pub(super) fn saved(&self) -> Option<ConfigurationImage> {
        ConfigurationImage::parse(&self.flash)
    }

    /// Begins a permitted maintenance command of bits 0 to 4 or bit 6.
    pub(super) fn begin(&mut self, now: u64, bits: u32, current: ConfigurationImage) {
        self.begin_job(now, Scope::Device, bits, current);
    }

    /// The error is the status of a rejected command.
    pub(super) fn begin_channel(
        &mut self,
        now: u64,
        number: usize,
        bits: u32,
        application: &Application,
        state: AlState,
    ) -> Result<(), ApplyStatus> {
        if state == AlState::Op || self.is_busy() {
            return Err(ApplyStatus::Fail);
        }
        if bits & command::SAVE != 0 {
            // an invalid configuration is not saved
            application.build_channel(number)?;
        }
        // the other channels keep their stored configuration
        let mut image = self.saved().unwrap_or_else(ConfigurationImage::factory);
        image.replace_channel(number, &application.configuration());
        let bits = bits & (command::SAVE | command::LOAD | command::FACTORY);
        self.begin_job(now, Scope::Channel(number), bits, image);
        Ok(())
    }

    fn begin_job(&mut self, now: u64, scope: Scope, bits: u32, image: ConfigurationImage) {
        if bits & (command::SAVE | command::FACTORY) != 0 {
            // the contents are invalid until the end; erased cells read as ones
            self.flash.truncate(self.flash.len() / 2);
            self.flash.push(0xFF);
        }
        let durations = [
            (command::SAVE, WRITE_NS),
            (command::LOAD, LOAD_NS),
            (command::FACTORY, WRITE_NS),
            (command::VALIDATE, VALIDATE_NS),
            (command::ACTIVATE, VALIDATE_NS),
            (command::REBUILD_EEPROM, WRITE_NS),
        ];
        let parts = durations.into_iter().filter(|(bit, _)| bits & bit != 0);
        let done_at = now + parts.map(|(_, time)| time).sum::<u64>();
        self.job = Some(Job { done_at, scope, bits, image });
    }

    pub(super) fn finish(&mut self, target: &mut Target<'_>) -> Option<Completion> {
        let job = self.job.take()?;
        Some(match job.scope {
            Scope::Device => Completion::Device {
                status: self.execute(&job, target).err().unwrap_or(MaintenanceStatus::Ok),
                rebuilds_eeprom: job.bits & command::REBUILD_EEPROM != 0,
            },
            Scope::Channel(number) => {
                let status = self.execute_for_channel(number, &job, target);
                Completion::Channel { number, status }
            }
        })
    }

    /// Bits 0 to 4 in ascending order, up to the first that fails.
    fn execute(&mut self, job: &Job, target: &mut Target<'_>) -> Result<(), MaintenanceStatus> {
        let has = |bit| job.bits & bit != 0;
        if has(command::SAVE) {
            self.store(&job.image, target.faults)?;
        }
        let changes = has(command::LOAD) || has(command::FACTORY) || has(command::ACTIVATE);
        if changes && target.state == AlState::Op {
            return Err(MaintenanceStatus::Denied);
        }
        if has(command::LOAD) {
            let is_erased = self.flash.is_empty();
            let error = if is_erased {
                MaintenanceStatus::ImageInvalid
            } else {
                MaintenanceStatus::CrcError
            };
            restore(&self.saved().ok_or(error)?, target)?;
        }
        if has(command::FACTORY) {
            if target.faults.flash_failures.take() {
                return Err(MaintenanceStatus::FlashError);
            }
            self.flash.clear();
            restore(&ConfigurationImage::factory(), target)?;
        }
        if has(command::VALIDATE) {
            target.firmware.validate().map_err(image_status)?;
        }
        if has(command::ACTIVATE) {
            target.firmware.activate(target.now).map_err(image_status)?;
        }
        Ok(())
    }

    fn store(
        &mut self,
        image: &ConfigurationImage,
        faults: &mut PendingFaults,
    ) -> Result<(), MaintenanceStatus> {
        if faults.flash_failures.take() {
            return Err(MaintenanceStatus::FlashError);
        }
        self.flash = image.to_bytes();
        Ok(())
    }

    fn execute_for_channel(
        &mut self,
        number: usize,
        job: &Job,
        target: &mut Target<'_>,
    ) -> ApplyStatus {
        use command::{FACTORY, LOAD, SAVE};
        let has = |bit| job.bits & bit != 0;
        if has(SAVE) && self.store(&job.image, target.faults).is_err() {
            return ApplyStatus::Fail;
        }
        if (has(LOAD) || has(FACTORY)) && target.state == AlState::Op {
            return ApplyStatus::Fail;
        }
        if has(LOAD) {
            let Some(stored) = self.saved() else {
                return ApplyStatus::Fail;
            };
            let status = target.application.restore_channel(number, &stored);
            if status != ApplyStatus::Ok {
                return status;
            }
        }
        if has(FACTORY) {
            let mut image = job.image.clone();
            image.replace_channel(number, &ConfigurationImage::factory());
            if self.store(&image, target.faults).is_err() {
                return ApplyStatus::Fail;
            }
            return target.application.restore_channel(number, &image);
        }
        ApplyStatus::Ok
    }
}

fn restore(image: &ConfigurationImage, target: &mut Target<'_>) -> Result<(), MaintenanceStatus> {
    if target.application.restore(image, target.state) {
        Ok(())
    } else {
        Err(MaintenanceStatus::ImageInvalid)
    }
}

fn image_status(error: FirmwareUpdateError) -> MaintenanceStatus {
    match error {
        FirmwareUpdateError::Package(FirmwarePackageError::PayloadCheck(..)) => {
            MaintenanceStatus::CrcError
        }
        _ => MaintenanceStatus::ImageInvalid,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gateway::config::GatewayModelConfig;

    struct Fixture {
        store: ConfigurationStore,
        application: Application,
        firmware: FirmwareUpdate,
        faults: PendingFaults,
    }

    impl Fixture {
        fn new() -> Self {
            let config = GatewayModelConfig::default();
            Self {
                store: ConfigurationStore::default(),
                application: Application::new(&config, 1),
                firmware: FirmwareUpdate::new(config.firmware),
                faults: PendingFaults::default(),
            }
        }

        fn run(&mut self, bits: u32) -> MaintenanceStatus {
            self.store.begin(0, bits, self.application.configuration());
            let now = self.store.done_at().unwrap();
            let mut target = Target {
                application: &mut self.application,
                firmware: &mut self.firmware,
                faults: &mut self.faults,
                state: AlState::PreOp,
                now,
            };
            match self.store.finish(&mut target) {
                Some(Completion::Device { status, rebuilds_eeprom: false }) => status,
                other => panic!("{other:?}"),
            }
        }
    }

    #[test]
    fn save_stores_the_present_configuration() {
        let mut fixture = Fixture::new();
        assert_eq!(fixture.store.stored_crc(), 0);
        assert_eq!(fixture.run(command::LOAD), MaintenanceStatus::ImageInvalid);
        assert_eq!(fixture.run(command::SAVE), MaintenanceStatus::Ok);
        assert_eq!(fixture.store.stored_crc(), fixture.application.configuration().crc());
        assert_eq!(fixture.run(command::LOAD), MaintenanceStatus::Ok);
        assert_eq!(fixture.run(command::FACTORY), MaintenanceStatus::Ok);
        assert!(fixture.store.saved().is_none());
    }

    #[test]
    fn interrupted_save_leaves_an_invalid_image() {
        let mut fixture = Fixture::new();
        fixture.run(command::SAVE);
        fixture.store.begin(0, command::SAVE, fixture.application.configuration());
        assert!(fixture.store.is_busy());
        fixture.store.cancel();
        assert_eq!((fixture.store.done_at(), fixture.store.stored_crc()), (None, 0));
        assert_eq!(fixture.run(command::LOAD), MaintenanceStatus::CrcError);
    }

    #[test]
    fn failing_flash_is_reported() {
        let mut fixture = Fixture::new();
        fixture.faults.flash_failures.add(1);
        assert_eq!(fixture.run(command::SAVE), MaintenanceStatus::FlashError);
    }
}
