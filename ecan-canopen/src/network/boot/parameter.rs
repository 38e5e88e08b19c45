//! Parameters that a node gets before it runs.

use std::fmt;
use std::sync::Arc;

use crate::object;

/// Bit of the COB-ID of a PDO.
const NO_RTR: u32 = 1 << 30;

/// One value to write to a node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Parameter {
    /// Object index.
    pub index: u16,
    /// Object subindex.
    pub subindex: u8,
    /// The value, little-endian, with as many bytes as the object has.
    pub data: Vec<u8>,
    /// Name of the object for messages, as in its device file; may be empty.
    pub name: Arc<str>,
    /// The value is read back after all downloads and must be the same. Not for objects that are
    /// write-only or whose value the node changes.
    pub is_verified: bool,
}

impl Parameter {
    /// A value without a name, which is verified.
    pub fn new((index, subindex): (u16, u8), data: impl Into<Vec<u8>>) -> Self {
        Self { index, subindex, data: data.into(), name: Arc::from(""), is_verified: true }
    }

    /// Returns whether a node that has this value returned `value`.
    pub(super) fn is_confirmed_by(&self, value: &[u8]) -> bool {
        let is_pdo_cob_id = matches!(self.key(), (0x1400..=0x15FF | 0x1800..=0x19FF, 1));
        match (self.data.as_array::<4>(), value.as_array::<4>()) {
            // Nodes differ in whether bit 30, no remote request, can change.
            (Some(own), Some(found)) if is_pdo_cob_id => {
                (u32::from_le_bytes(*own) ^ u32::from_le_bytes(*found)) & !NO_RTR == 0
            }
            _ => self.data == value,
        }
    }

    pub(in crate::network) fn key(&self) -> (u16, u8) {
        (self.index, self.subindex)
    }

    pub(in crate::network) fn subject(&self) -> Subject {
        let name = (!self.name.is_empty()).then(|| self.name.clone());
        Subject { index: self.index, subindex: self.subindex, name }
    }
}

/// An object in a message: `0x6081:00 (Profile velocity)`. A clone does not allocate.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Subject {
    /// Object index.
    pub index: u16,
    /// Object subindex.
    pub subindex: u8,
    /// Its name in the device file.
    pub name: Option<Arc<str>>,
}

impl fmt::Display for Subject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "0x{:04X}:{:02X}", self.index, self.subindex)?;
        let name = match (&self.name, self.index) {
            (Some(name), _) => name,
            (None, object::CONFIGURATION_DATE) => "configuration date",
            (None, object::STORE_PARAMETERS) => "save parameters",
            (None, _) => return Ok(()),
        };
        write!(f, " ({name})")
    }
}

/// Date and time of a configuration, as object 0x1020 keeps them (CiA 301, 7.5.2.19).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ConfigurationDate {
    /// Days since 1984-01-01.
    pub days: u32,
    /// Milliseconds after midnight.
    pub milliseconds: u32,
}

/// Configuration of one node by SDO: plain data.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ParameterSet {
    /// Values, written in this order.
    pub parameters: Vec<Parameter>,
    /// A node whose 0x1020 has this date and time has the configuration already: nothing is written.
    /// It is written to 0x1020 after the downloads.
    pub date: Option<ConfigurationDate>,
    /// Saves the parameters in the node (0x1010:01) after the downloads.
    pub saves: bool,
}
