//! SDO downloads, the result of a configuration.

use core::fmt;

use super::describe::write_object_name;
use super::entry::Object;
use super::object;
use super::object_type::ObjectType;

/// One SDO download.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SdoWrite {
    /// Object index.
    pub index: u16,
    /// Subindex.
    pub subindex: u8,
    /// The value; of a signed type its two's complement.
    pub value: u32,
    /// Its type, which sets the number of bytes.
    pub ty: ObjectType,
}

/// 0 as U8 to 0x0000:00: the filler of an empty list, never sent.
impl Default for SdoWrite {
    fn default() -> Self {
        Self::new(0, 0, ObjectType::U8, 0)
    }
}

impl SdoWrite {
    /// Creates a download of `value` as `ty`.
    pub const fn new(index: u16, subindex: u8, ty: ObjectType, value: u32) -> Self {
        Self { index, subindex, value, ty }
    }

    /// The download that applies what was written to a member of an object family: 1 to its apply
    /// command.
    pub(crate) const fn apply(object: &Object, instance: u8) -> Self {
        let command = match object.apply {
            Some(apply) => apply.command,
            None => 0,
        };
        Self::new(object.first + instance as u16 * object.stride, command, ObjectType::U8, 1)
    }

    /// Returns the value as it is sent, little-endian, and the number of valid bytes.
    pub const fn bytes(&self) -> ([u8; 4], usize) {
        let size = match self.ty {
            ObjectType::U8 => 1,
            ObjectType::U16 => 2,
            _ => 4,
        };
        (self.value.to_le_bytes(), size)
    }
}

impl fmt::Display for SdoWrite {
    /// `0x8010:03 TxPDO Profile Control / PDO size multiplier = 8`
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "0x{:04X}:{:02}", self.index, self.subindex)?;
        if let Some(object) = object(self.index) {
            f.write_str(" ")?;
            write_object_name(f, object, self.index)?;
            if let Some(entry) = object.entry(self.subindex) {
                write!(f, " / {}", entry.name)?;
            }
        }
        write!(f, " = {}", self.value)
    }
}
