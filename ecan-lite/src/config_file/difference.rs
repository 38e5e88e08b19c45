//! A difference between a device and a configuration file.

use std::fmt;

use ecan_host::Expectation;
use ecan_protocol::object::{describe, lookup};

/// Expected value of an entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Expected {
    /// The value of the file.
    Value(u32),
    /// The condition of a readback.
    Readback(Expectation),
    /// The device loads the filter into the editing window.
    Loaded,
}

impl fmt::Display for Expected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Value(value) => write!(f, "{value}"),
            Self::Readback(expected) => write!(f, "{expected}"),
            Self::Loaded => f.write_str("loaded"),
        }
    }
}

/// An entry in which a device and a file differ.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// Index of the object.
    pub index: u16,
    /// Subindex of the entry; for a filter, in the editing window.
    pub subindex: u8,
    /// Index of the filter in its list, for an entry of a filter.
    pub filter: Option<u8>,
    /// Value of the file.
    pub expected: Expected,
    /// Value of the device; `None` if it does not have the entry.
    pub found: Option<u32>,
    /// True if the master writes the entry at each start: the PDO assignment and the active profile.
    /// The flash does not keep these, so they differ from power-up to the start.
    pub is_set_at_start: bool,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", describe(self.index, self.subindex))?;
        if let Some(filter) = self.filter {
            write!(f, " of filter {filter}")?;
        }
        let entry = lookup(self.index, self.subindex).map(|(_, entry)| entry);
        let meaning = |value| match entry.and_then(|entry| entry.meaning(value)) {
            Some(text) => format!(" ({text})"),
            None => String::new(),
        };
        let (expected, found) = (self.expected, self.found);
        let text = match expected {
            Expected::Value(value) => meaning(value),
            Expected::Readback(_) | Expected::Loaded => String::new(),
        };
        match (expected, found) {
            (_, None) => write!(
                f,
                ": the file has {expected}{text}, the device lacks it (assumption H42: older firmware)"
            ),
            (Expected::Loaded, Some(found)) => {
                write!(f, ": the device does not load it, {found}{}", meaning(found))
            }
            (_, Some(found)) => {
                write!(f, ": the file has {expected}{text}, the device {found}{}", meaning(found))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filter_that_is_not_loaded_is_reported() {
        let subindex = ecan_protocol::config::FilterWindow::STANDARD.status;
        let difference = Difference {
            index: 0x8001,
            subindex,
            filter: Some(3),
            expected: Expected::Loaded,
            found: Some(1),
            is_set_at_start: false,
        };
        let text = difference.to_string();
        assert!(text.contains(" of filter 3: the device does not load it, 1"), "{text}");
        assert!(text.starts_with("0x8001:"), "{text}");
    }
}
