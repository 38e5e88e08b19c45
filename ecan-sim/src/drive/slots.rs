//! Objects that the drive updates.

use ecan_canopen::object;

use super::dictionary::{Dictionary, Slot};

/// Indices of the updated objects; their values are in `Device::value`.
pub(super) const UPDATED: [u16; 13] = [
    object::ERROR_REGISTER,
    object::ERROR_CODE,
    object::STATUSWORD,
    object::MODE_DISPLAY,
    object::POSITION_DEMAND,
    object::POSITION_ACTUAL_INTERNAL,
    object::POSITION_ACTUAL,
    object::VELOCITY_DEMAND,
    object::VELOCITY_ACTUAL,
    object::TORQUE_DEMAND,
    object::TORQUE_ACTUAL,
    object::FOLLOWING_ERROR,
    object::DIGITAL_INPUTS,
];

/// Slots of the updated objects; `None` if the dictionary lacks the object.
pub(super) type Slots = [Option<Slot>; UPDATED.len()];

pub(super) fn find(objects: &Dictionary) -> Slots {
    UPDATED.map(|index| objects.find(index, 0).ok())
}
