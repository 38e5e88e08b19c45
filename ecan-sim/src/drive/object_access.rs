//! SDO access to the dictionary: rules, checks, and effects of a write.

use ecan_canopen::{AccessType, HeartbeatConsumer, Mpdo, MpdoAddress, object};
use ecan_protocol::object::AbortCode;

use super::axis_commands::ReceivedCommands;
use super::config::{SdoDirection, SdoEffect, SdoRule};
use super::device::Device;
use super::dictionary::{Key, Object, Slot, Value, split_index};
use super::homing;
use super::network::{Network, clear_history};
use super::pdo::PdoObject;
use super::sdo_server::TransferError;

/// "save" and "load", little-endian.
const SAVE: i64 = 0x6576_6173;
const LOAD: i64 = 0x6461_6F6C;

/// EMCY error code: the destination object of an MPDO is not available.
const NO_DESTINATION: u16 = 0x8230;
/// EMCY error code: MPDO with another length than 8 bytes.
const LENGTH: u16 = 0x8210;

impl Device {
    pub(super) fn upload(&mut self, key: Key, out: &mut Vec<u8>) -> Result<(), TransferError> {
        self.apply_rule(key, SdoDirection::Read)?;
        self.model.publish(self.network.state);
        let slot = self.model.objects.find(key)?;
        Ok(self.model.objects.read(slot, out)?)
    }

    /// Checks whether a download of `length` bytes may start.
    pub(super) fn begin_download(
        &mut self,
        key: Key,
        length: Option<usize>,
    ) -> Result<(), TransferError> {
        self.apply_rule(key, SdoDirection::Write)?;
        let slot = self.model.objects.find(key)?;
        Ok(self.model.objects.check_write(slot, length)?)
    }

    pub(super) fn download(&mut self, key: Key, value: &[u8]) -> Result<(), TransferError> {
        let slot = self.model.objects.find(key)?;
        match self.model.objects.decode(slot, value)? {
            Some(number) => self.write(slot, key, number)?,
            None => self.model.objects.put_bytes(slot, value),
        }
        Ok(())
    }

    /// Writes the object that a multiplexed PDO (CiA 301, 7.2.2.4) in destination address mode names.
    pub(super) fn on_mpdo(&mut self, data: &[u8]) {
        let Ok(mpdo) = Mpdo::parse(data) else { return self.model.report(LENGTH) };
        let is_destination = matches!(mpdo.address, MpdoAddress::Destination(_));
        if !is_destination || !mpdo.is_for(self.config.node) {
            return;
        }
        self.pdos.count_multiplexed();
        let key = (mpdo.index, mpdo.subindex);
        let value = self.size(key).and_then(|size| mpdo.data.get(..size));
        if value.is_none_or(|value| self.download(key, value).is_err()) {
            self.model.report(NO_DESTINATION);
        }
    }

    /// Size of an object's type, for expedited downloads without size.
    pub(super) fn size(&self, key: Key) -> Option<usize> {
        let slot = self.model.objects.find(key).ok()?;
        self.model.objects.object(slot)?.data_type.size()
    }

    fn apply_rule(
        &mut self,
        (index, subindex): Key,
        direction: SdoDirection,
    ) -> Result<(), TransferError> {
        let applies = |rule: &SdoRule| {
            rule.index == index
                && rule.subindex.is_none_or(|only| only == subindex)
                && (rule.direction == direction || rule.direction == SdoDirection::Both)
        };
        let found = self.rules.iter_mut().find(|(rule, left)| applies(rule) && *left != Some(0));
        let Some((rule, left)) = found else { return Ok(()) };
        if let Some(left) = left {
            *left -= 1;
        }
        Err(match rule.effect {
            SdoEffect::Abort(code) => TransferError::Abort(code),
            SdoEffect::Silence => TransferError::Silence,
        })
    }

    fn write(&mut self, slot: Slot, key: Key, number: i64) -> Result<(), AbortCode> {
        self.check(key, number)?;
        match key {
            (object::STORE_PARAMETERS, group) if number == SAVE => {
                for object in self.model.objects.iter_mut().filter(|object| is_parameter(object)) {
                    if group_range(group).contains(&object.index) {
                        object.saved = Some(object.value.clone());
                    }
                }
            }
            // The defaults apply after the next reset.
            (object::RESTORE_PARAMETERS, group) if number == LOAD => {
                for object in self.model.objects.iter_mut() {
                    if group_range(group).contains(&object.index) {
                        object.saved = None;
                    }
                }
            }
            (object::STORE_PARAMETERS | object::RESTORE_PARAMETERS, _) => {
                return Err(AbortCode::NOT_STORED);
            }
            (object::ERROR_HISTORY, 0) => clear_history(&mut self.model.objects),
            _ => {
                self.model.objects.put(slot, number as u64);
                self.date_expires(slot, key);
                self.follow_up(key, number);
            }
        }
        Ok(())
    }

    /// The configuration date 0x1020 applies to unchanged parameters only.
    fn date_expires(&mut self, slot: Slot, (index, _): Key) {
        let is_changed = self.model.objects.object(slot).is_some_and(is_parameter);
        if is_changed && index != object::CONFIGURATION_DATE {
            self.model.objects.set(object::CONFIGURATION_DATE, 1, 0);
            self.model.objects.set(object::CONFIGURATION_DATE, 2, 0);
        }
    }

    /// Checks beyond the type and limits of an object.
    fn check(&self, (index, subindex): Key, number: i64) -> Result<(), AbortCode> {
        if let Some(pdo) = PdoObject::of(index) {
            return pdo.check(
                &self.model.objects,
                self.network.state,
                &self.config.quirks,
                (index, subindex),
                number as u32,
            );
        }
        let (axis, index) = split_index(index);
        match (index, subindex) {
            (object::MODE_OF_OPERATION, _)
                if self.model.is_drive && !self.model.has_mode(axis, number as i8) =>
            {
                Err(AbortCode::RANGE)
            }
            (object::HOMING_METHOD, _)
                if self.model.is_drive && number != 0 && !homing::is_supported(number as i8) =>
            {
                Err(AbortCode::RANGE)
            }
            // Only while the communication cycle period is 0; the counter counts at least to 2.
            (object::SYNC_COUNTER_OVERFLOW, _) => {
                match self.model.objects.number(object::COMMUNICATION_CYCLE, 0).unwrap_or(0) {
                    0 if number == 1 => Err(AbortCode::RANGE),
                    0 => Ok(()),
                    _ => Err(AbortCode::DEVICE_STATE),
                }
            }
            // The drive does not produce TIME, and supports 11-bit CAN IDs only.
            (object::TIME_COB_ID, _) if number as u32 & !(1 << 31 | 0x7FF) != 0 => {
                Err(AbortCode::RANGE)
            }
            // The drive is not a SYNC producer, and supports 11-bit CAN IDs only.
            (object::SYNC_COB_ID, _) if number as u32 & !0x7FF != 0 => Err(AbortCode::RANGE),
            (object::CONSUMER_HEARTBEAT, 1..) => match HeartbeatConsumer::from_raw(number as u32) {
                Some(entry)
                    if Network::is_watched(&self.model.objects, entry.producer, subindex) =>
                {
                    Err(AbortCode::PARAMETER_INCOMPATIBLE)
                }
                _ => Ok(()),
            },
            _ => Ok(()),
        }
    }

    fn follow_up(&mut self, (index, subindex): Key, number: i64) {
        if let Some(pdo) = PdoObject::of(index) {
            return self.pdos.load_pdo(pdo, &mut self.model);
        }
        match index {
            object::PRODUCER_HEARTBEAT => self.network.load(self.now, &self.model.objects),
            object::CONSUMER_HEARTBEAT if subindex > 0 => {
                self.network.load_watches(&self.model.objects);
            }
            object::SYNC_COB_ID | object::SYNC_COUNTER_OVERFLOW => {
                self.pdos.load_sync(&self.model.objects)
            }
            object::TIME_COB_ID => self.pdos.load_time(&self.model.objects),
            object::SCANNER_LIST => self.pdos.load_transmit(&mut self.model),
            object::GUARD_TIME | object::LIFE_TIME_FACTOR => {
                self.guarding.load(&self.model.objects)
            }
            _ if !self.model.is_drive => {}
            _ => {
                let mut received = ReceivedCommands { by_sdo: true, ..ReceivedCommands::default() };
                let (axis, of_first) = split_index(index);
                let Some(unit) = self.model.units.get_mut(axis) else { return };
                if unit.axis.store_command(of_first, number, &mut received) {
                    unit.apply(&received);
                } else if index >= 0x6000 {
                    self.model.load_parameters();
                }
            }
        }
    }
}

/// Objects that a subindex of 0x1010 and 0x1011 concerns.
fn group_range(group: u8) -> std::ops::RangeInclusive<u16> {
    match group {
        0 | 1 => 0x0000..=0xFFFF,
        2 => 0x1000..=0x1FFF,
        3 => 0x6000..=0x9FFF,
        _ => 0x2000..=0x5FFF,
    }
}

/// Commands are not saved.
fn is_parameter(object: &Object) -> bool {
    let kept = !matches!(
        object.index,
        object::ERROR_HISTORY | object::STORE_PARAMETERS | object::RESTORE_PARAMETERS
    );
    kept && object.access == AccessType::ReadWrite && matches!(object.value, Value::Number(_))
}
