//! Commands to the axis: controlword, mode, targets.

use ecan_canopen::{Controlword, DriveState, OperatingMode, object};

use super::axis::{Axis, Targets};
use super::dictionary::nearest;
use super::motion::MotionDemand;
use super::parameters::Parameters;
use super::power::{Conditions, halt_stop_mode};
use super::trace::{CommandSource, TargetKind, TargetRecord, TraceCause, TraceEvent};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct ReceivedCommands {
    pub(super) controlword: Option<u16>,
    pub(super) mode: Option<i8>,
    pub(super) position: bool,
    pub(super) velocity: bool,
    pub(super) torque: bool,
    pub(super) interpolation: bool,
    pub(super) vl_velocity: bool,
    pub(super) offsets: bool,
    pub(super) by_sdo: bool,
}

impl Axis {
    /// Stores a command written to an object. Returns false for objects that are not commands.
    pub(super) fn store_command(
        &mut self,
        index: u16,
        number: i64,
        received: &mut ReceivedCommands,
    ) -> bool {
        match index {
            object::CONTROLWORD => received.controlword = Some(number as u16),
            object::MODE_OF_OPERATION => received.mode = Some(number as i8),
            object::TARGET_POSITION => {
                self.targets.position = number as i32;
                received.position = true;
            }
            object::TARGET_VELOCITY => {
                self.targets.velocity = number as i32;
                received.velocity = true;
            }
            object::TARGET_TORQUE => {
                self.targets.torque = number as i16;
                received.torque = true;
            }
            object::INTERPOLATION_DATA => {
                self.targets.interpolation = number as i32;
                received.interpolation = true;
            }
            object::VL_TARGET_VELOCITY => {
                self.targets.vl_velocity = number as i16;
                received.vl_velocity = true;
            }
            object::POSITION_OFFSET => self.targets.position_offset = number as i32,
            object::VELOCITY_OFFSET => {
                self.targets.velocity_offset = number as i32;
                received.offsets = true;
            }
            object::TORQUE_OFFSET => {
                self.targets.torque_offset = number as i16;
                received.offsets = true;
            }
            object::PROBE_FUNCTION => self.probes.set_function(number as u16),
            // Outputs have no effect on the motor.
            object::DIGITAL_OUTPUTS => {}
            _ => return false,
        }
        true
    }

    /// Applies the commands of a frame: mode, controlword, targets, in this order.
    pub(super) fn apply(&mut self, received: &ReceivedCommands, parameters: &Parameters) {
        if let Some(raw) = received.mode {
            self.request_mode(raw, parameters);
        }
        if let Some(word) = received.controlword {
            let source = if received.by_sdo { CommandSource::Sdo } else { CommandSource::Pdo };
            self.command(Controlword(word), source, parameters);
        }
        if received.position && self.mode != Some(OperatingMode::ProfilePosition) {
            let followed = self.follows(OperatingMode::CyclicPosition);
            self.record(TargetKind::Position, self.targets.position, followed, parameters);
            if followed {
                self.follow_position(parameters);
            }
        }
        if received.interpolation {
            let followed = self.follows(OperatingMode::InterpolatedPosition)
                && self.power.controlword.has(Controlword::MODE_4)
                && parameters.interpolation_buffer.is_some();
            self.record(TargetKind::Position, self.targets.interpolation, followed, parameters);
            if followed {
                self.interpolate(parameters);
            }
        }
        if received.vl_velocity {
            let followed = self.follows(OperatingMode::Velocity);
            let target = self.targets.vl_velocity.into();
            self.record(TargetKind::Velocity, target, followed, parameters);
            if followed {
                self.follow_vl_velocity();
            }
        }
        if received.velocity {
            let followed = self.follows(OperatingMode::CyclicVelocity)
                || self.follows(OperatingMode::ProfileVelocity);
            self.record(TargetKind::Velocity, self.targets.velocity, followed, parameters);
            if followed {
                self.follow_velocity();
            }
        }
        if received.torque {
            let followed = self.follows(OperatingMode::CyclicTorque)
                || self.follows(OperatingMode::ProfileTorque);
            self.record(TargetKind::Torque, self.targets.torque.into(), followed, parameters);
            if followed {
                self.follow_torque();
            }
        }
        if received.offsets {
            let Targets { velocity_offset, torque_offset, .. } = self.targets;
            self.history.note_offsets(velocity_offset, torque_offset.into());
        }
    }

    fn follows(&self, mode: OperatingMode) -> bool {
        self.power.state == DriveState::OperationEnabled
            && self.mode == Some(mode)
            && !self.power.has_next_state()
            && !self.power.controlword.has(Controlword::HALT)
    }

    fn record(&mut self, kind: TargetKind, target: i32, followed: bool, parameters: &Parameters) {
        let record = self.history.add(TargetRecord {
            time_ns: self.now,
            kind,
            target,
            state: self.power.state,
            followed,
            actual: self.position(),
            previous: None,
            first: false,
            window: parameters.following_window,
        });
        self.trace.add(self.now, TraceEvent::Target(record));
    }

    /// Mechanical position of a target, clamped to the software limits.
    fn mechanical(&mut self, target: i32, parameters: &Parameters) -> f64 {
        let allowed = match parameters.limits {
            Some((low, high)) => target.clamp(low, high),
            None => target,
        };
        self.at_limit = allowed != target;
        let here = self.position_wide();
        // Targets wrap as positions do: the shorter direction is meant.
        let distance = allowed.wrapping_sub(here as i32);
        (self.origin + here + i64::from(distance)) as f64
    }

    pub(super) fn follow_position(&mut self, parameters: &Parameters) {
        let target = self.targets.position.wrapping_add(self.targets.position_offset);
        let position = self.mechanical(target, parameters);
        self.motion.follow_position(position, parameters.interpolation as f64 / 1e9);
    }

    fn interpolate(&mut self, parameters: &Parameters) {
        let position = self.mechanical(self.targets.interpolation, parameters);
        let buffer = parameters.interpolation_buffer.unwrap_or(0);
        self.motion.interpolate(position, parameters.interpolation as f64 / 1e9, buffer);
    }

    pub(super) fn follow_torque(&mut self) {
        let torque = f64::from(self.targets.torque);
        self.motion.follow(match self.mode {
            Some(OperatingMode::ProfileTorque) => MotionDemand::ProfileTorque(torque),
            _ => MotionDemand::Torque(torque),
        });
    }

    /// Bits 4, 5 and 6 of the controlword together let the ramp follow the target; without them it
    /// goes to 0.
    pub(super) fn follow_vl_velocity(&mut self) {
        let bits = Controlword::MODE_4 | Controlword::MODE_5 | Controlword::MODE_6;
        let is_enabled = self.power.controlword.has(bits);
        let target = if is_enabled { f64::from(self.targets.vl_velocity) } else { 0.0 };
        self.motion.follow(MotionDemand::VlVelocity(target));
    }

    pub(super) fn follow_velocity(&mut self) {
        let velocity = f64::from(self.targets.velocity);
        self.motion.follow(if self.mode == Some(OperatingMode::CyclicVelocity) {
            MotionDemand::Velocity(velocity)
        } else {
            MotionDemand::ProfileVelocity(velocity)
        });
    }

    fn request_mode(&mut self, raw: i8, parameters: &Parameters) {
        let mode = OperatingMode::from_raw(raw);
        if self.config.quirks.ignored_modes.contains(&raw) {
            return;
        }
        let delay = u64::from(self.config.quirks.mode_delay_ms) * 1_000_000;
        if delay == 0 {
            self.change_mode(mode, parameters);
        } else {
            self.next_mode = Some((mode, self.now.saturating_add(delay)));
        }
    }

    pub(super) fn change_mode(&mut self, mode: Option<OperatingMode>, parameters: &Parameters) {
        if mode == self.mode {
            return;
        }
        self.mode = mode;
        self.trace.add(self.now, TraceEvent::Mode(mode));
        if self.power.state == DriveState::OperationEnabled && !self.power.has_next_state() {
            self.enable(parameters);
        }
    }

    fn command(&mut self, word: Controlword, source: CommandSource, parameters: &Parameters) {
        let previous = self.power.controlword;
        self.trace.add_controlword(self.now, word, source);
        let cause = TraceCause::Command(source);
        let conditions = Conditions {
            may_enable: self.mode.is_some() || !self.config.quirks.needs_mode,
            may_reset: !self.config.quirks.stuck_in_fault,
            may_quick_stop: !self.config.quirks.ignores_quick_stop,
            enable_ns: u64::from(self.config.enable_ms) * 1_000_000,
        };
        let action = self.power.command(self.now, word, parameters, &conditions);
        self.execute(action, cause, parameters);
        if self.power.state != DriveState::OperationEnabled || self.power.has_next_state() {
            return;
        }
        let rises = |bit| word.has(bit) && !previous.has(bit);
        let falls = |bit| previous.has(bit) && !word.has(bit);
        let halt = word.has(Controlword::HALT);
        match self.mode {
            Some(OperatingMode::ProfilePosition) if rises(Controlword::MODE_4) => {
                self.set_point(word, parameters);
            }
            Some(OperatingMode::ProfilePosition) if !word.has(Controlword::MODE_4) => {
                self.motion.release_set_point();
            }
            Some(OperatingMode::Homing) if rises(Controlword::MODE_4) && !halt => {
                self.motion.start_homing(parameters.homing_method, &self.motor);
            }
            Some(OperatingMode::InterpolatedPosition) if falls(Controlword::MODE_4) => {
                self.motion.end_interpolation();
            }
            Some(OperatingMode::Velocity) if !halt => self.follow_vl_velocity(),
            Some(OperatingMode::Homing) if falls(Controlword::MODE_4) => self.motion.abort_homing(),
            _ => {}
        }
        if halt {
            self.stop(halt_stop_mode(parameters.halt), parameters);
        } else if falls(Controlword::HALT) {
            self.motion.resume();
            match self.mode {
                Some(OperatingMode::ProfileVelocity) => self.follow_velocity(),
                Some(OperatingMode::ProfileTorque) => self.follow_torque(),
                Some(OperatingMode::Velocity) => self.follow_vl_velocity(),
                _ => {}
            }
        }
    }

    /// Bit 5 of the controlword changes the set-point immediately, bit 6 makes it relative.
    fn set_point(&mut self, word: Controlword, parameters: &Parameters) {
        let mut target = self.targets.position;
        if word.has(Controlword::MODE_6) {
            let base = (nearest(self.motion.set_point_base()) - self.origin) as i32;
            target = target.wrapping_add(base);
        }
        let position = self.mechanical(target, parameters);
        self.record(TargetKind::Position, target, true, parameters);
        self.motion.set_point(position, word.has(Controlword::MODE_5));
    }
}
