//! Modes of operation: from targets to what the motor is made to do. Positions are mechanical.

use ecan_canopen::{Controlword, OperatingMode, Statusword};

use super::homing::{Finding, Homing};
use super::motor::{Actuation, Motor};
use super::parameters::Parameters;
use super::ramp::{Bounds, Ramp};
use super::settings::MotorConfig;

/// Whether the drive knows a mode.
pub(super) const fn is_supported(mode: OperatingMode) -> bool {
    matches!(
        mode,
        OperatingMode::ProfilePosition
            | OperatingMode::ProfileVelocity
            | OperatingMode::Homing
            | OperatingMode::CyclicPosition
            | OperatingMode::CyclicVelocity
            | OperatingMode::CyclicTorque
    )
}

/// The demand in a mode.
#[derive(Clone, Copy, Debug)]
enum MotionDemand {
    /// Brake, then stand.
    Hold,
    /// Brake with this deceleration for a stop or halt, then stand.
    Stop { deceleration: f64 },
    /// Go straight from one cyclic position to the next.
    Interpolate { from: f64, to: f64, elapsed: f64, duration: f64, velocity: f64 },
    /// Turn as told, increments per second.
    Velocity(f64),
    /// Push as told, thousandths.
    Torque(f64),
    /// Go to the set-point.
    Profile,
    /// Turn towards the speed told, with the profile's acceleration.
    ProfileVelocity(f64),
    /// Look for the reference.
    Home(Homing),
}

/// Set-points of profile position.
#[derive(Clone, Copy, Debug, Default)]
struct SetPoints {
    current: Option<f64>,
    next: Option<f64>,
    /// Last set-point, reached or not.
    goal: Option<f64>,
    acknowledged: bool,
}

/// How homing ended, if it ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum HomingResult {
    None,
    Attained,
    Failed,
}

/// The demand side of the drive.
#[derive(Clone, Debug)]
pub(super) struct Motion {
    settings: MotorConfig,
    ramp: Ramp,
    course: MotionDemand,
    set_points: SetPoints,
    homing: HomingResult,
    /// For how long the motor has been at the set-point, nanoseconds.
    in_window: u64,
}

impl Motion {
    pub(super) fn new(settings: MotorConfig) -> Self {
        Self {
            settings,
            ramp: Ramp::at(f64::from(settings.start_position)),
            course: MotionDemand::Hold,
            set_points: SetPoints::default(),
            homing: HomingResult::None,
            in_window: 0,
        }
    }

    /// Demanded position.
    pub(super) const fn position(&self) -> f64 {
        self.ramp.position
    }

    /// Demanded speed.
    pub(super) const fn velocity(&self) -> f64 {
        self.ramp.velocity
    }

    /// Takes up the motor where it is: it brakes and stands until a target comes.
    pub(super) fn take_up(&mut self, motor: &Motor) {
        self.ramp = Ramp { position: motor.position(), velocity: motor.velocity() };
        self.course = MotionDemand::Hold;
        self.set_points = SetPoints::default();
        self.in_window = 0;
    }

    /// Forgets that the reference was found.
    pub(super) fn forget_home(&mut self) {
        self.homing = HomingResult::None;
    }

    /// While the power stage is off the demand is where the motor is.
    pub(super) fn shadow(&mut self, motor: &Motor) {
        self.ramp = Ramp::at(motor.position());
        self.course = MotionDemand::Hold;
    }

    /// Stops with a deceleration, then stands, whatever the mode.
    pub(super) fn stop(&mut self, motor: &Motor, deceleration: f64) {
        if !self.is_position_controlled() {
            self.ramp = Ramp { position: motor.position(), velocity: motor.velocity() };
        }
        self.course = MotionDemand::Stop { deceleration };
    }

    /// Whether a stop has been ordered and the motor stands.
    pub(super) fn has_stopped(&self, motor: &Motor) -> bool {
        matches!(self.course, MotionDemand::Stop { .. })
            && self.ramp.velocity == 0.0
            && motor.has_settled()
    }

    /// Goes on after a halt: profile modes with what they were about, others wait for a target.
    pub(super) fn go_on(&mut self) {
        if matches!(self.course, MotionDemand::Stop { .. }) {
            self.course = match self.set_points.current {
                Some(_) => MotionDemand::Profile,
                None => MotionDemand::Hold,
            };
        }
    }

    const fn is_stopping(&self) -> bool {
        matches!(self.course, MotionDemand::Stop { .. })
    }

    const fn is_position_controlled(&self) -> bool {
        !matches!(
            self.course,
            MotionDemand::Velocity(_) | MotionDemand::Torque(_) | MotionDemand::ProfileVelocity(_)
        )
    }

    /// Whether the distance between demand and motor is a following error in this mode.
    pub(super) const fn watches_following(&self, mode: Option<OperatingMode>) -> bool {
        self.is_position_controlled()
            && matches!(
                mode,
                Some(
                    OperatingMode::CyclicPosition
                        | OperatingMode::ProfilePosition
                        | OperatingMode::Homing
                )
            )
    }

    /// A cyclic position, to be reached after `duration` seconds.
    pub(super) fn cyclic_position(&mut self, to: f64, duration: f64) {
        if !self.is_stopping() {
            let from = self.ramp.position;
            let velocity = (to - from) / duration;
            self.course = MotionDemand::Interpolate { from, to, elapsed: 0.0, duration, velocity };
        }
    }

    /// A cyclic speed.
    pub(super) fn cyclic_velocity(&mut self, velocity: f64) {
        if !self.is_stopping() {
            self.course = MotionDemand::Velocity(velocity);
        }
    }

    /// A cyclic torque.
    pub(super) fn cyclic_torque(&mut self, torque: f64) {
        if !self.is_stopping() {
            self.course = MotionDemand::Torque(torque);
        }
    }

    /// The speed of profile velocity.
    pub(super) fn profile_velocity(&mut self, velocity: f64) {
        if !self.is_stopping() {
            self.course = MotionDemand::ProfileVelocity(velocity);
        }
    }

    /// Bit 4 of the controlword has risen in profile position: a new set-point, if there is room.
    pub(super) fn set_point(&mut self, position: f64, at_once: bool) {
        let set_points = &mut self.set_points;
        if set_points.next.is_some() {
            return;
        }
        set_points.acknowledged = true;
        if at_once || set_points.current.is_none() {
            set_points.current = Some(position);
            set_points.goal = Some(position);
            self.in_window = 0;
            if !self.is_stopping() {
                self.course = MotionDemand::Profile;
            }
        } else {
            set_points.next = Some(position);
        }
    }

    /// What a relative set-point counts from.
    pub(super) fn set_point_base(&self) -> f64 {
        let set_points = &self.set_points;
        set_points.next.or(set_points.current).or(set_points.goal).unwrap_or(self.ramp.position)
    }

    /// Bit 4 of the controlword is low in profile position.
    pub(super) fn release_set_point(&mut self) {
        if self.set_points.next.is_none() {
            self.set_points.acknowledged = false;
        }
    }

    /// Begins homing. False when the method is not known.
    pub(super) fn home(&mut self, method: i8, motor: &Motor) -> bool {
        self.homing = HomingResult::None;
        match Homing::begin(method, motor.position(), &self.settings) {
            Some(homing) => {
                self.course = MotionDemand::Home(homing);
                true
            }
            None => {
                self.homing = HomingResult::Failed;
                false
            }
        }
    }

    /// Breaks homing off.
    pub(super) fn leave_home(&mut self) {
        if matches!(self.course, MotionDemand::Home(_)) {
            self.course = MotionDemand::Hold;
        }
    }

    /// One step of the demand; gives what the motor has to do, and the mechanical position of the
    /// reference when homing finds it.
    pub(super) fn step(
        &mut self,
        seconds: f64,
        motor: &Motor,
        parameters: &Parameters,
    ) -> (Actuation, Option<f64>) {
        let mut found = None;
        match self.course {
            MotionDemand::Hold => self.brake(seconds, parameters.profile.deceleration),
            MotionDemand::Stop { deceleration } => self.brake(seconds, deceleration),
            MotionDemand::Interpolate { from, to, elapsed, duration, velocity } => {
                let elapsed = elapsed + seconds;
                if elapsed >= duration {
                    self.ramp = Ramp::at(to);
                    // The speed of the way just finished counts until the next target is late.
                    self.ramp.velocity = if elapsed < 1.5 * duration { velocity } else { 0.0 };
                } else {
                    self.ramp = Ramp { position: from + velocity * elapsed, velocity };
                }
                self.course = MotionDemand::Interpolate { from, to, elapsed, duration, velocity };
            }
            MotionDemand::Velocity(velocity) => {
                self.ramp = Ramp { position: motor.position(), velocity };
                return (Actuation::Velocity(velocity), None);
            }
            MotionDemand::Torque(torque) => {
                self.ramp = Ramp { position: motor.position(), velocity: motor.velocity() };
                return (Actuation::Torque(torque), None);
            }
            MotionDemand::ProfileVelocity(velocity) => {
                let bounds =
                    Bounds { velocity: parameters.max_profile_velocity, ..parameters.profile };
                self.ramp.towards_velocity(seconds, velocity, &bounds);
                self.ramp.position = motor.position();
                return (Actuation::Velocity(self.ramp.velocity), None);
            }
            MotionDemand::Profile => self.go_to_set_point(seconds, parameters),
            MotionDemand::Home(homing) => {
                found = self.look_for_home(seconds, homing, motor, parameters)
            }
        }
        let Ramp { position, velocity } = self.ramp;
        (Actuation::Position { position, velocity }, found)
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
                self.set_points.goal = Some(next);
                self.in_window = 0;
            }
        }
    }

    fn look_for_home(
        &mut self,
        seconds: f64,
        mut homing: Homing,
        motor: &Motor,
        parameters: &Parameters,
    ) -> Option<f64> {
        let acceleration = parameters.homing_acceleration;
        match homing.look(motor.position(), &self.settings) {
            Finding::Go { positive, fast } => {
                let speed = if fast { parameters.homing_fast } else { parameters.homing_slow };
                let velocity = if positive { speed } else { -speed };
                let bounds = Bounds { velocity: speed, acceleration, deceleration: acceleration };
                self.ramp.towards_velocity(seconds, velocity, &bounds);
                self.course = MotionDemand::Home(homing);
                None
            }
            Finding::Home(position) => {
                self.homing = HomingResult::Attained;
                self.course = MotionDemand::Hold;
                self.brake(seconds, acceleration);
                Some(position)
            }
            Finding::Failed => {
                self.homing = HomingResult::Failed;
                self.course = MotionDemand::Hold;
                self.brake(seconds, acceleration);
                None
            }
        }
    }

    /// Judges whether the set-point has been reached, after `ns` more.
    pub(super) fn watch_window(&mut self, ns: u64, motor: &Motor, parameters: &Parameters) {
        let inside = self.set_points.goal.is_some_and(|goal| {
            (goal - motor.position()).abs() <= f64::from(parameters.position_window)
        });
        self.in_window = if inside { self.in_window.saturating_add(ns) } else { 0 };
    }

    /// Bits 10, 12 and 13 of the statusword, in Operation Enabled.
    pub(super) fn status_bits(
        &self,
        mode: Option<OperatingMode>,
        halted: bool,
        motor: &Motor,
        parameters: &Parameters,
    ) -> u16 {
        let bit = |set: bool, bit: u16| if set { bit } else { 0 };
        let still = motor.has_settled() && self.ramp.velocity == 0.0;
        let (reached, bit_12, bit_13) = match mode {
            Some(OperatingMode::ProfilePosition) => {
                let idle = self.set_points.current.is_none() && self.set_points.next.is_none();
                let there = idle && self.in_window >= parameters.position_window_time.max(1);
                (if halted { still } else { there }, self.set_points.acknowledged, false)
            }
            Some(OperatingMode::ProfileVelocity) => {
                let near = match self.course {
                    MotionDemand::ProfileVelocity(target) => {
                        (motor.velocity() - target).abs() <= parameters.velocity_window
                    }
                    _ => true,
                };
                let slow = motor.velocity().abs() <= parameters.velocity_window;
                (if halted { still } else { near }, slow, false)
            }
            Some(OperatingMode::Homing) => {
                let attained = self.homing == HomingResult::Attained;
                let running = matches!(self.course, MotionDemand::Home(_));
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

/// What bits 4 to 6 and 8 of a controlword say that those of the one before did not.
#[derive(Clone, Copy, Debug)]
pub(super) struct ModeBits {
    pub(super) rises: bool,
    pub(super) falls: bool,
    pub(super) at_once: bool,
    pub(super) relative: bool,
    pub(super) halt: bool,
    pub(super) halt_ends: bool,
}

impl ModeBits {
    pub(super) const fn of(word: Controlword, previous: Controlword) -> Self {
        let now = word.has(Controlword::MODE_4);
        let before = previous.has(Controlword::MODE_4);
        Self {
            rises: now && !before,
            falls: !now && before,
            at_once: word.has(Controlword::MODE_5),
            relative: word.has(Controlword::MODE_6),
            halt: word.has(Controlword::HALT),
            halt_ends: !word.has(Controlword::HALT) && previous.has(Controlword::HALT),
        }
    }
}
