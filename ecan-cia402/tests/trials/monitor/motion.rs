//! Limits of position, velocity and torque at the motor, and of what takes effect.

use ecan_canopen::OperatingMode;
use ecan_cia402::{AxisConfig, OutputObject};
use ecan_sim::{TargetKind, TargetRecord};

use super::{AxisMonitor, Braking, REST};
use crate::plan::MS;
use crate::report::Kind;

/// The position controller of the simulated drive (gain 200/s, period 1 ms) adds 0.2 of a change of
/// velocity that it could not follow within one period; the targets of an application that reverses
/// at the limit change it by twice the limit, of which the motor follows one half at once.
const OVERSHOOT: f64 = 1.22;
/// If a target is late, the simulated drive extrapolates: it feeds the velocity forward for half a
/// period more, while its demand rests. The motor runs ahead, by at most velocity / gain, and the
/// position controller brings it back on top of the next target.
fn late_overshoot(target_ns: f64) -> f64 {
    1.0 - (-POSITION_GAIN * target_ns / 2.0e9).exp()
}
/// Gain of the position controller of the simulated drive, 1/s.
const POSITION_GAIN: f64 = 200.0;
/// Time after a late target in which the position controller still corrects: eight time constants.
const LATE_NS: u64 = 40 * MS;
/// A target takes effect when its SYNC arrives. Other frames on the bus shift it: with four axes on a
/// channel by up to eight frames of 130 us. The drive begins its interpolation where it is, so a
/// target that comes earlier by this time than one period makes the motion faster.
///
/// A gateway that serves its frames on a clock of its own shifts them by up to its period, too.
const SYNC_JITTER_NS: f64 = 0.35e6;
/// The same in the times of targets, in target periods.
const TARGET_JITTER: f64 = 0.35;
/// Noise of one increment of a target, per controller period.
const ROUNDING: f64 = 2_000.0;
/// The following error of the motor may change by this time of motion at the limit: it cannot
/// follow within one period, and the position controller needs 5 ms (1 / gain) to reduce it.
const LAG_S: f64 = 0.005;
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
/// 0x6081 of the simulated drive: a tenth of its maximum velocity.
const PROFILE_VELOCITY: f64 = 655_360.0;
/// After a stop the position controller of the simulated drive brings the motor to rest.
const SETTLE_NS: u64 = 80 * MS;

/// Acceleration of the simulated motor per thousandth of its rated torque, in its controller period of
/// 1 ms, increments per second.
const PER_MILLE_PERIOD: f64 = 200_000_000.0 / 3_000.0 / 1_000.0;

/// Most that a feed-forward can add to the velocity of the simulated motor, increments per second.
///
/// The position controller takes back a constant offset within some periods; each change of the
/// offset in a target period adds what is not taken back yet. A feed-forward that ends at once does
/// so with the targets. An offset of torque acts for one controller period.
pub(super) fn feed_forward_deviation(config: &AxisConfig, target_ns: f64) -> f64 {
    let limits = &config.feed_forward;
    let has = |output| config.outputs.contains(&output);
    let mut deviation = 0.0;
    if has(OutputObject::VelocityOffset) {
        let kept = (-POSITION_GAIN * target_ns / 1e9).exp();
        let change = f64::from(limits.velocity_change);
        deviation += (change / (1.0 - kept)).min(2.0 * f64::from(limits.velocity));
    }
    if has(OutputObject::TorqueOffset) {
        deviation += 2.0 * f64::from(limits.torque) * PER_MILLE_PERIOD;
    }
    deviation
}

/// Distance from its last target at which a motor with a feed-forward rests, increments: the velocity that
/// the feed-forward adds, over the gain of the position controller (docs/SAFETY.md). A stop ends the
/// feed-forward, and the motor returns by this.
pub(super) fn feed_forward_distance(config: &AxisConfig) -> f64 {
    let limits = &config.feed_forward;
    let has = |output| config.outputs.contains(&output);
    let mut added = 0.0;
    if has(OutputObject::VelocityOffset) {
        added += f64::from(limits.velocity);
    }
    if has(OutputObject::TorqueOffset) {
        added += f64::from(limits.torque) * PER_MILLE_PERIOD;
    }
    added / POSITION_GAIN
}

impl AxisMonitor {
    /// Targets that wait on a disturbed path may take effect together: up to `extra` more than one in
    /// a period.
    pub fn releasing(&mut self, until: u64, extra: f64) {
        let is_over = self.sampled_ns >= self.released_until;
        self.released = if is_over { extra } else { self.released.max(extra) };
        let release_ns = RELEASE_NS + 2 * self.target_ns as u64;
        self.released_until = self.released_until.max(until + release_ns);
    }

    pub(super) fn released(&self, at: u64) -> f64 {
        self.scheduled + if at < self.released_until { self.released } else { 0.0 }
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
                let limit = self.step_limit / (self.target_ns / 1e9);
                let jitter = 1.0 + (SYNC_JITTER_NS + self.service_period_ns) / self.target_ns;
                let late = if at < self.late_until { late_overshoot(self.target_ns) } else { 0.0 };
                let together = 1.0 + self.released(at);
                let most =
                    limit * (OVERSHOOT * jitter * together + late) + ROUNDING + self.feed_forward;
                if at >= self.released_until && self.scheduled == 0.0 {
                    self.fastest = self.fastest.max((self.velocity.abs() - ROUNDING) / limit);
                }
                if self.velocity.abs() > most {
                    let text = format!(
                        "{:.0}/s, {:.2} times the limit of {limit:.0}/s",
                        self.velocity,
                        self.velocity.abs() / limit
                    );
                    self.report(at, Kind::Velocity, text);
                }
                // Targets that take effect in the window, one more at its edge, and the lag.
                let offset = 2.0 * f64::from(self.standstill);
                let most = limit * (seconds + LAG_S * together)
                    + self.step_limit * together
                    + offset
                    + self.feed_forward * LAG_S * 2.0;
                let travel = (self.position - first).abs();
                if travel > most {
                    let text = format!("{travel:.0} in {seconds:.3} s; the limit is {most:.0}");
                    self.report(at, Kind::Travel, text);
                }
            }
            Some(OperatingMode::CyclicVelocity) => {
                let targets = (seconds / (self.target_ns / 1e9)).ceil() + 1.0 + self.released(at);
                let most = self.step_limit * targets + ROUNDING + self.feed_forward;
                let gain = self.velocity.abs() - first_velocity.abs();
                if gain > most {
                    let text = format!("by {gain:.0}/s in {seconds:.3} s; the limit is {most:.0}");
                    self.report(at, Kind::Acceleration, text);
                }
                self.check_speed(at);
            }
            Some(OperatingMode::ProfileVelocity | OperatingMode::Velocity) => self.check_speed(at),
            Some(OperatingMode::ProfilePosition)
                if self.velocity.abs() > PROFILE_VELOCITY * OVERSHOOT =>
            {
                let text = format!("{:.0}/s; 0x6081 is {PROFILE_VELOCITY:.0}", self.velocity);
                self.report(at, Kind::Velocity, text);
            }
            Some(OperatingMode::CyclicTorque | OperatingMode::ProfileTorque) => {
                let most = self.bounds.map_or(f64::MAX, |(low, high)| {
                    f64::from(low.unsigned_abs().max(high.unsigned_abs()))
                });
                // The first sample still shows the brake of the enabled drive. A halted drive brakes in PT.
                let brakes = self.mode == Some(OperatingMode::ProfileTorque) && self.is_halted;
                if self.torque.abs() > most + 1.0 && !self.targets.is_empty() && !brakes {
                    let text = format!("{:.0}; the limit is {most:.0}", self.torque);
                    self.report(at, Kind::Torque, text);
                }
            }
            _ => {}
        }
    }

    pub(super) fn check_speed(&mut self, at: u64) {
        if let Some((low, high)) = self.bounds {
            let most = f64::from(low.unsigned_abs().max(high.unsigned_abs())) * 1.02
                + ROUNDING
                + self.feed_forward;
            if self.velocity.abs() > most {
                let text = format!("{:.0}/s; the limit is {most:.0}", self.velocity);
                self.report(at, Kind::Velocity, text);
            }
        }
    }

    pub(super) fn check_braking(&mut self, at: u64, braking: &Braking) {
        let seconds = at.saturating_sub(braking.at_ns) as f64 / 1e9;
        let speed = braking.velocity.abs();
        let stop_s = speed / braking.deceleration;
        if seconds > stop_s + SETTLE_NS as f64 / 1e9 {
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
        let most = speed * speed / (2.0 * braking.deceleration)
            + speed * 2.0 * LAG_S
            + self.feed_forward_distance
            + 500.0;
        let travel = (self.position - braking.position).abs();
        if travel > most {
            let text = format!("{travel:.0} after a stop at {speed:.0}/s; the limit is {most:.0}");
            self.report(at, Kind::StopDistance, text);
        }
    }

    pub(super) fn check_target(&mut self, record: &TargetRecord) {
        if !record.followed {
            return;
        }
        let at = record.time_ns;
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
        if let Some((low, high)) = self.bounds {
            let outside = |value: i32| {
                i64::from(low) - i64::from(value).min(i64::from(low))
                    + (i64::from(value).max(i64::from(high)) - i64::from(high))
            };
            let before = self.targets.back().map_or(record.actual, |(_, target)| *target);
            // An axis that held while its drive stayed enabled starts again at its actual position.
            let is_late = |(then, _): &(u64, i32)| (at - then) as f64 > 3.0 * self.target_ns;
            let has_resumed = std::mem::take(&mut self.has_resumed);
            let is_first = record.kind == TargetKind::Position
                && (has_resumed || self.targets.back().is_none_or(is_late));
            let slack = if is_first { i64::from(self.standstill) * 2 } else { 0 };
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
        if record.first && record.kind == TargetKind::Position {
            if record.offset() > 2 * self.standstill {
                let text = format!("first target {} from the actual position", record.offset());
                self.report(at, Kind::FirstTarget, text);
            }
        } else if record.first && record.target != 0 {
            let text = format!("first target {}", record.target);
            self.report(at, Kind::FirstTarget, text);
        }
        if self.targets.back().is_some_and(|(then, _)| (at - then) as f64 > self.target_ns + 0.5e6)
        {
            self.late_until = at + LATE_NS;
        }
        let jitter = TARGET_JITTER + self.service_period_ns / self.target_ns;
        // Compared with each of the last targets: one limit per target and per period since then.
        for (nth, (then, target)) in self.targets.iter().rev().enumerate() {
            let periods = ((at - then) as f64 / self.target_ns + jitter).floor();
            // A target that was sent when the path broke is lost before the host can detect it:
            // the next one makes its step, too.
            let more = self.released(*then).max(self.released(at));
            let targets = (nth + 1) as f64 * (1.0 + self.scheduled);
            let periods = (periods.max(1.0) + more).min(targets + more);
            let distance = f64::from(record.target.wrapping_sub(*target)).abs();
            if distance > self.step_limit * periods {
                let ms = (at - then) as f64 / 1e6;
                let text = format!(
                    "{distance:.0} in {ms:.2} ms ({periods} periods of {:.0} ms); the limit is {:.0}",
                    self.target_ns / 1e6,
                    self.step_limit * periods
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
