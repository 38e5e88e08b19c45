//! Rows of the object dictionary: objects and their entries.

use super::sdo_write::SdoWrite;
use super::value::ObjectValue;

/// CoE data type of an object dictionary entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ObjectType {
    /// Unsigned, 8 bit.
    U8,
    /// Unsigned, 16 bit.
    U16,
    /// Unsigned, 32 bit.
    U32,
    /// Signed, 32 bit. Values in the dictionary and in [`SdoWrite`](super::SdoWrite) are its two's
    /// complement.
    I32,
    /// Text whose length the device decides.
    VisibleString,
    /// STRING(16): one 16-byte unit of a PDO image (manual 5.1).
    String16,
}

impl ObjectType {
    /// Bytes of a value in an SDO transfer; `None` if the device decides.
    pub const fn size_bytes(self) -> Option<usize> {
        match self {
            Self::U8 => Some(1),
            Self::U16 => Some(2),
            Self::U32 | Self::I32 => Some(4),
            Self::VisibleString => None,
            Self::String16 => Some(16),
        }
    }

    /// Name in the tables of the manual (13).
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

    /// True for the types whose values fit into a `u32`.
    pub const fn is_integer(self) -> bool {
        !matches!(self, Self::VisibleString | Self::String16)
    }

    /// Largest raw value of an integer type, 0 for a string type.
    pub const fn max_value(self) -> u32 {
        match self {
            Self::U8 => 0xFF,
            Self::U16 => 0xFFFF,
            Self::U32 | Self::I32 => u32::MAX,
            Self::VisibleString | Self::String16 => 0,
        }
    }
}

/// SDO access to an entry (manual 3.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Access {
    /// Read only.
    Ro,
    /// Read and write.
    Rw,
    /// Write only: a command; its read value has no meaning.
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
    /// Name in the manual.
    pub name: &'static str,
    /// Data type.
    pub ty: ObjectType,
    /// SDO access.
    pub access: Access,
    /// Value after a factory reset; `None` if the device decides it at run time.
    pub default: Option<u32>,
    /// Smallest valid value.
    pub min: u32,
    /// Largest valid value.
    pub max: u32,
    /// Physical unit, if the value has one.
    pub unit: Option<&'static str>,
    /// Meaning of single values. For a writable entry the list is complete.
    pub values: &'static [(u32, &'static str)],
    /// Meaning of single bits. For a writable entry the list is complete.
    pub bits: &'static [(u8, &'static str)],
    /// Key in a configuration file, as a path inside the object's table; `None` if it has no key.
    pub key: Option<&'static str>,
    /// How a configuration file states the value.
    pub form: KeyForm,
    /// Subindices of the entries that must not be 0 for this one to have an effect.
    pub needs: &'static [u8],
}

/// How a configuration file states the value of an [`Entry`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeyForm {
    /// As a whole number.
    Number,
    /// As `true` or `false`.
    Flag,
    /// As one word: the text of the value in lower case, with underscores.
    Word,
    /// As a list of words, in lower case; each stands for the given bits.
    Words(&'static [(&'static str, u32)]),
    /// As one of these sizes; its position in the list is the raw value.
    Size(&'static [u32]),
    /// As a percentage, or as the first one of a list of two.
    LowerBound,
    /// As a percentage, or as the second one of a list of two.
    UpperBound,
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
            key: None,
            form: KeyForm::Number,
            needs: &[],
        }
    }

    /// A field of a configuration: type, range and texts follow from its Rust type.
    pub(super) const fn field<T: ObjectValue>(subindex: u8, name: &'static str) -> Self {
        let mut entry = Self::rw(subindex, name, T::TYPE).range(0, T::MAX);
        (entry.values, entry.bits, entry.form) = (T::VALUES, T::BITS, T::FORM);
        entry
    }

    pub(super) const fn ro(subindex: u8, name: &'static str, ty: ObjectType) -> Self {
        Self::new(subindex, name, ty, Access::Ro)
    }

    pub(super) const fn rw(subindex: u8, name: &'static str, ty: ObjectType) -> Self {
        Self::new(subindex, name, ty, Access::Rw)
    }

    pub(super) const fn wo(subindex: u8, name: &'static str, ty: ObjectType) -> Self {
        Self::new(subindex, name, ty, Access::Wo)
    }

    /// Subindex 0 of an object with several entries: its highest subindex.
    pub(super) const fn highest(subindex: u8) -> Self {
        Self::ro(0, "Highest subindex", ObjectType::U8).default(subindex as u32)
    }

    pub(super) const fn default(mut self, value: u32) -> Self {
        self.default = Some(value);
        self
    }

    pub(super) const fn range(mut self, min: u32, max: u32) -> Self {
        self.min = min;
        self.max = max;
        self
    }

    pub(super) const fn unit(mut self, unit: &'static str) -> Self {
        self.unit = Some(unit);
        self
    }

    pub(super) const fn values(mut self, values: &'static [(u32, &'static str)]) -> Self {
        self.values = values;
        self
    }

    pub(super) const fn bits(mut self, bits: &'static [(u8, &'static str)]) -> Self {
        self.bits = bits;
        self
    }

    pub(super) const fn key(mut self, key: &'static str) -> Self {
        self.key = Some(key);
        self
    }

    pub(super) const fn no_key(mut self) -> Self {
        self.key = None;
        self
    }

    pub(super) const fn form(mut self, form: KeyForm) -> Self {
        self.form = form;
        self
    }

    pub(super) const fn needs(mut self, needs: &'static [u8]) -> Self {
        self.needs = needs;
        self
    }

    /// True if the manual allows the value: it is inside the range, and if the manual lists values
    /// or bits, it is one of those values or consists of those bits.
    ///
    /// The device does not reject every other value at once: objects with [`Object::apply`] accept
    /// it and report the fault in their status when it is applied.
    pub fn accepts(&self, value: u32) -> bool {
        self.ty.is_integer()
            && (self.min..=self.max).contains(&value)
            && (self.values.is_empty() || self.values.iter().any(|&(v, _)| v == value))
            && (self.bits.is_empty() || value & !self.bit_mask() == 0)
    }

    /// All bits that have a meaning, 0 if the entry is not a bit field.
    pub fn bit_mask(&self) -> u32 {
        self.bits
            .iter()
            .fold(0, |mask, &(bit, _)| mask | 1u32.checked_shl(u32::from(bit)).unwrap_or(0))
    }

    /// Meaning of a value, if the manual lists it.
    pub fn meaning(&self, value: u32) -> Option<&'static str> {
        self.values.iter().find(|&&(v, _)| v == value).map(|&(_, meaning)| meaning)
    }
}

/// Command and status of an object whose values take effect when they are applied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Apply {
    /// Subindex of the apply command; 1 applies.
    pub command: u8,
    /// Subindex of the result.
    pub status: u8,
}

/// An object, or a family of objects with the same entries.
#[derive(Clone, Copy, Debug)]
pub struct Object {
    /// Index of the first object.
    pub first: u16,
    /// Number of objects with the same entries (4 for 0x8001..0x8004).
    pub count: u16,
    /// Distance between the indices of two neighbours.
    pub stride: u16,
    /// Name in the manual.
    pub name: &'static str,
    /// Chapter of the manual that describes it.
    pub chapter: &'static str,
    /// Apply command and status, if the object has them.
    pub apply: Option<Apply>,
    /// The entries in ascending order of subindex, subindex 0 included.
    pub entries: &'static [Entry],
}

impl Object {
    pub(super) const fn single(
        first: u16,
        name: &'static str,
        chapter: &'static str,
        entries: &'static [Entry],
    ) -> Self {
        Self::family(first, 1, 1, name, chapter, entries)
    }

    pub(super) const fn family(
        first: u16,
        count: u16,
        stride: u16,
        name: &'static str,
        chapter: &'static str,
        entries: &'static [Entry],
    ) -> Self {
        Self { first, count, stride, name, chapter, apply: None, entries }
    }

    pub(super) const fn applied_by(mut self, command: u8, status: u8) -> Self {
        self.apply = Some(Apply { command, status });
        self
    }

    /// Number of a family member (the channel for 0x8001..0x8004), `None` if the index is not one of
    /// this object.
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

    /// Returns the entry at a subindex.
    pub fn entry(&self, subindex: u8) -> Option<&'static Entry> {
        let at = self.entries.binary_search_by_key(&subindex, |entry| entry.subindex).ok()?;
        self.entries.get(at)
    }

    /// The download that applies what was written to a family member: the command with value 1.
    ///
    /// Only for objects with [`apply`](Self::apply).
    pub(crate) const fn apply_write(&self, instance: u8) -> SdoWrite {
        let command = match self.apply {
            Some(apply) => apply.command,
            None => 0,
        };
        SdoWrite::new(self.first + instance as u16 * self.stride, command, ObjectType::U8, 1)
    }

    /// Highest subindex; 0 for an object of a single value.
    pub fn highest_subindex(&self) -> u8 {
        self.entries.last().map_or(0, |entry| entry.subindex)
    }
}
