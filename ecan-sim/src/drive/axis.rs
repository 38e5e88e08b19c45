//! The axis of the drive: power stage, motion and motor together, in the coordinates of the user.

use ecan_canopen::{Controlword, DriveState, NodeLossReaction, OperatingMode, Statusword};

use super::history::TargetHistory;
use super::homing::Switches;
use super::motion::Motion;
use super::motor::{Actuation, Motor};
use super::parameters::Parameters;
use super::power::{Action, PowerStage, StopMode};
use super::settings::DriveConfig;
use crate::earliest::earliest;

/// Following error too great for too long.
const FOLLOWING_ERROR: u16 = 0x8611;

/// Latest commands.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Targets {
    pub(super) position: i32,
    pub(super) velocity: i32,
    pub(super) torque: i16,
    pub(super) position_offset: i32,
    pub(super) velocity_offset: i32,
    pub(super) torque_offset: i16,
}

/// What the axis has to report to the rest of the drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Report {
    /// It has found a fault.
    Fault(u16),
    /// A fault has been reset.
    Reset,
}

/// One axis.
#[derive(Clone, Debug)]
pub(super) struct Axis {
    pub(super) settings: DriveConfig,
    pub(super) now: u64,
    /// Period of the controller, nanoseconds.
    period: u64,
    /// The same in seconds.
    period_seconds: f64,
    /// First multiple of the period behind `now`.
    next_tick: u64,
    pub(super) power: PowerStage,
    pub(super) motion: Motion,
    pub(super) motor: Motor,
    /// Mode in force; `None` is no mode.
    pub(super) mode: Option<OperatingMode>,
    /// Mode that comes into force, and when.
    pub(super) next_mode: Option<(Option<OperatingMode>, u64)>,
    pub(super) targets: Targets,
    /// Mechanical position of the user's zero.
    pub(super) origin: i64,
    /// Since when the following error has been too great.
    strayed_since: Option<u64>,
    pub(super) at_limit: bool,
    blocked_until: Option<u64>,
    pub(super) history: TargetHistory,
    report: Option<Report>,
}

impl Axis {
    pub(super) fn new(settings: &DriveConfig) -> Self {
        let period = u64::from(settings.motor.period_us.clamp(1, 1_000)) * 1_000;
        Self {
            settings: settings.clone(),
            now: 0,
            period,
            period_seconds: seconds(period),
            next_tick: period,
            power: PowerStage::new(),
            motion: Motion::new(settings.motor),
            motor: Motor::new(settings.motor),
            mode: None,
            next_mode: None,
            targets: Targets::default(),
            origin: 0,
            strayed_since: None,
            at_limit: false,
            blocked_until: None,
            history: TargetHistory::new(settings.history),
            report: None,
        }
    }

    pub(super) const fn motor(&self) -> &Motor {
        &self.motor
    }

    pub(super) const fn state(&self) -> DriveState {
        self.power.state()
    }

    pub(super) const fn controlword(&self) -> Controlword {
        self.power.controlword()
    }

    pub(super) const fn mode(&self) -> Option<OperatingMode> {
        self.mode
    }

    /// Something that has happened and the drive has not taken notice of.
    pub(super) fn take_report(&mut self) -> Option<Report> {
        self.report.take()
    }

    /// Actual position without the limits of 32 bits.
    pub(super) fn position_wide(&self) -> i64 {
        self.motor.position().round() as i64 - self.origin
    }

    /// Actual position. It runs over as 32 bits do.
    pub(super) fn position(&self) -> i32 {
        self.position_wide() as i32
    }

    /// Demanded position.
    pub(super) fn demand(&self) -> i32 {
        (self.motion.position().round() as i64 - self.origin) as i32
    }

    /// Demanded speed.
    pub(super) fn demanded_velocity(&self) -> i32 {
        self.motion.velocity() as i32
    }

    /// Distance between demand and motor where that is a following error.
    pub(super) fn following_error(&self) -> i32 {
        if self.power.is_energised() && self.motion.watches_following(self.mode) {
            (self.motion.position() - self.motor.position()) as i32
        } else {
            0
        }
    }

    pub(super) fn switches(&self) -> Switches {
        Switches::at(self.motor.position(), &self.settings.motor)
    }

    pub(super) const fn is_energised(&self) -> bool {
        self.power.is_energised()
    }

    /// The mode that the drive has from the beginning.
    pub(super) fn preset_mode(&mut self, raw: i8) {
        if !self.power.is_energised() {
            self.mode = OperatingMode::from_raw(raw);
        }
    }

    /// The self-test is over.
    pub(super) fn ready(&mut self) {
        self.power.ready();
    }

    /// Loss of supply, or a reset of the device: the power stage is off and knows nothing.
    pub(super) fn restart(&mut self, supply_lost: bool) {
        self.power = PowerStage::new();
        self.motion.shadow(&self.motor);
        self.motion.forget_home();
        self.mode = None;
        self.next_mode = None;
        self.targets = Targets::default();
        self.strayed_since = None;
        self.at_limit = false;
        self.report = None;
        if supply_lost && !self.settings.motor.absolute_encoder {
            self.origin = self.motor.position().round() as i64;
        }
    }

    /// Jams the machine until then.
    pub(super) fn block(&mut self, until: u64) {
        self.blocked_until = Some(until);
        self.motor.block(true);
    }

    pub(super) fn limit_torque(&mut self, parameters: &Parameters) {
        self.motor.limit_torque(parameters.max_torque);
    }

    /// Whether anything moves or may have to.
    pub(super) fn is_live(&self) -> bool {
        self.power.is_energised() || !self.motor.is_still()
    }

    /// When the controller ticks next, if it does.
    pub(super) fn next_tick(&self) -> Option<u64> {
        self.is_live().then_some(self.next_tick)
    }

    /// The last tick of the controller up to `now`, if it is still to come.
    pub(super) fn missed_tick(&self, now: u64) -> Option<u64> {
        (self.next_tick <= now && self.is_live()).then(|| now / self.period * self.period)
    }

    /// When something happens that others may notice at once. Ticks of the controller can be made
    /// up for, all but the one that may find a fault.
    pub(super) fn next_event(&self, parameters: &Parameters) -> Option<u64> {
        let mode = self.next_mode.map(|(_, at)| at);
        let fault = self.earliest_fault(parameters);
        earliest([fault, mode, self.power.enabled_at(), self.blocked_until])
    }

    /// The first tick that may find too great a following error for too long.
    fn earliest_fault(&self, parameters: &Parameters) -> Option<u64> {
        if !self.may_stray(parameters) {
            return None;
        }
        let since = self.strayed_since.unwrap_or(self.next_tick);
        let at = since.saturating_add(parameters.following_time);
        if at <= self.next_tick {
            return Some(self.next_tick);
        }
        Some(at.div_ceil(self.period).saturating_mul(self.period))
    }

    /// Moves the clock to a time that is not before its own.
    ///
    /// Controllers of all drives tick together, at multiples of their period.
    fn set_now(&mut self, now: u64) {
        self.now = now;
        if now == self.next_tick {
            self.next_tick = now.saturating_add(self.period);
        } else if now > self.next_tick {
            self.next_tick = (now / self.period + 1).saturating_mul(self.period);
        }
    }

    /// Lets time pass up to `to`.
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
            self.motor.block(false);
        }
        let action = self.power.brake_opens(self.now);
        self.act(action, parameters);
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
        self.set_now(end);
        if !self.power.is_energised() {
            self.motor.advance(seconds, Actuation::Free);
            self.motion.shadow(&self.motor);
            return;
        }
        let (actuation, found) = self.motion.step(seconds, &self.motor, parameters);
        self.motor.advance(seconds, actuation);
        if let Some(reference) = found {
            // Zero lies the home offset behind the reference (CiA 402-2, 0x607C).
            self.origin = reference.round() as i64 + i64::from(parameters.home_offset);
            self.history.restart();
        }
        self.motion.watch_window(ns, &self.motor, parameters);
        if self.power.is_leaving() && self.motion.has_stopped(&self.motor) {
            let action = self.power.stands();
            self.act(action, parameters);
        }
        self.watch_following(parameters);
    }

    fn watch_following(&mut self, parameters: &Parameters) {
        if !self.strays(parameters) {
            self.strayed_since = None;
            return;
        }
        let since = *self.strayed_since.get_or_insert(self.now);
        if self.now - since >= parameters.following_time {
            self.fault(FOLLOWING_ERROR, parameters);
        }
    }

    fn strays(&self, parameters: &Parameters) -> bool {
        self.may_stray(parameters)
            && self.following_error().unsigned_abs() > parameters.following_window
    }

    /// Whether a following error is watched.
    fn may_stray(&self, parameters: &Parameters) -> bool {
        parameters.following_window != u32::MAX
            && self.power.state() == DriveState::OperationEnabled
    }

    /// A fault has been found.
    pub(super) fn fault(&mut self, code: u16, parameters: &Parameters) {
        if matches!(self.power.state(), DriveState::FaultReactionActive | DriveState::Fault) {
            return;
        }
        self.report = Some(Report::Fault(code));
        self.strayed_since = None;
        let action = self.power.fault(parameters);
        self.act(action, parameters);
    }

    /// The host is gone (0x6007).
    pub(super) fn host_lost(&mut self, code: u16, parameters: &Parameters) {
        match parameters.node_loss {
            NodeLossReaction::None | NodeLossReaction::Other(_) => {}
            NodeLossReaction::Fault => self.fault(code, parameters),
            NodeLossReaction::DisableVoltage if self.power.is_energised() => {
                let action = self.power.release(DriveState::SwitchOnDisabled);
                self.act(action, parameters);
            }
            NodeLossReaction::QuickStop if self.power.state() == DriveState::OperationEnabled => {
                let action = self.power.quick_stop(parameters);
                self.act(action, parameters);
            }
            NodeLossReaction::DisableVoltage | NodeLossReaction::QuickStop => {}
        }
    }

    pub(super) fn act(&mut self, action: Action, parameters: &Parameters) {
        match action {
            Action::None => {}
            Action::TakeUp => self.take_up(parameters),
            Action::Free => self.motion.shadow(&self.motor),
            Action::Slow(slowing) => self.slow(slowing, parameters),
            Action::Reset => self.report = Some(Report::Reset),
        }
    }

    pub(super) fn take_up(&mut self, parameters: &Parameters) {
        self.motion.take_up(&self.motor);
        self.history.restart();
        self.strayed_since = None;
        self.at_limit = false;
        let old = self.settings.quirks.follows_old_target;
        match self.mode {
            Some(OperatingMode::ProfileVelocity) => self.follow_velocity(),
            Some(OperatingMode::CyclicPosition) if old => self.follow_position(parameters),
            _ => {}
        }
    }

    pub(super) fn slow(&mut self, slowing: StopMode, parameters: &Parameters) {
        let deceleration = match slowing {
            StopMode::Profile => parameters.profile.deceleration,
            StopMode::Quick => parameters.quick_deceleration,
            StopMode::Limit => self.motor.max_acceleration(),
        };
        self.motion.stop(&self.motor, deceleration);
    }

    /// The statusword, without the bits that are not the axis's.
    pub(super) fn statusword(&self, parameters: &Parameters) -> Statusword {
        let state = self.power.state();
        let mut word = Statusword::of_state(state).0;
        if state == DriveState::OperationEnabled {
            let halted = self.controlword().has(Controlword::HALT);
            word |= self.motion.status_bits(self.mode, halted, &self.motor, parameters);
            if self.strays(parameters) {
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
