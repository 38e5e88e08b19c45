//! Objects that a drive updates before they are read.

use ecan_canopen::object;

use super::axis_objects::axis_index;
use super::dictionary::{Dictionary, Slot};

const COUNT: usize = 20;

/// Indices for the first axis.
const UPDATED_OBJECTS: [u16; COUNT] = [
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
    object::VL_VELOCITY_DEMAND,
    object::VL_VELOCITY_ACTUAL,
    object::PROBE_STATUS,
    object::PROBE_1_POSITIVE,
    object::PROBE_1_NEGATIVE,
    object::PROBE_2_POSITIVE,
    object::PROBE_2_NEGATIVE,
];

/// Slots of these objects of an axis, as far as the dictionary has them, with their indices for the
/// first axis.
pub(super) type Slots = Vec<(Slot, u16)>;

pub(super) fn find_updated(objects: &Dictionary, axis: usize, is_drive: bool) -> Slots {
    let is_updated = |index| {
        let is_shared = index == object::ERROR_REGISTER;
        if axis == 0 { is_drive || is_shared } else { is_drive && !is_shared }
    };
    let find = |index| objects.find((axis_index(axis, index), 0)).ok().map(|slot| (slot, index));
    UPDATED_OBJECTS.into_iter().filter(|index| is_updated(*index)).filter_map(find).collect()
}
