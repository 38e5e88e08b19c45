use ecan_protocol::mapping::Direction;

use super::channel_control::{self, FIRST_CHANNEL_OBJECT};
use super::profile_control;

pub(super) const SYSTEM: u16 = 0x8000;
pub(super) const GLOBAL_DATA_PATH: u16 = 0x8020;
pub(super) const FIRST_DATA_PATH: u16 = 0x8021;
pub(super) const DIAGNOSTIC_TEST: u16 = 0x8030;
pub(super) const CYCLE_PERFORMANCE: u16 = 0x9011;
pub(super) const MAINTENANCE: u16 = 0xB000;
pub(super) const MAINTENANCE_COMMAND: u8 = 4;
pub(super) const MODE_TIMEOUT: u8 = 3;

const TEST_KEY: u8 = 1;

/// What the firmware does after a value was stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Command {
    Nothing,
    Reboot,
    RotatePins,
    ApplyChannel(usize),
    ChannelFlash { channel: usize, bits: u32 },
    EditFilters { channel: usize, extended: bool, command: u8 },
    ApplyProfile(Direction),
    ControlProfile { direction: Direction, bits: u32 },
    ProfileRequested(Direction),
    AssignmentWritten(Direction),
    // `apply` false: the command object is only reset
    GlobalDataPath { apply: bool },
    DataPath { channel: usize, apply: bool },
    TestPolicies { key: bool },
    Performance { subindex: u8, clear: bool },
    Register { channel: usize },
    AccessMode(u8),
    Maintenance(u32),
}

impl Command {
    pub(super) fn of(index: u16, subindex: u8, value: u32) -> Self {
        let channel = |first: u16| usize::from(index - first);
        let byte = value.to_le_bytes()[0];
        match index {
            SYSTEM if subindex == 1 && value == 1 => Self::Reboot,
            SYSTEM if subindex == 12 => Self::RotatePins,
            0x8001..=0x8004 => Self::of_channel(channel(FIRST_CHANNEL_OBJECT), subindex, value),
            0x1C12 => Self::AssignmentWritten(Direction::RxPdo),
            0x1C13 => Self::AssignmentWritten(Direction::TxPdo),
            0x8010 => Self::of_profile(Direction::TxPdo, subindex, value),
            0x8011 => Self::of_profile(Direction::RxPdo, subindex, value),
            GLOBAL_DATA_PATH if subindex == 2 => Self::GlobalDataPath { apply: value == 1 },
            0x8021..=0x8024 if subindex == 2 => {
                Self::DataPath { channel: channel(FIRST_DATA_PATH), apply: value == 1 }
            }
            DIAGNOSTIC_TEST => Self::TestPolicies { key: subindex == TEST_KEY },
            CYCLE_PERFORMANCE => Self::Performance { subindex, clear: value == 1 },
            0xA000..=0xA003 if subindex == 2 => Self::Register { channel: channel(0xA000) },
            MAINTENANCE if subindex == 1 => Self::AccessMode(byte),
            MAINTENANCE if subindex == MAINTENANCE_COMMAND => Self::Maintenance(value),
            _ => Self::Nothing,
        }
    }

    fn of_channel(channel: usize, subindex: u8, value: u32) -> Self {
        use channel_control::subindex as si;
        let command = value.to_le_bytes()[0];
        match subindex {
            si::APPLY if value == 1 => Self::ApplyChannel(channel),
            si::FLASH if value != 0 => Self::ChannelFlash { channel, bits: value },
            si::STANDARD_COMMAND => Self::EditFilters { channel, extended: false, command },
            si::EXTENDED_COMMAND => Self::EditFilters { channel, extended: true, command },
            _ => Self::Nothing,
        }
    }

    fn of_profile(direction: Direction, subindex: u8, value: u32) -> Self {
        use profile_control::subindex as si;
        match subindex {
            si::APPLY if value == 1 => Self::ApplyProfile(direction),
            si::COMMAND => Self::ControlProfile { direction, bits: value },
            si::MULTIPLIER..=si::OPTIONS => Self::ProfileRequested(direction),
            _ => Self::Nothing,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn apply_commands_act_on_one_only() {
        assert_eq!(Command::of(0x8003, 1, 1), Command::ApplyChannel(2));
        assert_eq!(Command::of(0x8003, 1, 0), Command::Nothing);
        assert_eq!(Command::of(0x8010, 1, 1), Command::ApplyProfile(Direction::TxPdo));
        assert_eq!(Command::of(0x8024, 2, 1), Command::DataPath { channel: 3, apply: true });
        assert_eq!(Command::of(0x8024, 2, 0), Command::DataPath { channel: 3, apply: false });
    }

    #[test]
    fn plain_values_set_off_nothing() {
        for (index, subindex) in [(0x8000, 6), (0x8001, 10), (0x8020, 4), (0x8021, 5), (0xB000, 3)]
        {
            assert_eq!(Command::of(index, subindex, 1), Command::Nothing, "{index:#x}:{subindex}");
        }
    }
}
