//! 0x1000..0x1C13 and the process data objects: the objects of CoE and of the PDO mapping
//! (manual 5.1, ETG.1000.6), and the PDO assignment as SDO downloads (manual 5.4.1, 5.4.3 phase B).

use super::ObjectType::{String16, U8, U16, U32, VisibleString};
use super::entry::{Entry, Object};
use super::{ObjectType, SdoWrite};
use crate::mapping::{Direction, MAX_MULTIPLIER, assignment_index, pdo_map_index};

/// Subindex of the 16-byte data objects 0x6000.. and 0x7000.. that the PDOs map.
///
/// The manual gives only their indices. The host reads the mapped subindex of a device from 0x1600..
/// and 0x1A00..
pub const MAPPED_SUBINDEX: u8 = 1;

/// Chunks per direction, and objects per PDO mapping family (manual 5.1).
const CHUNKS: u16 = 24;
const UNITS_PER_CHUNK: u16 = 8;

/// Returns the value of a mapping object 0x1600..0x1617 or 0x1A00..0x1A17 at subindex 1 to 8: index,
/// subindex and bit length (128) of the mapped 16-byte object (manual 5.1.1). `None` for any other
/// object or subindex. The mapped subindex is [`MAPPED_SUBINDEX`], an assumption.
pub const fn pdo_mapping_entry(index: u16, subindex: u8) -> Option<u32> {
    let (chunk, data) = match index {
        0x1600..=0x1617 => (index - 0x1600, 0x7000),
        0x1A00..=0x1A17 => (index - 0x1A00, 0x6000),
        _ => return None,
    };
    if subindex == 0 || subindex as u16 > UNITS_PER_CHUNK {
        return None;
    }
    let object: u32 = data + chunk as u32 * 0x80 + (subindex as u32 - 1) * 0x10;
    Some(object << 16 | (MAPPED_SUBINDEX as u32) << 8 | 128)
}

pub(super) const DEVICE_TYPE: Object =
    Object::single(0x1000, "Device type", "15", &[Entry::ro(0, "Device type", U32)]);

pub(super) const DEVICE_NAME: Object =
    Object::single(0x1008, "Device name", "15", &[Entry::ro(0, "Device name", VisibleString)]);

pub(super) const HARDWARE_VERSION: Object = Object::single(
    0x1009,
    "Hardware version",
    "15",
    &[Entry::ro(0, "Hardware version", VisibleString)],
);

pub(super) const SOFTWARE_VERSION: Object = Object::single(
    0x100A,
    "Software version",
    "15.3.1",
    &[Entry::ro(0, "Software version", VisibleString)],
);

pub(super) const IDENTITY: Object = Object::single(
    0x1018,
    "Identity",
    "15",
    &[
        Entry::highest(4),
        Entry::ro(1, "Vendor id", U32),
        Entry::ro(2, "Product code", U32),
        Entry::ro(3, "Revision", U32),
        Entry::ro(4, "Serial number", U32),
    ],
);

/// The mapping differs by chunk, so it has no default here: see [`pdo_mapping_entry`].
const MAPPING_ENTRIES: &[Entry] = &[
    Entry::highest(8),
    Entry::ro(1, "Mapped unit 0", U32),
    Entry::ro(2, "Mapped unit 1", U32),
    Entry::ro(3, "Mapped unit 2", U32),
    Entry::ro(4, "Mapped unit 3", U32),
    Entry::ro(5, "Mapped unit 4", U32),
    Entry::ro(6, "Mapped unit 5", U32),
    Entry::ro(7, "Mapped unit 6", U32),
    Entry::ro(8, "Mapped unit 7", U32),
];

pub(super) const RX_PDO_MAPPING: Object =
    Object::family(0x1600, CHUNKS, 1, "RxPDO chunk map", "5.1", MAPPING_ENTRIES);

pub(super) const TX_PDO_MAPPING: Object =
    Object::family(0x1A00, CHUNKS, 1, "TxPDO chunk map", "5.1", MAPPING_ENTRIES);

const SYNC_MANAGER_TYPE: &[(u32, &str)] = &[
    (0, "unused"),
    (1, "mailbox, master to slave"),
    (2, "mailbox, slave to master"),
    (3, "process data outputs"),
    (4, "process data inputs"),
];

pub(super) const SYNC_MANAGER_TYPES: Object = Object::single(
    0x1C00,
    "Sync manager types",
    "5.3",
    &[
        Entry::highest(4),
        Entry::ro(1, "SM0 type", U8).default(1).values(SYNC_MANAGER_TYPE),
        Entry::ro(2, "SM1 type", U8).default(2).values(SYNC_MANAGER_TYPE),
        Entry::ro(3, "SM2 type", U8).default(3).values(SYNC_MANAGER_TYPE),
        Entry::ro(4, "SM3 type", U8).default(4).values(SYNC_MANAGER_TYPE),
    ],
);

/// Subindex 0 (number of assigned chunks) and one entry per chunk.
const fn assignment_entries(first_map: u16) -> [Entry; CHUNKS as usize + 1] {
    const NAMES: [&str; CHUNKS as usize] = [
        "Chunk 0", "Chunk 1", "Chunk 2", "Chunk 3", "Chunk 4", "Chunk 5", "Chunk 6", "Chunk 7",
        "Chunk 8", "Chunk 9", "Chunk 10", "Chunk 11", "Chunk 12", "Chunk 13", "Chunk 14",
        "Chunk 15", "Chunk 16", "Chunk 17", "Chunk 18", "Chunk 19", "Chunk 20", "Chunk 21",
        "Chunk 22", "Chunk 23",
    ];
    let count = Entry::rw(0, "Assigned chunks", U8).range(0, CHUNKS as u32);
    let mut entries = [count; CHUNKS as usize + 1];
    let mut chunk = 0;
    while chunk < CHUNKS as usize {
        // infallible: evaluated by the compiler only
        entries[chunk + 1] = Entry::rw(chunk as u8 + 1, NAMES[chunk], U16)
            .default(first_map as u32 + chunk as u32)
            .range(first_map as u32, first_map as u32 + CHUNKS as u32 - 1);
        chunk += 1;
    }
    entries
}

static RX_ASSIGNMENT_ENTRIES: [Entry; CHUNKS as usize + 1] = assignment_entries(0x1600);
static TX_ASSIGNMENT_ENTRIES: [Entry; CHUNKS as usize + 1] = assignment_entries(0x1A00);

pub(super) static RX_PDO_ASSIGNMENT: Object =
    Object::single(0x1C12, "RxPDO assignment", "5.1", &RX_ASSIGNMENT_ENTRIES);

pub(super) static TX_PDO_ASSIGNMENT: Object =
    Object::single(0x1C13, "TxPDO assignment", "5.1", &TX_ASSIGNMENT_ENTRIES);

pub(super) const INPUT_DATA: Object = Object::family(
    0x6000,
    CHUNKS * UNITS_PER_CHUNK,
    0x10,
    "TxPDO data unit",
    "5.1.1",
    &[Entry::highest(MAPPED_SUBINDEX), Entry::ro(MAPPED_SUBINDEX, "Bytes", String16)],
);

pub(super) const OUTPUT_DATA: Object = Object::family(
    0x7000,
    CHUNKS * UNITS_PER_CHUNK,
    0x10,
    "RxPDO data unit",
    "5.1.1",
    &[Entry::highest(MAPPED_SUBINDEX), Entry::rw(MAPPED_SUBINDEX, "Bytes", String16)],
);

/// Returns the downloads that assign the first `multiplier` chunks of a direction: count 0, the
/// chunks, the count. A multiplier above 24 counts as 24.
pub fn assignment_writes(direction: Direction, multiplier: u8) -> AssignmentWrites {
    AssignmentWrites { direction, multiplier: multiplier.min(MAX_MULTIPLIER), next: 0 }
}

/// Iterator of [`assignment_writes`].
#[derive(Clone, Debug)]
pub struct AssignmentWrites {
    direction: Direction,
    multiplier: u8,
    next: u8,
}

impl Iterator for AssignmentWrites {
    type Item = SdoWrite;

    fn next(&mut self) -> Option<SdoWrite> {
        let step = self.next;
        let index = assignment_index(self.direction);
        let write = match step {
            0 => SdoWrite::new(index, 0, ObjectType::U8, 0),
            s if s <= self.multiplier => {
                let map = pdo_map_index(self.direction, s - 1);
                SdoWrite::new(index, s, ObjectType::U16, u32::from(map))
            }
            s if s == self.multiplier + 1 => {
                SdoWrite::new(index, 0, ObjectType::U8, u32::from(self.multiplier))
            }
            _ => return None,
        };
        self.next += 1;
        Some(write)
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let left = usize::from((self.multiplier + 2).saturating_sub(self.next));
        (left, Some(left))
    }
}

impl ExactSizeIterator for AssignmentWrites {}
