//! One axis of the drive: power stage, motion and motor, in user coordinates.

use ecan_canopen::{DriveState, NodeLossReaction, OperatingMode, Statusword};

use super::config::DriveConfig;
use super::dictionary::nearest;
use super::homing::{Switches, TouchProbes};
use super::motion::{HomingResult, Motion};
use super::motor::{Actuation, Motor, Offsets};
use super::parameters::Parameters;
use super::power::{Action, PowerStage, StopMode};
use super::trace::{DriveTrace, MotionSample, TargetHistory, TraceCause, TraceEvent};
use crate::event_queue::earliest;

/// EMCY error code: following error exceeds its window for too long.
const FOLLOWING_ERROR: u16 = 0x8611;

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Targets {
    pub(super) position: i32,
    pub(super) velocity: i32,
    pub(super) torque: i16,
    pub(super) position_offset: i32,
    pub(super) velocity_offset: i32,
    pub(super) torque_offset: i16,
    pub(super) interpolation: i32,
    pub(super) vl_velocity: i16,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Report {
    Fault(u16),
    FaultReset,
}

#[derive(Clone, Debug)]
pub(super) struct Axis {
    pub(super) config: DriveConfig,
    pub(super) now: u64,
    /// Controller period, ns and s.
    period: u64,
    period_seconds: f64,
    /// First multiple of the period after `now`.
    next_tick: u64,
    pub(super) power: PowerStage,
    pub(super) motion: Motion,
    pub(super) motor: Motor,
    /// Active mode; `None` is no mode.
    pub(super) mode: Option<OperatingMode>,
    /// Requested mode and the time at which it becomes active.
    pub(super) next_mode: Option<(Option<OperatingMode>, u64)>,
    pub(super) targets: Targets,
    /// Mechanical position of the user's zero position.
    pub(super) origin: i64,
    /// Begin of the present excess of the following error window.
    following_error_since: Option<u64>,
    pub(super) at_limit: bool,
    blocked_until: Option<u64>,
    pub(super) probes: TouchProbes,
    pub(super) history: TargetHistory,
    pub(super) trace: DriveTrace,
    pub(super) report: Option<Report>,
}

impl Axis {
    pub(super) fn new(config: &DriveConfig) -> Self {
        let period = u64::from(config.motor.period_us.clamp(1, 1_000)) * 1_000;
        Self {
            config: config.clone(),
            now: 0,
            period,
            period_seconds: seconds(period),
            next_tick: period,
            power: PowerStage::new(),
            motion: Motion::new(config.motor),
            motor: Motor::new(config.motor),
            mode: None,
            next_mode: None,
            targets: Targets::default(),
            origin: 0,
            following_error_since: None,
            at_limit: false,
            blocked_until: None,
            probes: TouchProbes::default(),
            history: TargetHistory::new(config.history),
            trace: DriveTrace::new(config.trace),
            report: None,
        }
    }

    /// Actual position, not wrapped to 32 bits.
    pub(super) fn position_wide(&self) -> i64 {
        nearest(self.motor.position) - self.origin
    }

    /// Actual position; wraps at 32 bits.
    pub(super) fn position(&self) -> i32 {
        self.position_wide() as i32
    }

    pub(super) fn demand(&self) -> i32 {
        (nearest(self.motion.ramp.position) - self.origin) as i32
    }

    /// Demand minus actual position in modes that monitor it, otherwise 0.
    pub(super) fn following_error(&self) -> i32 {
        if self.power.is_energised() && self.motion.monitors_following_error(self.mode) {
            (self.motion.ramp.position - self.motor.position) as i32
        } else {
            0
        }
    }

    /// A velocity in revolutions per minute.
    pub(super) fn rpm(&self, velocity: f64) -> i64 {
        nearest(velocity * 60.0 / self.motor.increments_per_revolution())
    }

    pub(super) fn switches(&self) -> Switches {
        Switches::at(self.motor.position, &self.config.motor)
    }

    /// Sets the mode that is active after start.
    pub(super) fn preset_mode(&mut self, raw: i8) {
        if !self.power.is_energised() {
            self.mode = OperatingMode::from_raw(raw);
            self.trace.add(self.now, TraceEvent::Mode(self.mode));
        }
    }

    /// Restarts after loss of supply or a reset of the device, with the power stage off.
    pub(super) fn restart(&mut self, supply_lost: bool) {
        let was_energised = self.power.is_energised();
        self.power = PowerStage::new();
        self.trace.add_state(self.now, self.power.state, TraceCause::Restart);
        if was_energised {
            self.trace_release(TraceCause::Restart);
        }
        self.motion.follow_motor(&self.motor);
        self.motion.homing = HomingResult::None;
        self.mode = None;
        self.trace.add(self.now, TraceEvent::Mode(None));
        self.next_mode = None;
        self.targets = Targets::default();
        self.probes = TouchProbes::default();
        self.following_error_since = None;
        self.at_limit = false;
        self.report = None;
        if supply_lost && !self.config.motor.absolute_encoder {
            self.origin = nearest(self.motor.position);
        }
    }

    pub(super) fn block(&mut self, until: u64) {
        self.blocked_until = Some(until);
        self.motor.is_blocked = true;
    }

    pub(super) fn is_live(&self) -> bool {
        self.power.is_energised() || self.motor.velocity != 0.0
    }

    pub(super) fn next_tick(&self) -> Option<u64> {
        self.is_live().then_some(self.next_tick)
    }

    /// The last controller tick up to `now` that has not run yet.
    pub(super) fn missed_tick(&self, now: u64) -> Option<u64> {
        (self.next_tick <= now && self.is_live()).then(|| now / self.period * self.period)
    }

    /// Time of the next event that others can observe. Controller ticks can run late, except one
    /// that may detect a fault.
    pub(super) fn next_event(&self, parameters: &Parameters) -> Option<u64> {
        let mode = self.next_mode.map(|(_, at)| at);
        let fault = self.earliest_fault(parameters);
        earliest([fault, mode, self.power.enabled_at, self.blocked_until])
    }

    /// The first tick that can detect a following error.
    fn earliest_fault(&self, parameters: &Parameters) -> Option<u64> {
        if !self.monitors_following_error(parameters) {
            return None;
        }
        let since = self.following_error_since.unwrap_or(self.next_tick);
        let at = since.saturating_add(parameters.following_time);
        if at <= self.next_tick {
            return Some(self.next_tick);
        }
        Some(at.div_ceil(self.period).saturating_mul(self.period))
    }

    /// Advances the clock. The controllers of all drives tick together, at multiples of their
    /// period.
    fn set_now(&mut self, now: u64) {
        self.now = now;
        if now == self.next_tick {
            self.next_tick = now.saturating_add(self.period);
        } else if now > self.next_tick {
            self.next_tick = (now / self.period + 1).saturating_mul(self.period);
        }
    }

    pub(super) fn advance(&mut self, to: u64, parameters: &Parameters) {
        while self.now < to {
            if !self.is_live() {
                self.set_now(to);
                break;
            }
            let end = self.next_tick.min(to);
            self.step(end, parameters);
        }
        if self.blocked_until.is_some_and(|at| at <= self.now) {
            self.blocked_until = None;
            self.motor.is_blocked = false;
        }
        let action = self.power.finish_enabling(self.now);
        self.execute(action, TraceCause::Drive, parameters);
        if let Some((mode, at)) = self.next_mode
            && at <= self.now
        {
            self.next_mode = None;
            self.change_mode(mode, parameters);
        }
    }

    fn step(&mut self, end: u64, parameters: &Parameters) {
        let ns = end - self.now;
        let seconds = if ns == self.period { self.period_seconds } else { seconds(ns) };
        let is_tick = end == self.next_tick;
        self.set_now(end);
        let before = self.motor.position;
        self.step_motion(ns, seconds, parameters);
        self.probes.step(before, &self.motor, self.origin, &self.config.motor);
        if is_tick && self.trace.is_on() {
            let Motor { position, velocity, torque, .. } = self.motor;
            let sample = MotionSample { position, velocity, torque };
            self.trace.add(end, TraceEvent::Motion(sample));
        }
    }

    fn step_motion(&mut self, ns: u64, seconds: f64, parameters: &Parameters) {
        if !self.power.is_energised() {
            self.motor.offsets = Offsets::default();
            self.motor.advance(seconds, Actuation::Free);
            self.motion.follow_motor(&self.motor);
            return;
        }
        self.motor.offsets = self.offsets();
        let (actuation, found) = self.motion.step(seconds, &self.motor, parameters);
        self.motor.advance(seconds, actuation);
        if let Some(reference) = found {
            // The zero position is the home offset away from the reference (CiA 402-2, 0x607C).
            self.origin = nearest(reference) + i64::from(parameters.home_offset);
            self.history.restart();
        }
        self.motion.update_window(ns, &self.motor, parameters);
        if self.power.has_next_state() && self.motion.has_stopped(&self.motor) {
            let action = self.power.finish_stop();
            self.execute(action, TraceCause::Drive, parameters);
        }
        self.update_following_error(parameters);
    }

    /// The offsets take effect while the drive follows cyclic targets, not while it stops.
    fn offsets(&self) -> Offsets {
        let velocity = f64::from(self.targets.velocity_offset);
        let torque = f64::from(self.targets.torque_offset);
        if !self.motion.follows_cyclic_targets() {
            return Offsets::default();
        }
        match self.mode {
            Some(OperatingMode::CyclicPosition | OperatingMode::CyclicVelocity) => {
                Offsets { velocity, torque }
            }
            Some(OperatingMode::CyclicTorque) => Offsets { velocity: 0.0, torque },
            _ => Offsets::default(),
        }
    }

    fn update_following_error(&mut self, parameters: &Parameters) {
        if !self.exceeds_window(parameters) {
            self.following_error_since = None;
            return;
        }
        let since = *self.following_error_since.get_or_insert(self.now);
        if self.now - since >= parameters.following_time {
            self.fault(FOLLOWING_ERROR, parameters);
        }
    }

    fn exceeds_window(&self, parameters: &Parameters) -> bool {
        self.monitors_following_error(parameters)
            && self.following_error().unsigned_abs() > parameters.following_window
    }

    fn monitors_following_error(&self, parameters: &Parameters) -> bool {
        parameters.following_window != u32::MAX && self.power.state == DriveState::OperationEnabled
    }

    pub(super) fn fault(&mut self, code: u16, parameters: &Parameters) {
        if self.power.is_faulted() {
            return;
        }
        self.report = Some(Report::Fault(code));
        self.following_error_since = None;
        let action = self.power.fault(parameters);
        self.execute(action, TraceCause::Fault(code), parameters);
    }

    /// Applies the reaction to loss of the host (0x6007).
    pub(super) fn host_lost(&mut self, code: u16, parameters: &Parameters) {
        match parameters.node_loss {
            NodeLossReaction::Fault => self.fault(code, parameters),
            NodeLossReaction::DisableVoltage if self.power.is_energised() => {
                let action = self.power.release(DriveState::SwitchOnDisabled);
                self.execute(action, TraceCause::HostLost(code), parameters);
            }
            NodeLossReaction::QuickStop if self.power.state == DriveState::OperationEnabled => {
                let action = self.power.quick_stop(parameters);
                self.execute(action, TraceCause::HostLost(code), parameters);
            }
            _ => {}
        }
    }

    pub(super) fn execute(&mut self, action: Action, cause: TraceCause, parameters: &Parameters) {
        self.trace.add_state(self.now, self.power.state, cause);
        match action {
            Action::None => {}
            Action::Enable => {
                self.trace.add(self.now, TraceEvent::Enable { cause });
                self.enable(parameters);
            }
            Action::Release => {
                self.trace_release(cause);
                self.motion.follow_motor(&self.motor);
            }
            Action::Stop(mode) => {
                let deceleration = self.stop(mode, parameters);
                self.trace.add(self.now, TraceEvent::Stop { deceleration, cause });
            }
            Action::Reset => self.report = Some(Report::FaultReset),
        }
    }

    pub(super) fn enable(&mut self, parameters: &Parameters) {
        self.motion.enable(&self.motor);
        self.history.restart();
        self.following_error_since = None;
        self.at_limit = false;
        let old = self.config.quirks.follows_old_target;
        match self.mode {
            Some(OperatingMode::ProfileVelocity) => self.follow_velocity(),
            Some(OperatingMode::ProfileTorque) => self.follow_torque(),
            Some(OperatingMode::Velocity) => self.follow_vl_velocity(),
            Some(OperatingMode::CyclicPosition) if old => self.follow_position(parameters),
            _ => {}
        }
    }

    fn trace_release(&mut self, cause: TraceCause) {
        let velocity = self.motor.velocity;
        self.trace.add(self.now, TraceEvent::Release { velocity, cause });
    }

    /// Begins to decelerate; returns the deceleration.
    pub(super) fn stop(&mut self, mode: StopMode, parameters: &Parameters) -> f64 {
        let deceleration = match mode {
            StopMode::Profile => parameters.profile.deceleration,
            StopMode::Quick => parameters.quick_deceleration,
            StopMode::Limit => self.motor.max_acceleration(),
        };
        self.motion.stop(&self.motor, deceleration);
        deceleration
    }

    pub(super) fn finish_self_test(&mut self) {
        self.power.finish_self_test();
        self.trace.add_state(self.now, self.power.state, TraceCause::Drive);
    }

    /// The statusword without the bits that belong to the device.
    pub(super) fn statusword(&self, parameters: &Parameters) -> Statusword {
        let state = self.power.state;
        let mut word = Statusword::of_state(state).0;
        if state == DriveState::OperationEnabled {
            let command = self.power.controlword;
            word |= self.motion.status_bits(self.mode, command, &self.motor, parameters);
            if self.exceeds_window(parameters) {
                word |= Statusword::MODE_13;
            }
            if self.at_limit {
                word |= Statusword::INTERNAL_LIMIT;
            }
        }
        Statusword(word)
    }
}

fn seconds(ns: u64) -> f64 {
    ns as f64 / 1e9
}
