//! Limits of position, velocity and torque at the motor, and of what takes effect.

use ecan_canopen::OperatingMode;
use ecan_sim::{TargetKind, TargetRecord};

use super::{AxisMonitor, Braking, Permit, REST};
use crate::plan::MS;
use crate::report::Kind;

/// Time after a late target in which the position controller still corrects: eight time constants.
const LATE_NS: u64 = 40 * MS;
/// Time after a disturbance of the path, and two target periods, in which waiting targets may take
/// effect.
const RELEASE_NS: u64 = 40 * MS;
/// Targets that may take effect in one period in addition to the regular one. A gateway that stalls,
/// or whose image is lost, has one image more than is confirmed; while the bus is occupied, a second frame
/// waits in its controller. SAFETY.md states both bounds.
pub const RELEASED: f64 = 1.0;
pub const RELEASED_BY_BUS: f64 = 2.0;
/// Targets that a bus-off longer than a target period loses before the host is informed.
pub const LOST_IN_BUS_OFF: f64 = 2.0;
/// The same while images are damaged or lost: one more follows the last image.
pub const LOST_IN_HIDDEN_BUS_OFF: f64 = 3.0;
/// Scheduled targets that are lost in a row while the pulses of a clock that jumped move past the
/// process data.
pub const LOST_BY_CLOCK: f64 = 2.0;

impl AxisMonitor {
    /// Targets that wait on a disturbed path may take effect together: up to `extra` more than one in
    /// a period.
    pub fn releasing(&mut self, until: u64, extra: f64) {
        let is_over = self.sampled_ns >= self.released_until;
        self.released = if is_over { extra } else { self.released.max(extra) };
        let release_ns = RELEASE_NS + 2 * self.target_ns as u64;
        self.released_until = self.released_until.max(until + release_ns);
    }

    /// The host lost time, in which it corrected no clock.
    pub fn time_lost(&mut self, ns: u64) {
        if self.sampled_ns < self.released_until {
            self.released_until += ns;
        }
    }

    pub(super) fn released(&self, at: u64) -> f64 {
        if at < self.released_until { self.released.max(self.scheduled) } else { 0.0 }
    }

    pub(super) fn check_motion(&mut self, at: u64) {
        if at < self.unlimited_until.max(self.stop_frames_until) {
            self.window.clear();
            return;
        }
        if let Some(braking) = self.braking {
            self.check_braking(at, &braking);
        }
        if !self.follows {
            return;
        }
        self.window.push_back((at, self.position, self.velocity));
        let span_ns = (4.0 * self.target_ns).max(20e6) as u64;
        while self.window.front().is_some_and(|(from, ..)| at - from > span_ns) {
            self.window.pop_front();
        }
        let Some(&(from, first, first_velocity)) = self.window.front() else { return };
        let seconds = (at - from) as f64 / 1e9;
        match self.mode {
            Some(OperatingMode::CyclicPosition | OperatingMode::InterpolatedPosition) => {
                let limit = self.bounds.limit();
                let together = 1.0 + self.released(at);
                if at >= self.released_until {
                    self.fastest = self.fastest.max(self.velocity.abs() / limit);
                }
                if self.velocity.abs() > self.bounds.velocity(together, at < self.late_until) {
                    let text = format!(
                        "{:.0}/s, {:.2} times the limit of {limit:.0}/s",
                        self.velocity,
                        self.velocity.abs() / limit
                    );
                    self.report(at, Kind::Velocity, text);
                }
                let most = self.bounds.travel(seconds, together);
                let travel = (self.position - first).abs();
                if travel > most {
                    let text = format!("{travel:.0} in {seconds:.3} s; the limit is {most:.0}");
                    self.report(at, Kind::Travel, text);
                }
            }
            Some(OperatingMode::CyclicVelocity) => {
                let most = self.bounds.gain(seconds, self.released(at));
                let gain = self.velocity.abs() - first_velocity.abs();
                if gain > most {
                    let text = format!("by {gain:.0}/s in {seconds:.3} s; the limit is {most:.0}");
                    self.report(at, Kind::Acceleration, text);
                }
                self.check_speed(at);
            }
            Some(OperatingMode::ProfileVelocity | OperatingMode::Velocity) => self.check_speed(at),
            Some(OperatingMode::ProfilePosition)
                if self.velocity.abs() > self.bounds.profile_velocity() =>
            {
                let most = self.bounds.profile_velocity();
                let text = format!("{:.0}/s; the limit is {most:.0}", self.velocity);
                self.report(at, Kind::Velocity, text);
            }
            Some(OperatingMode::CyclicTorque | OperatingMode::ProfileTorque) => {
                let most = self.bounds.torque();
                // The first sample still shows the brake of the enabled drive. A halted drive brakes in PT.
                let brakes = self.mode == Some(OperatingMode::ProfileTorque) && self.is_halted;
                if self.torque.abs() > most && !self.targets.is_empty() && !brakes {
                    let text = format!("{:.0}; the limit is {most:.0}", self.torque);
                    self.report(at, Kind::Torque, text);
                }
            }
            _ => {}
        }
    }

    pub(super) fn check_speed(&mut self, at: u64) {
        let most = self.bounds.speed();
        if self.velocity.abs() > most {
            let text = format!("{:.0}/s; the limit is {most:.0}", self.velocity);
            self.report(at, Kind::Velocity, text);
        }
    }

    pub(super) fn check_braking(&mut self, at: u64, braking: &Braking) {
        let seconds = at.saturating_sub(braking.at_ns) as f64 / 1e9;
        let speed = braking.velocity.abs();
        if seconds > self.bounds.rest_s(speed, braking.deceleration) {
            if self.velocity.abs() > REST {
                let text = format!(
                    "{:.0}/s {:.0} ms after a stop at {speed:.0}/s",
                    self.velocity,
                    seconds * 1e3
                );
                self.report(at, Kind::NotAtRest, text);
            }
            self.braking = None;
            return;
        }
        let most = self.bounds.stop_distance(speed, braking.deceleration);
        let travel = (self.position - braking.position).abs();
        if travel > most {
            let text = format!("{travel:.0} after a stop at {speed:.0}/s; the limit is {most:.0}");
            self.report(at, Kind::StopDistance, text);
        }
    }

    pub(super) fn check_target(&mut self, record: &TargetRecord) {
        if record.kind == TargetKind::Velocity && record.target == 0 {
            self.stand();
        }
        if !record.followed {
            return;
        }
        let at = record.time_ns;
        // The drive of an axis that held, or was adopted, may have been enabled all the time.
        let is_first = std::mem::take(&mut self.has_resumed) || record.first;
        if at < self.stop_frames_until {
            self.targets.clear();
            return;
        }
        let is_profile = matches!(
            self.mode,
            Some(
                OperatingMode::ProfilePosition
                    | OperatingMode::ProfileVelocity
                    | OperatingMode::ProfileTorque
                    | OperatingMode::Velocity
            )
        );
        if let Some((low, high)) = self.range {
            let outside = |value: i32| {
                i64::from(low) - i64::from(value).min(i64::from(low))
                    + (i64::from(value).max(i64::from(high)) - i64::from(high))
            };
            let before = self.targets.back().map_or(record.actual, |(_, target)| *target);
            // An axis that held while its drive stayed enabled starts again at its actual position.
            let is_late = |(then, _): &(u64, i32)| (at - then) as f64 > 3.0 * self.target_ns;
            let restarts =
                record.kind == TargetKind::Position && self.targets.back().is_none_or(is_late);
            let slack = if restarts { self.bounds.first_target(0.0) as i64 } else { 0 };
            if outside(record.target) > outside(before) + slack {
                let text = format!("target {} after {before}, {low}..{high}", record.target);
                self.report(at, Kind::Bounds, text);
            }
        }
        if self.target_kind.replace(record.kind) != Some(record.kind) {
            self.targets.clear();
        }
        if is_profile {
            self.targets.clear();
            self.targets.push_back((at, record.target));
            return;
        }
        if is_first && record.kind == TargetKind::Position {
            let most = self.bounds.first_target(self.released(at));
            if f64::from(record.offset()) > most && !self.is_unknown {
                let text = format!("first target {} from the actual position", record.offset());
                self.report(at, Kind::FirstTarget, text);
            }
        } else if record.first && record.target != 0 && self.permit != Permit::None {
            let text = format!("first target {}", record.target);
            self.report(at, Kind::FirstTarget, text);
        }
        if self.targets.back().is_some_and(|(then, _)| (at - then) as f64 > self.target_ns + 0.5e6)
        {
            self.late_until = at + LATE_NS;
        }
        self.has_moved &= !is_first;
        if let Some((then, first)) = self.targets.back().copied()
            && !self.has_moved
            && first != record.target
        {
            // Repetitions of the first target are sent with each SYNC, not in each target period.
            self.has_moved = true;
            self.targets.clear();
            self.targets.push_back((then.min(at - self.target_ns as u64), first));
        }
        for (nth, (then, target)) in self.targets.iter().rev().enumerate() {
            // A target that was sent when the path broke is lost before the host can detect it:
            // the next one makes its step, too.
            let more = self.released(*then).max(self.released(at));
            let dropped = if more > 0.0 { self.scheduled } else { 0.0 };
            let most = self.bounds.step(nth, at - then, more, dropped);
            let distance = f64::from(record.target.wrapping_sub(*target)).abs();
            if distance > most {
                let ms = (at - then) as f64 / 1e6;
                let text = format!(
                    "{distance:.0} in {ms:.2} ms (period {:.0} ms, target {} before); the limit is {most:.0}",
                    self.target_ns / 1e6,
                    nth + 1,
                );
                let kind = if nth == 0 { Kind::TargetStep } else { Kind::TargetsTogether };
                self.report(at, kind, text);
                break;
            }
        }
        if self.targets.len() >= 6 {
            self.targets.pop_front();
        }
        self.targets.push_back((at, record.target));
    }
}
