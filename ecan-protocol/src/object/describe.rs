//! Texts for entries of the object dictionary.

use core::fmt;

use super::entry::Object;
use super::{lookup, object};

/// Text of an entry: `0x8010:03 (TxPDO Profile Control, PDO size multiplier)`.
///
/// The subindex is decimal. In a family the number of the object follows its name, counted from 0 like
/// the channels. An object that is not in the dictionary has its numbers only.
pub fn describe(index: u16, subindex: u8) -> impl fmt::Display {
    Description { index, subindex }
}

/// Text of a configuration field if the object is clear: `Node mode (subindex 8)`.
pub(crate) fn describe_field(index: u16, subindex: u8) -> impl fmt::Display {
    Field { name: lookup(index, subindex).map(|(_, entry)| entry.name), subindex }
}

struct Field {
    name: Option<&'static str>,
    subindex: u8,
}

impl fmt::Display for Field {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.name {
            Some(name) => write!(f, "{name} (subindex {})", self.subindex),
            None => write!(f, "subindex {}", self.subindex),
        }
    }
}

struct Description {
    index: u16,
    subindex: u8,
}

impl fmt::Display for Description {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "0x{:04X}:{:02}", self.index, self.subindex)?;
        let Some(object) = object(self.index) else {
            return Ok(());
        };
        f.write_str(" (")?;
        write_object_name(f, object, self.index)?;
        if let Some(entry) = object.entry(self.subindex) {
            write!(f, ", {}", entry.name)?;
        }
        f.write_str(")")
    }
}

/// Name of the object, followed by its number in a family.
pub(crate) fn write_object_name(
    f: &mut fmt::Formatter<'_>,
    object: &Object,
    index: u16,
) -> fmt::Result {
    f.write_str(object.name)?;
    match object.instance(index) {
        Some(instance) if object.count > 1 => write!(f, " {instance}"),
        _ => Ok(()),
    }
}
