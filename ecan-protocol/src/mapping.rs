//! Process data directions, the 128 byte chunk mapping and its sync managers (manual 5.1, 5.3).

use core::fmt;

/// CAN channels of a gateway.
pub const CHANNELS: usize = 4;
/// Bytes of one mapping chunk, the unit of the PDO size.
pub const CHUNK_BYTES: usize = 128;
/// Mapping units of a chunk.
pub const UNITS_PER_CHUNK: usize = 8;
/// Bytes of one mapping unit, an object of type STRING(16).
pub const UNIT_BYTES: usize = 16;
/// Bytes of the fixed header at the start of an image.
pub const HEADER_BYTES: usize = 24;
/// Largest PDO size multiplier N.
pub const MAX_MULTIPLIER: u8 = 24;
/// Largest PDO image of one direction, in bytes.
pub const MAX_PDO_BYTES: usize = MAX_MULTIPLIER as usize * CHUNK_BYTES;
/// Most packets in one image: the header counts them in one byte.
pub const MAX_PACKETS: usize = 255;

crate::text_enum! {
    /// A direction of process data, named as seen by the slave, as in the manual.
    #[derive(PartialOrd, Ord)]
    pub enum Direction;
    /// Slave to master (SM3, inputs): received CAN frames. Controlled by 0x8010.
    TxPdo = "TxPDO";
    /// Master to slave (SM2, outputs): CAN frames to send. Controlled by 0x8011.
    RxPdo = "RxPDO";
}

impl Direction {
    /// Both directions.
    pub const ALL: [Self; 2] = [Self::TxPdo, Self::RxPdo];

    /// The PDO Profile Control object of this direction: 0x8010 or 0x8011 (manual 13.2).
    pub const fn profile_object(self) -> u16 {
        match self {
            Self::TxPdo => 0x8010,
            Self::RxPdo => 0x8011,
        }
    }
}

/// Index of the PDO that maps a chunk: 0x1A00 or 0x1600 plus `chunk` (0 to 23).
pub const fn pdo_map_index(direction: Direction, chunk: u8) -> u16 {
    let base: u16 = match direction {
        Direction::TxPdo => 0x1A00,
        Direction::RxPdo => 0x1600,
    };
    base + chunk as u16
}

/// Subindex of a unit (0 to 7) in the PDO of its chunk.
///
/// The manual counts from 1; the host reads the actual subindex of a gateway before it registers
/// entries.
pub const fn map_subindex(unit: u8) -> u8 {
    unit.saturating_add(1)
}

/// Index of the data object of a unit: 0x6000 or 0x7000 plus 0x80 for each chunk (0 to 23)
/// and 0x10 for each unit (0 to 7).
pub const fn data_object_index(direction: Direction, chunk: u8, unit: u8) -> u16 {
    let base: u16 = match direction {
        Direction::TxPdo => 0x6000,
        Direction::RxPdo => 0x7000,
    };
    base + chunk as u16 * 0x80 + unit as u16 * 0x10
}

/// Returns direction, chunk and unit of a data object; `None` for other objects.
pub const fn locate_data_object(index: u16) -> Option<(Direction, u8, u8)> {
    let direction = match index & 0xF000 {
        0x6000 => Direction::TxPdo,
        0x7000 => Direction::RxPdo,
        _ => return None,
    };
    let offset = index & 0x0FFF;
    let chunk = (offset / 0x80) as u8;
    if !offset.is_multiple_of(0x10) || chunk >= MAX_MULTIPLIER {
        return None;
    }
    Some((direction, chunk, (offset % 0x80 / 0x10) as u8))
}

/// Offset of a unit in the continuous image, in bytes.
pub const fn buffer_offset(chunk: u8, unit: u8) -> usize {
    chunk as usize * CHUNK_BYTES + unit as usize * UNIT_BYTES
}

/// The sync manager PDO assignment object: 0x1C13 for TxPDO, 0x1C12 for RxPDO.
pub const fn assignment_index(direction: Direction) -> u16 {
    match direction {
        Direction::TxPdo => 0x1C13,
        Direction::RxPdo => 0x1C12,
    }
}

/// The sync manager of a direction: 3 for TxPDO, 2 for RxPDO.
pub const fn sync_manager(direction: Direction) -> u8 {
    match direction {
        Direction::TxPdo => 3,
        Direction::RxPdo => 2,
    }
}

/// Physical start address of the direction's sync manager (manual 5.3).
pub const fn sync_manager_address(direction: Direction) -> u16 {
    match direction {
        Direction::TxPdo => 0x1D00,
        Direction::RxPdo => 0x1100,
    }
}

/// Control byte of the direction's sync manager, a single buffer (manual 5.3).
pub const fn sync_manager_control(direction: Direction) -> u8 {
    match direction {
        Direction::TxPdo => 0x22,
        Direction::RxPdo => 0x66,
    }
}

/// Start, length and control byte of a sync manager, in its registers (0x0800 + 8 per number) or in
/// the SII (category 41), which have the same format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SyncManagerLayout {
    /// Physical start address.
    pub start: u16,
    /// Length in bytes. In the SII the largest one, in the registers that of the assigned PDOs.
    pub length: u16,
    /// Control byte.
    pub control: u8,
}

impl SyncManagerLayout {
    /// Bytes of a sync manager in the registers and in the SII.
    pub const BYTES: usize = 8;

    /// SM2 or SM3 as the SII must have it (manual 5.3, 15.7).
    pub const fn required(direction: Direction) -> Self {
        Self {
            start: sync_manager_address(direction),
            length: MAX_PDO_BYTES as u16,
            control: sync_manager_control(direction),
        }
    }

    /// Reads the format of the registers and of the SII.
    pub const fn from_bytes(bytes: [u8; Self::BYTES]) -> Self {
        let [s0, s1, l0, l1, control, ..] = bytes;
        Self { start: u16::from_le_bytes([s0, s1]), length: u16::from_le_bytes([l0, l1]), control }
    }

    /// Returns whether start and control byte are those of the manual, which include the trigger of the process data
    /// watchdog; any length.
    pub const fn has_required_start_and_control(self, direction: Direction) -> bool {
        let required = Self::required(direction);
        self.start == required.start && self.control == required.control
    }
}

impl fmt::Display for SyncManagerLayout {
    /// `start 0x1100, 3072 bytes, control byte 0x66`
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { start, length, control } = self;
        write!(f, "start 0x{start:04X}, {length} bytes, control byte 0x{control:02X}")
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::ToString;

    use super::*;

    #[test]
    fn layout_is_read_from_registers_and_compared() {
        let inputs = SyncManagerLayout::from_bytes([0x00, 0x1D, 0x80, 0x01, 0x22, 0, 1, 4]);
        assert_eq!(inputs, SyncManagerLayout { start: 0x1D00, length: 384, control: 0x22 });
        assert!(inputs.has_required_start_and_control(Direction::TxPdo));
        assert!(!inputs.has_required_start_and_control(Direction::RxPdo));
        let outputs = |control| SyncManagerLayout { start: 0x1100, length: 384, control };
        assert!(outputs(0x66).has_required_start_and_control(Direction::RxPdo));
        assert!(!outputs(0x26).has_required_start_and_control(Direction::RxPdo), "no watchdog");
        assert!(
            !SyncManagerLayout { start: 0x1D80, ..inputs }
                .has_required_start_and_control(Direction::TxPdo)
        );
        let required = SyncManagerLayout::required(Direction::RxPdo);
        assert_eq!(required.to_string(), "start 0x1100, 3072 bytes, control byte 0x66");
    }

    #[test]
    fn mapping_matches_the_manual() {
        assert_eq!(pdo_map_index(Direction::RxPdo, 0), 0x1600);
        assert_eq!(pdo_map_index(Direction::RxPdo, 23), 0x1617);
        assert_eq!(pdo_map_index(Direction::TxPdo, 23), 0x1A17);
        assert_eq!(data_object_index(Direction::RxPdo, 0, 7), 0x7070);
        assert_eq!(data_object_index(Direction::RxPdo, 1, 0), 0x7080);
        assert_eq!(data_object_index(Direction::TxPdo, 1, 7), 0x60F0);
        assert_eq!(map_subindex(7), 8);
        assert_eq!(buffer_offset(0, 7), 112);
        assert_eq!(buffer_offset(1, 0), 128);
        assert_eq!(MAX_PDO_BYTES, 3072);
    }

    #[test]
    fn data_object_round_trip() {
        for direction in Direction::ALL {
            for chunk in 0..MAX_MULTIPLIER {
                for unit in 0..UNITS_PER_CHUNK as u8 {
                    let index = data_object_index(direction, chunk, unit);
                    assert_eq!(locate_data_object(index), Some((direction, chunk, unit)));
                }
            }
        }
        assert_eq!(locate_data_object(0x6C00), None);
        assert_eq!(locate_data_object(0x7001), None);
        assert_eq!(locate_data_object(0x8010), None);
    }
}
