//! The slave as the EtherCAT master sees it: AL state, sync managers, process data, clock and
//! emergencies.

use ecan_protocol::device::{AlState, AlStatusCode};
use ecan_protocol::mapping::Direction;

use super::al_state::{AlStateMachine, Requirement, Watchdog};
use super::application::Application;
use super::config::{GatewayModelConfig, Sync0, SyncManagerConfig};
use super::data_path::{DataPath, ServiceTimes};
use super::dc_clock::{DistributedClock, OutputTiming, PulseTrain, ServiceTimer};
use super::diagnostics::{Emergency, EmergencyQueue};
use super::fault::PendingFaults;
use super::firmware_update::FirmwareUpdate;
use super::sync_managers::SyncManagers;
use super::variant::{
    AssignActivate, Emergencies, ProcessDataWatchdog, SafeOpInputs, SafeOpOutputs,
};

/// The firmware behind the slave controller, at a time.
pub(crate) struct Firmware<'a> {
    pub(super) config: &'a GatewayModelConfig,
    pub(super) now: u64,
    pub(super) application: &'a mut Application,
    pub(super) update: &'a mut FirmwareUpdate,
    pub(super) faults: &'a mut PendingFaults,
}

impl Firmware<'_> {
    /// Returns whether the response of the last transfer gets lost, by a fault.
    pub(crate) fn take_lost_response(&mut self) -> bool {
        self.faults.take_lost_response()
    }

    /// Counts a read of SM3 that the slave controller rejects.
    pub(crate) fn count_rejected_read(&mut self) {
        self.application.data_path.counters.reads_rejected += 1;
    }
}

/// Slave controller of a gateway with its distributed clock, and the services that it triggers. Without supply and
/// while the firmware boots its state is INIT.
#[derive(Clone, Debug)]
pub(crate) struct EthercatSide {
    al: AlStateMachine,
    sync_managers: SyncManagers,
    watchdog: Watchdog,
    clock: DistributedClock,
    services: ServiceTimer,
    output_timing: OutputTiming,
    emergencies: EmergencyQueue,
}

impl EthercatSide {
    pub(super) fn new(config: &GatewayModelConfig, seed: u64) -> Self {
        Self {
            al: AlStateMachine::new(),
            sync_managers: SyncManagers::new(),
            watchdog: Watchdog::new(),
            clock: DistributedClock::new(config.clock_drift_ppb),
            services: ServiceTimer::new(config, seed),
            output_timing: OutputTiming::new(config.sync0_window),
            emergencies: EmergencyQueue::new(),
        }
    }

    /// Loses what does not survive a loss of supply or a reboot.
    pub(super) fn reset(&mut self, config: &GatewayModelConfig) {
        self.al = AlStateMachine::new();
        self.sync_managers.reset();
        self.watchdog = Watchdog::new();
        self.clock = DistributedClock::new(config.clock_drift_ppb);
        self.services.cancel();
        self.output_timing.restart();
        self.emergencies.waiting.clear();
    }

    /// The master writes AL control. A request also acknowledges a pending error. A request that
    /// cannot be met leaves the state and raises the error indication with its AL status code. With
    /// Sync0 configured, OP is entered with the first pulse; see [`Gateway::al_state`](super::Gateway::al_state).
    pub(super) fn request_al_state(&mut self, state: AlState, firmware: &mut Firmware<'_>) {
        self.al.acknowledge();
        match self.meet_requirement(state, firmware) {
            Ok(()) if self.must_await_sync(state, firmware.now) => {
                self.al.awaiting_sync_since = Some(firmware.now)
            }
            Ok(()) => self.enter(state, firmware),
            Err(code) => self.al.fail(code),
        }
    }

    pub(crate) fn reject_unknown_al_state(&mut self) {
        self.al.fail(AlStatusCode::UNKNOWN_STATE);
    }

    pub(super) fn al(&self) -> &AlStateMachine {
        &self.al
    }

    fn meet_requirement(
        &mut self,
        to: AlState,
        firmware: &mut Firmware<'_>,
    ) -> Result<(), AlStatusCode> {
        match self.al.requirement(to)? {
            Requirement::Nothing => Ok(()),
            Requirement::Mailboxes(error) => {
                self.sync_managers.are_mailboxes_valid().then_some(()).ok_or(error)
            }
            Requirement::Profiles => {
                self.check_clock_configuration(firmware.config)?;
                firmware.application.apply_missing_profiles(self.al.state);
                firmware.application.check_process_data(&self.sync_managers)
            }
            Requirement::ProcessDataAndSync => {
                firmware.application.check_process_data(&self.sync_managers)
            }
        }
    }

    fn check_clock_configuration(&self, config: &GatewayModelConfig) -> Result<(), AlStatusCode> {
        let needs_sync1 = config.variant.assign_activate == AssignActivate::Sync0AndSync1;
        match needs_sync1 && self.clock.sync0.is_some() && !self.clock.has_sync1 {
            true => Err(AlStatusCode::DC_CONFIGURATION),
            false => Ok(()),
        }
    }

    fn must_await_sync(&self, to: AlState, now: u64) -> bool {
        self.al.requirement(to) == Ok(Requirement::ProcessDataAndSync)
            && self.clock.pulses.is_some_and(|pulses| pulses.pulses_until(now) == 0)
    }

    /// When the wait for the first pulse ends, with the pulse or by timeout.
    pub(super) fn awaited_sync(&self, config: &GatewayModelConfig) -> Option<u64> {
        let since = self.al.awaiting_sync_since?;
        let timeout = since.saturating_add(config.sync_wait_ns);
        let first = self.clock.pulses.map_or(since, PulseTrain::first_ns);
        Some(first.min(timeout))
    }

    pub(super) fn finish_awaiting_sync(&mut self, firmware: &mut Firmware<'_>) {
        self.al.awaiting_sync_since = None;
        let pulses = self.clock.pulses;
        if pulses.is_none_or(|pulses| pulses.pulses_until(firmware.now) > 0) {
            self.enter(AlState::Op, firmware);
        } else {
            self.al.fail(AlStatusCode::NO_SYNC);
        }
    }

    fn enter(&mut self, state: AlState, firmware: &mut Firmware<'_>) {
        let change = self.al.enter(state);
        if change.leaves_op() {
            firmware.application.data_path.stop_outputs();
            self.output_timing.restart();
            self.services.restart_idle(firmware.now);
        }
        if change.stops_mailbox() {
            self.sync_managers.mailbox_stops = self.sync_managers.mailbox_stops.wrapping_add(1);
        }
        if change.starts_process_data() {
            self.sync_managers.empty_process_data();
            firmware.application.data_path.start_inputs();
            self.services.last = firmware.now;
            self.services.restart_idle(firmware.now);
            self.publish_inputs(firmware);
        } else if change.stops_process_data() {
            self.sync_managers.stop_process_data();
            self.services.cancel();
        }
        match state {
            AlState::Op => {
                self.watchdog.fed_at = firmware.now;
                if firmware.config.variant.safeop_outputs == SafeOpOutputs::Kept {
                    self.sync_managers.outputs.empty();
                }
            }
            AlState::Init => {
                self.emergencies.waiting.clear();
                // without a mailbox a file transfer cannot continue
                firmware.update.abandon();
            }
            _ => {}
        }
    }

    /// The slave leaves OP (a lower state is kept) with an error.
    pub(super) fn fall_back(&mut self, code: AlStatusCode, firmware: &mut Firmware<'_>) {
        self.al.awaiting_sync_since = None;
        if self.al.is_op() {
            self.fall_to(AlState::SafeOp, code, firmware);
        } else {
            self.raise_al_error(code, firmware);
        }
    }

    fn fall_to(&mut self, state: AlState, code: AlStatusCode, firmware: &mut Firmware<'_>) {
        if self.al.is_op() {
            firmware.application.data_path.counters.al_errors += 1;
        }
        self.enter(state, firmware);
        self.raise_al_error(code, firmware);
    }

    fn raise_al_error(&mut self, code: AlStatusCode, firmware: &mut Firmware<'_>) {
        self.al.fail(code);
        self.raise_emergency(Emergency::al_error(code), firmware.config);
    }

    /// Configures a sync manager, 0 to 3, or disables it (`None`). Others are ignored. In SAFEOP
    /// and OP, one that no longer fits makes the slave fall back to PREOP.
    pub(super) fn configure_sync_manager(
        &mut self,
        sm: u8,
        config: Option<SyncManagerConfig>,
        firmware: &mut Firmware<'_>,
    ) {
        let config = config.filter(|config| config.length > 0);
        let changed = self.sync_managers.configure(sm, config);
        if changed
            && self.al.exchanges_process_data()
            && let Err(code) = firmware.application.check_process_data(&self.sync_managers)
        {
            self.fall_to(AlState::PreOp, code, firmware);
        }
    }

    /// Configuration of a sync manager.
    pub(super) fn sync_manager(&self, sm: u8) -> Option<SyncManagerConfig> {
        self.sync_managers.config(sm)
    }

    /// Changes when the contents of the mailboxes become void.
    pub(crate) fn mailbox_stops(&self) -> u32 {
        self.sync_managers.mailbox_stops
    }

    /// Changes when a partial access to process data becomes void.
    pub(crate) fn process_data_stops(&self) -> u32 {
        self.sync_managers.process_data_stops
    }

    pub(crate) fn input_image(&self) -> &[u8] {
        self.sync_managers.inputs.image()
    }

    pub(crate) fn exchanges_process_data(&self) -> bool {
        self.al.exchanges_process_data()
    }

    /// Returns whether SM2 holds a write that the firmware has not read yet.
    pub(super) fn outputs_full(&self) -> bool {
        self.sync_managers.outputs.is_full()
    }

    /// Returns whether SM3 holds an image for the master to read.
    pub(super) fn inputs_full(&self) -> bool {
        self.sync_managers.inputs.is_full()
    }

    /// A complete write to SM2. Against the Sync0 pulses counts `arrival`, the time at which the frame has passed
    /// the slave: a front end may exchange process data when the master sends them.
    pub(crate) fn write_outputs(
        &mut self,
        arrival: u64,
        data: &[u8],
        firmware: &mut Firmware<'_>,
    ) -> bool {
        let is_written = self.exchanges_process_data() && self.sync_managers.outputs.write(data);
        if !is_written {
            self.reject_outputs(arrival, firmware);
            return false;
        }
        let DataPath { counters, performance, .. } = &mut firmware.application.data_path;
        counters.images_written += 1;
        performance.pdi_interrupt(arrival, self.clock.pulses, true);
        self.watchdog.feed(firmware.now);
        self.services.outputs_written(firmware.now, arrival);
        if self.al.is_op() && self.output_timing.outputs_written(self.clock.pulses, arrival) {
            counters.outputs_missed += 1;
            self.check_output_timing(firmware);
        }
        true
    }

    /// Outputs for SM2 were rejected.
    pub(crate) fn reject_outputs(&mut self, arrival: u64, firmware: &mut Firmware<'_>) {
        firmware.application.data_path.counters.writes_rejected += 1;
        if !self.al.is_op() || !self.sync_managers.outputs.is_full() {
            return;
        }
        if self.output_timing.write_rejected(self.clock.pulses, arrival) {
            self.services.retry(firmware.now);
        }
        self.check_output_timing(firmware);
    }

    fn check_output_timing(&mut self, firmware: &mut Firmware<'_>) {
        if let Some(code) = self.output_timing.error() {
            self.fall_back(code, firmware);
        }
    }

    /// A complete read of SM3.
    pub(super) fn read_inputs(&mut self, out: &mut [u8], firmware: &mut Firmware<'_>) -> bool {
        if !self.exchanges_process_data() || !self.sync_managers.inputs.read(out) {
            firmware.application.data_path.counters.reads_rejected += 1;
            return false;
        }
        self.inputs_were_read(firmware);
        true
    }

    /// The master has read SM3 to its last byte.
    pub(crate) fn inputs_were_read(&mut self, firmware: &mut Firmware<'_>) {
        let is_publish_due = self.sync_managers.finish_read();
        let DataPath { counters, performance, .. } = &mut firmware.application.data_path;
        counters.images_read += 1;
        performance.pdi_interrupt(firmware.now, self.clock.pulses, false);
        if is_publish_due {
            self.publish_inputs(firmware);
        }
    }

    pub(crate) fn begin_partial_read(&mut self) {
        self.sync_managers.is_reading_inputs = true;
    }

    /// Sets the process data watchdog, in nanoseconds; 0 disables it.
    pub(super) fn set_watchdog_ns(&mut self, watchdog_ns: u64, config: &GatewayModelConfig) {
        if config.variant.watchdog == ProcessDataWatchdog::Configured {
            self.watchdog.timeout_ns = watchdog_ns;
        }
    }

    pub(super) fn watchdog_expiry(&self, config: &GatewayModelConfig) -> Option<u64> {
        let runs = self.al.is_op()
            && self.sync_managers.outputs.feeds_watchdog()
            && config.variant.watchdog != ProcessDataWatchdog::Absent;
        self.watchdog.expiry().filter(|_| runs)
    }

    pub(super) fn expire_watchdog(&mut self, firmware: &mut Firmware<'_>) {
        self.watchdog.expire();
        self.fall_back(AlStatusCode::SM_WATCHDOG, firmware);
    }

    pub(crate) fn watchdog_expirations(&self) -> u32 {
        self.watchdog.expirations
    }

    pub(crate) fn watchdog_has_expired(&self) -> bool {
        self.watchdog.is_expired
    }

    pub(super) fn clock(&self) -> &DistributedClock {
        &self.clock
    }

    pub(super) fn clock_mut(&mut self) -> &mut DistributedClock {
        &mut self.clock
    }

    /// The master restarts the control loop of the clock (0x0930).
    pub(crate) fn restart_dc_control(&mut self, now: u64) {
        self.clock.change(now, |clock| clock.restart_control(now));
    }

    /// The Sync0 pulses, while Sync0 is active.
    pub(super) fn pulses(&self) -> Option<PulseTrain> {
        self.clock.pulses
    }

    /// Starts Sync0, changes it, or stops it (`None`). A stop in OP is a fatal sync error (0x002C).
    /// Frames scheduled for the previous pulses are dropped.
    pub(super) fn set_dc_sync0(&mut self, sync0: Option<Sync0>, firmware: &mut Firmware<'_>) {
        if sync0 == self.clock.sync0 {
            return;
        }
        self.clock.set_sync0(sync0, firmware.now);
        self.output_timing.restart();
        firmware.application.data_path.sync0_changed();
        if sync0.is_none() && self.al.is_op() {
            self.fall_back(AlStatusCode::FATAL_SYNC, firmware);
        }
    }

    /// End of the longest permitted sequence of pulses without outputs, if it is limited.
    pub(super) fn missed_sync_expiry(&self, config: &GatewayModelConfig) -> Option<u64> {
        let pulses = self.clock.pulses?;
        let limit = u64::from(config.missed_sync_limit);
        (self.al.is_op() && limit > 0).then(|| {
            pulses
                .next_after(self.watchdog.fed_at)
                .saturating_add(limit.saturating_mul(pulses.cycle_ns()))
        })
    }

    /// Time of the distributed clock, whether written by the master or not, in nanoseconds.
    pub(crate) fn dc_time(&self, now: u64) -> u64 {
        self.clock.clock.line.system(now)
    }

    /// The next Sync0 pulse in the system time of the slave; `None` without Sync0.
    pub(crate) fn next_sync0_system_time(&self, now: u64) -> Option<u64> {
        self.clock.pulses.and_then(|pulses| pulses.next_system_after(now))
    }

    /// Queues an emergency if the mailbox is active. Does not allocate.
    pub(super) fn raise_emergency(&mut self, emergency: Emergency, config: &GatewayModelConfig) {
        let is_sent = config.variant.emergencies == Emergencies::Sent;
        if is_sent && self.al.state.has_mailbox() {
            self.emergencies.push(emergency);
        }
    }

    pub(crate) fn has_emergency(&self) -> bool {
        !self.emergencies.waiting.is_empty()
    }

    pub(crate) fn take_emergency(&mut self) -> Option<Emergency> {
        self.emergencies.waiting.pop_front()
    }

    pub(super) fn idle_service_time(&self) -> Option<u64> {
        let is_timed =
            self.al.state == AlState::SafeOp || (self.al.is_op() && self.services.is_free_running);
        is_timed.then(|| self.services.idle_due())
    }

    /// Runs the data path: outputs in SM2 go to the CAN side, and inputs to SM3.
    fn serve(&mut self, firmware: &mut Firmware<'_>) {
        let is_op = self.al.is_op();
        let times = ServiceTimes {
            now: firmware.now,
            outputs_at: self.services.outputs_at,
            pulses: self.clock.pulses,
        };
        let Self { sync_managers, output_timing, .. } = self;
        let data_path = &mut firmware.application.data_path;
        data_path.counters.services += 1;
        if sync_managers.outputs.is_full() && !output_timing.is_image_missed {
            let image = sync_managers.outputs.image();
            data_path.performance.outputs_read(image.len());
            if is_op {
                data_path.take_image(image, &times);
            }
            if is_op || firmware.config.variant.safeop_outputs == SafeOpOutputs::Discarded {
                sync_managers.outputs.empty();
            }
        }
        data_path.serve(is_op);
        if sync_managers.can_publish(firmware.config.publishes_after_read) {
            self.publish_inputs(firmware);
        }
        self.services.last = firmware.now;
    }

    /// Builds a TxPDO image and publishes it in SM3, which must be empty.
    fn publish_inputs(&mut self, firmware: &mut Firmware<'_>) {
        if !self.al.is_op() && firmware.config.variant.safeop_inputs == SafeOpInputs::Absent {
            return;
        }
        let Self { sync_managers, services, .. } = self;
        let Firmware { application, faults, .. } = firmware;
        let inputs = &mut sync_managers.inputs;
        let length = inputs.length().unwrap_or(0);
        if let Some(image) = application.data_path.build_inputs(length, services.last, faults) {
            inputs.publish(image);
        }
    }

    /// Runs the service that is due after outputs, at a retry or in the idle loop.
    pub(super) fn run_service(&mut self, is_idle: bool, firmware: &mut Firmware<'_>) {
        if is_idle {
            self.services.restart_idle(firmware.now);
        } else {
            self.services.cancel();
        }
        self.serve(firmware);
    }

    pub(super) fn service_due(&self) -> Option<u64> {
        self.services.due()
    }

    /// Stops all services for a time, by a fault.
    pub(super) fn stall_services(&mut self, until: u64) {
        self.services.stalled_until = until;
    }

    /// The memory of the process data sync manager of a direction.
    pub(super) fn process_data_memory(&self, direction: Direction) -> &[u8] {
        match direction {
            Direction::TxPdo => self.sync_managers.inputs.memory(),
            Direction::RxPdo => self.sync_managers.outputs.memory(),
        }
    }

    /// Writes into the memory of SM2, which sends nothing without a complete write.
    pub(super) fn store_output(&mut self, offset: usize, data: &[u8]) {
        self.sync_managers.outputs.store_at(offset, data);
    }
}
