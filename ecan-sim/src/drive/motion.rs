//! Modes of operation: from targets to the actuation of the motor. Positions are mechanical.

use std::collections::VecDeque;

use ecan_canopen::{Controlword, OperatingMode, Statusword};

use super::config::MotorConfig;
use super::homing::{Finding, Homing};
use super::motor::{Actuation, Motor};
use super::parameters::{Bounds, Parameters, Ramp};

/// Most set-points of the interpolated position mode that wait (0x60C4:01).
pub(super) const INTERPOLATION_BUFFER: usize = 8;

pub(super) const fn is_supported(mode: OperatingMode) -> bool {
    matches!(
        mode,
        OperatingMode::ProfilePosition
            | OperatingMode::Velocity
            | OperatingMode::ProfileVelocity
            | OperatingMode::ProfileTorque
            | OperatingMode::Homing
            | OperatingMode::InterpolatedPosition
            | OperatingMode::CyclicPosition
            | OperatingMode::CyclicVelocity
            | OperatingMode::CyclicTorque
    )
}

#[derive(Clone, Copy, Debug)]
pub(super) enum MotionDemand {
    /// Decelerate, then hold the position.
    Hold,
    /// Decelerate for a stop or halt, then hold the position.
    Stop {
        deceleration: f64,
    },
    /// Interpolate between two cyclic positions.
    Interpolate {
        from: f64,
        to: f64,
        elapsed: f64,
        duration: f64,
        velocity: f64,
    },
    /// Constant velocity, increments per second.
    Velocity(f64),
    /// Torque in thousandths of the rated torque.
    Torque(f64),
    Profile,
    /// Ramp to this velocity with the profile acceleration.
    ProfileVelocity(f64),
    /// Ramp to this torque with the torque slope.
    ProfileTorque(f64),
    /// Ramp to this velocity, revolutions per minute, with the ramps of the velocity mode.
    VlVelocity(f64),
    Home(Homing),
}

#[derive(Clone, Copy, Debug, Default)]
struct SetPoints {
    current: Option<f64>,
    next: Option<f64>,
    /// Last set-point, reached or not.
    target: Option<f64>,
    acknowledged: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum HomingResult {
    None,
    Attained,
    Failed,
}

#[derive(Clone, Debug)]
pub(super) struct Motion {
    config: MotorConfig,
    pub(super) ramp: Ramp,
    demand: MotionDemand,
    set_points: SetPoints,
    pub(super) homing: HomingResult,
    /// Time for which the motor has been within the position window, ns.
    in_window: u64,
    /// Set-points of the interpolated position mode that wait.
    waiting: VecDeque<f64>,
    /// Torque demand of the profile torque mode.
    torque: f64,
}

impl Motion {
    pub(super) fn new(config: MotorConfig) -> Self {
        Self {
            config,
            ramp: Ramp::at(f64::from(config.start_position)),
            demand: MotionDemand::Hold,
            set_points: SetPoints::default(),
            homing: HomingResult::None,
            in_window: 0,
            waiting: VecDeque::with_capacity(INTERPOLATION_BUFFER),
            torque: 0.0,
        }
    }

    /// Enables the axis at the present motor position; it stops and holds until a target arrives.
    pub(super) fn enable(&mut self, motor: &Motor) {
        self.ramp = Ramp { position: motor.position, velocity: motor.velocity };
        self.demand = MotionDemand::Hold;
        self.set_points = SetPoints::default();
        self.in_window = 0;
        self.waiting.clear();
        self.torque = 0.0;
    }

    /// Sets the demand to the motor position while the power stage is off.
    pub(super) fn follow_motor(&mut self, motor: &Motor) {
        self.ramp = Ramp::at(motor.position);
        self.demand = MotionDemand::Hold;
    }

    /// Decelerates and then holds the position, in any mode.
    pub(super) fn stop(&mut self, motor: &Motor, deceleration: f64) {
        if !self.is_position_controlled() {
            self.ramp = Ramp { position: motor.position, velocity: motor.velocity };
        }
        self.demand = MotionDemand::Stop { deceleration };
        self.waiting.clear();
        self.torque = 0.0;
    }

    pub(super) fn has_stopped(&self, motor: &Motor) -> bool {
        self.is_stopping() && self.ramp.velocity == 0.0 && motor.has_settled()
    }

    /// Continues after a halt: profile modes with their set-point, others hold until a target
    /// arrives.
    pub(super) fn resume(&mut self) {
        if self.is_stopping() {
            self.demand = match self.set_points.current {
                Some(_) => MotionDemand::Profile,
                None => MotionDemand::Hold,
            };
        }
    }

    const fn is_stopping(&self) -> bool {
        matches!(self.demand, MotionDemand::Stop { .. })
    }

    pub(super) const fn follows_cyclic_targets(&self) -> bool {
        matches!(
            self.demand,
            MotionDemand::Interpolate { .. } | MotionDemand::Velocity(_) | MotionDemand::Torque(_)
        )
    }

    const fn is_position_controlled(&self) -> bool {
        !matches!(
            self.demand,
            MotionDemand::Velocity(_)
                | MotionDemand::Torque(_)
                | MotionDemand::ProfileVelocity(_)
                | MotionDemand::ProfileTorque(_)
                | MotionDemand::VlVelocity(_)
        )
    }

    pub(super) const fn monitors_following_error(&self, mode: Option<OperatingMode>) -> bool {
        self.is_position_controlled()
            && matches!(
                mode,
                Some(
                    OperatingMode::CyclicPosition
                        | OperatingMode::InterpolatedPosition
                        | OperatingMode::ProfilePosition
                        | OperatingMode::Homing
                )
            )
    }

    /// Follows a demand, except during a stop.
    pub(super) fn follow(&mut self, demand: MotionDemand) {
        if !self.is_stopping() {
            self.demand = demand;
        }
    }

    /// Follows a cyclic position to reach after `duration` seconds.
    pub(super) fn follow_position(&mut self, to: f64, duration: f64) {
        let from = self.ramp.position;
        let velocity = (to - from) / duration;
        self.follow(MotionDemand::Interpolate { from, to, elapsed: 0.0, duration, velocity });
    }

    /// Takes a set-point of the interpolated position mode. It waits in the buffer while the one before
    /// is not reached; if the buffer is full it is dropped.
    pub(super) fn interpolate(&mut self, to: f64, duration: f64, buffer: usize) {
        let is_under_way = match self.demand {
            MotionDemand::Interpolate { elapsed, duration, .. } => elapsed < duration,
            _ => false,
        };
        if !is_under_way && self.waiting.is_empty() {
            self.follow_position(to, duration);
        } else if self.waiting.len() < buffer.min(INTERPOLATION_BUFFER) {
            self.waiting.push_back(to);
        }
    }

    /// Ends the interpolated motion: bit 4 of the controlword fell.
    pub(super) fn end_interpolation(&mut self) {
        self.waiting.clear();
        self.follow(MotionDemand::Hold);
    }

    /// Handles a rising edge of controlword bit 4 in profile position: a new set-point, if the
    /// buffer has room.
    pub(super) fn set_point(&mut self, position: f64, immediate: bool) {
        let set_points = &mut self.set_points;
        if set_points.next.is_some() {
            return;
        }
        set_points.acknowledged = true;
        if immediate || set_points.current.is_none() {
            set_points.current = Some(position);
            set_points.target = Some(position);
            self.in_window = 0;
            self.follow(MotionDemand::Profile);
        } else {
            set_points.next = Some(position);
        }
    }

    /// The position to which a relative set-point is added.
    pub(super) fn set_point_base(&self) -> f64 {
        let set_points = &self.set_points;
        set_points.next.or(set_points.current).or(set_points.target).unwrap_or(self.ramp.position)
    }

    /// Handles a low bit 4 of the controlword in profile position.
    pub(super) fn release_set_point(&mut self) {
        if self.set_points.next.is_none() {
            self.set_points.acknowledged = false;
        }
    }

    /// Starts homing; it fails if the method is not supported.
    pub(super) fn start_homing(&mut self, method: i8, motor: &Motor) {
        match Homing::begin(method, motor.position, &self.config) {
            Some(homing) => {
                self.homing = HomingResult::None;
                self.demand = MotionDemand::Home(homing);
            }
            None => self.homing = HomingResult::Failed,
        }
    }

    pub(super) fn abort_homing(&mut self) {
        if matches!(self.demand, MotionDemand::Home(_)) {
            self.demand = MotionDemand::Hold;
        }
    }

    /// Advances the demand by one step. Returns the actuation, and the mechanical position of the
    /// reference when homing finds it.
    pub(super) fn step(
        &mut self,
        seconds: f64,
        motor: &Motor,
        parameters: &Parameters,
    ) -> (Actuation, Option<f64>) {
        let mut found = None;
        match self.demand {
            MotionDemand::Hold => self.brake(seconds, parameters.profile.deceleration),
            MotionDemand::Stop { deceleration } => self.brake(seconds, deceleration),
            MotionDemand::Interpolate { from, to, elapsed, duration, velocity } => {
                let elapsed = elapsed + seconds;
                if elapsed >= duration {
                    self.ramp = Ramp::at(to);
                    if let Some(next) = self.waiting.pop_front() {
                        self.continue_interpolation(to, next, elapsed - duration, duration);
                        let Ramp { position, velocity } = self.ramp;
                        return (Actuation::Position { position, velocity }, None);
                    }
                    // Velocity of the finished segment, kept until the next target is late.
                    self.ramp.velocity = if elapsed < 1.5 * duration { velocity } else { 0.0 };
                } else {
                    self.ramp = Ramp { position: from + velocity * elapsed, velocity };
                }
                self.demand = MotionDemand::Interpolate { from, to, elapsed, duration, velocity };
            }
            MotionDemand::Velocity(velocity) => {
                self.ramp = Ramp { position: motor.position, velocity };
                return (Actuation::Velocity(velocity), None);
            }
            MotionDemand::Torque(torque) => {
                self.ramp = Ramp { position: motor.position, velocity: motor.velocity };
                return (Actuation::Torque(torque), None);
            }
            MotionDemand::ProfileVelocity(velocity) => {
                let bounds =
                    Bounds { velocity: parameters.max_profile_velocity, ..parameters.profile };
                self.ramp.towards_velocity(seconds, velocity, &bounds);
                self.ramp.position = motor.position;
                return (Actuation::Velocity(self.ramp.velocity), None);
            }
            MotionDemand::ProfileTorque(torque) => {
                let change = parameters.torque_slope * seconds;
                self.torque += (torque - self.torque).clamp(-change, change);
                self.ramp = Ramp { position: motor.position, velocity: motor.velocity };
                return (Actuation::Torque(self.torque), None);
            }
            MotionDemand::VlVelocity(target) => {
                let velocity = parameters.vl.velocity(target);
                self.ramp.towards_velocity(seconds, velocity, &parameters.vl.bounds);
                self.ramp.position = motor.position;
                return (Actuation::Velocity(self.ramp.velocity), None);
            }
            MotionDemand::Profile => self.go_to_set_point(seconds, parameters),
            MotionDemand::Home(homing) => {
                found = self.search_home(seconds, homing, motor, parameters)
            }
        }
        let Ramp { position, velocity } = self.ramp;
        (Actuation::Position { position, velocity }, found)
    }

    /// Begins the segment to the next set-point, `elapsed` seconds ago.
    fn continue_interpolation(&mut self, from: f64, to: f64, elapsed: f64, duration: f64) {
        let velocity = (to - from) / duration;
        self.demand = MotionDemand::Interpolate { from, to, elapsed, duration, velocity };
        self.ramp = Ramp { position: from + velocity * elapsed, velocity };
    }

    fn brake(&mut self, seconds: f64, deceleration: f64) {
        let bounds = Bounds { velocity: f64::MAX, acceleration: deceleration, deceleration };
        self.ramp.towards_velocity(seconds, 0.0, &bounds);
    }

    fn go_to_set_point(&mut self, seconds: f64, parameters: &Parameters) {
        let Some(target) = self.set_points.current else {
            return self.brake(seconds, parameters.profile.deceleration);
        };
        if self.ramp.towards_position(seconds, target, &parameters.profile) {
            self.set_points.current = self.set_points.next.take();
            if let Some(next) = self.set_points.current {
                self.set_points.target = Some(next);
                self.in_window = 0;
            }
        }
    }

    fn search_home(
        &mut self,
        seconds: f64,
        mut homing: Homing,
        motor: &Motor,
        parameters: &Parameters,
    ) -> Option<f64> {
        let acceleration = parameters.homing_acceleration;
        match homing.evaluate(motor.position, &self.config) {
            Finding::Go { positive, fast } => {
                let speed = if fast { parameters.homing_fast } else { parameters.homing_slow };
                let velocity = if positive { speed } else { -speed };
                let bounds = Bounds { velocity: speed, acceleration, deceleration: acceleration };
                self.ramp.towards_velocity(seconds, velocity, &bounds);
                self.demand = MotionDemand::Home(homing);
                None
            }
            Finding::Home(position) => {
                self.homing = HomingResult::Attained;
                self.demand = MotionDemand::Hold;
                self.brake(seconds, acceleration);
                Some(position)
            }
            Finding::Failed => {
                self.homing = HomingResult::Failed;
                self.demand = MotionDemand::Hold;
                self.brake(seconds, acceleration);
                None
            }
        }
    }

    /// Updates the time in the position window after `ns` more.
    pub(super) fn update_window(&mut self, ns: u64, motor: &Motor, parameters: &Parameters) {
        let inside = self.set_points.target.is_some_and(|target| {
            (target - motor.position).abs() <= f64::from(parameters.position_window)
        });
        self.in_window = if inside { self.in_window.saturating_add(ns) } else { 0 };
    }

    /// Bits 10, 12 and 13 of the statusword in Operation enabled.
    pub(super) fn status_bits(
        &self,
        mode: Option<OperatingMode>,
        word: Controlword,
        motor: &Motor,
        parameters: &Parameters,
    ) -> u16 {
        let halted = word.has(Controlword::HALT);
        let is_interpolating =
            word.has(Controlword::MODE_4) && parameters.interpolation_buffer.is_some();
        let bit = |set: bool, bit: u16| if set { bit } else { 0 };
        let still = motor.has_settled() && self.ramp.velocity == 0.0;
        let (reached, bit_12, bit_13) = match mode {
            Some(OperatingMode::ProfilePosition) => {
                let idle = self.set_points.current.is_none() && self.set_points.next.is_none();
                let there = idle && self.in_window >= parameters.position_window_time.max(1);
                (if halted { still } else { there }, self.set_points.acknowledged, false)
            }
            Some(OperatingMode::ProfileVelocity) => {
                let near = match self.demand {
                    MotionDemand::ProfileVelocity(target) => {
                        (motor.velocity - target).abs() <= parameters.velocity_window
                    }
                    _ => true,
                };
                let slow = motor.velocity.abs() <= parameters.velocity_window;
                (if halted { still } else { near }, slow, false)
            }
            Some(OperatingMode::ProfileTorque) => {
                let near = match self.demand {
                    MotionDemand::ProfileTorque(target) => self.torque == target,
                    _ => true,
                };
                (if halted { still } else { near }, false, false)
            }
            Some(OperatingMode::Velocity) => {
                let near = match self.demand {
                    MotionDemand::VlVelocity(target) => {
                        let target = parameters.vl.velocity(target);
                        (motor.velocity - target).abs() <= parameters.velocity_window
                    }
                    _ => true,
                };
                (if halted { still } else { near }, false, false)
            }
            Some(OperatingMode::InterpolatedPosition) => {
                let is_active = is_interpolating && !halted && !self.is_stopping();
                (self.waiting.is_empty() && still, is_active, false)
            }
            Some(OperatingMode::Homing) => {
                let attained = self.homing == HomingResult::Attained;
                let running = matches!(self.demand, MotionDemand::Home(_));
                let failed = self.homing == HomingResult::Failed;
                (!running && still, attained, failed)
            }
            Some(mode) if mode.is_cyclic() => (false, !halted && !self.is_stopping(), false),
            _ => (false, false, false),
        };
        bit(reached, Statusword::TARGET_REACHED)
            | bit(bit_12, Statusword::MODE_12)
            | bit(bit_13, Statusword::MODE_13)
    }
}
