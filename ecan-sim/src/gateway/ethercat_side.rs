//! The slave as the EtherCAT master sees it: AL state, sync managers, process data, clock and
//! emergencies.

use ecan_protocol::device::{AlState, AlStatusCode};

use super::Gateway;
use super::al_state::Requirement;
use super::config::{MAILBOXES, Sync0, SyncManagerConfig};
use super::data_path::DataPath;
use super::dc_clock::PulseTrain;
use super::diagnostics::Emergency;
use super::variant::{AssignActivate, Emergencies, ProcessDataWatchdog, SafeOpOutputs};

impl Gateway {
    /// The master writes AL control. A request also acknowledges a pending error. A request that
    /// cannot be met leaves the state and raises the error indication with its AL status code. With
    /// Sync0 configured, OP is entered with the first pulse; see [`al_state`](Self::al_state).
    pub fn request_al_state(&mut self, now: u64, state: AlState) {
        self.advance(now);
        if !self.is_responding() {
            return;
        }
        self.al.acknowledge();
        match self.meet_requirement(state) {
            Ok(()) if self.must_await_sync(state) => self.al.awaiting_sync_since = Some(self.now),
            Ok(()) => self.enter(state),
            Err(code) => self.al.fail(code),
        }
    }

    pub(crate) fn reject_unknown_al_state(&mut self, now: u64) {
        self.advance(now);
        if self.is_responding() {
            self.al.fail(AlStatusCode::UNKNOWN_STATE);
        }
    }

    /// The present state.
    #[must_use]
    pub fn al_state(&self) -> AlState {
        self.al.state
    }

    /// The error indication, bit 4 of AL status.
    #[must_use]
    pub fn al_error(&self) -> bool {
        self.al.has_error
    }

    /// The AL status code; 0 without an error.
    #[must_use]
    pub fn al_status_code(&self) -> u16 {
        self.al.status_code.0
    }

    fn meet_requirement(&mut self, to: AlState) -> Result<(), AlStatusCode> {
        match self.al.requirement(to)? {
            Requirement::Nothing => Ok(()),
            Requirement::Mailboxes(error) => {
                self.sync_managers.are_mailboxes_valid().then_some(()).ok_or(error)
            }
            Requirement::Profiles => {
                self.check_clock_configuration()?;
                self.application.apply_missing_profiles(self.al.state);
                self.application.check_process_data(&self.sync_managers)
            }
            Requirement::ProcessDataAndSync => {
                self.application.check_process_data(&self.sync_managers)
            }
        }
    }

    fn check_clock_configuration(&self) -> Result<(), AlStatusCode> {
        let needs_sync1 = self.config.variant.assign_activate == AssignActivate::Sync0AndSync1;
        match needs_sync1 && self.clock.sync0.is_some() && !self.clock.has_sync1 {
            true => Err(AlStatusCode::DC_CONFIGURATION),
            false => Ok(()),
        }
    }

    fn must_await_sync(&self, to: AlState) -> bool {
        self.al.requirement(to) == Ok(Requirement::ProcessDataAndSync)
            && self.clock.pulses.is_some_and(|pulses| pulses.pulses_until(self.now) == 0)
    }

    /// When the wait for the first pulse ends, with the pulse or by timeout.
    pub(super) fn awaited_sync(&self) -> Option<u64> {
        let since = self.al.awaiting_sync_since?;
        let timeout = since.saturating_add(self.config.sync_wait_ns);
        let first = self.clock.pulses.map_or(since, PulseTrain::first_ns);
        Some(first.min(timeout))
    }

    pub(super) fn finish_awaiting_sync(&mut self) {
        self.al.awaiting_sync_since = None;
        let pulses = self.clock.pulses;
        if pulses.is_none_or(|pulses| pulses.pulses_until(self.now) > 0) {
            self.enter(AlState::Op);
        } else {
            self.al.fail(AlStatusCode::NO_SYNC);
        }
    }

    fn enter(&mut self, state: AlState) {
        let change = self.al.enter(state);
        if change.leaves_op() {
            self.application.data_path.stop_outputs();
            self.output_timing.restart();
            self.services.restart_idle(self.now);
        }
        if change.stops_mailbox() {
            self.sync_managers.mailbox_stops = self.sync_managers.mailbox_stops.wrapping_add(1);
        }
        if change.starts_process_data() {
            self.sync_managers.empty_process_data();
            self.application.data_path.start_inputs();
            self.services.last = self.now;
            self.services.restart_idle(self.now);
            self.publish_inputs();
        } else if change.stops_process_data() {
            self.sync_managers.stop_process_data();
            self.services.cancel();
        }
        match state {
            AlState::Op => {
                self.watchdog.fed_at = self.now;
                if self.config.variant.safeop_outputs == SafeOpOutputs::Kept {
                    self.sync_managers.outputs.empty();
                }
            }
            AlState::Init => {
                self.emergencies.waiting.clear();
                // without a mailbox a file transfer cannot continue
                self.firmware.abandon();
            }
            _ => {}
        }
    }

    /// The slave leaves OP (a lower state is kept) with an error.
    pub(super) fn fall_back(&mut self, code: AlStatusCode) {
        if !self.is_responding() {
            return;
        }
        self.al.awaiting_sync_since = None;
        if self.al.is_op() {
            self.fall_to(AlState::SafeOp, code);
        } else {
            self.raise_al_error(code);
        }
    }

    fn fall_to(&mut self, state: AlState, code: AlStatusCode) {
        if self.al.is_op() {
            self.application.data_path.counters.al_errors += 1;
        }
        self.enter(state);
        self.raise_al_error(code);
    }

    fn raise_al_error(&mut self, code: AlStatusCode) {
        self.al.fail(code);
        self.raise_emergency(Emergency::al_error(code));
    }

    /// Configures a sync manager, 0 to 3, or disables it (`None`). Others are ignored. In SAFEOP
    /// and OP, one that no longer fits makes the slave fall back to PREOP.
    pub fn configure_sync_manager(&mut self, sm: u8, config: Option<SyncManagerConfig>) {
        let config = config.filter(|config| config.length > 0);
        let changed = self.sync_managers.configure(sm, config);
        if changed
            && self.al.exchanges_process_data()
            && let Err(code) = self.application.check_process_data(&self.sync_managers)
        {
            self.fall_to(AlState::PreOp, code);
        }
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

    pub(crate) fn exchanges_process_data(&self) -> bool {
        self.is_responding() && self.al.exchanges_process_data()
    }

    /// Returns whether SM2 holds a write that the firmware has not read yet.
    #[must_use]
    pub fn outputs_full(&self) -> bool {
        self.sync_managers.outputs.is_full()
    }

    /// Returns whether SM3 holds an image for the master to read.
    #[must_use]
    pub fn inputs_full(&self) -> bool {
        self.sync_managers.inputs.is_full()
    }

    pub(crate) fn input_image(&self) -> &[u8] {
        self.sync_managers.inputs.image()
    }

    /// A complete write to SM2, in its full length. Returns `false` (not counted by the working
    /// counter) outside SAFEOP and OP, with another length, and while the buffer is full.
    ///
    /// In SAFEOP the firmware empties the buffer without parsing it. Does not allocate.
    pub fn write_outputs(&mut self, now: u64, data: &[u8]) -> bool {
        self.write_outputs_arriving(now, now, data)
    }

    /// [`write_outputs`](Self::write_outputs) of a front end that exchanges process data when the
    /// master sends them: against the Sync0 pulses counts `arrival`, the time at which the frame has
    /// passed the slave.
    pub(crate) fn write_outputs_arriving(&mut self, now: u64, arrival: u64, data: &[u8]) -> bool {
        self.advance(now);
        let is_written = self.exchanges_process_data() && self.sync_managers.outputs.write(data);
        if !is_written {
            self.reject_outputs(arrival);
            return false;
        }
        let DataPath { counters, performance, .. } = &mut self.application.data_path;
        counters.images_written += 1;
        performance.pdi_interrupt(arrival, self.clock.pulses, true);
        self.watchdog.feed(self.now);
        self.services.outputs_written(self.now, arrival);
        if self.al.is_op() && self.output_timing.outputs_written(self.clock.pulses, arrival) {
            counters.outputs_missed += 1;
            self.check_output_timing();
        }
        true
    }

    /// Outputs for SM2 were rejected.
    pub(crate) fn reject_outputs(&mut self, arrival: u64) {
        self.application.data_path.counters.writes_rejected += 1;
        if !self.al.is_op() || !self.sync_managers.outputs.is_full() {
            return;
        }
        if self.output_timing.write_rejected(self.clock.pulses, arrival) {
            self.services.retry(self.now);
        }
        self.check_output_timing();
    }

    fn check_output_timing(&mut self) {
        if let Some(code) = self.output_timing.error() {
            self.fall_back(code);
        }
    }

    /// A complete read of SM3, in its full length. Returns `false` (not counted, `out` unchanged)
    /// outside SAFEOP and OP, with another length, and while the buffer is empty. Does not
    /// allocate.
    pub fn read_inputs(&mut self, now: u64, out: &mut [u8]) -> bool {
        self.advance(now);
        if !self.exchanges_process_data() || !self.sync_managers.inputs.read(out) {
            self.application.data_path.counters.reads_rejected += 1;
            return false;
        }
        self.inputs_were_read(now);
        true
    }

    /// The master has read SM3 to its last byte.
    pub(crate) fn inputs_were_read(&mut self, now: u64) {
        self.advance(now);
        let is_publish_due = self.sync_managers.finish_read();
        let DataPath { counters, performance, .. } = &mut self.application.data_path;
        counters.images_read += 1;
        performance.pdi_interrupt(self.now, self.clock.pulses, false);
        if is_publish_due {
            self.publish_inputs();
        }
    }

    pub(crate) fn begin_partial_read(&mut self) {
        self.sync_managers.is_reading_inputs = true;
    }

    pub(crate) fn count_rejected_read(&mut self) {
        self.application.data_path.counters.reads_rejected += 1;
    }

    /// Sets the process data watchdog, in nanoseconds; 0 disables it. It runs in OP while the
    /// control byte of SM2 has the watchdog bit.
    pub fn set_watchdog_ns(&mut self, watchdog_ns: u64) {
        if self.config.variant.watchdog == ProcessDataWatchdog::Configured {
            self.watchdog.timeout_ns = watchdog_ns;
        }
    }

    pub(super) fn watchdog_expiry(&self) -> Option<u64> {
        let runs = self.al.is_op()
            && self.sync_managers.outputs.feeds_watchdog()
            && self.config.variant.watchdog != ProcessDataWatchdog::Absent;
        self.watchdog.expiry().filter(|_| runs)
    }

    pub(crate) fn watchdog_expirations(&self) -> u32 {
        self.watchdog.expirations
    }

    pub(crate) fn watchdog_has_expired(&self) -> bool {
        self.watchdog.is_expired
    }

    /// The master activates Sync1, too, or not. This model has no Sync1 pulses.
    pub fn set_dc_sync1(&mut self, is_active: bool) {
        self.clock.has_sync1 = is_active;
    }

    /// Starts Sync0, changes it, or stops it (`None`). A stop in OP is a fatal sync error (0x002C).
    /// Frames scheduled for the previous pulses are dropped.
    pub fn set_dc_sync0(&mut self, sync0: Option<Sync0>) {
        if sync0 == self.clock.sync0 {
            return;
        }
        self.clock.set_sync0(sync0, self.now);
        self.output_timing.restart();
        self.application.data_path.sync0_changed();
        if sync0.is_none() && self.al.is_op() {
            self.fall_back(AlStatusCode::FATAL_SYNC);
        }
    }

    /// End of the longest permitted sequence of pulses without outputs, if it is limited.
    pub(super) fn missed_sync_expiry(&self) -> Option<u64> {
        let pulses = self.clock.pulses?;
        let limit = u64::from(self.config.missed_sync_limit);
        (self.al.is_op() && limit > 0).then(|| {
            pulses
                .next_after(self.watchdog.fed_at)
                .saturating_add(limit.saturating_mul(pulses.cycle_ns()))
        })
    }

    /// System time of the distributed clock (0x0910); `None` until the master has written it.
    #[must_use]
    pub fn dc_system_time(&self, now: u64) -> Option<u64> {
        self.clock.clock.written_time(now)
    }

    /// Time of the distributed clock, whether written by the master or not, in nanoseconds.
    pub(crate) fn dc_time(&self, now: u64) -> u64 {
        self.clock.clock.line.system(now)
    }

    pub(crate) fn dc_time_since_boot(&self, now: u64) -> u64 {
        self.dc_time(now).saturating_sub(self.dc_time(self.power.booted_at))
    }

    /// Difference found by the last correction of the clock, received time minus own, in
    /// nanoseconds (0x092C).
    #[must_use]
    pub fn dc_difference_ns(&self) -> i64 {
        self.clock.clock.difference_ns
    }

    /// The next Sync0 pulse in simulated time; `None` without Sync0.
    #[must_use]
    pub fn next_sync0(&self, now: u64) -> Option<u64> {
        self.clock.pulses.map(|pulses| pulses.next_after(now))
    }

    /// The next Sync0 pulse in the system time of the slave; `None` without Sync0.
    pub(crate) fn next_sync0_system_time(&self, now: u64) -> Option<u64> {
        self.clock.pulses.and_then(|pulses| pulses.next_system_after(now))
    }

    /// The master sets the time of the clock.
    pub fn write_dc_system_time(&mut self, now: u64, system_ns: u64) {
        self.clock.change(now, |clock| clock.write(system_ns, now));
    }

    /// The master sends the reference time; the clock is corrected towards it.
    pub fn correct_dc_system_time(&mut self, now: u64, system_ns: u64) {
        self.clock.change(now, |clock| clock.correct(system_ns, now));
    }

    /// The master restarts the control loop of the clock (0x0930).
    pub(crate) fn restart_dc_control(&mut self, now: u64) {
        self.clock.change(now, |clock| clock.restart_control(now));
    }

    /// Number of boots; the slave controller is reset with each one.
    pub(crate) fn boots(&self) -> u32 {
        self.power.boots
    }

    /// Queues an emergency if the mailbox is active. Does not allocate.
    pub(super) fn raise_emergency(&mut self, emergency: Emergency) {
        let is_sent = self.config.variant.emergencies == Emergencies::Sent;
        if is_sent && self.is_responding() && self.al.state.has_mailbox() {
            self.emergencies.push(emergency);
        }
    }

    pub(crate) fn has_emergency(&self) -> bool {
        !self.emergencies.waiting.is_empty()
    }

    pub(crate) fn take_emergency(&mut self) -> Option<Emergency> {
        self.emergencies.waiting.pop_front()
    }
}
