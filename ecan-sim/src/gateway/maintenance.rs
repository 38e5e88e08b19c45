//! 0xB000: access mode, maintenance status and sequence, diagnostic flags (manual 13.7); and the commands that
//! writes of objects mean.
//!
//! The mode that a command needs is an assumption: the manual states only that the mode can be the
//! cause of a denial, that engineering mode enables some functions, and the purpose of factory
//! mode. Here clearing diagnostics is always permitted; saving, loading, validating and activating
//! need engineering or factory mode; restoring the factory configuration and rebuilding the EEPROM
//! need factory mode. In OP, where the flash must not delay the cycle, only clearing and validating
//! are permitted. The status numbers other than 0 and 2 follow the order of the manual. Diagnostic
//! flags 0 to 3 are never set: this gateway publishes complete images and has no stage before the
//! parser.

use ecan_protocol::device::{AccessMode, MaintenanceStatus};
use ecan_protocol::mapping::Direction;

use super::channel_control::FIRST_CHANNEL_OBJECT;
use super::variant::{GatewayVariant, MaintenanceMode, MaintenanceNumbers};
use super::{channel_control, profile_control};

/// Legacy maintenance diag flags, 0xB000:6.
pub(super) mod flag {
    pub(in crate::gateway) const TX_RING_DROP: u16 = 1 << 4;
    pub(in crate::gateway) const TX_FIFO_FULL: u16 = 1 << 5;
    pub(in crate::gateway) const SCHED_LATE_DROP: u16 = 1 << 6;
    pub(in crate::gateway) const SCHED_QUEUE_FULL: u16 = 1 << 7;
    pub(in crate::gateway) const SCHED_TX_FAIL: u16 = 1 << 8;
    pub(in crate::gateway) const SCHED_TIMER_MISS: u16 = 1 << 9;
}

/// Bits of the maintenance command; several can be set.
pub(super) mod command {
    use ecan_protocol::device::MaintenanceCommand;

    pub(in crate::gateway) const SAVE: u32 = MaintenanceCommand::Save as u32;
    pub(in crate::gateway) const LOAD: u32 = MaintenanceCommand::Load as u32;
    pub(in crate::gateway) const FACTORY: u32 = MaintenanceCommand::Factory as u32;
    pub(in crate::gateway) const VALIDATE: u32 = MaintenanceCommand::Validate as u32;
    pub(in crate::gateway) const ACTIVATE: u32 = MaintenanceCommand::Activate as u32;
    pub(in crate::gateway) const CLEAR_DIAGNOSTICS: u32 =
        MaintenanceCommand::ClearDiagnostics as u32;
    pub(in crate::gateway) const REBUILD_EEPROM: u32 = MaintenanceCommand::RebuildEeprom as u32;
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PendingCommand {
    /// No command, or a denied one.
    Nothing,
    ClearDiagnostics,
    /// These bits are permitted and take time.
    Execute(u32),
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Maintenance {
    mode: AccessMode,
    pub(super) mode_ends: Option<u64>,
    status: MaintenanceStatus,
    sequence: u32,
    rule: MaintenanceMode,
    numbers: MaintenanceNumbers,
}

impl Maintenance {
    pub(super) fn new(variant: &GatewayVariant) -> Self {
        Self {
            rule: variant.maintenance_mode,
            numbers: variant.maintenance_status,
            ..Self::default()
        }
    }

    /// Grants an access mode, for `timeout_s` seconds or, with 0, without limit.
    pub(super) fn request_mode(&mut self, now: u64, mode: u8, timeout_s: u16) {
        self.mode = AccessMode::from_raw(mode).unwrap_or(AccessMode::Factory);
        self.mode_ends = (self.mode != AccessMode::Run && timeout_s != 0)
            .then(|| now.saturating_add(u64::from(timeout_s) * 1_000_000_000));
    }

    pub(super) fn expire(&mut self, now: u64) {
        if self.mode_ends.is_some_and(|ends| ends <= now) {
            self.mode = AccessMode::Run;
            self.mode_ends = None;
        }
    }

    pub(super) fn is_engineering(&self) -> bool {
        self.mode >= AccessMode::Engineering
    }

    pub(super) fn command(&mut self, bits: u32, in_op: bool, is_receiving: bool) -> PendingCommand {
        if bits == 0 {
            return PendingCommand::Nothing;
        }
        if bits == command::CLEAR_DIAGNOSTICS {
            self.finish(MaintenanceStatus::Ok);
            return PendingCommand::ClearDiagnostics;
        }
        if self.allows(bits, in_op, is_receiving) {
            return PendingCommand::Execute(bits);
        }
        self.finish(MaintenanceStatus::Denied);
        PendingCommand::Nothing
    }

    fn allows(&self, bits: u32, in_op: bool, is_receiving: bool) -> bool {
        use command::{ACTIVATE, CLEAR_DIAGNOSTICS, FACTORY, REBUILD_EEPROM, VALIDATE};
        let stands_alone = bits & (CLEAR_DIAGNOSTICS | REBUILD_EEPROM) != 0;
        let needed = match (self.rule, bits & (FACTORY | REBUILD_EEPROM)) {
            (MaintenanceMode::Run, _) => AccessMode::Run,
            (MaintenanceMode::ByCommand, 0) => AccessMode::Engineering,
            _ => AccessMode::Factory,
        };
        (!stands_alone || bits.is_power_of_two())
            && self.mode >= needed
            && (!in_op || bits == VALIDATE)
            && !(is_receiving && bits & (VALIDATE | ACTIVATE | REBUILD_EEPROM) != 0)
    }

    pub(super) fn begin(&mut self) {
        self.status = MaintenanceStatus::Busy;
    }

    pub(super) fn finish(&mut self, status: MaintenanceStatus) {
        self.status = status;
        self.sequence = self.sequence.wrapping_add(1);
    }

    /// Value of a subindex of 0xB000; `None` for the others.
    pub(super) fn readback(&self, subindex: u8) -> Option<u32> {
        Some(match subindex {
            2 => self.mode.raw().into(),
            5 => match (self.numbers, self.status) {
                (MaintenanceNumbers::Swapped, MaintenanceStatus::CrcError) => {
                    MaintenanceStatus::ImageInvalid.raw().into()
                }
                (MaintenanceNumbers::Swapped, MaintenanceStatus::ImageInvalid) => {
                    MaintenanceStatus::CrcError.raw().into()
                }
                (_, status) => status.raw().into(),
            },
            12 => self.sequence,
            _ => return None,
        })
    }
}

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
