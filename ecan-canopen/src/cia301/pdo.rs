//! PDOs, with MPDOs, SYNC and TIME: mapping, communication parameters and messages (CiA 301, 7.2.2, 7.2.5, 7.2.6 and
//! 7.5.2).

use core::fmt;

use ecan_protocol::can::CanId;

use super::cob_id::CobId;
use super::nmt::NodeId;

/// An entry of a PDO mapping object, 0x1600.. or 0x1A00...
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MappingEntry {
    /// Index of the mapped object.
    pub index: u16,
    /// Its subindex.
    pub subindex: u8,
    /// Its length in bits.
    pub bits: u8,
}

impl MappingEntry {
    /// An entry.
    pub const fn new(index: u16, subindex: u8, bits: u8) -> Self {
        Self { index, subindex, bits }
    }

    /// The value of the entry.
    pub const fn raw(self) -> u32 {
        let [low, high] = self.index.to_le_bytes();
        u32::from_le_bytes([self.bits, self.subindex, low, high])
    }

    /// The entry with this value.
    pub const fn from_raw(raw: u32) -> Self {
        let [bits, subindex, low, high] = raw.to_le_bytes();
        Self { index: u16::from_le_bytes([low, high]), subindex, bits }
    }
}

impl fmt::Display for MappingEntry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "0x{:04X}:{:02} ({} bits)", self.index, self.subindex, self.bits)
    }
}

const INVALID: u32 = 1 << 31;
const NO_RTR: u32 = 1 << 30;
const EXTENDED: u32 = 1 << 29;

/// The COB-ID entry of a PDO, subindex 1 of 0x1400.. or 0x1800...
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PdoCobId {
    /// Identifier of the frames.
    pub id: CanId,
    /// True if the PDO exists. Only one that does not may be mapped again.
    pub is_valid: bool,
    /// True if remote frames may ask for it (TPDO only).
    pub allows_rtr: bool,
}

impl PdoCobId {
    /// An existing PDO that no remote frame may ask for.
    pub const fn new(id: CanId) -> Self {
        Self { id, is_valid: true, allows_rtr: false }
    }

    /// The same, not existing.
    #[must_use]
    pub const fn invalid(self) -> Self {
        Self { is_valid: false, ..self }
    }

    /// The value of the entry.
    pub fn raw(self) -> u32 {
        let flag = |set, bit| if set { bit } else { 0 };
        self.id.raw()
            | flag(self.id.is_extended(), EXTENDED)
            | flag(!self.allows_rtr, NO_RTR)
            | flag(!self.is_valid, INVALID)
    }

    /// The entry with this value; `None` for an 11-bit identifier that has more bits.
    pub fn from_raw(raw: u32) -> Option<Self> {
        let id = CanId::new(raw & 0x1FFF_FFFF, raw & EXTENDED != 0).ok()?;
        Some(Self { id, is_valid: raw & INVALID == 0, allows_rtr: raw & NO_RTR == 0 })
    }
}

/// When a PDO is sent or takes effect, subindex 2 of 0x1400.. or 0x1800...
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TransmissionType {
    /// With the next SYNC after an event.
    SynchronousAcyclic,
    /// With every n-th SYNC, n from 1 to 240.
    Synchronous(u8),
    /// On request, sampled with SYNC.
    RtrSynchronous,
    /// On request.
    RtrEvent,
    /// By an event of the manufacturer.
    EventManufacturer,
    /// By an event of the device profile.
    EventProfile,
}

impl TransmissionType {
    /// The number.
    pub const fn raw(self) -> u8 {
        match self {
            Self::SynchronousAcyclic => 0,
            Self::Synchronous(every) => every,
            Self::RtrSynchronous => 252,
            Self::RtrEvent => 253,
            Self::EventManufacturer => 254,
            Self::EventProfile => 255,
        }
    }

    /// The type with this number; `None` for the reserved 241 to 251.
    pub const fn from_raw(raw: u8) -> Option<Self> {
        Some(match raw {
            0 => Self::SynchronousAcyclic,
            1..=240 => Self::Synchronous(raw),
            252 => Self::RtrSynchronous,
            253 => Self::RtrEvent,
            254 => Self::EventManufacturer,
            255 => Self::EventProfile,
            _ => return None,
        })
    }

    /// Returns whether SYNC rules it.
    pub const fn is_synchronous(self) -> bool {
        matches!(self, Self::SynchronousAcyclic | Self::Synchronous(_) | Self::RtrSynchronous)
    }
}

/// Identifier of SYNC unless 0x1005 says otherwise.
pub const SYNC_COB_ID: CobId = CobId::SYNC;

/// Data of a SYNC: nothing, or the counter (1 to 240).
pub fn sync_data(counter: &Option<[u8; 1]>) -> &[u8] {
    counter.as_ref().map_or(&[], |counter| &counter[..])
}

/// The counter of a SYNC, `Some(None)` for one without; `None` for what is no SYNC.
pub fn parse_sync(data: &[u8]) -> Option<Option<u8>> {
    match data {
        [] => Some(None),
        [counter @ 1..=240] => Some(Some(*counter)),
        _ => None,
    }
}

/// Days from 1970-01-01 to 1984-01-01.
const EPOCH_DAYS: u64 = 5_113;
const DAY_MS: u64 = 86_400_000;
const MS: u64 = 1_000_000;
/// Milliseconds have 28 bits; the upper four are reserved.
const MS_MASK: u32 = 0x0FFF_FFFF;

/// Error: the time is not within a day.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{ms} ms after midnight are out of range; allowed: 0 to {}", TimeOfDay::DAY_MS - 1)]
pub struct TimeOfDayError {
    /// Milliseconds after midnight.
    pub ms: u32,
}

/// Time of day and date, in milliseconds and days since 1984-01-01.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TimeOfDay {
    days: u16,
    ms: u32,
}

impl TimeOfDay {
    /// Milliseconds of a day.
    pub const DAY_MS: u32 = DAY_MS as u32;

    /// The time `ms` milliseconds after midnight, `days` days after 1984-01-01.
    ///
    /// # Errors
    /// [`TimeOfDayError`] if `ms` is not below [`DAY_MS`](Self::DAY_MS).
    pub const fn new(days: u16, ms: u32) -> Result<Self, TimeOfDayError> {
        if ms < Self::DAY_MS { Ok(Self { days, ms }) } else { Err(TimeOfDayError { ms }) }
    }

    /// Days since 1984-01-01.
    pub const fn days(self) -> u16 {
        self.days
    }

    /// Milliseconds after midnight.
    pub const fn ms(self) -> u32 {
        self.ms
    }

    /// Converts Unix time in nanoseconds; `None` before 1984 and after 2163-06-06, the last day that 16 bits express.
    pub fn from_unix_ns(unix_ns: u64) -> Option<Self> {
        let ms = unix_ns / MS;
        let days = u16::try_from((ms / DAY_MS).checked_sub(EPOCH_DAYS)?).ok()?;
        Some(Self { days, ms: (ms % DAY_MS) as u32 })
    }

    /// Unix time in nanoseconds.
    pub const fn unix_ns(self) -> u64 {
        ((self.days as u64 + EPOCH_DAYS) * DAY_MS + self.ms as u64) * MS
    }

    /// The data of the CAN frame.
    pub const fn to_bytes(self) -> [u8; 6] {
        let [a, b, c, d] = self.ms.to_le_bytes();
        let [low, high] = self.days.to_le_bytes();
        [a, b, c, d, low, high]
    }

    /// Reads the data of a CAN frame; `None` for another length, or for milliseconds beyond a day. Reserved bits
    /// are ignored.
    pub fn parse(data: &[u8]) -> Option<Self> {
        let &[a, b, c, d, low, high] = data else { return None };
        let ms = u32::from_le_bytes([a, b, c, d]) & MS_MASK;
        Self::new(u16::from_le_bytes([low, high]), ms).ok()
    }
}

/// `day 15667, 13:45:00.250`
impl fmt::Display for TimeOfDay {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (seconds, ms) = (self.ms / 1_000, self.ms % 1_000);
        let (hours, minutes, seconds) = (seconds / 3_600, seconds / 60 % 60, seconds % 60);
        write!(f, "day {}, {hours:02}:{minutes:02}:{seconds:02}.{ms:03}", self.days)
    }
}

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

/// Error: data that is not an MPDO, or a value that does not fit one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MpdoError {
    /// An MPDO has 8 data bytes.
    #[error("an MPDO has {length} data bytes; required: 8")]
    Length {
        /// Number of bytes.
        length: usize,
    },
    /// A value has at most 4 bytes.
    #[error("a value of {length} bytes does not fit an MPDO; allowed: 0 to 4")]
    Value {
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

    /// An MPDO of a value of up to four bytes.
    ///
    /// # Errors
    /// [`MpdoError::Value`] for a longer one.
    pub fn new(
        address: MpdoAddress,
        (index, subindex): (u16, u8),
        value: &[u8],
    ) -> Result<Self, MpdoError> {
        let mut data = [0; 4];
        let used = data.get_mut(..value.len()).ok_or(MpdoError::Value { length: value.len() })?;
        used.copy_from_slice(value);
        Ok(Self { address, index, subindex, data })
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
    /// [`MpdoError`].
    pub fn parse(data: &[u8]) -> Result<Self, MpdoError> {
        let &[address, low, high, subindex, a, b, c, d] = data else {
            return Err(MpdoError::Length { length: data.len() });
        };
        let node = NodeId::from_raw(address & !DESTINATION);
        let address = if address & DESTINATION != 0 {
            MpdoAddress::Destination(node)
        } else {
            MpdoAddress::Source(node.ok_or(MpdoError::NoProducer)?)
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
        let [low, high] = self.index.to_le_bytes();
        u32::from_le_bytes([self.subindex, low, high, self.count])
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
        match NodeId::from_raw(producer) {
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
    use std::string::ToString;

    use proptest::prelude::*;

    use super::*;

    #[test]
    fn mapping_entries() {
        let target = MappingEntry::new(0x607A, 0, 32);
        assert_eq!(target.raw(), 0x607A_0020);
        assert_eq!(MappingEntry::from_raw(0x607A_0020), target);
    }

    #[test]
    fn cob_id_entries() {
        let entry = PdoCobId::new(CanId::standard(0x201).unwrap());
        assert_eq!(entry.raw(), 0x4000_0201);
        assert_eq!(entry.invalid().raw(), 0xC000_0201);
        assert_eq!(PdoCobId::from_raw(0xC000_0201), Some(entry.invalid()));
        assert_eq!(PdoCobId::from_raw(0x0000_0181).unwrap().raw(), 0x0000_0181);
        assert_eq!(PdoCobId::from_raw(0x0000_0800), None);
        let extended = PdoCobId::from_raw(0x2000_0800).unwrap();
        assert!(extended.id.is_extended() && extended.is_valid && extended.allows_rtr);
    }

    #[test]
    fn transmission_types() {
        for raw in 0..=255 {
            match TransmissionType::from_raw(raw) {
                Some(kind) => assert_eq!(kind.raw(), raw),
                None => assert!((241..=251).contains(&raw)),
            }
        }
        assert!(TransmissionType::Synchronous(1).is_synchronous());
        assert!(!TransmissionType::EventProfile.is_synchronous());
    }

    #[test]
    fn with_and_without_counter() {
        assert_eq!(sync_data(&None), []);
        assert_eq!(sync_data(&Some([7])), [7]);
        assert_eq!(parse_sync(&[]), Some(None));
        assert_eq!(parse_sync(&[240]), Some(Some(240)));
        assert_eq!(parse_sync(&[0]), None);
        assert_eq!(parse_sync(&[1, 2]), None);
    }

    extern crate std;

    const S: u64 = 1_000_000_000;

    #[test]
    fn epoch_is_1984() {
        // 1984-01-01T00:00:00Z
        let epoch = TimeOfDay::from_unix_ns(441_763_200 * S).unwrap();
        assert_eq!((epoch.days(), epoch.ms()), (0, 0));
        assert_eq!(TimeOfDay::from_unix_ns(441_763_200 * S - 1), None);
        // 2026-11-24T13:45:00.25Z
        let time = TimeOfDay::from_unix_ns(1_795_527_900 * S + 250_000_000).unwrap();
        assert_eq!((time.days(), time.ms()), (15_668, 49_500_250));
        assert_eq!(time.to_string(), "day 15668, 13:45:00.250");
        assert_eq!(time.to_bytes(), [0x5A, 0x50, 0xF3, 0x02, 0x34, 0x3D]);
        let last = TimeOfDay::new(u16::MAX, TimeOfDay::DAY_MS - 1).unwrap();
        assert_eq!(TimeOfDay::from_unix_ns(last.unix_ns()), Some(last));
        assert_eq!(TimeOfDay::from_unix_ns(last.unix_ns() + MS), None);
    }

    #[test]
    fn reserved_bits_are_ignored_and_wrong_data_rejected() {
        let time = TimeOfDay::new(2, 1).unwrap();
        assert_eq!(TimeOfDay::parse(&[1, 0, 0, 0xF0, 2, 0]), Some(time));
        assert_eq!(TimeOfDay::parse(&[0, 0x5C, 0x26, 0x05, 2, 0]), None, "24:00:00.000");
        assert_eq!(TimeOfDay::parse(&[0; 5]), None);
        assert_eq!(TimeOfDay::parse(&[0; 8]), None);
    }

    proptest! {
        #[test]
        fn times_survive_both_conversions(days: u16, ms in 0..TimeOfDay::DAY_MS) {
            let time = TimeOfDay::new(days, ms).unwrap();
            prop_assert_eq!(TimeOfDay::parse(&time.to_bytes()), Some(time));
            prop_assert_eq!(TimeOfDay::from_unix_ns(time.unix_ns()), Some(time));
        }
    }

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
        assert_eq!(Mpdo::parse(&[0; 8]), Err(MpdoError::NoProducer));
        assert_eq!(Mpdo::parse(&[0x85; 7]), Err(MpdoError::Length { length: 7 }));
        assert_eq!(Mpdo::new(address, (0x2001, 3), &[0; 5]), Err(MpdoError::Value { length: 5 }));
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
