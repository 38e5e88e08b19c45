//! The objects that the drive itself keeps up to date: where they are, and what they tell.

use ecan_canopen::object;

use super::device::Device;
use super::dictionary::{Dictionary, Slot};

/// Slots of what the drive tells; `None` where the dictionary has no such object.
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

    /// Those among them that are in use.
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

impl Device {
    /// Brings all objects that the drive tells up to date.
    pub(super) fn publish(&mut self) {
        let slots = self.slots;
        self.publish_to(&slots);
    }

    /// The same for those that its PDOs carry.
    pub(super) fn publish_sent(&mut self) {
        let slots = self.sent_slots;
        self.publish_to(&slots);
    }

    fn publish_to(&mut self, slots: &Slots) {
        let torque = |device: &Self| device.axis.motor().torque().round() as i64;
        self.tell(slots.error_register, |device| device.emergency.register().0.into());
        self.tell(slots.error_code, |device| device.emergency.code().into());
        self.tell(slots.statusword, |device| device.statusword().0.into());
        self.tell(slots.mode_display, |device| {
            device.axis.mode().map_or(0, |mode| i64::from(mode.raw()))
        });
        self.tell(slots.position_demand, |device| device.axis.demand().into());
        self.tell(slots.position_internal, |device| device.axis.motor().position().round() as i64);
        self.tell(slots.position, |device| device.axis.position().into());
        self.tell(slots.velocity_demand, |device| device.axis.demanded_velocity().into());
        self.tell(slots.velocity, |device| device.axis.motor().velocity().round() as i64);
        self.tell(slots.torque_demand, torque);
        self.tell(slots.torque, torque);
        self.tell(slots.following_error, |device| device.axis.following_error().into());
        self.tell(slots.inputs, |device| device.axis.switches().bits().into());
    }

    fn tell(&mut self, slot: Option<Slot>, value: impl FnOnce(&Self) -> i64) {
        if let Some(slot) = slot {
            let value = value(self);
            self.objects.put(slot, value as u64);
        }
    }
}
