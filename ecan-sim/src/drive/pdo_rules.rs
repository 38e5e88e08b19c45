//! Rules for writing PDO parameters (CiA 301, 7.5.2.35 to 7.5.2.38).

use ecan_canopen::{MappingEntry, Mpdo, NmtState, PdoCobId, TransmissionType, object};
use ecan_protocol::can::CanId;
use ecan_protocol::object::AbortCode;

use super::config::DriveQuirks;
use super::default_objects::PDO_ENTRIES;
use super::dictionary::{Dictionary, mapped_bits};
use super::pdo::{PDO_BYTES, is_dummy, valid_pdo_id};

/// PDO parameters: communication at 0x1400 and 0x1800, mapping at 0x1600 and 0x1A00.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PdoObject {
    pub(super) is_sent: bool,
    is_mapping: bool,
    pub(super) number: u16,
}

impl PdoObject {
    pub(super) fn of(index: u16) -> Option<Self> {
        (object::RPDO_COMMUNICATION..object::TPDO_MAPPING + 0x200).contains(&index).then_some(
            Self {
                is_sent: index >= object::TPDO_COMMUNICATION,
                is_mapping: index & 0x200 != 0,
                number: index & 0x1FF,
            },
        )
    }

    const fn communication(self) -> u16 {
        let first =
            if self.is_sent { object::TPDO_COMMUNICATION } else { object::RPDO_COMMUNICATION };
        first + self.number
    }

    pub(super) fn check(
        self,
        objects: &Dictionary,
        state: NmtState,
        quirks: &DriveQuirks,
        (index, subindex): (u16, u8),
        value: u32,
    ) -> Result<(), AbortCode> {
        if !self.is_mapping {
            return self.check_communication(objects, state, subindex, value);
        }
        if quirks.fixed_mapping {
            return Err(AbortCode::READ_ONLY);
        }
        if state == NmtState::Operational {
            return Err(AbortCode::DEVICE_STATE);
        }
        let must_be_invalid = quirks.rejects_mapping_while_valid && self.can_be_invalid(objects);
        if must_be_invalid && self.valid_id(objects).is_some() {
            return Err(AbortCode::UNSUPPORTED_ACCESS);
        }
        if subindex == 0 {
            return self.check_count(objects, index, value);
        }
        if objects.number(index, 0).unwrap_or(0) != 0 {
            return Err(AbortCode::SUBINDEX_LOCKED);
        }
        if value != 0 {
            self.check_entry(objects, MappingEntry::from_raw(value))?;
        }
        Ok(())
    }

    /// Returns whether a client can write the COB-ID. Some devices have a constant one.
    fn can_be_invalid(self, objects: &Dictionary) -> bool {
        let slot = objects.find((self.communication(), 1)).ok();
        let object = slot.and_then(|slot| objects.object(slot));
        object.is_none_or(|object| object.access.is_writable())
    }

    fn valid_id(self, objects: &Dictionary) -> Option<CanId> {
        valid_pdo_id(objects.number(self.communication(), 1)? as u32)
    }

    fn check_communication(
        self,
        objects: &Dictionary,
        state: NmtState,
        subindex: u8,
        value: u32,
    ) -> Result<(), AbortCode> {
        match subindex {
            1 => {
                let new = PdoCobId::from_raw(value).ok_or(AbortCode::RANGE)?;
                if new.is_valid && is_restricted(new.id) {
                    return Err(AbortCode::RANGE);
                }
                if state == NmtState::Operational {
                    return Err(AbortCode::DEVICE_STATE);
                }
                // The COB-ID of an existing PDO cannot change.
                if new.is_valid && self.valid_id(objects).is_some_and(|old| old != new.id) {
                    return Err(AbortCode::UNSUPPORTED_ACCESS);
                }
                Ok(())
            }
            2 => match TransmissionType::from_raw(value as u8) {
                // Remote frames are not answered.
                None | Some(TransmissionType::RtrSynchronous | TransmissionType::RtrEvent) => {
                    Err(AbortCode::RANGE)
                }
                Some(_) => Ok(()),
            },
            3 | 6 if self.valid_id(objects).is_some() => Err(AbortCode::UNSUPPORTED_ACCESS),
            _ => Ok(()),
        }
    }

    /// Size of an object in bytes, if this PDO may map it.
    fn check_entry(self, objects: &Dictionary, entry: MappingEntry) -> Result<usize, AbortCode> {
        let bytes = usize::from(entry.bits / 8);
        if !self.is_sent && is_dummy(entry) {
            return Ok(bytes);
        }
        let slot = objects.find((entry.index, entry.subindex))?;
        let object = objects.object(slot).ok_or(AbortCode::NO_OBJECT)?;
        let carries = if self.is_sent { object.can_be_sent() } else { object.can_be_received() };
        if carries && mapped_bits(object.data_type) == Some(entry.bits) {
            Ok(bytes)
        } else {
            Err(AbortCode::NOT_MAPPABLE)
        }
    }

    fn check_count(self, objects: &Dictionary, index: u16, count: u32) -> Result<(), AbortCode> {
        // The drive sends MPDOs in source address mode only, and receives them in the other one only.
        let mode = if self.is_sent { Mpdo::SOURCE_MAPPING } else { Mpdo::DESTINATION_MAPPING };
        if count == u32::from(mode) {
            return Ok(());
        }
        if count as usize > PDO_ENTRIES {
            return Err(AbortCode::TOO_GREAT);
        }
        let mut length = 0;
        for subindex in 1..=count as u8 {
            let raw = objects.number(index, subindex).ok_or(AbortCode::RANGE)?;
            length += self.check_entry(objects, MappingEntry::from_raw(raw as u32))?;
        }
        if length > PDO_BYTES { Err(AbortCode::PDO_LENGTH) } else { Ok(()) }
    }
}

/// COB-IDs that CiA 301 reserves for other services.
fn is_restricted(id: CanId) -> bool {
    !id.is_extended()
        && matches!(
            id.raw(),
            0x000..=0x07F | 0x101..=0x180 | 0x581..=0x5FF | 0x601..=0x67F | 0x6E0..=0x6FF
                | 0x701..=0x7FF
        )
}
