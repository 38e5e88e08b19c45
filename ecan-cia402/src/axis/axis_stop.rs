//! Stop of one axis in any state, and the first contact with its drive.

use std::time::Duration;

use ecan_canopen::{Controlword, Network, Statusword, object};

use super::axis::Axis;
use super::axis_state::AxisState;
use super::drive_status::Round;
use super::drive_status::{REST_NS, is_energised};
use super::power::{DISABLE_NS, StopCause};
use super::setup::{SetupState, Verification};
use super::status::AxisError;
use super::takeover::{ADOPT_NS, Inspection, Takeover, TakeoverState};

/// Attempts without an answer after which a drive counts as absent or gone: 800 ms.
const GONE_ATTEMPTS: u32 = 4;

/// The same for a drive that was enabled at the first contact: until then its channel gets no
/// heartbeat, so that its own watch stops it.
const TAKEOVER_ATTEMPTS: u32 = 24;

/// Attempts without an answer after which the node of a drive may be in NMT Stopped, if it has no life sign. Process
/// data have carried a stop for 200 ms by then.
const WAKE_ATTEMPTS: u32 = 2;

/// Time for which a drive without an actual position must report that it is off.
const BLIND_REST_NS: u64 = 1_000_000_000;

impl Axis {
    /// Stops the drive in every setup and state of the axis. Cancels a command to enable that waits.
    pub(crate) fn stop(&mut self, cause: StopCause, now_ns: u64) {
        self.stop_targets();
        self.guard.begin_stop();
        if cause.is_commanded() {
            self.recovery = None;
        }
        if matches!(cause, StopCause::QuickStop | StopCause::StopAll) {
            self.guard.hold();
        }
        self.state = self.state.stopped_by(cause, now_ns);
        let has_process_data = self.is_commanded_by_process_data();
        if let AxisState::Stopping(stop) = &mut self.state
            && !has_process_data
        {
            // The last RPDO of an earlier owner may wait in the drive for a SYNC, and its controlword
            // would enable a drive in Quick Stop Active.
            stop.switch_off_at_rest();
        }
    }

    /// Returns whether the drive is known to be off, or at rest in Quick Stop Active, or never answered.
    pub(crate) fn is_stopped(&self, now_ns: u64) -> bool {
        // After a configuration that found the drive enabled, its state is read again. A drive that never answered
        // may be enabled when it answers its configuration.
        let is_awaited = self.drive.heard_ns.is_none() && self.setup.is_pending();
        if self.takeover != TakeoverState::Done || is_awaited {
            return false;
        }
        match self.state {
            AxisState::Stopped(_) => true,
            AxisState::Standby | AxisState::Releasing(_) | AxisState::ResettingFault(_) => {
                // A command to enable may have been on the path to a drive that went silent.
                let is_silent = self.drive.heard_ns.is_some()
                    && self.setup.is_complete()
                    && !self.is_fresh(now_ns);
                !is_silent
                    && self.drive.is_off_or_unknown()
                    && (self.drive.rest.is_empty() || self.drive.rest.was_at_rest())
            }
            _ => false,
        }
    }

    /// Returns whether the drive reported something, and not that it has stopped.
    pub(crate) fn may_move(&self, now_ns: u64) -> bool {
        self.drive.heard_ns.is_some() && !self.is_stopped(now_ns)
    }

    /// Returns whether the drive cannot be reached at present.
    pub(crate) fn is_gone(&self) -> bool {
        !self.reachability.gateway || self.poll.unanswered() >= GONE_ATTEMPTS
    }

    /// Returns whether the drive may be moving although it does not report that it obeys a stop.
    pub(crate) fn is_uncontrolled(&self, now_ns: u64) -> bool {
        let may_move = self.drive.state.is_none_or(is_energised);
        self.state.is_stopping()
            && may_move
            && self.drive.heard_ns.is_some()
            && !self.is_fresh(now_ns)
    }

    pub(crate) fn is_fresh(&self, now_ns: u64) -> bool {
        self.drive.is_fresh(now_ns, self.fresh_ns)
    }

    pub(crate) fn drive_is_at_rest(&self, now_ns: u64) -> bool {
        self.drive.is_at_rest(now_ns, self.fresh_ns)
    }

    /// Continues the SDO transfers that a stop or the first contact needs.
    pub(crate) fn step_poll(&mut self, network: &mut Network, now_ns: u64) {
        if self.state.is_stopping() && self.setup.is_running() && !self.is_off_for_setup() {
            // A drive that never answered may be enabled; the stop needs its SDO server.
            self.cancel_setup(network);
            self.setup = SetupState::Unconfigured;
        }
        let is_inspecting = matches!(self.takeover, TakeoverState::Inspecting { .. });
        let is_needed = is_inspecting || self.needs_stop_by_sdo(now_ns);
        if !is_needed || !self.reachability.gateway {
            self.poll.cancel(network, self.node);
            return self.step_takeover(network, false, now_ns);
        }
        self.suspend_verification(network, now_ns);
        let round = match self.state {
            AxisState::Stopping(stop) => {
                let state = self.drive.state.filter(|_| self.is_fresh(now_ns));
                let command = stop.command(state, self.drive_is_at_rest(now_ns));
                Round::Stop(command.map(Controlword::of))
            }
            _ if self.takeover_policy == Takeover::Adopt => {
                Round::InspectForAdoption(self.kept_position())
            }
            _ => Round::Inspect,
        };
        if !self.node_share.may_poll && !self.poll.is_running() {
            // Another axis of the node uses its SDO client.
            return self.step_takeover(network, false, now_ns);
        }
        let Self { poll, drive, config, inspection, node, .. } = self;
        let is_answered = poll.step(network, *node, now_ns, round, |index, value| match index {
            object::STATUSWORD => drive.statusword_received(Statusword(value as u16), now_ns),
            object::POSITION_ACTUAL => {
                drive.rest.observe(value as i32, config.range, config.standstill, now_ns);
            }
            _ => inspection.note(index, value),
        });
        if self.poll.unanswered() >= WAKE_ATTEMPTS {
            self.wake_node(network, now_ns);
        }
        self.step_takeover(network, is_answered, now_ns);
    }

    /// Process data do not reach the drive, or their effect is not visible.
    fn needs_stop_by_sdo(&self, now_ns: u64) -> bool {
        self.state.is_stopping()
            && !self.setup.is_running()
            && (!self.is_commanded_by_process_data()
                || self.verification != Verification::Complete
                || !self.reachability.operational
                || !self.is_fresh(now_ns))
    }

    fn is_commanded_by_process_data(&self) -> bool {
        self.setup.has_process_data() && self.guard.resting_target().is_some()
    }

    fn step_takeover(&mut self, network: &mut Network, is_answered: bool, now_ns: u64) {
        match &mut self.takeover {
            TakeoverState::Waiting => {
                if self.reachability.gateway {
                    self.inspection = Inspection::default();
                    self.drive.rest.restart();
                    self.takeover = TakeoverState::Inspecting { since_ns: now_ns };
                }
            }
            TakeoverState::Inspecting { since_ns } => {
                let since_ns = *since_ns;
                let is_absent = self.poll.unanswered() >= GONE_ATTEMPTS;
                // Of an attempt that was not answered to its end, the statusword may have arrived.
                let needs_stop = !self.poll.is_running() && !self.drive.is_off_or_unknown();
                if is_answered || needs_stop {
                    self.inspected(since_ns, now_ns);
                } else if is_absent {
                    self.takeover = TakeoverState::Done;
                }
            }
            TakeoverState::Adopting(_) => {
                if self.state.is_stopping() {
                    self.cancel_adoption(network);
                    self.takeover = TakeoverState::Stopping;
                } else if self.step_adoption(network, now_ns) {
                    self.stop_enabled_drive(now_ns);
                }
            }
            TakeoverState::Stopping => {
                if !self.state.is_stopping() || self.poll.unanswered() >= TAKEOVER_ATTEMPTS {
                    self.takeover = TakeoverState::Done;
                }
            }
            TakeoverState::Done => self.is_uninspected = false,
        }
    }

    /// The drive has answered: it is off, is adopted, or is stopped.
    fn inspected(&mut self, since_ns: u64, now_ns: u64) {
        if self.state.is_stopping() {
            self.takeover = TakeoverState::Stopping;
        } else if self.drive.is_off_or_unknown() {
            self.takeover = TakeoverState::Done;
        } else if self.takeover_policy == Takeover::Stop || self.setup.is_pending() {
            self.stop_enabled_drive(now_ns);
        } else if self.drive_is_at_rest(now_ns)
            && let Some(target) = self.adoptable_target()
        {
            self.mode = self.config.mode;
            self.verification_stage = 0;
            self.takeover = TakeoverState::begin_adoption(self.verification_script(), target);
        } else if self.drive_is_at_rest(now_ns) || now_ns.saturating_sub(since_ns) > ADOPT_NS {
            self.stop_enabled_drive(now_ns);
        }
    }

    fn stop_enabled_drive(&mut self, now_ns: u64) {
        tracing::warn!(axis = self.index, "axis {}: enabled drive found, stopping", self.index);
        self.stop(StopCause::Takeover, now_ns);
        self.takeover = TakeoverState::Stopping;
    }

    /// A drive that never answered has sent something: its state is to be read.
    pub(crate) fn appeared(&mut self) {
        let is_unknown = self.drive.heard_ns.is_none() && !self.poll.is_answered();
        if is_unknown && self.takeover == TakeoverState::Done && !self.setup.is_pending() {
            self.takeover = TakeoverState::Waiting;
        }
    }

    pub(crate) fn step_stop(&mut self, now_ns: u64) {
        let is_fresh = self.is_fresh(now_ns);
        let state = self.drive.state;
        match &mut self.state {
            AxisState::Stopping(stop) => {
                stop.note_status(is_fresh, now_ns);
                let stop = *stop;
                if self.has_stopped(now_ns) {
                    tracing::info!(axis = self.index, "axis {}: stopped", self.index);
                    self.state = AxisState::Stopped(stop);
                    if stop.enable_since_ns.is_some() && self.setup.is_complete() {
                        self.begin_enable(now_ns);
                    }
                    return;
                }
                let waited = Duration::from_nanos(now_ns.saturating_sub(stop.since_ns));
                if waited.as_nanos() > DISABLE_NS.into() {
                    let not_disabled = AxisError::NotDisabled { state };
                    self.error = self.error.or(Some(not_disabled));
                }
                self.expire_enable(now_ns);
            }
            AxisState::Stopped(stop) => {
                let stop = *stop;
                // A command to enable may still have been on the path to the drive.
                let stays = state.is_none_or(|state| stop.is_reached(state));
                if is_fresh && !stays && self.setup.is_complete() {
                    self.state = self.state.stopped_by(stop.cause, now_ns);
                }
            }
            _ => {}
        }
    }

    fn expire_enable(&mut self, now_ns: u64) {
        let AxisState::Stopping(stop) = &mut self.state else { return };
        let Some(since_ns) = stop.enable_since_ns else { return };
        let waited = Duration::from_nanos(now_ns.saturating_sub(since_ns));
        if waited > self.config.enable_timeout {
            stop.enable_since_ns = None;
            let (state, guard) = (self.drive.state, self.guard.state());
            self.error = Some(AxisError::EnableTimedOut { state, guard, waited });
        }
    }

    /// Returns whether the drive reported that it was off before its configuration began.
    fn is_off_for_setup(&self) -> bool {
        self.drive.heard_ns.is_some()
    }

    /// Returns whether a pending stop is complete.
    fn has_stopped(&self, now_ns: u64) -> bool {
        let AxisState::Stopping(stop) = &self.state else { return false };
        if self.setup.is_running() {
            return self.is_off_for_setup();
        }
        let waited_ns = now_ns.saturating_sub(stop.since_ns);
        // A status from before the command confirms nothing.
        let is_confirmed = self.drive.heard_ns > Some(stop.commanded_ns) && self.is_fresh(now_ns);
        let Some(state) = self.drive.state.filter(|_| is_confirmed) else {
            let is_absent = self.poll.is_answered() || self.poll.unanswered() >= GONE_ATTEMPTS;
            return self.drive.heard_ns.is_none() && is_absent;
        };
        let is_at_rest = self.drive_is_at_rest(now_ns)
            || self.drive.rest.is_empty() && !is_energised(state) && waited_ns > BLIND_REST_NS;
        stop.is_reached(state) && is_at_rest && waited_ns >= REST_NS
    }
}
