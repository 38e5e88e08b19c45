//! Rows of the object dictionary: objects and their entries.

use super::value::{Access, KeyForm, ObjectType, ObjectValue};

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
    /// Form of the value in a configuration file.
    pub form: KeyForm,
    /// Subindices of the entries that must not be 0 for this one to have an effect.
    pub needs: &'static [u8],
    /// Status that a write of this entry sets; that of an apply command is in [`Object::apply`].
    result: Option<WriteResult>,
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
            result: None,
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

    pub(super) const fn result(mut self, status: u8) -> Self {
        self.result = Some(WriteResult { status, sequence: None });
        self
    }

    /// As [`result`](Self::result), for a command whose end increments a sequence number.
    pub(super) const fn result_after(mut self, status: u8, sequence: u8) -> Self {
        self.result = Some(WriteResult { status, sequence: Some(sequence) });
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

/// Result of a write, in the same object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriteResult {
    /// Subindex of the status; 0 is OK.
    pub status: u8,
    /// Subindex of the number that the end of the command increments; `None` if the status is set at once.
    pub sequence: Option<u8>,
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
    /// The gateway saves its writable values in the Flash, except commands and editing windows;
    /// [`saved_entries`](Self::saved_entries) lists them.
    pub is_saved: bool,
    /// Writable entries of a saved object that are commands or editing windows, without the apply command.
    not_saved: &'static [u8],
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
        Self {
            first,
            count,
            stride,
            name,
            chapter,
            apply: None,
            is_saved: false,
            not_saved: &[],
            entries,
        }
    }

    pub(super) const fn applied_by(mut self, command: u8, status: u8) -> Self {
        self.apply = Some(Apply { command, status });
        self
    }

    pub(super) const fn saved(self) -> Self {
        self.saved_except(&[])
    }

    /// `not_saved` are the subindices of further commands and of editing windows.
    pub(super) const fn saved_except(mut self, not_saved: &'static [u8]) -> Self {
        (self.is_saved, self.not_saved) = (true, not_saved);
        self
    }

    /// The entries whose values the gateway saves in the Flash, and that belong to a configuration.
    pub fn saved_entries(&self) -> impl Iterator<Item = &'static Entry> + use<> {
        let Self { apply, is_saved, not_saved, entries, .. } = *self;
        entries.iter().filter(move |entry| {
            let is_command = apply.is_some_and(|apply| apply.command == entry.subindex);
            is_saved
                && entry.access == Access::Rw
                && entry.ty.is_integer()
                && !is_command
                && !not_saved.contains(&entry.subindex)
        })
    }

    /// Index of each member.
    pub fn indices(&self) -> impl Iterator<Item = u16> + use<> {
        let Self { first, count, stride, .. } = *self;
        (0..count).map(move |number| first + number * stride)
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

    /// Status that a write of an entry sets; `None` if the object has none for it.
    pub fn result_of(&self, entry: &Entry) -> Option<WriteResult> {
        let apply = self.apply.filter(|apply| apply.command == entry.subindex);
        let applied = apply.map(|apply| WriteResult { status: apply.status, sequence: None });
        entry.result.or(applied)
    }

    /// Returns the entry at a subindex.
    pub fn entry(&self, subindex: u8) -> Option<&'static Entry> {
        let at = self.entries.binary_search_by_key(&subindex, |entry| entry.subindex).ok()?;
        self.entries.get(at)
    }

    /// Highest subindex; 0 for an object of a single value.
    pub fn highest_subindex(&self) -> u8 {
        self.entries.last().map_or(0, |entry| entry.subindex)
    }
}
