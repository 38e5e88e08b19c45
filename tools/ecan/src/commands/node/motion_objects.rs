//! Objects whose values can move a motor.

use ecan_canopen::object;

/// Targets of the modes that have no constant elsewhere: 0x6042 (vl), 0x60C1 (ip).
const VL_TARGET_VELOCITY: u16 = 0x6042;
const INTERPOLATION_DATA: u16 = 0x60C1;
/// Distance of the objects of the axes of a drive (CiA 402-2, 5).
const AXIS_OFFSET: u16 = 0x800;

/// Returns whether a write can start, stop or change a motion: controlword, mode and targets of any
/// of the 8 axes, and the outputs.
pub fn moves_a_motor(index: u16) -> bool {
    if !(0x6000..0xA000).contains(&index) {
        return false;
    }
    matches!(
        0x6000 + (index - 0x6000) % AXIS_OFFSET,
        object::CONTROLWORD
            | VL_TARGET_VELOCITY
            | object::MODE_OF_OPERATION
            | object::TARGET_TORQUE
            | object::TARGET_POSITION
            | object::TARGET_VELOCITY
            | object::POSITION_OFFSET
            | object::VELOCITY_OFFSET
            | object::TORQUE_OFFSET
            | INTERPOLATION_DATA
            | DIGITAL_OUTPUTS
    )
}

/// Digital outputs, among them the brake.
const DIGITAL_OUTPUTS: u16 = 0x60FE;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_of_every_axis_are_covered() {
        for index in [0x6040, 0x6060, 0x607A, 0x60FF, 0x6071, 0x6840, 0x9840, 0x60B1, 0x60FE] {
            assert!(moves_a_motor(index), "{index:04X}");
        }
        for index in [0x1017, 0x6041, 0x6081, 0x2000, 0xA040, 0x5040] {
            assert!(!moves_a_motor(index), "{index:04X}");
        }
    }
}
