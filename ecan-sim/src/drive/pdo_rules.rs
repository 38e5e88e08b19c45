//! Rules for writing PDO parameters (CiA 301, 7.5.2.35 to 7.5.2.38).

use ecan_canopen::{MappingEntry, NmtState, PdoCobId, TransmissionType, object};
use ecan_protocol::can::CanId;
use ecan_protocol::object::AbortCode;

use super::config::DriveQuirks;
use super::default_objects::PDO_ENTRIES;
use super::dictionary::Dictionary;
use super::pdo::{PDO_BYTES, is_dummy};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PdoObject {
    /// 0x1400 to 0x15FF.
    ReceiveCommunication(u16),
    /// 0x1600 to 0x17FF.
    ReceiveMapping(u16),
    /// 0x1800 to 0x19FF.
    TransmitCommunication(u16),
    /// 0x1A00 to 0x1BFF.
    TransmitMapping(u16),
}

impl PdoObject {
    pub(super) const fn of(index: u16) -> Option<Self> {
        let number = index & 0x1FF;
        match index & 0xFE00 {
            object::RPDO_COMMUNICATION => Some(Self::ReceiveCommunication(number)),
            object::RPDO_MAPPING => Some(Self::ReceiveMapping(number)),
            object::TPDO_COMMUNICATION => Some(Self::TransmitCommunication(number)),
            object::TPDO_MAPPING => Some(Self::TransmitMapping(number)),
            _ => None,
        }
    }

    const fn is_sent(self) -> bool {
        matches!(self, Self::TransmitCommunication(_) | Self::TransmitMapping(_))
    }

    const fn communication(self) -> u16 {
        match self {
            Self::ReceiveCommunication(number) | Self::ReceiveMapping(number) => {
                object::RPDO_COMMUNICATION + number
            }
            Self::TransmitCommunication(number) | Self::TransmitMapping(number) => {
                object::TPDO_COMMUNICATION + number
            }
        }
    }

    /// Checks a write to a subindex.
    ///
    /// # Errors
    /// The abort code.
    pub(super) fn check(
        self,
        objects: &Dictionary,
        state: NmtState,
        quirks: &DriveQuirks,
        (index, subindex): (u16, u8),
        value: u32,
    ) -> Result<(), AbortCode> {
        match self {
            Self::ReceiveMapping(_) | Self::TransmitMapping(_) => {
                if quirks.fixed_mapping {
                    return Err(AbortCode::READ_ONLY);
                }
                if state == NmtState::Operational {
                    return Err(AbortCode::DEVICE_STATE);
                }
                if quirks.refuses_mapping_while_valid && self.is_valid(objects) {
                    return Err(AbortCode::UNSUPPORTED_ACCESS);
                }
                if subindex == 0 {
                    self.check_count(objects, index, value)
                } else {
                    self.check_entry_write(objects, index, value)
                }
            }
            Self::ReceiveCommunication(_) | Self::TransmitCommunication(_) => {
                self.check_communication(objects, state, subindex, value)
            }
        }
    }

    fn is_valid(self, objects: &Dictionary) -> bool {
        objects
            .number(self.communication(), 1)
            .and_then(|raw| PdoCobId::from_raw(raw as u32))
            .is_some_and(|cob_id| cob_id.is_valid)
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
                let old = objects.number(self.communication(), 1).unwrap_or(0);
                let old = PdoCobId::from_raw(old as u32);
                // The COB-ID of an existing PDO cannot change.
                match old {
                    Some(old) if old.is_valid && new.is_valid && old.id != new.id => {
                        Err(AbortCode::UNSUPPORTED_ACCESS)
                    }
                    _ => Ok(()),
                }
            }
            2 => match TransmissionType::from_raw(value as u8) {
                // Remote frames are not answered.
                None | Some(TransmissionType::RtrSynchronous | TransmissionType::RtrEvent) => {
                    Err(AbortCode::RANGE)
                }
                Some(_) => Ok(()),
            },
            3 | 6 if self.is_valid(objects) => Err(AbortCode::UNSUPPORTED_ACCESS),
            _ => Ok(()),
        }
    }

    fn check_entry_write(
        self,
        objects: &Dictionary,
        index: u16,
        value: u32,
    ) -> Result<(), AbortCode> {
        if objects.number(index, 0).unwrap_or(0) != 0 {
            return Err(AbortCode::SUBINDEX_LOCKED);
        }
        if value == 0 {
            return Ok(());
        }
        self.check_entry(objects, MappingEntry::from_raw(value)).map(|_| ())
    }

    /// Size of an object in bytes, if this PDO may map it.
    fn check_entry(self, objects: &Dictionary, entry: MappingEntry) -> Result<usize, AbortCode> {
        let bytes = usize::from(entry.bits / 8);
        if !self.is_sent() && is_dummy(entry) {
            return Ok(bytes);
        }
        let slot = objects.find(entry.index, entry.subindex)?;
        let object = objects.object(slot).ok_or(AbortCode::NO_OBJECT)?;
        let carries = if self.is_sent() { object.can_be_sent() } else { object.can_be_received() };
        if carries && object.data_type.bits() == Some(entry.bits) {
            Ok(bytes)
        } else {
            Err(AbortCode::NOT_MAPPABLE)
        }
    }

    fn check_count(self, objects: &Dictionary, index: u16, count: u32) -> Result<(), AbortCode> {
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
