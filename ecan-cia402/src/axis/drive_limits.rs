//! Limits of a drive, as it has them.

use ecan_canopen::{OperatingMode, Step, object};

use super::config::{AxisConfig, target_kind};
use super::drive_units::DriveUnits;
use crate::guard::terms::{GuardLimits, TargetKind};

/// Limits of a drive, read at the end of its configuration; `None` for an object that it does not have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct DriveLimits {
    /// Largest torque 0x6072, in thousandths of the rated torque.
    pub max_torque: Option<u16>,
    /// Software position limits 0x607D, in steps. Without effect if the first is not below the second.
    pub position: Option<(i32, i32)>,
    /// Largest speed of the motor 0x6080, in revolutions per minute.
    pub max_motor_speed: Option<u32>,
}

impl DriveLimits {
    pub(crate) fn steps() -> impl Iterator<Item = Step> {
        let objects = [
            (object::MAX_TORQUE, 0),
            (object::SOFTWARE_POSITION_LIMIT, 1),
            (object::SOFTWARE_POSITION_LIMIT, 2),
            (object::MAX_MOTOR_SPEED, 0),
        ];
        let read = |(index, subindex)| Step::read(index, subindex).named("limits").if_accepted();
        objects.into_iter().map(read)
    }

    pub(crate) fn from_values(value: impl Fn(u16, u8) -> Option<u64>) -> Self {
        let signed = |subindex| Some(value(object::SOFTWARE_POSITION_LIMIT, subindex)? as u32);
        Self {
            max_torque: value(object::MAX_TORQUE, 0).and_then(|raw| u16::try_from(raw).ok()),
            position: signed(1)
                .zip(signed(2))
                .map(|(low, high)| (low.cast_signed(), high.cast_signed())),
            max_motor_speed: value(object::MAX_MOTOR_SPEED, 0)
                .and_then(|raw| u32::try_from(raw).ok()),
        }
    }

    /// Narrows the limits of the guard in a mode to those of the drive; never widens one.
    pub(crate) fn narrow(
        &self,
        limits: &mut GuardLimits,
        (mode, config): (OperatingMode, &AxisConfig),
        units: &DriveUnits,
        target_period_ns: u64,
    ) {
        match target_kind(mode) {
            TargetKind::Position | TargetKind::Profile => {
                if let Some((low, high)) = self.position.filter(|(low, high)| low < high) {
                    limits.bounds = narrowed(limits.bounds, (low, high));
                }
            }
            TargetKind::Rate if is_torque(mode) => {
                if let Some(most) = self.max_torque {
                    limits.bounds = narrowed(limits.bounds, (-i32::from(most), most.into()));
                }
            }
            TargetKind::Rate | TargetKind::None => {}
        }
        let Some(turns_per_s) = self.max_motor_speed.map(|speed| f64::from(speed) / 60.0) else {
            return;
        };
        match mode {
            OperatingMode::CyclicPosition | OperatingMode::InterpolatedPosition => {
                if let Some(steps) = units.steps_per_motor_turn() {
                    // The cast saturates and drops the fraction.
                    let most = turns_per_s * steps * target_period_ns as f64 / 1e9;
                    limits.step = limits.step.min((most as u32).max(1));
                }
            }
            OperatingMode::CyclicVelocity | OperatingMode::ProfileVelocity => {
                let per_shaft = config.scale.velocity_units().or_else(|| units.velocity_units());
                if let Some(most) = per_shaft
                    .zip(units.steps_per_turn().zip(units.steps_per_motor_turn()))
                    .map(|(units, (shaft, motor))| turns_per_s * units.abs() * motor / shaft)
                {
                    let most = most as i32;
                    limits.bounds = narrowed(limits.bounds, (-most, most));
                }
            }
            _ => {}
        }
    }
}

fn is_torque(mode: OperatingMode) -> bool {
    matches!(mode, OperatingMode::ProfileTorque | OperatingMode::CyclicTorque)
}

/// The bounds that are in both; those of the configuration if they have nothing in common.
fn narrowed(bounds: Option<(i32, i32)>, (low, high): (i32, i32)) -> Option<(i32, i32)> {
    let Some((min, max)) = bounds else { return Some((low, high)) };
    let both = (min.max(low), max.min(high));
    Some(if both.0 <= both.1 { both } else { (min, max) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guard::position_range::PositionRange;
    use ecan_canopen::{NodeAddress, NodeId};

    #[test]
    fn guard_limits_are_narrowed_by_the_drive() {
        let node = NodeId::new(1).unwrap();
        let mut config = AxisConfig::new(NodeAddress { slave: 0, channel: 0, node });
        config.bounds = Some((-1_000, 50_000));
        let drive = DriveLimits {
            max_torque: Some(300),
            position: Some((-5_000, 20_000)),
            max_motor_speed: Some(60),
        };
        let units = DriveUnits { encoder: Some((65_536, 1)), ..DriveUnits::default() };
        let limits = |mode, units: &DriveUnits| {
            let mut limits = config.guard_limits(mode, 1);
            drive.narrow(&mut limits, (mode, &config), units, 2_000_000);
            (limits.bounds, limits.step)
        };
        let csp = OperatingMode::CyclicPosition;
        // One revolution per second in 2 ms.
        assert_eq!(limits(csp, &units), (Some((-1_000, 20_000)), 131));
        assert_eq!(limits(csp, &DriveUnits::default()).1, 1_000, "units unknown");
        config.bounds = None;
        let torque = OperatingMode::CyclicTorque;
        let mut narrow = config.guard_limits(torque, 1);
        drive.narrow(&mut narrow, (torque, &config), &units, 2_000_000);
        assert_eq!((narrow.bounds, narrow.range), (Some((-300, 300)), PositionRange::Linear));
        assert_eq!(narrowed(Some((1, 2)), (3, 4)), Some((1, 2)), "nothing in common");
    }
}
