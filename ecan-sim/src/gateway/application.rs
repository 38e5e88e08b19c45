use ecan_protocol::config::{ApplyStatus, ConfigObject, DataPathConfig, DataPathGlobal};
use ecan_protocol::device::{AlState, AlStatusCode};
use ecan_protocol::mapping::{CHANNELS, Direction};

use super::channel_control::{self, FIRST_CHANNEL_OBJECT};
use super::command::{FIRST_DATA_PATH, GLOBAL_DATA_PATH, SYSTEM};
use super::config::GatewayModelConfig;
use super::configuration_image::ConfigurationImage;
use super::counters::GatewayCounters;
use super::data_path::DataPath;
use super::object_server::ObjectServer;
use super::pin_rotation::PinRotation;
use super::sync_managers::SyncManagers;

/// Subindex of the apply status of 0x8020..0x8024.
const DATA_PATH_STATUS: u8 = 3;

#[derive(Debug)]
pub(super) struct Application {
    pub(super) objects: ObjectServer,
    pub(super) data_path: DataPath,
    pub(super) pins: PinRotation,
}

impl Application {
    pub(super) fn new(config: &GatewayModelConfig, seed: u64) -> Self {
        Self {
            objects: ObjectServer::new(),
            data_path: DataPath::new(config, seed),
            pins: PinRotation::default(),
        }
    }

    pub(super) fn reset(&mut self, counters: &mut GatewayCounters) {
        self.objects.reset();
        self.data_path.reset(counters);
        self.pins.reset();
    }

    pub(super) fn apply_profile(&mut self, direction: Direction, state: AlState) {
        let assigned = self.objects.assigned_chunks(direction);
        let profile = self.data_path.options.profiles.of_mut(direction);
        if profile.apply(&self.objects.values, state, assigned) {
            self.data_path.profile_changed(direction);
        }
    }

    /// Applies the requested profile of each direction that has no active one (manual 9.2 calls
    /// the defaults "default request").
    pub(super) fn apply_missing_profiles(&mut self, state: AlState) {
        for direction in Direction::ALL {
            if self.data_path.options.profiles.of(direction).active().is_none() {
                self.apply_profile(direction, state);
            }
        }
    }

    pub(super) fn note_profile_request(&mut self, direction: Direction) {
        self.data_path.options.profiles.of_mut(direction).note_request(&self.objects.values);
    }

    /// Checks SM2 and SM3 against the active profiles and the PDO assignment.
    pub(super) fn check_process_data(&self, sms: &SyncManagers) -> Result<(), AlStatusCode> {
        let bytes = |direction| {
            let active = self.data_path.options.profiles.of(direction).active_bytes();
            if self.objects.assigned_bytes(direction) == active { active } else { 0 }
        };
        sms.check_process_data(bytes(Direction::RxPdo), bytes(Direction::TxPdo))
    }

    pub(super) fn apply_channel(
        &mut self,
        number: usize,
        counters: &mut GatewayCounters,
    ) -> ApplyStatus {
        match self.build_channel(number) {
            Some(built) => self.data_path.apply_channel(number, built, counters),
            None => ApplyStatus::Fail,
        }
    }

    /// Builds the stored configuration of a channel; `None` for a channel that does not exist.
    pub(super) fn build_channel(&self, number: usize) -> Option<channel_control::Built> {
        let filters = self.objects.filters.get(number)?;
        Some(channel_control::build(&self.objects.values, number as u8, filters))
    }

    /// Activates the stored pin rotation, except in OP (apply status 1). A change restarts all
    /// controllers at their new connectors.
    pub(super) fn rotate_pins(&mut self, state: AlState, counters: &mut GatewayCounters) {
        const REQUESTED: u8 = 12;
        const ACTIVE: u8 = 13;
        const STATUS: u8 = 15;
        let values = &mut self.objects.values;
        if state == AlState::Op {
            values.set(SYSTEM, STATUS, 1);
            return;
        }
        let rotation = values.get_u8(SYSTEM, REQUESTED);
        values.set(SYSTEM, STATUS, 0);
        values.set(SYSTEM, ACTIVE, u32::from(rotation));
        if self.pins.set(rotation) {
            self.data_path.restart_channels(counters);
        }
    }

    pub(super) fn apply_global_data_path(&mut self) {
        let values = &self.objects.values;
        let requested =
            DataPathGlobal::from_values(|subindex| values.get(GLOBAL_DATA_PATH, subindex));
        let mut is_valid = requested.is_ok();
        if let Ok(requested) = requested {
            requested.check(&mut |_| is_valid = false);
            if is_valid {
                self.data_path.set_global(requested);
            }
        }
        self.set_data_path_status(GLOBAL_DATA_PATH, is_valid);
    }

    pub(super) fn apply_data_path(&mut self, number: usize, counters: &mut GatewayCounters) {
        let index = FIRST_DATA_PATH + number as u16;
        let values = &self.objects.values;
        let requested = DataPathConfig::from_values(|subindex| values.get(index, subindex));
        let mut is_valid = requested.is_ok();
        if let Ok(requested) = requested {
            requested.check(&mut |_| is_valid = false);
            if is_valid {
                self.data_path.set_policy(number, requested, counters);
            }
        }
        self.set_data_path_status(index, is_valid);
    }

    /// The manual specifies only "0=OK"; a rejected policy gives 1, as in 13.4.
    fn set_data_path_status(&mut self, index: u16, is_valid: bool) {
        let status = if is_valid { ApplyStatus::Ok } else { ApplyStatus::Fail };
        self.objects.values.set(index, DATA_PATH_STATUS, u32::from(status.raw()));
    }

    pub(super) fn configuration(&self) -> ConfigurationImage {
        let mut runs = [false; CHANNELS];
        for (runs, channel) in runs.iter_mut().zip(&self.data_path.channels) {
            *runs = channel.controller.config().is_some();
        }
        ConfigurationImage::collect(&self.objects.values, &self.objects.filters, runs)
    }

    /// Restores and applies a configuration, except what needs the master. Returns whether all
    /// channels could be applied.
    pub(super) fn restore(
        &mut self,
        image: &ConfigurationImage,
        state: AlState,
        counters: &mut GatewayCounters,
    ) -> bool {
        self.restore_common(image, state, counters);
        for direction in Direction::ALL {
            self.note_profile_request(direction);
        }
        self.restore_channels(image, counters)
    }

    pub(super) fn load_at_start(
        &mut self,
        image: &ConfigurationImage,
        state: AlState,
        counters: &mut GatewayCounters,
    ) {
        self.restore_common(image, state, counters);
        self.restore_channels(image, counters);
    }

    fn restore_common(
        &mut self,
        image: &ConfigurationImage,
        state: AlState,
        counters: &mut GatewayCounters,
    ) {
        image.restore_common(&mut self.objects.values);
        self.rotate_pins(state, counters);
        self.data_path.set_global(DataPathGlobal::default());
        self.apply_global_data_path();
        for number in 0..CHANNELS {
            self.apply_data_path(number, counters);
        }
    }

    fn restore_channels(
        &mut self,
        image: &ConfigurationImage,
        counters: &mut GatewayCounters,
    ) -> bool {
        let mut is_ok = true;
        for number in 0..CHANNELS {
            is_ok &= self.restore_channel(number, image, counters) == ApplyStatus::Ok;
        }
        is_ok
    }

    /// Restores a channel. It is applied if it runs, or ran when it was saved.
    pub(super) fn restore_channel(
        &mut self,
        number: usize,
        image: &ConfigurationImage,
        counters: &mut GatewayCounters,
    ) -> ApplyStatus {
        let ObjectServer { values, filters } = &mut self.objects;
        let channel = self.data_path.channels.get(number);
        let (Some(lists), Some(channel)) = (filters.get_mut(number), channel) else {
            return ApplyStatus::Fail;
        };
        let runs = channel.controller.config().is_some();
        if !image.restore_channel(number, values, lists) && !runs {
            return ApplyStatus::Ok;
        }
        let status = self.apply_channel(number, counters);
        let index = FIRST_CHANNEL_OBJECT + number as u16;
        let status_subindex = channel_control::subindex::APPLY_STATUS;
        self.objects.values.set(index, status_subindex, u32::from(status.raw()));
        status
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ecan_protocol::config::ProfileStatus;

    const APPLY_STATUS: u8 = channel_control::subindex::APPLY_STATUS;

    fn application() -> (Application, GatewayCounters) {
        (Application::new(&GatewayModelConfig::default(), 1), GatewayCounters::default())
    }

    #[test]
    fn missing_profiles_are_applied_outside_op_only() {
        let (mut application, _) = application();
        for direction in Direction::ALL {
            application.objects.values.set(direction.profile_object(), 3, 24);
        }
        application.apply_missing_profiles(AlState::Op);
        assert!(application.data_path.options.profiles.of(Direction::TxPdo).active().is_none());
        let status = application.data_path.options.profiles.of(Direction::TxPdo).readback(2);
        assert_eq!(status, Some(u32::from(ProfileStatus::InvalidState.raw())));
        application.apply_missing_profiles(AlState::PreOp);
        for direction in Direction::ALL {
            assert_eq!(application.data_path.options.profiles.of(direction).active_bytes(), 3072);
        }
    }

    #[test]
    fn pin_rotation_is_rejected_in_op() {
        let (mut application, mut counters) = application();
        application.objects.values.set(SYSTEM, 12, 1);
        application.rotate_pins(AlState::Op, &mut counters);
        assert_eq!(application.objects.values.get(SYSTEM, 15), 1);
        assert_eq!(application.pins.channel_at(0), Some(0));
        application.rotate_pins(AlState::PreOp, &mut counters);
        assert_eq!(application.objects.values.get(SYSTEM, 15), 0);
        assert_eq!(application.pins.channel_at(0), Some(3));
    }

    #[test]
    fn invalid_policy_is_reported_and_not_activated() {
        let (mut application, mut counters) = application();
        let before = application.data_path.channels[0].policy;
        application.objects.values.set(FIRST_DATA_PATH, 5, 0xFF);
        application.apply_data_path(0, &mut counters);
        assert_eq!(application.objects.values.get(FIRST_DATA_PATH, DATA_PATH_STATUS), 1);
        assert_eq!(application.data_path.channels[0].policy, before);
    }

    #[test]
    fn saved_running_channel_runs_after_the_restore() {
        let (mut application, mut counters) = application();
        assert_eq!(application.apply_channel(1, &mut counters), ApplyStatus::Ok);
        let image = application.configuration();
        application.reset(&mut counters);
        application.load_at_start(&image, AlState::Init, &mut counters);
        let running = application.data_path.channels.iter();
        let running: Vec<_> =
            running.map(|channel| channel.controller.config().is_some()).collect();
        assert_eq!(running, [false, true, false, false]);
        assert_eq!(application.objects.values.get(FIRST_CHANNEL_OBJECT + 1, APPLY_STATUS), 0);
    }
}
