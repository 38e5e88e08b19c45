//! Error history of a node, object 0x1003 (CiA 301, 7.5.2.4).

use core::fmt;

use super::emcy::{EmcyClass, error_code_text};

/// Entry of the error history.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct HistoryEntry {
    /// Error code, as in the emergency message.
    pub code: u16,
    /// Additional information of the manufacturer.
    pub additional: u16,
}

impl HistoryEntry {
    /// Reads the value of an entry.
    pub const fn from_raw(raw: u32) -> Self {
        Self { code: raw as u16, additional: (raw >> 16) as u16 }
    }

    /// The value of the entry.
    pub const fn raw(self) -> u32 {
        (self.additional as u32) << 16 | self.code as u32
    }

    /// Class of the code.
    pub const fn class(&self) -> EmcyClass {
        EmcyClass::of(self.code)
    }
}

/// `0x8611 following error (monitoring), additional 0x0001`
impl fmt::Display for HistoryEntry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "0x{:04X} ", self.code)?;
        match error_code_text(self.code) {
            Some(text) => write!(f, "{text} ({})", self.class())?,
            None => write!(f, "{}", self.class())?,
        }
        if self.additional != 0 {
            write!(f, ", additional 0x{:04X}", self.additional)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::ToString;

    use super::*;

    #[test]
    fn entry_has_code_and_additional_information() {
        let entry = HistoryEntry::from_raw(0x0001_8611);
        assert_eq!(entry, HistoryEntry { code: 0x8611, additional: 1 });
        assert_eq!(entry.raw(), 0x0001_8611);
        assert_eq!(entry.to_string(), "0x8611 following error (monitoring), additional 0x0001");
        assert_eq!(HistoryEntry::from_raw(0xFF42).to_string(), "0xFF42 device specific");
    }
}
