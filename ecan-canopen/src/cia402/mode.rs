//! Modes of operation (CiA 402-2, 10).

ecan_protocol::text_enum! {
    /// A mode of operation, 0x6060 and 0x6061.
    pub enum OperatingMode: i8;
    /// Profile position (PP).
    ProfilePosition = 1, "PP";
    /// Velocity (vl), of frequency converters.
    Velocity = 2, "VL";
    /// Profile velocity (PV).
    ProfileVelocity = 3, "PV";
    /// Profile torque (PT).
    ProfileTorque = 4, "PT";
    /// Homing (HM).
    Homing = 6, "HM";
    /// Interpolated position (IP).
    InterpolatedPosition = 7, "IP";
    /// Cyclic synchronous position (CSP).
    CyclicPosition = 8, "CSP";
    /// Cyclic synchronous velocity (CSV).
    CyclicVelocity = 9, "CSV";
    /// Cyclic synchronous torque (CST).
    CyclicTorque = 10, "CST";
}

impl OperatingMode {
    /// Returns whether a target comes with every cycle.
    pub const fn is_cyclic(self) -> bool {
        matches!(
            self,
            Self::InterpolatedPosition
                | Self::CyclicPosition
                | Self::CyclicVelocity
                | Self::CyclicTorque
        )
    }
}

/// The modes that a drive has, 0x6502.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SupportedModes(pub u32);

impl SupportedModes {
    /// The bit of a mode: its number minus one.
    pub const fn bit(mode: OperatingMode) -> u32 {
        1 << (mode.raw() - 1)
    }

    /// Returns whether the drive has a mode.
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
        for &mode in OperatingMode::ALL {
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
