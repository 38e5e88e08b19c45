//! Objects that the drive updates: their slots and values.

use ecan_canopen::object;

use super::dictionary::{Dictionary, Slot};

/// Slots of the updated objects; `None` if the dictionary lacks the object.
#[derive(Clone, Copy, Debug, Default)]
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

    /// The slots for which `is_used` is true.
    pub(super) fn in_use(&self, is_used: impl Fn(Slot) -> bool) -> Self {
        let keep = |slot: Option<Slot>| slot.filter(|slot| is_used(*slot));
        Self {
            error_register: keep(self.error_register),
            error_code: keep(self.error_code),
            statusword: keep(self.statusword),
            mode_display: keep(self.mode_display),
            position_demand: keep(self.position_demand),
            position_internal: keep(self.position_internal),
            position: keep(self.position),
            velocity_demand: keep(self.velocity_demand),
            velocity: keep(self.velocity),
            torque_demand: keep(self.torque_demand),
            torque: keep(self.torque),
            following_error: keep(self.following_error),
            inputs: keep(self.inputs),
        }
    }
}
