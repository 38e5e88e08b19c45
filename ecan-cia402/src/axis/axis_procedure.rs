//! One axis in what takes it many cycles: configuration, change of mode, homing.

use ecan_canopen::{
    Configuring, DriveState, Network, OperatingMode, Step, StepFailure, StepFault,
    TransmissionType, object,
};

use super::axis_core::{Axis, Reverification, Setup};
use super::guard_terms::GuardState;
use super::homing::{HomingState, HomingWatch};
use super::phase::AxisError;
use super::power::PowerGoal;
use super::procedure::{Procedure, Stage};
use super::script::{Script, mode_steps, script};

/// How long an axis may take to come to rest and switch off, in milliseconds.
const REST_TIMEOUT_MS: u64 = 30_000;
/// Pause before a drive that did not answer is asked again.
const RETRY_NS: u64 = 500_000_000;

impl Axis {
    /// Goes on with the configuration.
    pub(super) fn step_setup(&mut self, network: &mut Network, now_ns: u64) {
        match &mut self.setup {
            Setup::Steps => match self.configurator.step(network, now_ns) {
                Configuring::Running => {}
                Configuring::Done => self.setup = Setup::Mode(script(mode_steps(self.mode))),
                Configuring::Failed(failure) => self.fail_setup(failure),
            },
            Setup::Mode(script) => match script.advance(network, self.node, now_ns, |_, _, _| {}) {
                Configuring::Running => {}
                Configuring::Done => self.finish_setup(network),
                Configuring::Failed(failure) => self.fail_setup(failure),
            },
            Setup::None | Setup::Done | Setup::Failed(_) => {}
        }
    }

    fn fail_setup(&mut self, failure: StepFailure) {
        self.setup = Setup::Failed(failure);
        self.trouble = Some(AxisError::Setup(failure));
    }

    fn finish_setup(&mut self, network: &mut Network) {
        self.setup = Setup::Done;
        let producer = object::PRODUCER_HEARTBEAT;
        // What was written and read back; nothing where the drive has no heartbeat.
        let period_ms = self.configurator.uploaded(self.node, producer, 0).unwrap_or_default();
        let timeout_ms = u32::try_from(period_ms * 7 / 2).unwrap_or_default();
        network.set_heartbeat_timeout(self.node, timeout_ms);
        self.boot_ups = network.status(self.node).map_or(0, |status| status.boot_ups);
        self.statistics.restart_tpdo_count();
        if network.sdo_silences(self.node) != self.silences {
            // It may have restarted in between: then the first steps are forgotten.
            self.begin_doubt();
        }
    }

    /// Asks a drive that was out of sight whether it still has its configuration. One that does not
    /// answer is asked again.
    pub(super) fn step_doubt(&mut self, network: &mut Network, now_ns: u64) {
        if !self.is_configured() || self.procedure.is_some() {
            return;
        }
        match &mut self.doubt {
            Reverification::None => {}
            Reverification::Open { from_ns } => {
                if self.sight.in_service && now_ns >= *from_ns {
                    self.doubt = Reverification::Asking(self.verification());
                }
            }
            Reverification::Asking(script) => {
                match script.advance(network, self.node, now_ns, |_, _, _| {}) {
                    Configuring::Running => {}
                    Configuring::Done => self.doubt = Reverification::None,
                    Configuring::Failed(StepFailure {
                        fault: StepFault::Mismatch { .. }, ..
                    }) => {
                        self.forget_setup();
                    }
                    Configuring::Failed(_) => {
                        let from_ns = now_ns.saturating_add(RETRY_NS);
                        self.doubt = Reverification::Open { from_ns };
                    }
                }
            }
        }
    }

    /// Reads what a restart would have changed: the mapping of both PDOs, heartbeat and mode.
    fn verification(&self) -> Script {
        let nth = u16::from(self.settings.pdo_number.saturating_sub(1));
        let pdos = [
            (object::RPDO_MAPPING, self.layout.rpdo_entries()),
            (object::TPDO_MAPPING, self.layout.tpdo_entries()),
        ];
        let mapping = pdos.into_iter().flat_map(|(mapping, entries)| {
            let index = mapping + nth;
            let count = Step::expect(index, 0, entries.len() as u32);
            let entries = (1..).zip(entries);
            let entries = entries.map(move |(nth, entry)| Step::expect(index, nth, entry.raw()));
            [count].into_iter().chain(entries)
        });
        let communication = [object::RPDO_COMMUNICATION, object::TPDO_COMMUNICATION];
        let synchronous = TransmissionType::Synchronous(1).raw();
        let transmission =
            communication.map(|communication| Step::expect(communication + nth, 2, synchronous));
        let producer = object::PRODUCER_HEARTBEAT;
        let heartbeat = self.configurator.uploaded(self.node, producer, 0);
        let heartbeat = heartbeat.map(|period_ms| Step::expect(producer, 0, period_ms));
        let mode = Step::expect(object::MODE_DISPLAY, 0, self.mode.raw());
        script(mapping.chain(transmission).chain(heartbeat).chain([mode]))
    }

    /// Goes on with a change of mode or a homing.
    pub(super) fn step_procedure(&mut self, network: &mut Network, now_ns: u64) {
        let Some(mut procedure) = self.procedure else { return };
        let goes_on = match procedure.stage {
            Stage::Disabling => self.step_disabling(&mut procedure, now_ns),
            Stage::Writing(_) => self.step_writing(&mut procedure, network, now_ns),
            Stage::Enabling => self.step_enabling(&mut procedure, now_ns),
            Stage::Homing(_) => self.step_homing(&mut procedure, now_ns),
            Stage::WindingUp => self.step_winding_up(&mut procedure, now_ns),
            Stage::Restoring(_) => self.step_restoring(&mut procedure, network, now_ns),
        };
        self.procedure = goes_on.then_some(procedure);
        if !goes_on {
            self.end_procedure(&procedure, now_ns);
        }
    }

    /// The procedure is over. An axis that was enabled before is so again, unless something went
    /// wrong.
    fn end_procedure(&mut self, procedure: &Procedure, now_ns: u64) {
        if procedure.trouble.is_some() {
            // A fault says more than that the axis held for it.
            if !matches!(self.trouble, Some(AxisError::Fault { .. })) {
                self.trouble = procedure.trouble;
            }
        } else if procedure.then_enable && self.is_configured() {
            self.begin_enable(now_ns);
        }
    }

    /// To rest by the ramp, then power off.
    fn step_disabling(&mut self, procedure: &mut Procedure, now_ns: u64) -> bool {
        let is_moving = self.target().is_some() && !self.is_at_rest();
        let is_late = procedure.waited_ms(now_ns) > REST_TIMEOUT_MS;
        if is_moving && !is_late {
            return true;
        }
        if self.power.goal() != PowerGoal::Disabled {
            self.disable();
        }
        match self.state {
            Some(DriveState::SwitchOnDisabled) => {
                procedure.enter(Stage::Writing(procedure.script()), now_ns);
                true
            }
            Some(DriveState::Fault) => {
                procedure.trouble = Some(AxisError::Fault { error_code: 0 });
                false
            }
            state if is_late => {
                procedure.trouble = Some(AxisError::NotDisabled { state });
                false
            }
            _ => true,
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
                self.take_mode(OperatingMode::Homing);
                self.begin_enable(now_ns);
                procedure.enter(Stage::Enabling, now_ns);
                true
            }
            Configuring::Done => {
                self.take_mode(procedure.mode);
                false
            }
            Configuring::Failed(failure) => {
                procedure.trouble = Some(AxisError::Mode(failure));
                let restore = script(mode_steps(procedure.mode_before));
                procedure.enter(Stage::Restoring(restore), now_ns);
                true
            }
        }
    }

    fn step_enabling(&mut self, procedure: &mut Procedure, now_ns: u64) -> bool {
        if matches!(self.guard.state(), GuardState::Running { .. }) {
            procedure.enter(Stage::Homing(HomingWatch::default()), now_ns);
        } else if self.power.goal() != PowerGoal::Enabled {
            // Timed out, held or in fault: the trouble is there already.
            procedure.trouble = self.trouble;
            procedure.enter(Stage::WindingUp, now_ns);
        }
        true
    }

    fn step_homing(&mut self, procedure: &mut Procedure, now_ns: u64) -> bool {
        let waited_ms = procedure.waited_ms(now_ns);
        let Stage::Homing(watch) = &mut procedure.stage else { return false };
        let outcome = self.arrived.and_then(|feedback| watch.step(feedback.statusword));
        let limit_ms = procedure.homing.map_or(0, |homing| homing.timeout_ms);
        let trouble = if !matches!(self.guard.state(), GuardState::Running { .. }) {
            self.trouble.or(Some(AxisError::Homing(HomingState::Waiting)))
        } else {
            match outcome {
                Some(HomingState::Attained) => None,
                Some(state) => Some(AxisError::Homing(state)),
                None if waited_ms > u64::from(limit_ms) => {
                    let state = self.homing_state();
                    Some(AxisError::HomingTimedOut { state, waited_ms })
                }
                None => return true,
            }
        };
        procedure.trouble = trouble;
        procedure.enter(Stage::WindingUp, now_ns);
        true
    }

    /// Power off, whatever homing came to; a drive that still looks for its home stops with it.
    fn step_winding_up(&mut self, procedure: &mut Procedure, now_ns: u64) -> bool {
        if self.power.goal() != PowerGoal::Disabled {
            self.disable();
        }
        let is_off = matches!(self.state, Some(DriveState::SwitchOnDisabled | DriveState::Fault));
        if is_off || procedure.waited_ms(now_ns) > REST_TIMEOUT_MS {
            if !is_off {
                procedure.trouble =
                    procedure.trouble.or(Some(AxisError::NotDisabled { state: self.state }));
            }
            let restore = script(mode_steps(procedure.mode_before));
            procedure.enter(Stage::Restoring(restore), now_ns);
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
                self.take_mode(procedure.mode_before);
                false
            }
            Configuring::Failed(failure) => {
                // Nobody knows the drive's mode any more: it must be configured anew.
                procedure.trouble = procedure.trouble.or(Some(AxisError::Mode(failure)));
                self.fail_setup(failure);
                false
            }
        }
    }
}
