//! The firmware application: objects, data path and the four CAN connectors.

use ecan_protocol::can::CanFrame;
use ecan_protocol::config::{
    ApplyStatus, ConfigObject, DataPathConfig, DataPathFault, DataPathGlobal, FilterWindow,
};
use ecan_protocol::device::{AlState, AlStatusCode};
use ecan_protocol::mapping::{CHANNELS, Direction};

use super::channel::Channel;
use super::channel_control;
use super::channel_control::FIRST_CHANNEL_OBJECT;
use super::config::{GatewayModelConfig, PinRotation};
use super::configuration_image::ConfigurationImage;
use super::controller::ControllerConfig;
use super::data_path::DataPath;
use super::diagnostics::{Emergency, GatewayCounters};
use super::maintenance::{FIRST_DATA_PATH, GLOBAL_DATA_PATH, SYSTEM};
use super::object_server::ObjectServer;
use super::sync_managers::SyncManagers;
use super::variant::{
    ApplyAtSafeOp, ChannelsAtStart, CompatBits, FilterIndex, InvertedBudget, RotationEffect,
};
use crate::bus::{DetectedError, ErrorState, PhysicalLayer, StationConfig};

/// Subindex of the requested pin rotation in 0x8000.
const REQUESTED_ROTATION: u8 = 12;
/// Subindex of the apply status of 0x8020..0x8024.
const DATA_PATH_STATUS: u8 = 3;

#[derive(Clone, Debug)]
pub(crate) struct Application {
    pub(super) objects: ObjectServer,
    pub(super) data_path: DataPath,
    pub(super) pins: PinRotation,
}

impl Application {
    pub(super) fn new(config: &GatewayModelConfig, seed: u64) -> Self {
        Self {
            objects: ObjectServer::new(&config.variant),
            data_path: DataPath::new(config, seed),
            pins: PinRotation::new(config.variant.rotation_direction),
        }
    }

    pub(super) fn reset(&mut self) {
        let before =
            std::mem::replace(&mut self.objects, ObjectServer::new(self.data_path.variant()));
        if self.data_path.variant().filter_index == FilterIndex::Kept {
            for index in (FIRST_CHANNEL_OBJECT..).take(CHANNELS) {
                let subindex = FilterWindow::STANDARD.index;
                self.objects.values.set(index, subindex, before.values.get(index, subindex));
            }
        }
        self.data_path.reset();
        self.pins.reset();
    }

    pub(super) fn apply_profile(&mut self, direction: Direction, state: AlState) {
        let assigned = self.objects.assigned_chunks(direction);
        let profile = self.data_path.options.of_mut(direction);
        if profile.apply(&self.objects.values, state, assigned) {
            self.data_path.profile_changed(direction);
        }
    }

    /// Applies the requested profile of each direction that has no active one (manual 9.2 calls
    /// the defaults "default request").
    pub(super) fn apply_missing_profiles(&mut self, state: AlState) {
        if self.data_path.variant().apply_at_safeop == ApplyAtSafeOp::Required {
            return;
        }
        for direction in Direction::ALL {
            if self.data_path.options.of(direction).active.is_none() {
                self.apply_profile(direction, state);
            }
        }
    }

    pub(super) fn note_profile_request(&mut self, direction: Direction) {
        self.data_path.options.of_mut(direction).note_request(&self.objects.values);
    }

    /// Checks SM2 and SM3 against the active profiles and the PDO assignment.
    pub(super) fn check_process_data(&self, sms: &SyncManagers) -> Result<(), AlStatusCode> {
        let bytes = |direction| {
            let active = self.data_path.options.of(direction).active_bytes();
            if self.objects.assigned_bytes(direction) == active { active } else { 0 }
        };
        sms.check_process_data(bytes(Direction::RxPdo), bytes(Direction::TxPdo))
    }

    /// Applies the stored configuration of a channel; a rotation may take effect with it.
    pub(super) fn apply_channel(&mut self, number: usize, state: AlState) -> ApplyStatus {
        let is_pending =
            self.objects.values.get_u8(SYSTEM, REQUESTED_ROTATION) != self.pins.active();
        if is_pending && self.data_path.variant().rotation_effect == RotationEffect::ChannelApply {
            self.rotate_pins(state);
        }
        self.run_channel(number)
    }

    fn run_channel(&mut self, number: usize) -> ApplyStatus {
        let built = self.build_channel(number);
        self.data_path.apply_channel(number, built)
    }

    /// Applies the stored configuration of a channel, with its status.
    fn start_channel(&mut self, number: usize) {
        let status = self.run_channel(number);
        self.set_apply_status(number, status);
    }

    fn set_apply_status(&mut self, number: usize, status: ApplyStatus) {
        let index = FIRST_CHANNEL_OBJECT + number as u16;
        let subindex = channel_control::subindex::APPLY_STATUS;
        self.objects.values.set(index, subindex, u32::from(status.raw()));
    }

    /// Builds the stored configuration of a channel.
    pub(super) fn build_channel(&self, number: usize) -> Result<ControllerConfig, ApplyStatus> {
        let ObjectServer { values, filters } = &self.objects;
        let variant = self.data_path.variant();
        channel_control::build(values, number as u8, &filters[number], variant)
    }

    /// A rotation was written.
    pub(super) fn note_rotation(&mut self, state: AlState) {
        if state == AlState::Op || self.data_path.variant().rotation_effect == RotationEffect::Write
        {
            self.rotate_pins(state);
        }
    }

    /// Activates the stored pin rotation, except in OP (apply status 1). A change restarts all
    /// controllers at their new connectors.
    pub(super) fn rotate_pins(&mut self, state: AlState) {
        const ACTIVE: u8 = 13;
        const STATUS: u8 = 15;
        let values = &mut self.objects.values;
        if state == AlState::Op {
            values.set(SYSTEM, STATUS, 1);
            return;
        }
        let rotation = values.get_u8(SYSTEM, REQUESTED_ROTATION);
        values.set(SYSTEM, STATUS, 0);
        values.set(SYSTEM, ACTIVE, u32::from(rotation));
        if self.pins.set(rotation) {
            self.data_path.restart_channels();
        }
    }

    pub(super) fn apply_global_data_path(&mut self) {
        /// Bits of the compat mode that the manual's default sets.
        const LISTED: u16 = 3;
        let is_strict = self.data_path.variant().compat_bits == CompatBits::Rejected;
        let policy = self.policy(GLOBAL_DATA_PATH, |policy: &DataPathGlobal| {
            let mut is_valid = !(is_strict && policy.compat_mode & !LISTED != 0);
            policy.check(&mut |_| is_valid = false);
            is_valid
        });
        self.data_path.global = policy.unwrap_or(self.data_path.global);
    }

    pub(super) fn apply_data_path(&mut self, number: usize) {
        let is_lenient = self.data_path.variant().inverted_budget == InvertedBudget::Accepted;
        let policy = self.policy(FIRST_DATA_PATH + number as u16, |policy: &DataPathConfig| {
            let mut is_valid = true;
            policy.check(&mut |fault| {
                is_valid &= is_lenient && !matches!(fault, DataPathFault::Range(_));
            });
            is_valid
        });
        if let Some(policy) = policy {
            self.data_path.set_policy(number, policy);
        }
    }

    /// The stored policy of an object, if it is valid; sets the apply status. The manual specifies
    /// only "0=OK"; an invalid policy gives 1, as in 13.4.
    fn policy<C: ConfigObject>(
        &mut self,
        index: u16,
        is_valid: impl FnOnce(&C) -> bool,
    ) -> Option<C> {
        let values = &mut self.objects.values;
        let policy = C::from_values(|subindex| values.get(index, subindex)).ok();
        let policy = policy.filter(is_valid);
        let status = if policy.is_some() { ApplyStatus::Ok } else { ApplyStatus::Fail };
        values.set(index, DATA_PATH_STATUS, u32::from(status.raw()));
        policy
    }

    /// Starts with the saved configuration.
    pub(super) fn start(&mut self, saved: Option<ConfigurationImage>, state: AlState) {
        if let Some(image) = saved {
            self.load_at_start(&image, state);
        } else if self.data_path.variant().channels_at_start == ChannelsAtStart::Active {
            (0..CHANNELS).for_each(|channel| self.start_channel(channel));
        }
    }

    pub(super) fn configuration(&self) -> ConfigurationImage {
        let channels = &self.data_path.channels;
        let runs = std::array::from_fn(|number| channels[number].controller.config.is_some());
        ConfigurationImage::collect(&self.objects.values, &self.objects.filters, runs)
    }

    /// Restores and applies a configuration, except what needs the master. Returns whether all
    /// channels could be applied.
    pub(super) fn restore(&mut self, image: &ConfigurationImage, state: AlState) -> bool {
        let is_ok = self.load_at_start(image, state);
        for direction in Direction::ALL {
            self.note_profile_request(direction);
        }
        is_ok
    }

    /// The same at the start of the firmware, when no profile is active.
    pub(super) fn load_at_start(&mut self, image: &ConfigurationImage, state: AlState) -> bool {
        image.restore_common(&mut self.objects.values);
        self.rotate_pins(state);
        self.data_path.global = DataPathGlobal::default();
        self.apply_global_data_path();
        (0..CHANNELS).for_each(|number| self.apply_data_path(number));
        let mut is_ok = true;
        for number in 0..CHANNELS {
            is_ok &= self.restore_channel(number, image) == ApplyStatus::Ok;
        }
        is_ok
    }

    /// Restores a channel. It is applied if it runs, or ran when it was saved.
    pub(super) fn restore_channel(
        &mut self,
        number: usize,
        image: &ConfigurationImage,
    ) -> ApplyStatus {
        let ObjectServer { values, filters } = &mut self.objects;
        let runs = self.data_path.channels[number].controller.config.is_some();
        if !image.restore_channel(number, values, &mut filters[number]) && !runs {
            return ApplyStatus::Ok;
        }
        let status = self.run_channel(number);
        self.set_apply_status(number, status);
        status
    }

    /// The channel at a connector, by the active pin rotation (0x8000:13).
    fn channel_at(&self, connector: usize) -> Option<&Channel> {
        let Self { pins, data_path, .. } = self;
        Some(&data_path.channels[pins.channel_at(connector)?])
    }

    /// The channel at a connector to change, with its number and the counters.
    fn channel_at_mut(
        &mut self,
        connector: usize,
    ) -> Option<(usize, &mut Channel, &mut GatewayCounters)> {
        let Self { pins, data_path, .. } = self;
        let number = pins.channel_at(connector)?;
        Some((number, &mut data_path.channels[number], &mut data_path.counters))
    }

    /// How the controller at a connector (0 to 3) takes part in its bus; `None` while it is
    /// not configured, in INIT by its own register, or without supply.
    pub(super) fn station_config(&self, connector: usize) -> Option<StationConfig> {
        self.channel_at(connector)?.controller.station()
    }

    /// Sample points and delays of the controller at a connector; `None` while it is not configured.
    pub(super) fn physical_layer(&self, connector: usize) -> Option<PhysicalLayer> {
        self.channel_at(connector)?.controller.physical_layer()
    }

    /// Changes when [`station_config`](Self::station_config) may have changed or the controller
    /// was restarted.
    pub(super) fn station_generation(&self, connector: usize) -> u32 {
        let restarts =
            self.channel_at(connector).map_or(0, |channel| channel.controller.generation);
        // a rotation connects another controller, which may have the same number of restarts
        restarts.wrapping_add(self.pins.changes() << 16)
    }

    /// Takes the next frame that the controller at a connector puts into arbitration; `None`
    /// without one, or while the last one is neither confirmed nor abandoned.
    pub(super) fn next_transmit(&mut self, connector: usize) -> Option<CanFrame> {
        self.channel_at_mut(connector)?.1.controller.next_transmit()
    }

    /// Takes a request of the controller at a connector to recover from bus-off.
    pub(super) fn take_recovery_request(&mut self, connector: usize) -> bool {
        let channel = self.channel_at_mut(connector);
        channel.is_some_and(|(_, channel, _)| channel.controller.take_recovery_request())
    }

    /// The bus confirms the frame that was taken last.
    pub(crate) fn confirm(&mut self, connector: usize) {
        if let Some((_, channel, counters)) = self.channel_at_mut(connector) {
            counters.frames_on_bus += u64::from(channel.controller.transmitted());
        }
    }

    /// The bus abandoned the frame that was taken last.
    pub(super) fn abandon(&mut self, connector: usize) {
        if let Some((_, channel, counters)) = self.channel_at_mut(connector) {
            let abandoned = channel.controller.abandoned();
            counters.transmit_losses.not_retransmitted += u64::from(abandoned);
        }
    }

    /// A frame arrives from the bus, complete at `now`.
    pub(crate) fn receive(&mut self, now: u64, connector: usize, frame: &CanFrame, start_ns: u64) {
        if let Some((_, channel, counters)) = self.channel_at_mut(connector) {
            channel.controller.receive(frame, start_ns, now, counters);
        }
    }

    /// The bus reports error state and error counters of the controller at a connector. Returns the emergency that
    /// follows.
    pub(super) fn set_bus_state(
        &mut self,
        connector: usize,
        state: ErrorState,
        tec: u16,
        rec: u16,
    ) -> Option<Emergency> {
        let (number, channel, counters) = self.channel_at_mut(connector)?;
        let was_bus_off = channel.controller.is_bus_off();
        channel.bus_state(state, tec, rec, counters);
        match (was_bus_off, channel.controller.is_bus_off()) {
            (false, true) => Some(Emergency::bus_off(number)),
            (true, false) => Some(Emergency::bus_off_recovered(number)),
            _ => None,
        }
    }

    /// The controller at a connector detected errors on the bus.
    pub(super) fn note_bus_errors(&mut self, connector: usize, counted: u64, last: DetectedError) {
        if let Some((_, channel, _)) = self.channel_at_mut(connector) {
            channel.controller.note_errors(counted, last);
        }
    }
}

#[cfg(test)]
mod tests {
    use ecan_protocol::config::ProfileStatus;

    use super::*;

    const APPLY_STATUS: u8 = channel_control::subindex::APPLY_STATUS;

    fn application() -> Application {
        Application::new(&GatewayModelConfig::default(), 1)
    }

    #[test]
    fn missing_profiles_are_applied_outside_op_only() {
        let mut application = application();
        for direction in Direction::ALL {
            application.objects.values.set(direction.profile_object(), 3, 24);
        }
        application.apply_missing_profiles(AlState::Op);
        assert!(application.data_path.options.of(Direction::TxPdo).active.is_none());
        let status = application.data_path.options.of(Direction::TxPdo).readback(2);
        assert_eq!(status, Some(u32::from(ProfileStatus::InvalidState.raw())));
        application.apply_missing_profiles(AlState::PreOp);
        for direction in Direction::ALL {
            assert_eq!(application.data_path.options.of(direction).active_bytes(), 3072);
        }
    }

    #[test]
    fn pin_rotation_is_rejected_in_op() {
        let mut application = application();
        application.objects.values.set(SYSTEM, 12, 1);
        application.rotate_pins(AlState::Op);
        assert_eq!(application.objects.values.get(SYSTEM, 15), 1);
        assert_eq!(application.pins.channel_at(0), Some(0));
        application.rotate_pins(AlState::PreOp);
        assert_eq!(application.objects.values.get(SYSTEM, 15), 0);
        assert_eq!(application.pins.channel_at(0), Some(3));
    }

    #[test]
    fn invalid_policy_is_reported_and_not_activated() {
        let mut application = application();
        let before = application.data_path.channels[0].policy;
        application.objects.values.set(FIRST_DATA_PATH, 5, 0xFF);
        application.apply_data_path(0);
        assert_eq!(application.objects.values.get(FIRST_DATA_PATH, DATA_PATH_STATUS), 1);
        assert_eq!(application.data_path.channels[0].policy, before);
    }

    #[test]
    fn saved_running_channel_runs_after_the_restore() {
        let mut application = application();
        assert_eq!(application.apply_channel(1, AlState::PreOp), ApplyStatus::Ok);
        let image = application.configuration();
        application.reset();
        application.load_at_start(&image, AlState::Init);
        let running = application.data_path.channels.iter();
        let running: Vec<_> = running.map(|channel| channel.controller.config.is_some()).collect();
        assert_eq!(running, [false, true, false, false]);
        assert_eq!(application.objects.values.get(FIRST_CHANNEL_OBJECT + 1, APPLY_STATUS), 0);
    }
}
