//! Firmware model of one ECAN-Lite gateway.
//!
//! A [`Gateway`] has no Ethernet frames: a front end (a simulated libethercat, or a slave controller
//! on the wire) passes AL requests, mailbox transfers and complete sync manager accesses, and the
//! world connects its four channels to CAN buses. The caller passes the time, in simulated
//! nanoseconds; it must not run backwards. Equal calls with an equal seed give equal results.
//!
//! "A cycle" of the budgets of 0x8021..0x8024 is an assumption of this model: one data-path service
//! per complete SM2 write, `service_delay_ns` after it, and in SAFEOP one more per
//! `idle_service_ns`. A service parses the image, hands frames from the TX rings to the controllers,
//! drains the controllers into the RX caches, and builds the next TxPDO if SM3 is empty. Nothing in
//! it allocates.
//!
//! Points that the manual leaves open are switches, declared in [`variant`].
//!
//! The parts: [`AlStateMachine`], [`SyncManagers`], [`Watchdog`] and [`DistributedClock`] are the
//! slave controller; [`Application`] is the firmware with its objects and its data path;
//! [`ConfigurationStore`], [`FirmwareUpdate`] and [`Eeprom`] survive power loss. Accesses come in by
//! `ethercat_side`, `sdo_access`, `files` and `can_side`.

mod al_state;
mod application;
mod board;
mod can_side;
mod channel;
mod channel_control;
mod complete_access;
mod config;
mod configuration_store;
mod controller;
mod data_path;
mod dc_clock;
mod diagnostics;
mod ethercat_side;
mod fault;
mod files;
mod firmware_update;
mod maintenance;
mod message_ram;
mod object_server;
mod pdo;
mod profile_control;
mod receive_path;
mod register_service;
mod sdo_access;
mod service_timer;
mod sync_managers;
mod transmit_path;
pub mod variant;

use ecan_protocol::device::{AlState, AlStatusCode};
use ecan_protocol::mapping::CHANNELS;

use crate::event_queue::earliest;

use al_state::AlStateMachine;
use al_state::Watchdog;
use application::Application;
use board::Eeprom;
use board::PowerSupply;
use configuration_store::ConfigurationStore;
use data_path::ServiceTimes;
use dc_clock::DistributedClock;
use dc_clock::OutputTiming;
use diagnostics::EmergencyQueue;
use fault::PendingFaults;
use firmware_update::FirmwareUpdate;
use maintenance::Maintenance;
use service_timer::ServiceTimer;
use sync_managers::SyncManagers;
use variant::{ChannelsAtStart, SafeOpInputs, SafeOpOutputs};

pub(crate) use config::MAILBOXES;
pub use config::{GatewayModelConfig, Sync0, Sync0Window, SyncManagerConfig};
pub(crate) use diagnostics::Emergency;
pub use diagnostics::{GatewayCounters, ReceiveLosses, TransmitLosses};
pub use fault::GatewayFault;
pub use firmware_update::{FirmwarePackage, FirmwarePackageError};
pub use firmware_update::{FirmwareProgress, FirmwareUpdateError};
pub(crate) use sdo_access::DEVICE_NAME;

const NS_PER_MS: u64 = 1_000_000;

/// One simulated gateway.
#[derive(Clone, Debug)]
pub struct Gateway {
    config: GatewayModelConfig,
    now: u64,
    power: PowerSupply,
    al: AlStateMachine,
    sync_managers: SyncManagers,
    watchdog: Watchdog,
    clock: DistributedClock,
    services: ServiceTimer,
    output_timing: OutputTiming,
    application: Application,
    maintenance: Maintenance,
    emergencies: EmergencyQueue,
    store: ConfigurationStore,
    eeprom: Eeprom,
    firmware: FirmwareUpdate,
    faults: PendingFaults,
    /// Events so far that no call asked for; a caller compares it to notice changes.
    pub(crate) acts: u64,
}

impl Gateway {
    /// A gateway without supply. `seed` determines all random behaviour
    /// ([`GatewayModelConfig::service_jitter_ns`]).
    #[must_use]
    pub fn new(config: GatewayModelConfig, seed: u64) -> Self {
        let mut gateway = Self {
            now: 0,
            power: PowerSupply::new(config.boot_ms, config.reboot_delay_ms),
            al: AlStateMachine::new(),
            sync_managers: SyncManagers::new(),
            watchdog: Watchdog::new(),
            clock: DistributedClock::new(config.clock_drift_ppb),
            services: ServiceTimer::new(&config, seed),
            output_timing: OutputTiming::new(config.sync0_window),
            application: Application::new(&config, seed),
            maintenance: Maintenance::new(&config.variant),
            emergencies: EmergencyQueue::new(),
            store: ConfigurationStore::default(),
            eeprom: Eeprom::default(),
            firmware: FirmwareUpdate::new(config.firmware),
            faults: PendingFaults::default(),
            acts: 0,
            config,
        };
        gateway.lose_volatile_state();
        gateway
    }

    /// Configuration of the model.
    #[must_use]
    pub fn config(&self) -> &GatewayModelConfig {
        &self.config
    }

    /// Counters of the events inside the gateway.
    #[must_use]
    pub fn counters(&self) -> &GatewayCounters {
        &self.application.data_path.counters
    }

    /// Switches the supply. Off: nothing responds and all volatile state is lost. On: the firmware
    /// boots for [`GatewayModelConfig::boot_ms`] and then responds in INIT. Switching on a gateway
    /// that is on does nothing.
    pub fn power(&mut self, now: u64, on: bool) {
        self.advance(now);
        if on && self.power.is_off() {
            self.boot();
        } else if !on {
            self.lose_volatile_state();
            self.power.switch_off();
        }
    }

    /// Returns whether the gateway has its supply; it may still boot.
    #[must_use]
    pub fn is_powered(&self) -> bool {
        !self.power.is_off()
    }

    /// Returns whether the slave controller responds to EtherCAT frames.
    #[must_use]
    pub fn is_responding(&self) -> bool {
        self.power.is_running()
    }

    /// The next time at which the gateway acts without a call.
    #[must_use]
    pub fn next_event(&self) -> Option<u64> {
        if !self.power.is_running() {
            return self.power.boot_end();
        }
        earliest([
            self.services.due(),
            self.idle_service_time(),
            self.watchdog_expiry(),
            self.missed_sync_expiry(),
            self.awaited_sync(),
            self.application.data_path.release_time(),
            self.maintenance.mode_ends,
            self.store.done_at(),
            self.firmware.reset_at,
            self.power.reboot_at,
        ])
    }

    /// Executes everything that is due up to `now`, each event at its time.
    pub fn advance(&mut self, now: u64) {
        while let Some(due) = self.next_event().filter(|&due| due <= now) {
            self.now = self.now.max(due);
            self.act();
        }
        self.now = self.now.max(now);
    }

    fn act(&mut self) {
        self.acts += 1;
        let now = self.now;
        let due = |time: Option<u64>| time.is_some_and(|time| time <= now);
        if !self.power.is_running() {
            if due(self.power.boot_end()) {
                self.start_firmware();
            }
        } else if due(self.application.data_path.release_time()) {
            self.application.data_path.release_scheduled(now);
        } else if due(self.services.due()) {
            self.services.cancel();
            self.serve();
        } else if due(self.idle_service_time()) {
            self.services.restart_idle(now);
            self.serve();
        } else if due(self.awaited_sync()) {
            self.finish_awaiting_sync();
        } else if due(self.watchdog_expiry()) {
            self.watchdog.expire();
            self.fall_back(AlStatusCode::SM_WATCHDOG);
        } else if due(self.missed_sync_expiry()) {
            self.fall_back(AlStatusCode::FATAL_SYNC);
        } else if due(self.store.done_at()) {
            self.finish_store_command();
        } else if due(self.power.reboot_at) || due(self.firmware.reset_at) {
            self.boot();
        } else {
            self.maintenance.expire(now);
        }
    }

    fn idle_service_time(&self) -> Option<u64> {
        let is_timed =
            self.al.state == AlState::SafeOp || (self.al.is_op() && self.services.is_free_running);
        is_timed.then(|| self.services.idle_due())
    }

    fn boot(&mut self) {
        self.lose_volatile_state();
        self.power.boot(self.now);
    }

    /// The boot is complete: the marked firmware starts with the saved configuration.
    fn start_firmware(&mut self) {
        self.power.finish_boot();
        self.firmware.start();
        self.eeprom.start();
        if let Some(image) = self.store.saved() {
            self.application.load_at_start(&image, self.al.state);
        } else if self.config.variant.channels_at_start == ChannelsAtStart::Active {
            (0..CHANNELS).for_each(|channel| self.application.start_channel(channel));
        }
    }

    fn lose_volatile_state(&mut self) {
        self.application.reset();
        self.al = AlStateMachine::new();
        self.sync_managers.reset();
        self.watchdog = Watchdog::new();
        self.clock = DistributedClock::new(self.config.clock_drift_ppb);
        self.services.cancel();
        self.output_timing.restart();
        self.maintenance = Maintenance::new(&self.config.variant);
        self.store.cancel();
        self.firmware.stop();
        self.emergencies.waiting.clear();
    }

    fn serve(&mut self) {
        let is_op = self.al.is_op();
        let times = ServiceTimes {
            now: self.now,
            outputs_at: self.services.outputs_at,
            pulses: self.clock.pulses,
        };
        let Self {
            sync_managers, output_timing, application: Application { data_path, .. }, ..
        } = self;
        data_path.counters.services += 1;
        if sync_managers.outputs.is_full() && !output_timing.is_image_missed {
            let image = sync_managers.outputs.image();
            data_path.performance.outputs_read(image.len());
            if is_op {
                data_path.take_image(image, &times);
            }
            if is_op || self.config.variant.safeop_outputs == SafeOpOutputs::Discarded {
                sync_managers.outputs.empty();
            }
        }
        data_path.serve(is_op);
        if sync_managers.can_publish(self.config.publishes_after_read) {
            self.publish_inputs();
        }
        self.services.last = self.now;
    }

    /// Builds a TxPDO image and publishes it in SM3, which must be empty.
    fn publish_inputs(&mut self) {
        if !self.al.is_op() && self.config.variant.safeop_inputs == SafeOpInputs::Absent {
            return;
        }
        let Self { sync_managers, application, faults, services, .. } = self;
        let inputs = &mut sync_managers.inputs;
        let length = inputs.length().unwrap_or(0);
        if let Some(image) = application.data_path.build_inputs(length, services.last, faults) {
            inputs.publish(image);
        }
    }
}
