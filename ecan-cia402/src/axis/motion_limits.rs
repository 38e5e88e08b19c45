//! Limits of motion in units of a machine, and their conversion to increments.

use std::fmt;

/// Limits of an axis in units of its machine: of the axis, after the gear, by
/// [`AxisConfig::scale`](crate::AxisConfig::scale). A limit that is set replaces a value in increments, see the table;
/// `None` keeps that value.
///
/// | limit | CSP, IP | CSV | PV |
/// | --- | --- | --- | --- |
/// | `velocity` | replaces `step_limit` | narrows `bounds` | narrows `bounds` |
/// | `acceleration` | replaces `ramp` | replaces `step_limit` | fault |
/// | `jerk` | of `ramp` | of the halt | fault |
///
/// In CSV and PV the targets are velocities in units of the drive: a limit needs
/// [`Scale::with_velocity_units`](crate::Scale::with_velocity_units). In PP, CST, PT and VL every limit is a fault: the drive generates the
/// motion by its own objects, or the unit is unknown. The limits are those of
/// [`AxisConfig::mode`](crate::AxisConfig::mode); after a change of the mode to PP or PV the velocities and accelerations of
/// the motion are the drive's own.
///
/// # Application and host
///
/// The velocity limit applies to every target: the motion guard rejects one that exceeds it, in CSV
/// also one that exceeds the acceleration limit. Jerk, and in CSP acceleration, shape the motion that
/// the host makes: [`halt`](crate::Cia402::halt), [`stop_together`](crate::Cia402::stop_together),
/// shutdown and [`send_target_step`](crate::Cia402::send_target_step). They never reject a position
/// target of the application: a drive that gets no target stops at once, which is a larger
/// deceleration than the one that was rejected.
///
/// A stop of the host takes velocity / acceleration + acceleration / jerk; a shutdown switches the
/// drive off after five seconds, also if it is not at rest by then. Where nothing can be sent (a hold),
/// no limit shapes the stop: a drive in CSP stops by its own rules.
///
/// # Conversion
///
/// [`Cia402::new`](crate::Cia402::new) converts by the target period ([`Cia402::target_period`](crate::Cia402::target_period)),
/// and rounds down: the velocity to whole increments (or units of velocity) per period, acceleration
/// and jerk in CSP to 2^-32 increments. A limit that is less than that unit is a fault. With a velocity
/// limit, following-error window and standstill window follow as by [`AxisConfig::with_step_limit`](crate::AxisConfig::with_step_limit).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MotionLimits {
    /// Largest velocity in rad/s, of both directions.
    pub velocity: Option<f64>,
    /// Largest acceleration and deceleration in rad/s^2.
    pub acceleration: Option<f64>,
    /// Largest jerk in rad/s^3; `None` does not limit it.
    pub jerk: Option<f64>,
}

/// One of the [`MotionLimits`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MotionLimit {
    /// Velocity in rad/s.
    Velocity,
    /// Acceleration in rad/s^2.
    Acceleration,
    /// Jerk in rad/s^3.
    Jerk,
}

impl MotionLimit {
    /// Unit of its values.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Velocity => "rad/s",
            Self::Acceleration => "rad/s^2",
            Self::Jerk => "rad/s^3",
        }
    }
}

impl fmt::Display for MotionLimit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Velocity => "velocity limit",
            Self::Acceleration => "acceleration limit",
            Self::Jerk => "jerk limit",
        })
    }
}

impl MotionLimits {
    /// The limits that are set.
    pub fn iter(&self) -> impl Iterator<Item = (MotionLimit, f64)> {
        [
            (MotionLimit::Velocity, self.velocity),
            (MotionLimit::Acceleration, self.acceleration),
            (MotionLimit::Jerk, self.jerk),
        ]
        .into_iter()
        .filter_map(|(limit, value)| Some((limit, value?)))
    }
}
