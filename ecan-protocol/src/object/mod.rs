//! The object dictionary of the gateway as one constant table (manual 13).
//!
//! Subindices are decimal, as in the manual's tables. Object families (one object per channel
//! or chunk) are one [`Object`] with a count and a stride.

mod abort_code;
mod channel_information;
mod communication;
mod data_path;
mod describe;
mod device;
mod diagnostics;
mod maintenance;
mod mcan_channel;
mod pdo_profile;
mod register_service;
mod sdo_write;
mod system;

pub use abort_code::AbortCode;
pub use communication::{MAPPED_SUBINDEX, pdo_mapping_entry};
pub(crate) use data_path::{CHANNEL_DATA_PATH, GLOBAL_DATA_PATH};
pub use describe::describe;
pub(crate) use describe::{describe_field, write_object_name};
pub(crate) use diagnostics::DIAGNOSTIC_TEST;
pub(crate) use mcan_channel::MCAN_CHANNEL;
pub use register_service::WRITABLE_REGISTERS;
pub use sdo_write::SdoWrite;

/// CoE data type of an object dictionary entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ObjectType {
    /// Unsigned, 8 bit.
    U8,
    /// Unsigned, 16 bit.
    U16,
    /// Unsigned, 32 bit.
    U32,
    /// Signed, 32 bit. Values in the table and in [`SdoWrite`] are its two's complement.
    I32,
    /// Text whose length the device decides.
    VisibleString,
    /// STRING(16): one 16-byte unit of the process image (manual 5.1).
    String16,
}

impl ObjectType {
    /// Bytes that a value occupies in an SDO transfer; `None` where the device decides.
    pub const fn size_bytes(self) -> Option<usize> {
        match self {
            Self::U8 => Some(1),
            Self::U16 => Some(2),
            Self::U32 | Self::I32 => Some(4),
            Self::VisibleString => None,
            Self::String16 => Some(16),
        }
    }

    /// The name that the manual's tables have for it (manual 13).
    pub const fn name(self) -> &'static str {
        match self {
            Self::U8 => "U8",
            Self::U16 => "U16",
            Self::U32 => "U32",
            Self::I32 => "I32",
            Self::VisibleString => "STRING",
            Self::String16 => "STRING(16)",
        }
    }

    /// True for the types whose values fit a `u32`.
    pub const fn is_integer(self) -> bool {
        !matches!(self, Self::VisibleString | Self::String16)
    }

    /// Greatest raw value of an integer type, 0 for a string type.
    pub const fn max_value(self) -> u32 {
        match self {
            Self::U8 => 0xFF,
            Self::U16 => 0xFFFF,
            Self::U32 | Self::I32 => u32::MAX,
            Self::VisibleString | Self::String16 => 0,
        }
    }
}

/// Who may do what with an entry through SDO (manual 3.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Access {
    /// Read only.
    Ro,
    /// Read and write.
    Rw,
    /// Write only: a command whose read value means nothing.
    Wo,
}

impl Access {
    /// True when an SDO upload is allowed.
    pub const fn can_read(self) -> bool {
        matches!(self, Self::Ro | Self::Rw)
    }

    /// True when an SDO download is allowed.
    pub const fn can_write(self) -> bool {
        matches!(self, Self::Rw | Self::Wo)
    }
}

/// One subindex of an object.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Subindex, decimal in the manual.
    pub subindex: u8,
    /// Name as the manual gives it.
    pub name: &'static str,
    /// Data type.
    pub ty: ObjectType,
    /// SDO access.
    pub access: Access,
    /// Value after a factory start; `None` where the device decides it at run time.
    pub default: Option<u32>,
    /// Smallest valid value.
    pub min: u32,
    /// Greatest valid value.
    pub max: u32,
    /// Physical unit, if the value has one.
    pub unit: Option<&'static str>,
    /// Meaning of single values. For a writable entry the list is complete.
    pub values: &'static [(u32, &'static str)],
    /// Meaning of single bits. For a writable entry the list is complete.
    pub bits: &'static [(u8, &'static str)],
}

impl Entry {
    const fn new(subindex: u8, name: &'static str, ty: ObjectType, access: Access) -> Self {
        Self {
            subindex,
            name,
            ty,
            access,
            default: None,
            min: 0,
            max: ty.max_value(),
            unit: None,
            values: &[],
            bits: &[],
        }
    }

    const fn ro(subindex: u8, name: &'static str, ty: ObjectType) -> Self {
        Self::new(subindex, name, ty, Access::Ro)
    }

    const fn rw(subindex: u8, name: &'static str, ty: ObjectType) -> Self {
        Self::new(subindex, name, ty, Access::Rw)
    }

    const fn wo(subindex: u8, name: &'static str, ty: ObjectType) -> Self {
        Self::new(subindex, name, ty, Access::Wo)
    }

    /// Subindex 0 of an object with several entries: its highest subindex.
    const fn highest(subindex: u8) -> Self {
        Self::ro(0, "Highest subindex", ObjectType::U8).default(subindex as u32)
    }

    const fn default(mut self, value: u32) -> Self {
        self.default = Some(value);
        self
    }

    const fn range(mut self, min: u32, max: u32) -> Self {
        self.min = min;
        self.max = max;
        self
    }

    const fn flag(self) -> Self {
        self.range(0, 1)
    }

    const fn unit(mut self, unit: &'static str) -> Self {
        self.unit = Some(unit);
        self
    }

    const fn values(mut self, values: &'static [(u32, &'static str)]) -> Self {
        self.values = values;
        self
    }

    const fn bits(mut self, bits: &'static [(u8, &'static str)]) -> Self {
        self.bits = bits;
        self
    }

    /// True when a value is one that the manual allows: inside the range, and, where the manual
    /// lists values or bits, one of those values or made of those bits.
    ///
    /// The device does not refuse all others at once: objects with [`Object::apply`] take the
    /// value and answer in their status when it is applied.
    pub fn accepts(&self, value: u32) -> bool {
        self.ty.is_integer()
            && (self.min..=self.max).contains(&value)
            && (self.values.is_empty() || self.values.iter().any(|&(v, _)| v == value))
            && (self.bits.is_empty() || value & !self.bit_mask() == 0)
    }

    /// All bits that have a meaning, 0 when the entry is not a bit field.
    pub fn bit_mask(&self) -> u32 {
        self.bits
            .iter()
            .fold(0, |mask, &(bit, _)| mask | 1u32.checked_shl(u32::from(bit)).unwrap_or(0))
    }

    /// What the manual says a value means, if it lists it.
    pub fn meaning(&self, value: u32) -> Option<&'static str> {
        self.values.iter().find(|&&(v, _)| v == value).map(|&(_, meaning)| meaning)
    }
}

/// Command and status of an object whose values take effect only when they are applied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Apply {
    /// Subindex of the apply command; 1 applies.
    pub command: u8,
    /// Subindex of the result.
    pub status: u8,
}

/// An object, or a family of equal objects.
#[derive(Clone, Copy, Debug)]
pub struct Object {
    /// Index of the first object.
    pub first: u16,
    /// Number of objects with the same entries (4 for 0x8001..0x8004).
    pub count: u16,
    /// Distance of two neighbours' indices.
    pub stride: u16,
    /// Name as the manual gives it.
    pub name: &'static str,
    /// The chapter of the manual that describes it.
    pub chapter: &'static str,
    /// Apply command and status, if the object has them.
    pub apply: Option<Apply>,
    /// The entries in ascending order of subindex, subindex 0 included.
    pub entries: &'static [Entry],
}

impl Object {
    const fn single(
        first: u16,
        name: &'static str,
        chapter: &'static str,
        entries: &'static [Entry],
    ) -> Self {
        Self::family(first, 1, 1, name, chapter, entries)
    }

    const fn family(
        first: u16,
        count: u16,
        stride: u16,
        name: &'static str,
        chapter: &'static str,
        entries: &'static [Entry],
    ) -> Self {
        Self { first, count, stride, name, chapter, apply: None, entries }
    }

    const fn applied_by(mut self, command: u8, status: u8) -> Self {
        self.apply = Some(Apply { command, status });
        self
    }

    /// Which member of the family an index is (the channel for 0x8001..0x8004), `None` when it
    /// does not belong here.
    pub const fn instance(&self, index: u16) -> Option<u16> {
        if index < self.first {
            return None;
        }
        let distance = index - self.first;
        if distance.is_multiple_of(self.stride) && distance / self.stride < self.count {
            Some(distance / self.stride)
        } else {
            None
        }
    }

    /// The entry at a subindex.
    pub fn entry(&self, subindex: u8) -> Option<&'static Entry> {
        let at = self.entries.binary_search_by_key(&subindex, |entry| entry.subindex).ok()?;
        self.entries.get(at)
    }

    /// The highest subindex; 0 for an object of a single value.
    pub fn highest_subindex(&self) -> u8 {
        self.entries.last().map_or(0, |entry| entry.subindex)
    }
}

/// Every object of the gateway, in ascending order of index.
static OBJECTS: [&Object; 25] = [
    &communication::DEVICE_TYPE,
    &communication::DEVICE_NAME,
    &communication::HARDWARE_VERSION,
    &communication::SOFTWARE_VERSION,
    &communication::IDENTITY,
    &communication::RX_PDO_MAPPING,
    &communication::TX_PDO_MAPPING,
    &communication::SYNC_MANAGER_TYPES,
    &communication::RX_PDO_ASSIGNMENT,
    &communication::TX_PDO_ASSIGNMENT,
    &communication::INPUT_DATA,
    &communication::OUTPUT_DATA,
    &system::SYSTEM,
    &mcan_channel::MCAN_CHANNEL,
    &pdo_profile::TX_PDO_PROFILE,
    &pdo_profile::RX_PDO_PROFILE,
    &data_path::GLOBAL_DATA_PATH,
    &data_path::CHANNEL_DATA_PATH,
    &diagnostics::DIAGNOSTIC_TEST,
    &channel_information::CHANNEL_INFORMATION,
    &diagnostics::CYCLE_PERFORMANCE,
    &diagnostics::DATA_PATH_DIAGNOSTICS,
    &register_service::REGISTER_SERVICE,
    &maintenance::MAINTENANCE,
    &device::DEVICE_OBJECTS,
];

/// Every object of the gateway, in ascending order of index; a family stands once.
pub fn objects() -> &'static [&'static Object] {
    &OBJECTS
}

/// The object (or the family) that an index belongs to.
pub fn object(index: u16) -> Option<&'static Object> {
    OBJECTS.iter().copied().find(|object| object.instance(index).is_some())
}

/// The object and the entry at an index and subindex.
pub fn lookup(index: u16, subindex: u8) -> Option<(&'static Object, &'static Entry)> {
    let object = object(index)?;
    Some((object, object.entry(subindex)?))
}

/// The entries that a host writes, in ascending order, collected while compiling: subindex and
/// type of each writable entry with a subindex inside one of the two (inclusive) ranges.
pub(crate) const fn writable_fields<const N: usize>(
    object: &Object,
    ranges: [(u8, u8); 2],
) -> [(u8, ObjectType); N] {
    let mut fields = [(0, ObjectType::U8); N];
    let mut found = 0;
    let mut at = 0;
    while at < object.entries.len() {
        let entry = &object.entries[at];
        let s = entry.subindex;
        let wanted =
            (s >= ranges[0].0 && s <= ranges[0].1) || (s >= ranges[1].0 && s <= ranges[1].1);
        if wanted && matches!(entry.access, Access::Rw) {
            // infallible: evaluated by the compiler only, a wrong N does not build
            fields[found] = (s, entry.ty);
            found += 1;
        }
        at += 1;
    }
    assert!(found == N, "N is not the number of writable entries");
    fields
}
