//! The statusword (CiA 402-2, 8.4.2) and the states that it tells.

ecan_protocol::text_enum! {
    /// State of a drive's power stage.
    pub enum DriveState;
    /// Starting up.
    NotReadyToSwitchOn = "not ready to switch on";
    /// Power may not be switched on.
    SwitchOnDisabled = "switch on disabled";
    /// Power may be switched on.
    ReadyToSwitchOn = "ready to switch on";
    /// Power is on, the motor is without torque.
    SwitchedOn = "switched on";
    /// The motor follows its targets.
    OperationEnabled = "operation enabled";
    /// A quick stop runs or has ended with power on.
    QuickStopActive = "quick stop active";
    /// A fault was found, its reaction runs.
    FaultReactionActive = "fault reaction active";
    /// Faulted, the motor is without torque.
    Fault = "fault";
}

/// The statusword, 0x6041.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Statusword(pub u16);

impl Statusword {
    /// Bit 5: clear while a quick stop is active.
    pub const QUICK_STOP: u16 = 1 << 5;
    /// Bit 7: warning.
    pub const WARNING: u16 = 1 << 7;
    /// Bit 9: the drive follows the controlword.
    pub const REMOTE: u16 = 1 << 9;
    /// Bit 10: target reached (profile modes, homing).
    pub const TARGET_REACHED: u16 = 1 << 10;
    /// Bit 11: an internal limit is active.
    pub const INTERNAL_LIMIT: u16 = 1 << 11;
    /// Bit 12: by mode; in cyclic modes the drive follows its target, in PP the set-point is
    /// acknowledged, in PV the speed is 0, in IP the interpolation is active, in homing the home position is found.
    pub const MODE_12: u16 = 1 << 12;
    /// Bit 13: by mode; following error in position modes, homing error in homing.
    pub const MODE_13: u16 = 1 << 13;

    /// The state; `None` for a combination that CiA 402 does not know.
    pub const fn state(self) -> Option<DriveState> {
        Some(match self.0 & 0x6F {
            0x00 | 0x20 => DriveState::NotReadyToSwitchOn,
            0x40 | 0x60 => DriveState::SwitchOnDisabled,
            0x21 => DriveState::ReadyToSwitchOn,
            0x23 => DriveState::SwitchedOn,
            0x27 => DriveState::OperationEnabled,
            0x07 => DriveState::QuickStopActive,
            0x0F | 0x2F => DriveState::FaultReactionActive,
            0x08 | 0x28 => DriveState::Fault,
            _ => return None,
        })
    }

    /// The bits of a state, with voltage enabled where power is on.
    pub const fn of_state(state: DriveState) -> Self {
        Self(match state {
            DriveState::NotReadyToSwitchOn => 0x00,
            DriveState::SwitchOnDisabled => 0x40,
            DriveState::ReadyToSwitchOn => 0x21,
            DriveState::SwitchedOn => 0x33,
            DriveState::OperationEnabled => 0x37,
            DriveState::QuickStopActive => 0x17,
            DriveState::FaultReactionActive => 0x1F,
            DriveState::Fault => 0x08,
        })
    }

    /// Returns whether all of these bits are set.
    pub const fn has(self, bits: u16) -> bool {
        self.0 & bits == bits
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [DriveState; 8] = [
        DriveState::NotReadyToSwitchOn,
        DriveState::SwitchOnDisabled,
        DriveState::ReadyToSwitchOn,
        DriveState::SwitchedOn,
        DriveState::OperationEnabled,
        DriveState::QuickStopActive,
        DriveState::FaultReactionActive,
        DriveState::Fault,
    ];

    /// The masks and values of the standard, bit by bit.
    fn by_the_table(word: u16) -> Option<DriveState> {
        let table = [
            (0x4F, 0x00, DriveState::NotReadyToSwitchOn),
            (0x4F, 0x40, DriveState::SwitchOnDisabled),
            (0x6F, 0x21, DriveState::ReadyToSwitchOn),
            (0x6F, 0x23, DriveState::SwitchedOn),
            (0x6F, 0x27, DriveState::OperationEnabled),
            (0x6F, 0x07, DriveState::QuickStopActive),
            (0x4F, 0x0F, DriveState::FaultReactionActive),
            (0x4F, 0x08, DriveState::Fault),
        ];
        table.iter().find(|(mask, value, _)| word & mask == *value).map(|(.., state)| *state)
    }

    #[test]
    fn every_word_reads_as_the_table_says() {
        for word in 0..=u16::MAX {
            assert_eq!(Statusword(word).state(), by_the_table(word), "0x{word:04X}");
        }
    }

    #[test]
    fn states_come_back() {
        for state in ALL {
            assert_eq!(Statusword::of_state(state).state(), Some(state));
        }
    }
}
