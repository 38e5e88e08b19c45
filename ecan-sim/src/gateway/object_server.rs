//! SDO server: object values, and the rules that an access must meet (manual 3.1, 5.4, 13).
//!
//! ecan-protocol's object dictionary gives types and ranges; the rules of state and combination
//! are here. The mapping objects 0x1600.. and 0x1A00.. are read-only, as in an SII that fixes them.
//! Their entries map subindex 1 of the 16-byte data objects
//! ([`ecan_protocol::object::MAPPED_SUBINDEX`]); the manual names no subindex. After power-on all 24
//! chunks are assigned, as many as the SII's default sync manager size of 3072 bytes holds
//! (manual 5.3).
//!
//! Store of all SDO values: every integer entry of ecan-protocol's object dictionary.
//!
//! Configuration values are stored only here; the firmware decodes them when a command applies
//! them. Counters and states are computed on upload.
//!
//! 0xA000..0xA003: reading and, in engineering mode, writing MCAN registers (manual 13.6).
//!
//! Offsets and bits are those of the Bosch M_CAN core. A register that the model does not have
//! reads as 0. All registers of the whitelist are writable in engineering and factory mode; the
//! controller decides what a write does, and ignores writes to protected registers while CCCR.INIT
//! and CCE are not set. "Access denied" means that the mode is missing. The service is never busy.

use std::cmp::Ordering;

use ecan_protocol::config::{ApplyStatus, DiagnosticFault, DiagnosticTest};
use ecan_protocol::device::AlState;
use ecan_protocol::mapping::{
    CHANNELS, CHUNK_BYTES, Direction, MAX_MULTIPLIER, assignment_index, pdo_map_index,
};
use ecan_protocol::object::{AbortCode, Entry, Object, ObjectType, WRITABLE_REGISTERS, object};

use super::channel_control;
use super::channel_control::{FIRST_CHANNEL_OBJECT, FilterLists};
use super::data_path::DataPath;
use super::dictionary_values::DictionaryValues;
use super::maintenance::{DIAGNOSTIC_TEST, SYSTEM};
use super::mcan_registers::FramesDropped;
use super::variant::{AssignedAtStart, GatewayVariant, ProtectedRegister};

/// 0x8030:9, reason of the last rejected write; the manual numbers none.
pub(super) const TEST_REJECT_REASON: u8 = 9;
/// A policy without the key, or the key removed while a policy is set.
const LOCKED: u32 = 1;

#[derive(Clone, Debug)]
pub(super) struct ObjectServer {
    pub(super) values: DictionaryValues,
    pub(super) filters: [FilterLists; CHANNELS],
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Payload {
    Value(u32),
    /// A 16-byte unit of process data.
    Unit,
}

impl ObjectServer {
    pub(super) fn new(variant: &GatewayVariant) -> Self {
        let mut values = DictionaryValues::new();
        let assigned = match variant.assigned_at_start {
            AssignedAtStart::All => MAX_MULTIPLIER,
            AssignedAtStart::Nothing => 0,
        };
        for direction in Direction::ALL {
            values.set(assignment_index(direction), 0, u32::from(assigned));
        }
        Self { values, filters: std::array::from_fn(|_| FilterLists::new()) }
    }

    pub(super) fn find(
        index: u16,
        subindex: u8,
    ) -> Result<(&'static Object, &'static Entry), AbortCode> {
        let object = object(index).ok_or(AbortCode::NO_OBJECT)?;
        let entry = object.entry(subindex).ok_or(AbortCode::NO_SUBINDEX)?;
        Ok((object, entry))
    }

    pub(super) fn decode(entry: &Entry, data: &[u8]) -> Result<Payload, AbortCode> {
        if !entry.access.can_write() {
            return Err(AbortCode::READ_ONLY);
        }
        let size = entry.ty.size_bytes().ok_or(AbortCode::UNSUPPORTED_ACCESS)?;
        if data.is_empty() {
            return Err(AbortCode::LENGTH);
        }
        match data.len().cmp(&size) {
            Ordering::Greater => return Err(AbortCode::TOO_LONG),
            Ordering::Less => return Err(AbortCode::TOO_SHORT),
            Ordering::Equal => {}
        }
        if entry.ty == ObjectType::String16 {
            return Ok(Payload::Unit);
        }
        let mut bytes = [0; 4];
        bytes[..size].copy_from_slice(data);
        Ok(Payload::Value(u32::from_le_bytes(bytes)))
    }

    /// Checks range and combination of a value, and stores it. A PDO assignment also depends on
    /// the AL state.
    ///
    /// Fields of objects with an apply command are checked when applied, and the register service
    /// and the filter commands report their own status.
    pub(super) fn store(
        &mut self,
        (object, entry): (&Object, &Entry),
        index: u16,
        value: u32,
        state: AlState,
    ) -> Result<(), AbortCode> {
        let subindex = entry.subindex;
        if let Some(direction) = assignment_direction(index) {
            self.check_assignment(direction, subindex, value, state)?;
        } else {
            if is_checked_at_once(object, subindex) {
                check_range(entry, value)?;
            }
            if index == DIAGNOSTIC_TEST {
                self.check_test_policies(subindex, value)?;
            }
        }
        self.values.set(index, subindex, value);
        Ok(())
    }

    fn check_test_policies(&mut self, subindex: u8, value: u32) -> Result<(), AbortCode> {
        let mut locked = false;
        self.test_policies_with(Some((subindex, value)))
            .check(&mut |fault| locked |= fault == DiagnosticFault::Locked);
        if locked {
            self.values.set(DIAGNOSTIC_TEST, TEST_REJECT_REASON, LOCKED);
            return Err(AbortCode::PARAMETER_INCOMPATIBLE);
        }
        Ok(())
    }

    pub(super) fn test_policies(&self) -> DiagnosticTest {
        self.test_policies_with(None)
    }

    fn test_policies_with(&self, replaced: Option<(u8, u32)>) -> DiagnosticTest {
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

    /// 0x1C12 and 0x1C13 are writable in PREOP and SAFEOP, an entry only while the count is 0
    /// and only with a map of the direction.
    fn check_assignment(
        &self,
        direction: Direction,
        subindex: u8,
        value: u32,
        state: AlState,
    ) -> Result<(), AbortCode> {
        if !matches!(state, AlState::PreOp | AlState::SafeOp) {
            return Err(AbortCode::DEVICE_STATE);
        }
        if subindex == 0 {
            let is_valid = value <= u32::from(MAX_MULTIPLIER);
            return if is_valid { Ok(()) } else { Err(AbortCode::TOO_GREAT) };
        }
        if self.values.get(assignment_index(direction), 0) != 0 {
            return Err(AbortCode::SUBINDEX_LOCKED);
        }
        let first = u32::from(pdo_map_index(direction, 0));
        if !(first..first + u32::from(MAX_MULTIPLIER)).contains(&value) {
            return Err(AbortCode::NOT_MAPPABLE);
        }
        Ok(())
    }

    /// Number of assigned chunks; `None` if they are not the first ones in order, so that no
    /// multiplier describes them.
    pub(super) fn assigned_chunks(&self, direction: Direction) -> Option<u8> {
        let index = assignment_index(direction);
        let count = self.values.get_u8(index, 0);
        let is_in_order =
            |chunk| self.values.get(index, chunk + 1) == u32::from(pdo_map_index(direction, chunk));
        (0..count).all(is_in_order).then_some(count)
    }

    pub(super) fn assigned_bytes(&self, direction: Direction) -> usize {
        self.assigned_chunks(direction).map_or(0, |chunks| usize::from(chunks) * CHUNK_BYTES)
    }

    pub(super) fn edit_filters(&mut self, channel: usize, extended: bool, command: u8) {
        let index = FIRST_CHANNEL_OBJECT + channel as u16;
        self.filters[channel].command(&mut self.values, index, extended, command);
    }

    pub(super) fn finish_channel_command(
        &mut self,
        channel: usize,
        status_subindex: u8,
        status: ApplyStatus,
    ) {
        use channel_control::subindex::COMMAND_SEQUENCE;
        let index = FIRST_CHANNEL_OBJECT + channel as u16;
        let sequence = self.values.get(index, COMMAND_SEQUENCE).wrapping_add(1);
        self.values.set(index, COMMAND_SEQUENCE, sequence);
        self.values.set(index, status_subindex, u32::from(status.raw()));
    }
}

fn assignment_direction(index: u16) -> Option<Direction> {
    Direction::ALL.into_iter().find(|&direction| assignment_index(direction) == index)
}

fn is_checked_at_once(object: &Object, subindex: u8) -> bool {
    match object.first {
        0xA000 => false,
        0x8001 => matches!(subindex, 1 | 3),
        0x8010 | 0x8011 => matches!(subindex, 1 | 8),
        _ => object.apply.is_none_or(|apply| apply.command == subindex),
    }
}

fn check_range(entry: &Entry, value: u32) -> Result<(), AbortCode> {
    if value > entry.max {
        Err(AbortCode::TOO_GREAT)
    } else if value < entry.min {
        Err(AbortCode::TOO_SMALL)
    } else if !entry.accepts(value) {
        Err(AbortCode::RANGE)
    } else {
        Ok(())
    }
}

const FIRST_SERVICE: u16 = 0xA000;

const OFFSET: u8 = 1;
const COMMAND: u8 = 2;
const STATUS: u8 = 3;
const WRITE_VALUE: u8 = 4;
const READ_VALUE: u8 = 5;
const TIMESTAMP_LOW: u8 = 6;
const TIMESTAMP_HIGH: u8 = 7;

/// 0x8000:6, source clock of MCAN0; the others follow.
const FIRST_CLOCK: u8 = 6;

const COMMAND_READ: u8 = 1;
const COMMAND_WRITE: u8 = 2;

const OK: u32 = 0;
const OFFSET_INVALID: u32 = 1;
const WRITE_DENIED: u32 = 2;
const ACCESS_DENIED: u32 = 4;

pub(super) struct RegisterService<'a> {
    pub(super) number: usize,
    pub(super) values: &'a mut DictionaryValues,
    pub(super) data_path: &'a mut DataPath,
    pub(super) is_engineering: bool,
}

impl RegisterService<'_> {
    fn index(&self) -> u16 {
        FIRST_SERVICE + self.number as u16
    }

    pub(super) fn execute(&mut self, now: u64) {
        let index = self.index();
        let status = match self.values.get_u8(index, COMMAND) {
            0 => return,
            command @ (COMMAND_READ | COMMAND_WRITE) => self.access(command),
            _ => ACCESS_DENIED,
        };
        self.values.set(index, STATUS, status);
        let [low, high] = [now as u32, (now >> 32) as u32];
        self.values.set(index, TIMESTAMP_LOW, low);
        self.values.set(index, TIMESTAMP_HIGH, high);
    }

    fn access(&mut self, command: u8) -> u32 {
        let (number, index) = (self.number, self.index());
        let offset = self.values.get(index, OFFSET);
        let Some(offset) = u16::try_from(offset)
            .ok()
            .filter(|offset| (0x0004..=0x0404).contains(offset) && offset % 4 == 0)
        else {
            return OFFSET_INVALID;
        };
        let clock_hz = self.values.get(SYSTEM, FIRST_CLOCK + number as u8);
        let denies_locked =
            self.data_path.variant().protected_register == ProtectedRegister::Rejected;
        let DataPath { channels, counters, .. } = &mut *self.data_path;
        let channel = &mut channels[number];
        if command == COMMAND_READ {
            self.values.set(index, READ_VALUE, channel.controller.read_register(offset));
            return OK;
        }
        if !WRITABLE_REGISTERS.iter().any(|&(known, _)| known == offset) {
            return WRITE_DENIED;
        }
        if !self.is_engineering {
            return ACCESS_DENIED;
        }
        if denies_locked && channel.controller.is_locked(offset) {
            return WRITE_DENIED;
        }
        let value = self.values.get(index, WRITE_VALUE);
        let FramesDropped { transmit, receive } =
            channel.controller.write_register(offset, value, clock_hz);
        channel.transmit.note_stale(transmit);
        counters.transmit_losses.stale += transmit as u64;
        counters.receive_losses.flushed += receive as u64;
        OK
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(
        server: &mut ObjectServer,
        index: u16,
        subindex: u8,
        value: u32,
        state: AlState,
    ) -> Result<(), AbortCode> {
        server.store(ObjectServer::find(index, subindex)?, index, value, state)
    }

    #[test]
    fn assignment_needs_preop_and_a_zero_count() {
        let mut server = ObjectServer::new(&GatewayVariant::default());
        let rx = assignment_index(Direction::RxPdo);
        assert_eq!(server.assigned_chunks(Direction::RxPdo), Some(MAX_MULTIPLIER));
        let state = AlState::PreOp;
        assert_eq!(write(&mut server, rx, 0, 0, AlState::Op), Err(AbortCode::DEVICE_STATE));
        assert_eq!(write(&mut server, rx, 1, 0x1600, state), Err(AbortCode::SUBINDEX_LOCKED));
        assert_eq!(write(&mut server, rx, 0, 0, state), Ok(()));
        assert_eq!(write(&mut server, rx, 1, 0x1A00, state), Err(AbortCode::NOT_MAPPABLE));
        assert_eq!(write(&mut server, rx, 1, 0x1601, state), Ok(()));
        assert_eq!(write(&mut server, rx, 0, 1, state), Ok(()));
        assert_eq!(server.assigned_chunks(Direction::RxPdo), None);
        assert_eq!(server.assigned_bytes(Direction::RxPdo), 0);
    }

    #[test]
    fn download_length_must_match_the_entry() {
        let (_, entry) = ObjectServer::find(0x8010, 3).unwrap();
        assert_eq!(ObjectServer::decode(entry, &[8]), Ok(Payload::Value(8)));
        assert_eq!(ObjectServer::decode(entry, &[]), Err(AbortCode::LENGTH));
        assert_eq!(ObjectServer::decode(entry, &[8, 0]), Err(AbortCode::TOO_LONG));
        let (_, unit) = ObjectServer::find(0x7000, 1).unwrap();
        assert_eq!(ObjectServer::decode(unit, &[0; 16]), Ok(Payload::Unit));
        assert_eq!(ObjectServer::decode(unit, &[0; 15]), Err(AbortCode::TOO_SHORT));
    }

    #[test]
    fn test_policy_without_key_is_rejected_with_a_reason() {
        let mut server = ObjectServer::new(&GatewayVariant::default());
        let rejected = write(&mut server, DIAGNOSTIC_TEST, 4, 1, AlState::PreOp);
        assert_eq!(rejected, Err(AbortCode::PARAMETER_INCOMPATIBLE));
        assert_eq!(server.values.get(DIAGNOSTIC_TEST, TEST_REJECT_REASON), LOCKED);
        assert_eq!(server.test_policies(), DiagnosticTest::OFF);
        server.values.set(DIAGNOSTIC_TEST, TEST_REJECT_REASON, 0);
        assert_eq!(server.values.get(DIAGNOSTIC_TEST, TEST_REJECT_REASON), 0);
    }
}
