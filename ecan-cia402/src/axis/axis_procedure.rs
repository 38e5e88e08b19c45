//! Procedures of an axis over many cycles, in parallel with its state: verification, mode change, homing.

use std::time::Duration;

use ecan_canopen::{
    Configuring, DriveState, MappingEntry, Network, OperatingMode, Step, StepFailure, StepFault,
    TransmissionType, object,
};

use super::axis::Axis;
use super::axis_state::AxisState;
use super::homing::{HomingState, HomingWatch};
use super::power::{PowerGoal, StopCause};
use super::procedure::{Procedure, Stage};
use super::script::{Script, axis_script, mode_steps};
use super::setup::{RETRY_NS, Verification};
use super::status::AxisError;
use crate::guard::terms::GuardState;

/// Steps that compare a PDO mapping with its entries.
fn mapping_steps<I: Iterator<Item = MappingEntry>>(
    index: u16,
    entries: impl Fn() -> I,
) -> impl Iterator<Item = Step> {
    let count = Step::expect(index, 0, entries().count() as u32);
    let entries = (1..).zip(entries());
    let entries = entries.map(move |(nth, entry)| Step::expect(index, nth, entry.raw()));
    [count].into_iter().chain(entries)
}

const REST_TIMEOUT: Duration = Duration::from_secs(30);

impl Axis {
    pub(crate) fn is_verified(&self) -> bool {
        self.verification == Verification::Complete
    }

    /// Continues a verification. A drive that does not answer is asked again.
    pub(crate) fn step_verification(&mut self, network: &mut Network, now_ns: u64) {
        if self.procedure.is_some() {
            // It needs the SDO client of the node.
            return self.suspend_verification(network, now_ns);
        }
        if !self.setup.is_complete() || self.state.is_stopping() {
            return;
        }
        if self.mode_due.is_some() && !self.is_running() {
            self.require_verification();
        }
        match &mut self.verification {
            Verification::Complete => {}
            Verification::Due { from_ns } => {
                // The mode is only changed while the drive is off.
                let may_begin = self.mode_due.is_none() || self.drive.is_off();
                if self.reachability.gateway && now_ns >= *from_ns && may_begin {
                    self.begin_verification();
                }
            }
            Verification::Running(script) => {
                match script.advance(network, self.node, now_ns, |_, _, _| {}) {
                    Configuring::Running => {}
                    Configuring::Done => {
                        if let Some(mode) = self.mode_due {
                            return self.mode_restored(mode);
                        }
                        self.verification = match self.next_verification() {
                            Some(script) => Verification::Running(script),
                            None => Verification::Complete,
                        };
                    }
                    Configuring::Failed(StepFailure {
                        fault: StepFault::Mismatch { .. }, ..
                    }) => self.configuration_differs(),
                    Configuring::Failed(_) => {
                        let from_ns = now_ns.saturating_add(RETRY_NS);
                        self.verification = Verification::Due { from_ns };
                        self.wake_node(network, now_ns);
                    }
                }
            }
        }
    }

    fn begin_verification(&mut self) {
        self.verification_stage = 0;
        let script = match self.mode_due {
            Some(mode) => self.mode_script(mode),
            None => self.verification_script(),
        };
        self.verification = Verification::Running(script);
    }

    /// The drive displays the mode from before a cancelled procedure; the verification follows.
    fn mode_restored(&mut self, mode: OperatingMode) {
        let is_activated =
            !matches!(self.guard.state(), GuardState::Idle | GuardState::Holding { .. });
        self.confirm_mode(mode);
        if is_activated {
            self.guard.activate();
        }
        self.begin_verification();
    }

    pub(crate) fn suspend_verification(&mut self, network: &mut Network, now_ns: u64) {
        if let Verification::Running(script) = self.verification {
            script.cancel(network, self.node);
            self.verification = Verification::Due { from_ns: now_ns };
        }
    }

    /// The script of the next PDOs after one that is complete.
    pub(crate) fn next_verification(&mut self) -> Option<Script> {
        self.verification_stage += 1;
        let count = self.further.layout.rpdo_count().max(self.further.layout.tpdo_count());
        (self.verification_stage < count).then(|| self.verification_script())
    }

    /// Reads what a restart would have changed: the mapping of an RPDO and a TPDO, with those of the
    /// first stage heartbeat or guard time, and mode.
    pub(crate) fn verification_script(&self) -> Script {
        let (axis, stage) = (self.config.node_axis, self.verification_stage);
        let nth = self.config.pdo_number.saturating_sub(1) + stage as u16;
        let has_rpdo = stage < self.further.layout.rpdo_count();
        let has_tpdo = stage < self.further.layout.tpdo_count();
        let rpdo = has_rpdo.then(|| {
            let index = object::RPDO_MAPPING + nth;
            mapping_steps(index, || self.further.layout.rpdo_entries(stage))
        });
        let tpdo = has_tpdo.then(|| {
            let index = object::TPDO_MAPPING + nth;
            mapping_steps(index, || self.further.layout.tpdo_entries(stage))
        });
        let mapping = rpdo.into_iter().flatten().chain(tpdo.into_iter().flatten());
        let communication = [
            has_rpdo.then_some(object::RPDO_COMMUNICATION),
            has_tpdo.then_some(object::TPDO_COMMUNICATION),
        ];
        let synchronous = TransmissionType::Synchronous(1).raw();
        let transmission = communication
            .into_iter()
            .flatten()
            .map(|communication| Step::expect(communication + nth, 2, synchronous));
        if stage > 0 {
            return axis_script(axis, mapping.chain(transmission));
        }
        let life = match &self.config.drive.guarding {
            Some(guarding) => {
                let time_ms = guarding.guard_time.as_millis() as u64;
                Some(Step::expect(object::GUARD_TIME, 0, time_ms))
            }
            None => {
                let producer = object::PRODUCER_HEARTBEAT;
                self.heartbeat_ms.map(|period_ms| Step::expect(producer, 0, period_ms))
            }
        };
        let mode = Step::expect(object::MODE_DISPLAY, 0, self.mode.raw());
        axis_script(axis, mapping.chain(transmission).chain(life).chain([mode]))
    }

    /// Writes a mode and waits until the drive displays it.
    pub(crate) fn mode_script(&self, mode: OperatingMode) -> Script {
        axis_script(self.config.node_axis, mode_steps(mode))
    }

    pub(crate) fn step_procedure(&mut self, network: &mut Network, now_ns: u64) {
        let Some(mut procedure) = self.procedure else { return };
        let continues = match procedure.stage {
            Stage::Disabling => self.step_disabling(&mut procedure, now_ns),
            Stage::Writing(_) => self.step_writing(&mut procedure, network, now_ns),
            Stage::Enabling => self.step_enabling(&mut procedure, now_ns),
            Stage::Homing(_) => self.step_homing(&mut procedure, now_ns),
            Stage::Ending => self.step_ending(&mut procedure, now_ns),
            Stage::Restoring(_) => self.step_restoring(&mut procedure, network, now_ns),
        };
        self.procedure = continues.then_some(procedure);
        if continues {
            return;
        }
        if procedure.error.is_some() {
            // A fault is the cause of the hold that ended the procedure.
            if !matches!(self.error, Some(AxisError::Fault { .. })) {
                self.error = procedure.error;
            }
        } else if procedure.then_enable && self.setup.is_complete() {
            self.begin_enable(now_ns);
        }
    }

    /// Brings the axis to rest by the ramp, then switches power off. A hold, or a drive that is out of
    /// reach, ends the procedure.
    fn step_disabling(&mut self, procedure: &mut Procedure, now_ns: u64) -> bool {
        if self.is_uncontrolled(now_ns) {
            let not_disabled = AxisError::NotDisabled { state: self.drive.state };
            procedure.error = procedure.error.or(Some(not_disabled));
        }
        if procedure.error.is_some() {
            return false;
        }
        let is_moving = self.is_running() && !self.is_at_rest();
        let is_late = procedure.waited(now_ns) > REST_TIMEOUT;
        if is_moving && !is_late {
            return true;
        }
        match (self.state, self.drive.state) {
            (_, Some(DriveState::Fault)) => {
                procedure.error = Some(AxisError::Fault { error_code: 0 });
                false
            }
            (AxisState::Stopped(_), Some(DriveState::SwitchOnDisabled)) => {
                procedure.enter(Stage::Writing(procedure.script(self.config.node_axis)), now_ns);
                true
            }
            (_, state) if is_late => {
                procedure.error = Some(AxisError::NotDisabled { state });
                false
            }
            _ => {
                self.stop_for_procedure(now_ns);
                true
            }
        }
    }

    /// Switches the drive off; it stays so.
    fn stop_for_procedure(&mut self, now_ns: u64) {
        let is_stopping_off = self.state.is_stopping()
            && self.state.stop().is_some_and(|stop| stop.goal() != PowerGoal::QuickStopped);
        if !is_stopping_off {
            self.stop(StopCause::Procedure, now_ns);
        }
    }

    fn step_writing(
        &mut self,
        procedure: &mut Procedure,
        network: &mut Network,
        now_ns: u64,
    ) -> bool {
        let Stage::Writing(running) = &mut procedure.stage else { return false };
        match running.advance(network, self.node, now_ns, |_, _, _| {}) {
            Configuring::Running => true,
            Configuring::Done if procedure.homing.is_some() => {
                self.confirm_mode(OperatingMode::Homing);
                self.begin_enable(now_ns);
                procedure.enter(Stage::Enabling, now_ns);
                true
            }
            Configuring::Done => {
                self.confirm_mode(procedure.mode);
                false
            }
            Configuring::Failed(failure) => {
                procedure.error = Some(AxisError::Mode(failure));
                procedure.enter(Stage::Restoring(self.mode_script(procedure.mode_before)), now_ns);
                true
            }
        }
    }

    fn step_enabling(&mut self, procedure: &mut Procedure, now_ns: u64) -> bool {
        if self.is_running() {
            procedure.enter(Stage::Homing(HomingWatch::default()), now_ns);
        } else if self.state.enabling_since_ns().is_none() {
            // Timeout, hold or fault; the error is set.
            procedure.error = self.error;
            procedure.enter(Stage::Ending, now_ns);
        }
        true
    }

    fn step_homing(&mut self, procedure: &mut Procedure, now_ns: u64) -> bool {
        let waited = procedure.waited(now_ns);
        let Stage::Homing(watch) = &mut procedure.stage else { return false };
        let result = self.drive.arrived.and_then(|feedback| watch.step(feedback.statusword));
        let limit = procedure.homing.map_or(Duration::ZERO, |homing| homing.timeout);
        let error = if !self.is_running() {
            self.error.or(Some(AxisError::Homing(HomingState::Waiting)))
        } else {
            match result {
                Some(HomingState::Attained) => None,
                Some(state) => Some(AxisError::Homing(state)),
                None if waited > limit => {
                    let state = self.homing_state();
                    Some(AxisError::HomingTimedOut { state, waited })
                }
                None => return true,
            }
        };
        procedure.error = error;
        procedure.enter(Stage::Ending, now_ns);
        true
    }

    /// Switches power off after homing, with any result; a drive that is still homing stops with
    /// it.
    fn step_ending(&mut self, procedure: &mut Procedure, now_ns: u64) -> bool {
        let is_off = matches!(self.state, AxisState::Stopped(_)) && self.drive.is_off();
        if !is_off {
            self.stop_for_procedure(now_ns);
        }
        let is_late = procedure.waited(now_ns) > REST_TIMEOUT;
        if is_late && !is_off || self.is_uncontrolled(now_ns) {
            let not_disabled = AxisError::NotDisabled { state: self.drive.state };
            procedure.error = procedure.error.or(Some(not_disabled));
        }
        if is_off || is_late {
            procedure.enter(Stage::Restoring(self.mode_script(procedure.mode_before)), now_ns);
        }
        true
    }

    fn step_restoring(
        &mut self,
        procedure: &mut Procedure,
        network: &mut Network,
        now_ns: u64,
    ) -> bool {
        let Stage::Restoring(running) = &mut procedure.stage else { return false };
        match running.advance(network, self.node, now_ns, |_, _, _| {}) {
            Configuring::Running => true,
            Configuring::Done => {
                self.confirm_mode(procedure.mode_before);
                false
            }
            Configuring::Failed(failure) => {
                // The drive's mode is unknown: it must be configured again.
                procedure.error = procedure.error.or(Some(AxisError::Mode(failure)));
                self.setup_failed(failure);
                false
            }
        }
    }
}
