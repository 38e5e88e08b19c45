//! Entries and objects that the firmware of a gateway may lack: those that a version of the manual added, and
//! those that the SDK can do without.

/// Value that the SDK assumes for an entry that the firmware does not have, or `None` if it needs the entry.
///
/// Of 0xF000 only :17 and :18 are needed: they identify an ECAN-Lite. Limits are those of the manual's table (13.8),
/// because the apply of a profile verifies them; versions, serial number and features are 0, so that an optional
/// feature is not used. Test policies (0x8030) are off.
pub const fn assumed_value(index: u16, subindex: u8) -> Option<u32> {
    match (index, subindex) {
        (0xF000, 17 | 18) => None,
        (0xF000, 2 | 14) => Some(4),
        (0xF000, 9) => Some(1 << 1),
        (0xF000, 10) => Some(1),
        (0xF000, 11) => Some(24),
        (0xF000, 12) => Some(0x33),
        (0xF000, 13) => Some(3072),
        (0xF000, 15) => Some(0x1F),
        (0xF000, 1..=30) | (0x8030, 2..=6) => Some(0),
        _ => None,
    }
}

/// Object, or entry of an object, whose writes a startup can do without: the gateway then keeps its own behaviour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OptionalObject {
    /// Index.
    pub index: u16,
    /// Entry; `None` is the whole object.
    pub subindex: Option<u8>,
}

impl OptionalObject {
    /// The optional object that this entry belongs to: timestamp selection and data path of a channel.
    pub const fn of(index: u16, subindex: u8) -> Option<Self> {
        match (index, subindex) {
            (0x8001..=0x8004, 74) => Some(Self { index, subindex: Some(subindex) }),
            (0x8021..=0x8024, _) => Some(Self { index, subindex: None }),
            _ => None,
        }
    }

    /// Entry whose upload shows whether the firmware has the object.
    pub const fn probe(self) -> (u16, u8) {
        match self.subindex {
            Some(subindex) => (self.index, subindex),
            None => (self.index, 1),
        }
    }

    /// Returns whether the entry belongs to it.
    pub const fn contains(self, index: u16, subindex: u8) -> bool {
        match self.subindex {
            Some(own) => self.index == index && own == subindex,
            None => self.index == index,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::Capabilities;

    #[test]
    fn identification_alone_is_needed_of_the_capabilities() {
        let needed: [u8; 2] = [17, 18];
        for subindex in Capabilities::fields() {
            let is_needed = assumed_value(Capabilities::INDEX, *subindex).is_none();
            assert_eq!(is_needed, needed.contains(subindex), "{subindex}");
        }
        assert_eq!(assumed_value(0x8030, 4), Some(0));
        assert_eq!(assumed_value(0x8030, 1), None, "the key");
        assert_eq!(assumed_value(0x9020, 12), None);
    }

    #[test]
    fn optional_object_contains_its_entries() {
        let data_path = OptionalObject::of(0x8022, 20).unwrap();
        assert_eq!(data_path.probe(), (0x8022, 1));
        assert!(data_path.contains(0x8022, 3) && !data_path.contains(0x8021, 3));
        let timestamp = OptionalObject::of(0x8001, 74).unwrap();
        assert_eq!(timestamp.probe(), (0x8001, 74));
        assert!(!timestamp.contains(0x8001, 1));
        assert_eq!(OptionalObject::of(0x8001, 1), None);
    }
}
