//! Where the objects are that the drive itself keeps up to date.

use ecan_canopen::object;

use super::dictionary::{Dictionary, Slot};

/// Slots of what the drive tells; `None` where the dictionary has no such object.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slots {
    pub(super) error_register: Option<Slot>,
    pub(super) error_code: Option<Slot>,
    pub(super) statusword: Option<Slot>,
    pub(super) mode_display: Option<Slot>,
    pub(super) position_demand: Option<Slot>,
    pub(super) position_internal: Option<Slot>,
    pub(super) position: Option<Slot>,
    pub(super) velocity_demand: Option<Slot>,
    pub(super) velocity: Option<Slot>,
    pub(super) torque_demand: Option<Slot>,
    pub(super) torque: Option<Slot>,
    pub(super) following_error: Option<Slot>,
    pub(super) inputs: Option<Slot>,
}

impl Slots {
    pub(super) fn find(objects: &Dictionary) -> Self {
        let find = |index| objects.find(index, 0).ok();
        Self {
            error_register: find(object::ERROR_REGISTER),
            error_code: find(object::ERROR_CODE),
            statusword: find(object::STATUSWORD),
            mode_display: find(object::MODE_DISPLAY),
            position_demand: find(object::POSITION_DEMAND),
            position_internal: find(object::POSITION_ACTUAL_INTERNAL),
            position: find(object::POSITION_ACTUAL),
            velocity_demand: find(object::VELOCITY_DEMAND),
            velocity: find(object::VELOCITY_ACTUAL),
            torque_demand: find(object::TORQUE_DEMAND),
            torque: find(object::TORQUE_ACTUAL),
            following_error: find(object::FOLLOWING_ERROR),
            inputs: find(object::DIGITAL_INPUTS),
        }
    }
}
