//! Process data of an axis: one RPDO and one TPDO.

use ecan_canopen::{Controlword, MappingEntry, OperatingMode, Statusword, object};

/// Most bytes of a PDO on classic CAN.
const MAX_BYTES: usize = 8;

/// The object that the RPDO carries after the controlword.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum TargetObject {
    /// Target position, 0x607A, I32: CSP, PP and, unused, homing.
    #[default]
    Position,
    /// Target velocity, 0x60FF, I32: CSV and PV.
    Velocity,
    /// Target torque, 0x6071, I16: CST and PT.
    Torque,
}

impl TargetObject {
    /// The object that a mode takes its targets from; `None` for interpolated position, which this
    /// crate does not drive. Homing takes none, and goes with any.
    pub fn of_mode(mode: OperatingMode) -> Option<Self> {
        match mode {
            OperatingMode::CyclicPosition
            | OperatingMode::ProfilePosition
            | OperatingMode::Homing => Some(Self::Position),
            OperatingMode::CyclicVelocity | OperatingMode::ProfileVelocity => Some(Self::Velocity),
            OperatingMode::CyclicTorque | OperatingMode::ProfileTorque => Some(Self::Torque),
            OperatingMode::InterpolatedPosition => None,
        }
    }

    /// Returns whether a mode can be driven while this object is mapped.
    pub fn serves(self, mode: OperatingMode) -> bool {
        mode == OperatingMode::Homing || Self::of_mode(mode) == Some(self)
    }

    fn entry(self) -> MappingEntry {
        match self {
            Self::Position => MappingEntry::new(object::TARGET_POSITION, 0, 32),
            Self::Velocity => MappingEntry::new(object::TARGET_VELOCITY, 0, 32),
            Self::Torque => MappingEntry::new(object::TARGET_TORQUE, 0, 16),
        }
    }
}

/// The process data of an axis.
///
/// | | bytes 0, 1 | bytes 2.. | length |
/// | --- | --- | --- | --- |
/// | RPDO, CSP and PP | controlword 0x6040 | target position 0x607A | 6 |
/// | RPDO, CSV and PV | controlword | target velocity 0x60FF | 6 |
/// | RPDO, CST and PT | controlword | target torque 0x6071 | 4 |
/// | TPDO, all modes | statusword 0x6041 | actual position 0x6064 | 6 |
///
/// Statusword and actual position come in one frame, so that they are of one instant: the guard
/// relies on that when it begins at the actual position of an enabled drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct PdoLayout {
    /// After the controlword.
    pub target: TargetObject,
}

/// An RPDO, ready to be sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RpdoBytes {
    bytes: [u8; MAX_BYTES],
    length: usize,
}

impl RpdoBytes {
    /// The data of the frame.
    pub fn as_slice(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or_default()
    }
}

/// Values of a TPDO.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Feedback {
    /// The statusword.
    pub statusword: Statusword,
    /// The actual position of the same instant, in steps.
    pub position: i32,
}

impl PdoLayout {
    /// The layout for a mode; `None` for one that this crate does not drive.
    pub fn for_mode(mode: OperatingMode) -> Option<Self> {
        TargetObject::of_mode(mode).map(|target| Self { target })
    }

    /// Entries of the RPDO's mapping.
    pub fn rpdo_entries(self) -> [MappingEntry; 2] {
        [MappingEntry::new(object::CONTROLWORD, 0, 16), self.target.entry()]
    }

    /// Entries of the TPDO's mapping.
    pub fn tpdo_entries(self) -> [MappingEntry; 2] {
        [
            MappingEntry::new(object::STATUSWORD, 0, 16),
            MappingEntry::new(object::POSITION_ACTUAL, 0, 32),
        ]
    }

    /// The RPDO. A torque beyond an `i16` is cut to its limits. Real-time safe.
    pub fn encode(self, controlword: Controlword, target: i32) -> RpdoBytes {
        let mut bytes = [0; MAX_BYTES];
        let (head, tail) = bytes.split_at_mut(2);
        head.copy_from_slice(&controlword.0.to_le_bytes());
        let length = match self.target {
            TargetObject::Position | TargetObject::Velocity => fill(tail, &target.to_le_bytes()),
            TargetObject::Torque => {
                let torque = target.clamp(i16::MIN.into(), i16::MAX.into()) as i16;
                fill(tail, &torque.to_le_bytes())
            }
        };
        RpdoBytes { bytes, length: 2 + length }
    }

    /// Reads a TPDO; `None` where it is shorter than mapped. Real-time safe.
    pub fn decode(self, data: &[u8]) -> Option<Feedback> {
        let (status, rest) = data.split_first_chunk::<2>()?;
        let (position, _) = rest.split_first_chunk::<4>()?;
        Some(Feedback {
            statusword: Statusword(u16::from_le_bytes(*status)),
            position: i32::from_le_bytes(*position),
        })
    }
}

fn fill(to: &mut [u8], from: &[u8]) -> usize {
    for (to, from) in to.iter_mut().zip(from) {
        *to = *from;
    }
    from.len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ecan_canopen::Command;

    fn layout(mode: OperatingMode) -> PdoLayout {
        PdoLayout::for_mode(mode).unwrap()
    }

    #[test]
    fn csp_rpdo_is_six_bytes_little_endian() {
        let enable = Controlword::of(Command::EnableOperation);
        let rpdo = layout(OperatingMode::CyclicPosition).encode(enable, 0x1234_5678);
        assert_eq!(rpdo.as_slice(), [0x0F, 0x00, 0x78, 0x56, 0x34, 0x12]);
        let rpdo = layout(OperatingMode::CyclicVelocity).encode(Controlword(0x10F), -2);
        assert_eq!(rpdo.as_slice(), [0x0F, 0x01, 0xFE, 0xFF, 0xFF, 0xFF]);
        let rpdo = layout(OperatingMode::CyclicTorque).encode(enable, -40_000);
        assert_eq!(rpdo.as_slice(), [0x0F, 0x00, 0x00, 0x80]);
    }

    #[test]
    fn mapping_matches_the_encoded_length() {
        for &mode in OperatingMode::ALL {
            let Some(layout) = PdoLayout::for_mode(mode) else {
                assert_eq!(mode, OperatingMode::InterpolatedPosition);
                continue;
            };
            let bits: usize = layout.rpdo_entries().iter().map(|e| usize::from(e.bits)).sum();
            assert_eq!(layout.encode(Controlword(0), 0).as_slice().len() * 8, bits);
            assert!(layout.target.serves(mode) && layout.target.serves(OperatingMode::Homing));
        }
        assert_eq!(PdoLayout::default().rpdo_entries()[0].raw(), 0x6040_0010);
        assert_eq!(PdoLayout::default().rpdo_entries()[1].raw(), 0x607A_0020);
        assert_eq!(
            PdoLayout::default().tpdo_entries().map(|e| e.raw()),
            [0x6041_0010, 0x6064_0020]
        );
        assert!(!TargetObject::Position.serves(OperatingMode::CyclicVelocity));
    }

    #[test]
    fn short_tpdo_is_rejected() {
        let data = [0x37, 0x12, 0xFF, 0xFF, 0xFF, 0xFF];
        let feedback = Feedback { statusword: Statusword(0x1237), position: -1 };
        assert_eq!(PdoLayout::default().decode(&data), Some(feedback));
        for length in 0..6 {
            assert_eq!(PdoLayout::default().decode(&data[..length]), None);
        }
    }
}
