//! One simulated gateway: its parts, and the order in which they act.

use ecan_protocol::can::CanFrame;
use ecan_protocol::device::{AlState, AlStatusCode};
use ecan_protocol::object::AbortCode;

use super::application::Application;
use super::config::{Eeprom, GatewayModelConfig, MAILBOXES, PowerSupply, Sync0, SyncManagerConfig};
use super::configuration_store::ConfigurationStore;
use super::diagnostics::GatewayCounters;
use super::ethercat_side::{EthercatSide, Firmware};
use super::fault::PendingFaults;
use super::firmware_update::{FirmwareProgress, FirmwareUpdate, FirmwareUpdateError};
use super::maintenance::Maintenance;
use super::object_access::ObjectAccess;
use super::{NS_PER_MS, object_access};
use crate::bus::{DetectedError, ErrorState, PhysicalLayer, StationConfig};
use crate::event_queue::earliest;
use crate::fault::GatewayFault;

/// One simulated gateway.
#[derive(Clone, Debug)]
pub struct Gateway {
    config: GatewayModelConfig,
    now: u64,
    power: PowerSupply,
    side: EthercatSide,
    application: Application,
    maintenance: Maintenance,
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
            side: EthercatSide::new(&config, seed),
            application: Application::new(&config, seed),
            maintenance: Maintenance::new(&config.variant),
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

    /// The supply of the gateway.
    pub(crate) fn supply(&self) -> &PowerSupply {
        &self.power
    }

    /// The next time at which the gateway acts without a call.
    #[must_use]
    pub fn next_event(&self) -> Option<u64> {
        if !self.power.is_running() {
            return self.power.boot_end();
        }
        earliest([
            self.side.service_due(),
            self.side.idle_service_time(),
            self.side.watchdog_expiry(&self.config),
            self.side.missed_sync_expiry(&self.config),
            self.side.awaited_sync(&self.config),
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
                self.power.finish_boot();
                self.firmware.start();
                self.eeprom.start();
                self.application.start(self.store.saved(), self.side.al().state);
            }
            return;
        }
        let (side, mut firmware) = self.parts();
        let config = firmware.config;
        if due(firmware.application.data_path.release_time()) {
            firmware.application.data_path.release_scheduled(now);
        } else if due(side.service_due()) {
            side.run_service(false, &mut firmware);
        } else if due(side.idle_service_time()) {
            side.run_service(true, &mut firmware);
        } else if due(side.awaited_sync(config)) {
            side.finish_awaiting_sync(&mut firmware);
        } else if due(side.watchdog_expiry(config)) {
            side.expire_watchdog(&mut firmware);
        } else if due(side.missed_sync_expiry(config)) {
            side.fall_back(AlStatusCode::FATAL_SYNC, &mut firmware);
        } else if due(self.store.done_at()) {
            if self.object_access().finish_store_command() {
                self.eeprom.words.clear();
                self.boot();
            }
        } else if due(self.power.reboot_at) || due(self.firmware.reset_at) {
            self.boot();
        } else {
            self.maintenance.expire(now);
        }
    }

    fn boot(&mut self) {
        self.lose_volatile_state();
        self.power.boot(self.now);
    }

    fn lose_volatile_state(&mut self) {
        self.application.reset();
        self.side.reset(&self.config);
        self.maintenance = Maintenance::new(&self.config.variant);
        self.store.cancel();
        self.firmware.stop();
    }

    /// The EtherCAT side and the firmware behind it, without an advance of time.
    pub(crate) fn parts(&mut self) -> (&mut EthercatSide, Firmware<'_>) {
        let Self { config, now, side, application, firmware: update, faults, .. } = self;
        (side, Firmware { config, now: *now, application, update, faults })
    }

    /// Advances to `now` for an access to the EtherCAT side.
    pub(crate) fn ethercat(&mut self, now: u64) -> (&mut EthercatSide, Firmware<'_>) {
        self.advance(now);
        self.parts()
    }

    pub(crate) fn side(&self) -> &EthercatSide {
        &self.side
    }

    fn object_access(&mut self) -> ObjectAccess<'_> {
        let Self {
            config,
            now,
            side,
            power,
            application,
            maintenance,
            store,
            firmware,
            faults,
            ..
        } = self;
        let now = *now;
        ObjectAccess { config, now, side, power, application, maintenance, store, firmware, faults }
    }

    /// Advances to `now` for an access to objects.
    pub(crate) fn objects(&mut self, now: u64) -> ObjectAccess<'_> {
        self.advance(now);
        self.object_access()
    }

    /// The master writes AL control. A request also acknowledges a pending error. A request that
    /// cannot be met leaves the state and raises the error indication with its AL status code. With
    /// Sync0 configured, OP is entered with the first pulse; see [`al_state`](Self::al_state).
    pub fn request_al_state(&mut self, now: u64, state: AlState) {
        self.advance(now);
        if self.is_responding() {
            let (side, mut firmware) = self.ethercat(now);
            side.request_al_state(state, &mut firmware);
        }
    }

    /// The present state.
    #[must_use]
    pub fn al_state(&self) -> AlState {
        self.side.al().state
    }

    /// The error indication, bit 4 of AL status.
    #[must_use]
    pub fn al_error(&self) -> bool {
        self.side.al().has_error
    }

    /// The AL status code; 0 without an error.
    #[must_use]
    pub fn al_status_code(&self) -> u16 {
        self.side.al().status_code.0
    }

    /// Configures a sync manager, 0 to 3, or disables it (`None`). Others are ignored. In SAFEOP
    /// and OP, one that no longer fits makes the slave fall back to PREOP.
    pub fn configure_sync_manager(&mut self, sm: u8, config: Option<SyncManagerConfig>) {
        let (side, mut firmware) = self.parts();
        side.configure_sync_manager(sm, config, &mut firmware);
    }

    /// Configures the mailboxes as the SII specifies.
    pub(crate) fn set_up_mailboxes(&mut self) {
        for (number, config) in (0..).zip(MAILBOXES) {
            self.configure_sync_manager(number, Some(config));
        }
    }

    /// Configuration of a sync manager.
    #[must_use]
    pub fn sync_manager(&self, sm: u8) -> Option<SyncManagerConfig> {
        self.side.sync_manager(sm)
    }

    /// Returns whether SM2 holds a write that the firmware has not read yet.
    #[must_use]
    pub fn outputs_full(&self) -> bool {
        self.side.outputs_full()
    }

    /// Returns whether SM3 holds an image for the master to read.
    #[must_use]
    pub fn inputs_full(&self) -> bool {
        self.side.inputs_full()
    }

    /// A complete write to SM2, in its full length. Returns `false` (not counted by the working
    /// counter) outside SAFEOP and OP, with another length, and while the buffer is full.
    ///
    /// In SAFEOP the firmware empties the buffer without parsing it. Does not allocate.
    pub fn write_outputs(&mut self, now: u64, data: &[u8]) -> bool {
        let (side, mut firmware) = self.ethercat(now);
        side.write_outputs(now, data, &mut firmware)
    }

    /// A complete read of SM3, in its full length. Returns `false` (not counted, `out` unchanged)
    /// outside SAFEOP and OP, with another length, and while the buffer is empty. Does not
    /// allocate.
    pub fn read_inputs(&mut self, now: u64, out: &mut [u8]) -> bool {
        let (side, mut firmware) = self.ethercat(now);
        side.read_inputs(out, &mut firmware)
    }

    /// Sets the process data watchdog, in nanoseconds; 0 disables it. It runs in OP while the
    /// control byte of SM2 has the watchdog bit.
    pub fn set_watchdog_ns(&mut self, watchdog_ns: u64) {
        self.side.set_watchdog_ns(watchdog_ns, &self.config);
    }

    /// The master activates Sync1, too, or not. This model has no Sync1 pulses.
    pub fn set_dc_sync1(&mut self, is_active: bool) {
        self.side.clock_mut().has_sync1 = is_active;
    }

    /// Starts Sync0, changes it, or stops it (`None`). A stop in OP is a fatal sync error (0x002C).
    /// Frames scheduled for the previous pulses are dropped.
    pub fn set_dc_sync0(&mut self, sync0: Option<Sync0>) {
        let (side, mut firmware) = self.parts();
        side.set_dc_sync0(sync0, &mut firmware);
    }

    /// System time of the distributed clock (0x0910); `None` until the master has written it.
    #[must_use]
    pub fn dc_system_time(&self, now: u64) -> Option<u64> {
        self.side.clock().clock.written_time(now)
    }

    /// Difference found by the last correction of the clock, received time minus own, in
    /// nanoseconds (0x092C).
    #[must_use]
    pub fn dc_difference_ns(&self) -> i64 {
        self.side.clock().clock.difference_ns
    }

    /// The next Sync0 pulse in simulated time; `None` without Sync0.
    #[must_use]
    pub fn next_sync0(&self, now: u64) -> Option<u64> {
        self.side.pulses().map(|pulses| pulses.next_after(now))
    }

    /// The master sets the time of the clock.
    pub fn write_dc_system_time(&mut self, now: u64, system_ns: u64) {
        self.side.clock_mut().change(now, |clock| clock.write(system_ns, now));
    }

    /// The master sends the reference time; the clock is corrected towards it.
    pub fn correct_dc_system_time(&mut self, now: u64, system_ns: u64) {
        self.side.clock_mut().change(now, |clock| clock.correct(system_ns, now));
    }

    /// Returns whether the mailbox responds: booted, not in INIT, and not silenced by a fault.
    #[must_use]
    pub fn mailbox_answers(&self, now: u64) -> bool {
        self.is_responding()
            && self.side.al().state.has_mailbox()
            && !self.faults.is_mailbox_silent(now)
    }

    /// SDO upload: replaces the contents of `out` by the bytes of the entry; empty after an error.
    ///
    /// # Errors
    /// The abort code: no such object or subindex, write-only, wrong state, an injected one, or a
    /// timeout while the mailbox does not respond (see [`mailbox_answers`](Self::mailbox_answers)).
    pub fn sdo_upload(
        &mut self,
        now: u64,
        index: u16,
        subindex: u8,
        out: &mut Vec<u8>,
    ) -> Result<(), AbortCode> {
        self.objects(now).upload(index, subindex, out)
    }

    /// SDO download.
    ///
    /// # Errors
    /// The abort code: no such object or subindex, read-only, wrong length, value out of range,
    /// wrong state, an illegal combination, an injected one, or a timeout while the mailbox does
    /// not respond. Nothing has changed then. Values of objects with an apply command are stored
    /// unchecked and checked when applied.
    pub fn sdo_download(
        &mut self,
        now: u64,
        index: u16,
        subindex: u8,
        data: &[u8],
    ) -> Result<(), AbortCode> {
        self.objects(now).download(index, subindex, data)
    }

    /// Text of a string object.
    pub(crate) fn text(&self, index: u16) -> String {
        object_access::text(index, &self.config, &self.firmware)
    }

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

    /// How the controller at a connector (0 to 3) takes part in its bus; `None` while it is
    /// not configured, in INIT by its own register, or without supply.
    #[must_use]
    pub fn station_config(&self, connector: usize) -> Option<StationConfig> {
        self.application.station_config(connector)
    }

    /// Sample points and delays of the controller at a connector; `None` while it is not configured.
    #[must_use]
    pub fn physical_layer(&self, connector: usize) -> Option<PhysicalLayer> {
        self.application.physical_layer(connector)
    }

    /// Changes when [`station_config`](Self::station_config) may have changed or the controller
    /// was restarted.
    #[must_use]
    pub fn station_generation(&self, connector: usize) -> u32 {
        self.application.station_generation(connector)
    }

    /// Takes the next frame that the controller at a connector puts into arbitration; `None`
    /// without one, or while the last one is neither confirmed nor abandoned.
    pub fn next_transmit(&mut self, connector: usize) -> Option<CanFrame> {
        self.application.next_transmit(connector)
    }

    /// Takes a request of the controller at a connector to recover from bus-off.
    pub fn take_recovery_request(&mut self, connector: usize) -> bool {
        self.application.take_recovery_request(connector)
    }

    /// The bus confirms the frame that was taken last.
    pub fn transmitted(&mut self, now: u64, connector: usize, _frame: &CanFrame) {
        self.advance(now);
        self.can_side(now).confirm(connector);
    }

    /// The bus abandoned the frame that was taken last (automatic retransmission is off).
    pub fn abandoned(&mut self, now: u64, connector: usize, _frame: &CanFrame) {
        self.advance(now);
        self.application.abandon(connector);
    }

    /// A frame arrives from the bus, complete at `now`.
    pub fn received(&mut self, now: u64, connector: usize, frame: &CanFrame, start_ns: u64) {
        self.advance(now);
        self.can_side(now).receive(now, connector, frame, start_ns);
    }

    /// The CAN side at a time until which nothing is due.
    pub(crate) fn can_side(&mut self, now: u64) -> &mut Application {
        self.now = self.now.max(now);
        &mut self.application
    }

    /// The bus reports error state and error counters of the controller at a connector.
    pub fn bus_state(&mut self, now: u64, connector: usize, state: ErrorState, tec: u16, rec: u16) {
        self.advance(now);
        if let Some(emergency) = self.application.set_bus_state(connector, state, tec, rec) {
            let (side, firmware) = self.parts();
            side.raise_emergency(emergency, firmware.config);
        }
    }

    /// The controller at a connector detected errors on the bus: the last one, and the number of those
    /// that raised an error counter.
    pub fn bus_errors(&mut self, now: u64, connector: usize, counted: u64, last: DetectedError) {
        self.advance(now);
        self.application.note_bus_errors(connector, counted, last);
    }

    /// Injects a fault.
    pub fn inject(&mut self, now: u64, fault: GatewayFault) {
        self.advance(now);
        let until = |ms: u32| now + u64::from(ms) * NS_PER_MS;
        let faults = &mut self.faults;
        match fault {
            GatewayFault::SdoAbort { index, subindex, code, times } => {
                faults.abort_transfers(index, subindex, code, times);
            }
            GatewayFault::SdoResponseLost { index, subindex, times } => {
                faults.lose_responses(index, subindex, times);
            }
            GatewayFault::TornTxPdo { images } => faults.torn_images.add(images),
            GatewayFault::CrcErrorTxPdo { images } => faults.crc_errors.add(images),
            GatewayFault::FlashFailure { times } => faults.flash_failures.add(times),
            GatewayFault::MailboxSilent { ms } => faults.silence_mailbox(until(ms)),
            GatewayFault::ServiceStall { ms } => self.side.stall_services(until(ms)),
            GatewayFault::AlError { code } => {
                if self.is_responding() {
                    let (side, mut firmware) = self.parts();
                    side.fall_back(AlStatusCode(code), &mut firmware);
                }
            }
            GatewayFault::ClockJump { ns } => {
                self.side.clock_mut().change(now, |clock| clock.jump(ns, now));
            }
        }
    }
}
