//! Modes of operation (CiA 402-2, 10).

use core::fmt;

/// A mode of operation, 0x6060 and 0x6061.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum OperatingMode {
    /// Profile position (PP).
    ProfilePosition,
    /// Profile velocity (PV).
    ProfileVelocity,
    /// Profile torque (PT).
    ProfileTorque,
    /// Homing (HM).
    Homing,
    /// Interpolated position (IP).
    InterpolatedPosition,
    /// Cyclic synchronous position (CSP).
    CyclicPosition,
    /// Cyclic synchronous velocity (CSV).
    CyclicVelocity,
    /// Cyclic synchronous torque (CST).
    CyclicTorque,
}

impl OperatingMode {
    /// Every mode here.
    pub const ALL: [Self; 8] = [
        Self::ProfilePosition,
        Self::ProfileVelocity,
        Self::ProfileTorque,
        Self::Homing,
        Self::InterpolatedPosition,
        Self::CyclicPosition,
        Self::CyclicVelocity,
        Self::CyclicTorque,
    ];

    /// The number.
    #[must_use]
    pub const fn raw(self) -> i8 {
        match self {
            Self::ProfilePosition => 1,
            Self::ProfileVelocity => 3,
            Self::ProfileTorque => 4,
            Self::Homing => 6,
            Self::InterpolatedPosition => 7,
            Self::CyclicPosition => 8,
            Self::CyclicVelocity => 9,
            Self::CyclicTorque => 10,
        }
    }

    /// The mode with this number; `None` for 0 (no mode) and for others.
    #[must_use]
    pub const fn from_raw(raw: i8) -> Option<Self> {
        Some(match raw {
            1 => Self::ProfilePosition,
            3 => Self::ProfileVelocity,
            4 => Self::ProfileTorque,
            6 => Self::Homing,
            7 => Self::InterpolatedPosition,
            8 => Self::CyclicPosition,
            9 => Self::CyclicVelocity,
            10 => Self::CyclicTorque,
            _ => return None,
        })
    }

    /// Whether a target comes with every cycle.
    #[must_use]
    pub const fn is_cyclic(self) -> bool {
        matches!(self, Self::CyclicPosition | Self::CyclicVelocity | Self::CyclicTorque)
    }

    /// The usual short name.
    #[must_use]
    pub const fn short_name(self) -> &'static str {
        match self {
            Self::ProfilePosition => "PP",
            Self::ProfileVelocity => "PV",
            Self::ProfileTorque => "PT",
            Self::Homing => "HM",
            Self::InterpolatedPosition => "IP",
            Self::CyclicPosition => "CSP",
            Self::CyclicVelocity => "CSV",
            Self::CyclicTorque => "CST",
        }
    }
}

impl fmt::Display for OperatingMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.short_name())
    }
}

/// The modes that a drive has, 0x6502.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SupportedModes(pub u32);

impl SupportedModes {
    /// The bit of a mode: its number minus one.
    #[must_use]
    pub const fn bit(mode: OperatingMode) -> u32 {
        1 << (mode.raw() - 1)
    }

    /// Whether the drive has a mode.
    #[must_use]
    pub const fn contains(self, mode: OperatingMode) -> bool {
        self.0 & Self::bit(mode) != 0
    }

    /// The same with a mode.
    #[must_use]
    pub const fn with(self, mode: OperatingMode) -> Self {
        Self(self.0 | Self::bit(mode))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_and_their_bits() {
        for mode in OperatingMode::ALL {
            assert_eq!(OperatingMode::from_raw(mode.raw()), Some(mode));
        }
        assert_eq!(OperatingMode::from_raw(0), None);
        assert_eq!(SupportedModes::bit(OperatingMode::CyclicPosition), 0x80);
        let modes = SupportedModes::default().with(OperatingMode::Homing);
        assert_eq!(modes.0, 0x20);
        assert!(modes.contains(OperatingMode::Homing));
        assert!(!modes.contains(OperatingMode::CyclicTorque));
    }
}
