//! The EtherCAT state machine: what each transition needs, and what throws the slave back
//! (manual 5.4.6, 14; AL status codes of ETG.1000.6).

use ecan_protocol::device::{AlState, AlStatusCode};
use ecan_protocol::mapping::Direction;

use super::emergency::Emergency;
use super::schedule::PulseTrain;
use super::settings::{MAILBOXES, SmSettings, Sync0};
use super::sync_manager::{is_acceptable, overlap};
use super::{Gateway, maintenance};

/// The shortest mailbox that the services work with.
const SHORTEST_MAILBOX: u16 = 34;
/// Registers end here.
const MEMORY_START: u16 = 0x1000;

/// What lies between a request and its state.
enum Step {
    Done,
    AwaitSync,
}

impl Gateway {
    /// The master writes AL control. A request also acknowledges a pending error; one that
    /// cannot be met leaves the state and raises the error indication with its AL status code.
    /// OP with Sync0 switched on is reached with the first pulse; see [`al_state`](Self::al_state).
    pub fn request_al_state(&mut self, now: u64, state: AlState) {
        self.advance(now);
        if !self.is_responding() {
            return;
        }
        self.error = false;
        self.status_code = AlStatusCode::OK;
        self.awaiting_sync_since = None;
        match self.transition(state) {
            Ok(Step::Done) => self.enter(state),
            Ok(Step::AwaitSync) => self.awaiting_sync_since = Some(self.now),
            Err(code) => {
                self.error = true;
                self.status_code = code;
            }
        }
    }

    /// The present state.
    #[must_use]
    pub fn al_state(&self) -> AlState {
        self.state
    }

    /// The error indication, bit 4 of AL status.
    #[must_use]
    pub fn al_error(&self) -> bool {
        self.error
    }

    /// The AL status code; 0 without an error.
    #[must_use]
    pub fn al_status_code(&self) -> u16 {
        self.status_code.0
    }

    fn transition(&mut self, to: AlState) -> Result<Step, AlStatusCode> {
        use AlState::{Boot, Init, Op, PreOp, SafeOp};
        match (self.state, to) {
            (from, to) if from == to => Ok(Step::Done),
            (Init, PreOp) => {
                self.check_mailboxes(AlStatusCode::MAILBOX_CONFIGURATION)?;
                Ok(Step::Done)
            }
            (Init, Boot) => {
                self.check_mailboxes(AlStatusCode::BOOT_MAILBOX_CONFIGURATION)?;
                Ok(Step::Done)
            }
            (_, Init) | (SafeOp | Op, PreOp) | (Op, SafeOp) => Ok(Step::Done),
            (PreOp, SafeOp) => {
                self.apply_implicit_profiles();
                self.check_process_data()?;
                Ok(Step::Done)
            }
            (SafeOp, Op) => {
                self.check_process_data()?;
                match self.pulses {
                    Some(pulses) if pulses.pulses_until(self.now) == 0 => Ok(Step::AwaitSync),
                    _ => Ok(Step::Done),
                }
            }
            _ => Err(AlStatusCode::INVALID_STATE_CHANGE),
        }
    }

    /// Both mailboxes are single buffers, one in each direction, long enough for the services, in the
    /// memory, and apart.
    fn check_mailboxes(&self, otherwise: AlStatusCode) -> Result<(), AlStatusCode> {
        let is_mailbox = |sm: Option<SmSettings>, written_by_master| {
            sm.is_some_and(|sm| {
                sm.is_single_buffer(written_by_master)
                    && sm.length >= SHORTEST_MAILBOX
                    && sm.start >= MEMORY_START
            })
        };
        let [to_device, from_device] = self.mailboxes;
        let are_good = is_mailbox(to_device, true)
            && is_mailbox(from_device, false)
            && !overlap(to_device, from_device);
        if are_good { Ok(()) } else { Err(otherwise) }
    }

    /// A direction without an active profile gets the requested one at the way to SAFEOP, as
    /// if it had been applied (manual 9.2 calls its defaults "default request").
    fn apply_implicit_profiles(&mut self) {
        for direction in Direction::ALL {
            if self.profile(direction).active().is_none() {
                self.apply_profile(direction);
            }
        }
    }

    /// SM2 and SM3 must be as long as both the assignment and the active profile say.
    fn check_process_data(&self) -> Result<(), AlStatusCode> {
        let fits = |direction, settings| {
            let bytes = self.profile(direction).active_bytes();
            let assigned = self
                .assigned_chunks(direction)
                .map_or(0, |chunks| usize::from(chunks) * ecan_protocol::mapping::CHUNK_BYTES);
            assigned == bytes && is_acceptable(settings, direction, bytes)
        };
        let (outputs, inputs) = (self.outputs.settings(), self.inputs.settings());
        if !fits(Direction::RxPdo, outputs) {
            return Err(AlStatusCode::OUTPUT_CONFIGURATION);
        }
        if !fits(Direction::TxPdo, inputs) || overlap(outputs, inputs) {
            return Err(AlStatusCode::INPUT_CONFIGURATION);
        }
        Ok(())
    }

    fn enter(&mut self, state: AlState) {
        let from = std::mem::replace(&mut self.state, state);
        if from == AlState::Op && state != AlState::Op {
            self.stop_outputs();
        }
        if from.has_mailbox() && !state.has_mailbox() {
            self.mailbox_stops = self.mailbox_stops.wrapping_add(1);
        }
        let runs = |state| matches!(state, AlState::SafeOp | AlState::Op);
        match (runs(from), runs(state)) {
            (false, true) => self.start_inputs(),
            (true, false) => {
                self.outputs.empty();
                self.inputs.empty();
                (self.are_inputs_being_read, self.is_publish_due) = (false, false);
                self.process_data_stops = self.process_data_stops.wrapping_add(1);
                self.service_due = None;
            }
            _ => {}
        }
        match state {
            AlState::Op => self.last_outputs = self.now,
            AlState::Init => {
                self.emergencies.clear();
                // The mailbox is gone, and with it whoever was sending a file.
                self.firmware.abandon();
            }
            _ => {}
        }
    }

    /// Frames that came while nobody could fetch them are old; the first image shows none.
    fn start_inputs(&mut self) {
        self.outputs.empty();
        self.inputs.empty();
        self.results.clear();
        for channel in &mut self.channels {
            channel.flush_receive(&mut self.counters);
        }
        self.last_service = self.now;
        self.plan_idle_service();
        self.publish_inputs();
    }

    /// What still waits to be sent is old when outputs stop.
    fn stop_outputs(&mut self) {
        let mut stale = self.schedule.flush();
        for channel in &mut self.channels {
            stale += channel.transmit.flush();
        }
        self.counters.transmit_losses.stale += stale as u64;
        self.plan_idle_service();
    }

    fn plan_idle_service(&mut self) {
        self.idle_service_at = self.now + self.settings.idle_service_ns.max(1);
    }

    /// The slave itself leaves OP (or stays where it is below) with an error.
    pub(super) fn fall_back(&mut self, code: AlStatusCode) {
        if !self.is_responding() {
            return;
        }
        self.awaiting_sync_since = None;
        if self.state == AlState::Op {
            self.counters.al_errors += 1;
            self.enter(AlState::SafeOp);
        }
        self.error = true;
        self.status_code = code;
        self.raise_emergency(Emergency::al_error(code));
    }

    // Sync managers

    /// The master sets up a sync manager, 0 to 3, or disables it (`None`). Others are ignored.
    /// In SAFEOP and OP, one that no longer fits throws the slave back to PREOP.
    pub fn configure_sync_manager(&mut self, sm: u8, settings: Option<SmSettings>) {
        let settings = settings.filter(|settings| settings.length > 0);
        let before = match sm {
            2 => self.outputs.settings(),
            3 => self.inputs.settings(),
            _ => {
                if let Some(mailbox) = self.mailboxes.get_mut(usize::from(sm)) {
                    *mailbox = settings;
                }
                return;
            }
        };
        if before == settings {
            return;
        }
        match sm {
            2 => self.outputs.configure(settings),
            _ => self.inputs.configure(settings),
        }
        if matches!(self.state, AlState::SafeOp | AlState::Op)
            && let Err(code) = self.check_process_data()
        {
            if self.state == AlState::Op {
                self.counters.al_errors += 1;
            }
            self.enter(AlState::PreOp);
            self.error = true;
            self.status_code = code;
            self.raise_emergency(Emergency::al_error(code));
        }
    }

    /// Sets the mailboxes up as the SII says.
    pub(crate) fn set_up_mailboxes(&mut self) {
        for (number, settings) in (0..).zip(MAILBOXES) {
            self.configure_sync_manager(number, Some(settings));
        }
    }

    /// How a sync manager is set up.
    #[must_use]
    pub fn sync_manager(&self, sm: u8) -> Option<SmSettings> {
        match sm {
            2 => self.outputs.settings(),
            3 => self.inputs.settings(),
            _ => self.mailboxes.get(usize::from(sm)).copied().flatten(),
        }
    }

    /// Whether SM2 holds a write that the firmware has not read yet.
    #[must_use]
    pub fn outputs_full(&self) -> bool {
        self.outputs.is_full()
    }

    /// Whether SM3 holds an image for the master to read.
    #[must_use]
    pub fn inputs_full(&self) -> bool {
        self.inputs.is_full()
    }

    /// A complete write to SM2, all of its length. `false` (not counted by the working
    /// counter) outside SAFEOP and OP, with another length, and while the buffer is full.
    ///
    /// In SAFEOP the firmware takes the bytes out of the buffer unread. Does not allocate.
    pub fn write_outputs(&mut self, now: u64, data: &[u8]) -> bool {
        self.advance(now);
        if !self.exchanges_process_data() || !self.outputs.write(data) {
            self.counters.writes_refused += 1;
            return false;
        }
        self.counters.images_written += 1;
        self.performance.pdi_interrupt(self.now, self.pulses, true);
        self.is_watchdog_expired = false;
        self.last_outputs = self.now;
        self.outputs_at = self.now;
        let jitter = self.draw(self.settings.service_jitter_ns);
        self.service_due = Some(self.now + self.settings.service_delay_ns + jitter);
        true
    }

    /// A complete read of SM3, all of its length. `false` (not counted, `out` unchanged)
    /// outside SAFEOP and OP, with another length, and while the buffer is empty. Does not
    /// allocate.
    pub fn read_inputs(&mut self, now: u64, out: &mut [u8]) -> bool {
        self.advance(now);
        if !self.exchanges_process_data() || !self.inputs.read(out) {
            self.counters.reads_refused += 1;
            return false;
        }
        self.inputs_were_read(now);
        true
    }

    /// SM3 was read to its last byte and is empty now.
    pub(crate) fn inputs_were_read(&mut self, now: u64) {
        self.advance(now);
        self.inputs.empty();
        self.counters.images_read += 1;
        self.performance.pdi_interrupt(self.now, self.pulses, false);
        self.are_inputs_being_read = false;
        if std::mem::take(&mut self.is_publish_due) {
            self.publish_inputs();
        }
    }

    pub(crate) fn exchanges_process_data(&self) -> bool {
        self.is_responding() && matches!(self.state, AlState::SafeOp | AlState::Op)
    }

    // Watchdog and distributed clocks

    /// Sets the process data watchdog, in nanoseconds; 0 switches it off. It runs in OP while
    /// SM2's control byte has the watchdog bit.
    pub fn set_watchdog_ns(&mut self, watchdog_ns: u64) {
        self.watchdog_ns = watchdog_ns;
    }

    pub(super) fn watchdog_expiry(&self) -> Option<u64> {
        let runs =
            self.state == AlState::Op && self.watchdog_ns > 0 && self.outputs.feeds_watchdog();
        runs.then(|| self.last_outputs.saturating_add(self.watchdog_ns))
    }

    /// Switches Sync0 on, at other times, or off. Off in OP is a fatal sync error (0x002C);
    /// frames scheduled by the old pulses are dropped.
    pub fn set_dc_sync0(&mut self, sync0: Option<Sync0>) {
        if sync0 == self.sync0 {
            return;
        }
        let dropped = self.schedule.flush();
        if dropped > 0 {
            self.counters.transmit_losses.schedule_failed += dropped as u64;
            self.maintenance.flags |= maintenance::flag::SCHED_TIMER_MISS;
        }
        self.sync0 = sync0;
        self.pulses = sync0.map(|sync0| PulseTrain::new(sync0, self.clock.line(), self.now));
        self.performance.restart_pulses();
        if sync0.is_none() && self.state == AlState::Op {
            self.fall_back(AlStatusCode::FATAL_SYNC);
        }
    }

    /// When too many pulses in a row went by without outputs, if that is watched.
    pub(super) fn missed_sync_expiry(&self) -> Option<u64> {
        let pulses = self.pulses?;
        let limit = u64::from(self.settings.missed_sync_limit);
        (self.state == AlState::Op && limit > 0).then(|| {
            pulses
                .next_after(self.last_outputs)
                .saturating_add(limit.saturating_mul(pulses.cycle_ns()))
        })
    }

    /// When waiting for the first pulse ends, one way or the other.
    pub(super) fn awaited_sync(&self) -> Option<u64> {
        let since = self.awaiting_sync_since?;
        let timeout = since.saturating_add(self.settings.sync_wait_ns);
        let first = self.pulses.map_or(since, PulseTrain::first_ns);
        Some(first.min(timeout))
    }

    pub(super) fn finish_awaiting_sync(&mut self) {
        self.awaiting_sync_since = None;
        let synchronous = self.pulses.is_none_or(|pulses| pulses.pulses_until(self.now) > 0);
        if synchronous {
            self.enter(AlState::Op);
        } else {
            self.error = true;
            self.status_code = AlStatusCode::NO_SYNC;
        }
    }
}
