//! What a download sets off beside changing a value: apply commands, resets, test policies.

use ecan_protocol::config::{
    ApplyStatus, ConfigObject, DataPathConfig, DataPathGlobal, DiagnosticFault, DiagnosticTest,
};
use ecan_protocol::device::AlState;
use ecan_protocol::mapping::Direction;
use ecan_protocol::object::AbortCode;

use super::Gateway;
use super::channel_control::{self, FIRST_CHANNEL_OBJECT};
use super::maintenance::PendingCommand;
use super::profile_control::{self, COMMAND_CLEAR_ERRORS, COMMAND_RESET_SESSION};

const SYSTEM: u16 = 0x8000;
const GLOBAL_DATA_PATH: u16 = 0x8020;
const FIRST_DATA_PATH: u16 = 0x8021;
const DIAGNOSTIC_TEST: u16 = 0x8030;
const CYCLE_PERFORMANCE: u16 = 0x9011;
const FIRST_REGISTER_SERVICE: u16 = 0xA000;
const MAINTENANCE: u16 = 0xB000;

/// From the command to reboot to the reboot: the master fetches the answer.
const REBOOT_NS: u64 = 10_000_000;

/// Subindices of 0x8030.
mod test {
    pub(super) const KEY: u8 = 1;
    pub(super) const REJECT_REASON: u8 = 9;
}

/// Reasons in 0x8030:9; the manual numbers none.
mod reject {
    /// A policy without the key, or the key taken away from a policy.
    pub(super) const LOCKED: u32 = 1;
}

impl Gateway {
    /// Rules between several values, checked before a value is stored.
    pub(super) fn check_combination(
        &mut self,
        index: u16,
        subindex: u8,
        value: u32,
    ) -> Result<(), AbortCode> {
        // one command at a time; losing one in silence would leave the master waiting
        if (index, subindex) == (MAINTENANCE, 4) && self.flash_job.is_some() {
            return Err(AbortCode::DEVICE_STATE);
        }
        if index != DIAGNOSTIC_TEST {
            return Ok(());
        }
        let mut locked = false;
        self.diagnostic_test(Some((subindex, value)))
            .check(&mut |fault| locked |= fault == DiagnosticFault::Locked);
        if locked {
            self.values.set(DIAGNOSTIC_TEST, test::REJECT_REASON, reject::LOCKED);
            return Err(AbortCode::PARAMETER_INCOMPATIBLE);
        }
        Ok(())
    }

    /// The test policies as stored, or as they would be with one value replaced.
    fn diagnostic_test(&self, replaced: Option<(u8, u32)>) -> DiagnosticTest {
        let read = |subindex| {
            Ok::<_, std::convert::Infallible>(match replaced {
                Some((at, value)) if at == subindex => value,
                _ => self.values.get(DIAGNOSTIC_TEST, subindex),
            })
        };
        match DiagnosticTest::read(read) {
            Ok(test) => test,
            Err(never) => match never {},
        }
    }

    /// A value was stored.
    pub(super) fn after_write(&mut self, index: u16, subindex: u8, value: u32) {
        let channel = |first: u16| usize::from(index - first);
        match index {
            SYSTEM => self.after_system_write(subindex, value),
            0x8001..=0x8004 => {
                self.after_channel_write(channel(FIRST_CHANNEL_OBJECT), index, subindex, value);
            }
            0x8010 => self.after_profile_write(Direction::TxPdo, subindex, value),
            0x8011 => self.after_profile_write(Direction::RxPdo, subindex, value),
            GLOBAL_DATA_PATH if subindex == 2 => {
                self.values.set(index, subindex, 0);
                if value == 1 {
                    self.apply_global_data_path();
                }
            }
            0x8021..=0x8024 if subindex == 2 => {
                self.values.set(index, subindex, 0);
                if value == 1 {
                    self.apply_data_path(channel(FIRST_DATA_PATH), index);
                }
            }
            DIAGNOSTIC_TEST => {
                self.test = self.diagnostic_test(None);
                if subindex == test::KEY {
                    self.values.set(DIAGNOSTIC_TEST, test::REJECT_REASON, 0);
                }
                self.configure_codecs();
            }
            CYCLE_PERFORMANCE => {
                self.values.set(index, subindex, 0);
                if value == 1 {
                    self.clear_performance();
                }
            }
            0xA000..=0xA003 if subindex == 2 => {
                self.register_command(channel(FIRST_REGISTER_SERVICE), index);
            }
            MAINTENANCE => self.after_maintenance_write(subindex, value),
            _ => {}
        }
    }

    // 0x8000

    fn after_system_write(&mut self, subindex: u8, value: u32) {
        match subindex {
            1 if value == 1 => self.reboot_at = Some(self.now + REBOOT_NS),
            12 => self.rotate_pins(value),
            _ => {}
        }
    }

    /// The stored rotation is put in force.
    pub(super) fn apply_stored_rotation(&mut self) {
        const REQUESTED: u8 = 12;
        self.rotate_pins(self.values.get(SYSTEM, REQUESTED));
    }

    /// Rotation is taken over at once, but not in OP (apply status 1 then); it restarts all
    /// controllers with the configuration they have, at their new connectors.
    fn rotate_pins(&mut self, rotation: u32) {
        const ACTIVE: u8 = 13;
        const STATUS: u8 = 15;
        if self.state == AlState::Op {
            self.values.set(SYSTEM, STATUS, 1);
            return;
        }
        let rotation = rotation.to_le_bytes()[0];
        self.values.set(SYSTEM, STATUS, 0);
        self.values.set(SYSTEM, ACTIVE, u32::from(rotation));
        if rotation == self.pin_rotation {
            return;
        }
        self.pin_rotation = rotation;
        self.rotations = self.rotations.wrapping_add(1);
        for channel in &mut self.channels {
            channel.restart_in_place(&mut self.counters);
        }
    }

    // 0x8001..0x8004

    fn after_channel_write(&mut self, number: usize, index: u16, subindex: u8, value: u32) {
        use channel_control::subindex as si;
        let byte = value.to_le_bytes()[0];
        match subindex {
            si::APPLY if value == 1 => {
                let status = self.apply_channel(number);
                self.finish_channel_command(index, si::APPLY_STATUS, status);
            }
            si::FLASH if value != 0 => self.channel_flash_command(number, value),
            si::STANDARD_COMMAND | si::EXTENDED_COMMAND => {
                if let Some(lists) = self.filters.get_mut(number) {
                    let extended = subindex == si::EXTENDED_COMMAND;
                    lists.command(&mut self.values, index, extended, byte);
                }
            }
            _ => {}
        }
    }

    pub(super) fn finish_channel_command(
        &mut self,
        index: u16,
        status_subindex: u8,
        status: ApplyStatus,
    ) {
        use channel_control::subindex::COMMAND_SEQUENCE;
        let sequence = self.values.get(index, COMMAND_SEQUENCE).wrapping_add(1);
        self.values.set(index, COMMAND_SEQUENCE, sequence);
        self.values.set(index, status_subindex, u32::from(status.raw()));
    }

    /// Restarts the controller with the configuration in the dictionary; a configuration that
    /// does not work leaves it running as it was.
    pub(super) fn apply_channel(&mut self, number: usize) -> ApplyStatus {
        let Some(filters) = self.filters.get(number) else {
            return ApplyStatus::Fail;
        };
        let built = channel_control::build(&self.values, number as u8, filters);
        let Some(channel) = self.channels.get_mut(number) else {
            return ApplyStatus::Fail;
        };
        match built {
            Ok(config) => {
                self.counters.transmit_losses.schedule_failed +=
                    self.schedule.flush_channel(number) as u64;
                channel.apply(config, &mut self.counters);
                ApplyStatus::Ok
            }
            Err(status) => {
                channel.apply_failed = true;
                status
            }
        }
    }

    // 0x8010, 0x8011

    fn after_profile_write(&mut self, direction: Direction, subindex: u8, value: u32) {
        use profile_control::subindex as si;
        match subindex {
            si::APPLY if value == 1 => self.apply_profile(direction),
            si::COMMAND => {
                if value & COMMAND_RESET_SESSION != 0 {
                    self.reset_session(direction);
                }
                if value & COMMAND_CLEAR_ERRORS != 0 {
                    self.profile_mut(direction).clear_errors();
                }
            }
            si::MULTIPLIER..=si::OPTIONS => {
                let Self { profiles: [tx, rx], values, .. } = self;
                match direction {
                    Direction::TxPdo => tx.note_request(values),
                    Direction::RxPdo => rx.note_request(values),
                }
            }
            _ => {}
        }
    }

    /// Applies the requested profile of a direction. A changed layout starts a new session.
    pub(super) fn apply_profile(&mut self, direction: Direction) {
        let assigned = self.assigned_chunks(direction);
        let state = self.state;
        let Self { profiles: [tx, rx], values, .. } = self;
        let control = match direction {
            Direction::TxPdo => tx,
            Direction::RxPdo => rx,
        };
        if control.apply(values, state, assigned) {
            self.configure_codecs();
            if direction == Direction::RxPdo {
                self.parser.reset_session();
            }
        }
    }

    fn reset_session(&mut self, direction: Direction) {
        self.profile_mut(direction).reset_session();
        match direction {
            Direction::TxPdo => {
                self.builder.reset_session();
                self.results.clear();
            }
            Direction::RxPdo => self.parser.reset_session(),
        }
    }

    // 0x8020, 0x8021..0x8024

    pub(super) fn apply_global_data_path(&mut self) {
        let read = |subindex| self.values.get(GLOBAL_DATA_PATH, subindex);
        let requested = DataPathGlobal::from_values(read);
        let mut faulty = requested.is_err();
        if let Ok(requested) = requested {
            requested.check(&mut |_| faulty = true);
            if !faulty {
                self.data_path = requested;
            }
        }
        self.set_data_path_status(GLOBAL_DATA_PATH, faulty);
    }

    pub(super) fn apply_data_path(&mut self, number: usize, index: u16) {
        let requested = DataPathConfig::from_values(|subindex| self.values.get(index, subindex));
        let mut faulty = requested.is_err();
        if let Ok(requested) = requested {
            requested.check(&mut |_| faulty = true);
            if !faulty && let Some(channel) = self.channels.get_mut(number) {
                channel.set_policy(requested, &mut self.counters);
            }
        }
        self.set_data_path_status(index, faulty);
    }

    /// The manual knows only "0=OK"; a refused policy shows 1, as in 13.4.
    fn set_data_path_status(&mut self, index: u16, faulty: bool) {
        const STATUS: u8 = 3;
        let status = if faulty { ApplyStatus::Fail } else { ApplyStatus::Ok };
        self.values.set(index, STATUS, u32::from(status.raw()));
    }

    // 0xB000

    fn after_maintenance_write(&mut self, subindex: u8, value: u32) {
        match subindex {
            1 => {
                let timeout = self.values.get_u16(MAINTENANCE, 3);
                let mode = value.to_le_bytes()[0];
                self.maintenance.request_mode(self.now, mode, timeout);
            }
            4 => {
                let in_op = self.state == AlState::Op;
                let is_receiving = self.firmware.is_receiving();
                match self.maintenance.command(value, in_op, is_receiving) {
                    PendingCommand::Nothing => {}
                    PendingCommand::ClearDiagnostics => self.clear_diagnostics(),
                    PendingCommand::Execute(bits) => self.begin_maintenance(bits),
                }
            }
            _ => {}
        }
    }
}
