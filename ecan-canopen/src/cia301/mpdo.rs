//! Multiplexed PDOs (CiA 301, 7.2.2.4): one object per frame, addressed in the frame.

use core::fmt;

use super::nmt::NodeId;

/// Address of an MPDO.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MpdoAddress {
    /// Destination address mode: object of the consumer with this node-ID, or of all consumers (`None`).
    Destination(Option<NodeId>),
    /// Source address mode: object of the producer with this node-ID. A dispatcher list of the consumer
    /// translates it.
    Source(NodeId),
}

/// Multiplexed PDO: an object and its value of up to four bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Mpdo {
    /// Address mode and node.
    pub address: MpdoAddress,
    /// Index of the object.
    pub index: u16,
    /// Subindex of the object.
    pub subindex: u8,
    /// Value, little-endian; bytes beyond the length of the object have no meaning.
    pub data: [u8; 4],
}

/// Error: data that is not an MPDO.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MpdoDecodeError {
    /// An MPDO has 8 data bytes.
    #[error("an MPDO has {length} data bytes; required: 8")]
    Length {
        /// Number of bytes.
        length: usize,
    },
    /// In source address mode the producer has a node-ID.
    #[error("an MPDO in source address mode has node-ID 0; allowed: 1 to 127")]
    NoProducer,
}

const DESTINATION: u8 = 0x80;

impl Mpdo {
    /// Number of mapped objects (subindex 0 of the mapping) of an MPDO in source address mode.
    pub const SOURCE_MAPPING: u8 = 0xFE;
    /// Number of mapped objects (subindex 0 of the mapping) of an MPDO in destination address mode.
    pub const DESTINATION_MAPPING: u8 = 0xFF;

    /// An MPDO of a value of up to four bytes; `None` for a longer one.
    pub fn new(address: MpdoAddress, (index, subindex): (u16, u8), value: &[u8]) -> Option<Self> {
        let mut data = [0; 4];
        data.get_mut(..value.len())?.copy_from_slice(value);
        Some(Self { address, index, subindex, data })
    }

    /// The data of the CAN frame.
    pub const fn to_bytes(self) -> [u8; 8] {
        let node = match self.address {
            MpdoAddress::Destination(Some(node)) => DESTINATION | node.get(),
            MpdoAddress::Destination(None) => DESTINATION,
            MpdoAddress::Source(node) => node.get(),
        };
        let [low, high] = self.index.to_le_bytes();
        let [a, b, c, d] = self.data;
        [node, low, high, self.subindex, a, b, c, d]
    }

    /// Reads the data of a CAN frame.
    ///
    /// # Errors
    /// [`MpdoDecodeError`].
    pub fn parse(data: &[u8]) -> Result<Self, MpdoDecodeError> {
        let &[address, low, high, subindex, a, b, c, d] = data else {
            return Err(MpdoDecodeError::Length { length: data.len() });
        };
        let node = NodeId::new(address & !DESTINATION);
        let address = if address & DESTINATION != 0 {
            MpdoAddress::Destination(node)
        } else {
            MpdoAddress::Source(node.ok_or(MpdoDecodeError::NoProducer)?)
        };
        let index = u16::from_le_bytes([low, high]);
        Ok(Self { address, index, subindex, data: [a, b, c, d] })
    }

    /// Returns whether a consumer with this node-ID is addressed; in source address mode its dispatcher list
    /// decides.
    pub fn is_for(&self, consumer: NodeId) -> bool {
        match self.address {
            MpdoAddress::Destination(node) => node.is_none_or(|node| node == consumer),
            MpdoAddress::Source(_) => true,
        }
    }
}

/// Entry of an object scanner list, 0x1FA0 to 0x1FCF: objects that a producer sends in source address mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ScannerEntry {
    /// Index of the object.
    pub index: u16,
    /// First subindex.
    pub subindex: u8,
    /// Number of consecutive subindices, from 1.
    pub count: u8,
}

impl ScannerEntry {
    /// The value of the entry.
    pub const fn raw(self) -> u32 {
        (self.count as u32) << 24 | (self.index as u32) << 8 | self.subindex as u32
    }

    /// Reads an entry; `None` for an empty one. A block size of 0 counts as 1.
    pub const fn from_raw(raw: u32) -> Option<Self> {
        let [subindex, low, high, count] = raw.to_le_bytes();
        let index = u16::from_le_bytes([low, high]);
        if index == 0 { None } else { Some(Self { index, subindex, count: block(count) }) }
    }

    /// Returns whether the entry contains an object.
    pub const fn contains(&self, index: u16, subindex: u8) -> bool {
        self.index == index && subindex.wrapping_sub(self.subindex) < self.count
    }
}

/// Entry of an object dispatcher list, 0x1FD0 to 0x1FFF: translates objects of a producer to objects of the
/// consumer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct DispatcherEntry {
    /// Node-ID of the producer.
    pub producer: NodeId,
    /// Index of the object at the producer.
    pub index: u16,
    /// First subindex at the producer.
    pub subindex: u8,
    /// Index of the object at the consumer.
    pub local_index: u16,
    /// First subindex at the consumer.
    pub local_subindex: u8,
    /// Number of consecutive subindices, from 1.
    pub count: u8,
}

impl DispatcherEntry {
    /// The value of the entry.
    pub const fn raw(self) -> u64 {
        (self.count as u64) << 56
            | (self.local_index as u64) << 40
            | (self.local_subindex as u64) << 32
            | (self.index as u64) << 16
            | (self.subindex as u64) << 8
            | self.producer.get() as u64
    }

    /// Reads an entry; `None` for one without producer. A block size of 0 counts as 1.
    pub const fn from_raw(raw: u64) -> Option<Self> {
        let [producer, subindex, low, high, local_subindex, local_low, local_high, count] =
            raw.to_le_bytes();
        let index = u16::from_le_bytes([low, high]);
        let local_index = u16::from_le_bytes([local_low, local_high]);
        match NodeId::new(producer) {
            Some(producer) => {
                let count = block(count);
                Some(Self { producer, index, subindex, local_index, local_subindex, count })
            }
            None => None,
        }
    }

    /// Index and subindex at the consumer for an MPDO in source address mode; `None` if the entry does not contain
    /// its object.
    pub fn target(&self, mpdo: &Mpdo) -> Option<(u16, u8)> {
        let offset = mpdo.subindex.wrapping_sub(self.subindex);
        let matches = mpdo.address == MpdoAddress::Source(self.producer)
            && mpdo.index == self.index
            && offset < self.count;
        matches.then(|| (self.local_index, self.local_subindex.wrapping_add(offset)))
    }
}

const fn block(count: u8) -> u8 {
    if count == 0 { 1 } else { count }
}

/// `from node 5: 0x6064:00 = 01 02 03 04`
impl fmt::Display for Mpdo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.address {
            MpdoAddress::Destination(Some(node)) => write!(f, "to node {node}")?,
            MpdoAddress::Destination(None) => f.write_str("to all nodes")?,
            MpdoAddress::Source(node) => write!(f, "from node {node}")?,
        }
        write!(f, ": 0x{:04X}:{:02X} =", self.index, self.subindex)?;
        self.data.iter().try_for_each(|byte| write!(f, " {byte:02X}"))
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::ToString;

    use proptest::prelude::*;

    use super::*;

    fn node(id: u8) -> NodeId {
        NodeId::new(id).unwrap()
    }

    #[test]
    fn mpdo_bytes_match_cia_301() {
        let address = MpdoAddress::Destination(Some(node(5)));
        let mpdo = Mpdo::new(address, (0x2001, 3), &[1, 2]).unwrap();
        assert_eq!(mpdo.to_bytes(), [0x85, 0x01, 0x20, 3, 1, 2, 0, 0]);
        assert_eq!(mpdo.to_string(), "to node 5: 0x2001:03 = 01 02 00 00");
        assert!(mpdo.is_for(node(5)) && !mpdo.is_for(node(6)));
        let all = Mpdo { address: MpdoAddress::Destination(None), ..mpdo };
        assert_eq!(all.to_bytes()[0], 0x80);
        assert!(all.is_for(node(6)));
        let source = Mpdo { address: MpdoAddress::Source(node(5)), ..mpdo };
        assert_eq!(source.to_bytes()[0], 0x05);
        assert_eq!(Mpdo::parse(&[0; 8]), Err(MpdoDecodeError::NoProducer));
        assert_eq!(Mpdo::parse(&[0x85; 7]), Err(MpdoDecodeError::Length { length: 7 }));
        assert_eq!(Mpdo::new(address, (0x2001, 3), &[0; 5]), None);
    }

    #[test]
    fn scanner_entries_are_blocks_of_subindices() {
        let entry = ScannerEntry { index: 0x6401, subindex: 1, count: 3 };
        assert_eq!(entry.raw(), 0x0364_0101);
        assert_eq!(ScannerEntry::from_raw(0x0364_0101), Some(entry));
        assert_eq!(ScannerEntry::from_raw(0), None);
        assert_eq!(ScannerEntry::from_raw(0x0064_0101).unwrap().count, 1);
        let contained = (0..=5).map(|subindex| entry.contains(0x6401, subindex));
        assert!(contained.eq([false, true, true, true, false, false]));
        assert!(!entry.contains(0x6402, 1));
    }

    #[test]
    fn dispatcher_translates_objects_of_its_producer() {
        let entry = DispatcherEntry {
            producer: node(5),
            index: 0x6401,
            subindex: 1,
            local_index: 0x2100,
            local_subindex: 0x10,
            count: 3,
        };
        assert_eq!(entry.raw(), 0x0321_0010_6401_0105);
        assert_eq!(DispatcherEntry::from_raw(entry.raw()), Some(entry));
        assert_eq!(DispatcherEntry::from_raw(0), None);
        assert_eq!(DispatcherEntry::from_raw(0x0021_0010_6401_0105).unwrap().count, 1);
        let from = |id, subindex| {
            let address = MpdoAddress::Source(node(id));
            Mpdo::new(address, (0x6401, subindex), &[7]).unwrap()
        };
        assert_eq!(entry.target(&from(5, 1)), Some((0x2100, 0x10)));
        assert_eq!(entry.target(&from(5, 3)), Some((0x2100, 0x12)));
        assert_eq!(entry.target(&from(5, 4)), None);
        assert_eq!(entry.target(&from(5, 0)), None);
        assert_eq!(entry.target(&from(6, 1)), None);
        let destination = Mpdo { address: MpdoAddress::Destination(Some(node(5))), ..from(5, 1) };
        assert_eq!(entry.target(&destination), None);
    }

    proptest! {
        #[test]
        fn any_data_is_parsed_or_rejected(data in proptest::collection::vec(any::<u8>(), 0..=9)) {
            if let Ok(mpdo) = Mpdo::parse(&data) {
                prop_assert_eq!(&mpdo.to_bytes()[..], &data[..]);
            }
        }
    }
}
