//! PDO communication and mapping parameters (CiA 301, 7.5.2).

use core::fmt;

use ecan_protocol::can::CanId;

/// An entry of a PDO mapping object, 0x1600.. or 0x1A00...
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MappingEntry {
    /// Index of the mapped object.
    pub index: u16,
    /// Its subindex.
    pub subindex: u8,
    /// Its length in bits.
    pub bits: u8,
}

impl MappingEntry {
    /// An entry.
    pub const fn new(index: u16, subindex: u8, bits: u8) -> Self {
        Self { index, subindex, bits }
    }

    /// The value of the entry.
    pub const fn raw(self) -> u32 {
        (self.index as u32) << 16 | (self.subindex as u32) << 8 | self.bits as u32
    }

    /// The entry with this value.
    pub const fn from_raw(raw: u32) -> Self {
        let [bits, subindex, low, high] = raw.to_le_bytes();
        Self { index: u16::from_le_bytes([low, high]), subindex, bits }
    }
}

impl fmt::Display for MappingEntry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "0x{:04X}:{:02} ({} bits)", self.index, self.subindex, self.bits)
    }
}

const INVALID: u32 = 1 << 31;
const NO_RTR: u32 = 1 << 30;
const EXTENDED: u32 = 1 << 29;

/// The COB-ID entry of a PDO, subindex 1 of 0x1400.. or 0x1800...
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PdoCobId {
    /// Identifier of the frames.
    pub id: CanId,
    /// True if the PDO exists. Only one that does not may be mapped again.
    pub is_valid: bool,
    /// True if remote frames may ask for it (TPDO only).
    pub allows_rtr: bool,
}

impl PdoCobId {
    /// An existing PDO that no remote frame may ask for.
    pub const fn new(id: CanId) -> Self {
        Self { id, is_valid: true, allows_rtr: false }
    }

    /// The same, not existing.
    #[must_use]
    pub const fn invalid(self) -> Self {
        Self { is_valid: false, ..self }
    }

    /// The value of the entry.
    pub fn raw(self) -> u32 {
        let flag = |set, bit| if set { bit } else { 0 };
        self.id.raw()
            | flag(self.id.is_extended(), EXTENDED)
            | flag(!self.allows_rtr, NO_RTR)
            | flag(!self.is_valid, INVALID)
    }

    /// The entry with this value; `None` for an 11-bit identifier that has more bits.
    pub fn from_raw(raw: u32) -> Option<Self> {
        let id = CanId::new(raw & 0x1FFF_FFFF, raw & EXTENDED != 0).ok()?;
        Some(Self { id, is_valid: raw & INVALID == 0, allows_rtr: raw & NO_RTR == 0 })
    }
}

/// When a PDO is sent or takes effect, subindex 2 of 0x1400.. or 0x1800...
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TransmissionType {
    /// With the next SYNC after an event.
    SynchronousAcyclic,
    /// With every n-th SYNC, n from 1 to 240.
    Synchronous(u8),
    /// On request, sampled with SYNC.
    RtrSynchronous,
    /// On request.
    RtrEvent,
    /// By an event of the manufacturer.
    EventManufacturer,
    /// By an event of the device profile.
    EventProfile,
}

impl TransmissionType {
    /// The number.
    pub const fn raw(self) -> u8 {
        match self {
            Self::SynchronousAcyclic => 0,
            Self::Synchronous(every) => every,
            Self::RtrSynchronous => 252,
            Self::RtrEvent => 253,
            Self::EventManufacturer => 254,
            Self::EventProfile => 255,
        }
    }

    /// The type with this number; `None` for the reserved 241 to 251.
    pub const fn from_raw(raw: u8) -> Option<Self> {
        Some(match raw {
            0 => Self::SynchronousAcyclic,
            1..=240 => Self::Synchronous(raw),
            252 => Self::RtrSynchronous,
            253 => Self::RtrEvent,
            254 => Self::EventManufacturer,
            255 => Self::EventProfile,
            _ => return None,
        })
    }

    /// Returns whether SYNC rules it.
    pub const fn is_synchronous(self) -> bool {
        matches!(self, Self::SynchronousAcyclic | Self::Synchronous(_) | Self::RtrSynchronous)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mapping_entries() {
        let target = MappingEntry::new(0x607A, 0, 32);
        assert_eq!(target.raw(), 0x607A_0020);
        assert_eq!(MappingEntry::from_raw(0x607A_0020), target);
    }

    #[test]
    fn cob_id_entries() {
        let entry = PdoCobId::new(CanId::standard(0x201).unwrap());
        assert_eq!(entry.raw(), 0x4000_0201);
        assert_eq!(entry.invalid().raw(), 0xC000_0201);
        assert_eq!(PdoCobId::from_raw(0xC000_0201), Some(entry.invalid()));
        assert_eq!(PdoCobId::from_raw(0x0000_0181).unwrap().raw(), 0x0000_0181);
        assert_eq!(PdoCobId::from_raw(0x0000_0800), None);
        let extended = PdoCobId::from_raw(0x2000_0800).unwrap();
        assert!(extended.id.is_extended() && extended.is_valid && extended.allows_rtr);
    }

    #[test]
    fn transmission_types() {
        for raw in 0..=255 {
            match TransmissionType::from_raw(raw) {
                Some(kind) => assert_eq!(kind.raw(), raw),
                None => assert!((241..=251).contains(&raw)),
            }
        }
        assert!(TransmissionType::Synchronous(1).is_synchronous());
        assert!(!TransmissionType::EventProfile.is_synchronous());
    }
}
