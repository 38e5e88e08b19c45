//! Objects of a drive with the axes that update and use them, and the errors that both report.

use ecan_canopen::{
    ErrorRegister, NmtState, NodeLossReaction, OperatingMode, Statusword, SupportedModes, object,
};

use super::axis::{Axis, Report};
use super::axis_commands::ReceivedCommands;
use super::config::DriveConfig;
use super::dictionary::{
    Dictionary, MOST_AXES, Object, Slot, Slots, Value, axis_index, find_updated, nearest,
    split_index,
};
use super::motion;
use super::network::{Emergency, register_of};
use super::objects::ObjectSource;
use super::parameters::Parameters;
use super::pdo::{Mapping, PDO_BYTES};
use crate::event_queue::earliest;

/// Objects whose values a change of the node-ID resets: the communication profile.
const COMMUNICATION: std::ops::RangeInclusive<u16> = 0x1000..=0x1FFF;

/// Object dictionary, axes and errors of a drive.
#[derive(Clone, Debug)]
pub(super) struct ObjectModel {
    /// False for a node without CiA 402: its axes stay idle, and its objects only have values.
    pub(super) is_drive: bool,
    pub(super) objects: Dictionary,
    pub(super) units: AxisUnits,
    pub(super) emergency: Emergency,
}

impl ObjectModel {
    pub(super) fn new(config: &DriveConfig, source: &ObjectSource) -> Self {
        let (objects, is_drive) = source.objects(config);
        let axes = source.axis_count(&objects);
        Self {
            is_drive,
            units: AxisUnits::new(config, axes, &objects, is_drive),
            emergency: Emergency::new(),
            objects,
        }
    }

    /// Gives the objects in a range their values after a reset.
    pub(super) fn reset_values(&mut self, indices: std::ops::RangeInclusive<u16>) {
        for object in self.objects.iter_mut().filter(|object| indices.contains(&object.index)) {
            match (&mut object.value, object.saved.as_ref().unwrap_or(&object.default)) {
                (Value::Bytes(value), Value::Bytes(bytes)) => {
                    value.clear();
                    value.extend_from_slice(bytes);
                }
                (value, reset) => *value = reset.clone(),
            }
        }
        self.load_parameters();
    }

    /// Presets the modes of operation of all axes.
    pub(super) fn preset_modes(&mut self) {
        for unit in self.units.iter_mut() {
            let index = axis_index(unit.number, object::MODE_OF_OPERATION);
            let mode = self.objects.number(index, 0).unwrap_or(0) as i8;
            unit.axis.preset_mode(mode);
        }
    }

    /// Takes the objects of another node-ID. Objects outside the communication profile keep their values.
    pub(super) fn replace_objects(&mut self, mut objects: Dictionary) {
        for object in objects.iter_mut() {
            let Ok(slot) = self.objects.find(object.key()) else { continue };
            if let Some(before) = self.objects.object(slot) {
                carry_over(before, object);
            }
        }
        self.objects = objects;
    }

    pub(super) fn load_parameters(&mut self) {
        self.units.load_parameters(&self.objects);
    }

    /// Returns whether an axis supports a mode of operation; 0 (no mode) is supported.
    pub(super) fn has_mode(&self, axis: usize, raw: i8) -> bool {
        let index = axis_index(axis, object::SUPPORTED_MODES);
        let modes = self.objects.number(index, 0).unwrap_or(0);
        match OperatingMode::from_raw(raw) {
            Some(mode) => motion::is_supported(mode) && SupportedModes(modes as u32).contains(mode),
            None => raw == 0,
        }
    }

    /// Statusword of an axis.
    pub(super) fn statusword(&self, unit: &AxisUnit, state: NmtState) -> Statusword {
        // All axes have this bit in common.
        let remote = if state == NmtState::Initialising { 0 } else { Statusword::REMOTE };
        let mut word = unit.statusword().0 | remote;
        if self.emergency.register != 0 && !unit.axis.power.is_faulted() {
            word |= Statusword::WARNING;
        }
        Statusword(word)
    }

    /// Updates the objects of the axes that can be read.
    pub(super) fn publish(&mut self, state: NmtState) {
        self.publish_to(state, |unit| &unit.slots);
    }

    /// Updates the objects of the axes that transmit PDOs contain.
    pub(super) fn publish_pdos(&mut self, state: NmtState) {
        self.publish_to(state, |unit| &unit.pdo_slots);
    }

    fn publish_to(&mut self, state: NmtState, slots: impl Fn(&AxisUnit) -> &Slots) {
        for number in 0..self.units.count() {
            let mut position = 0;
            while let Some(unit) = self.units.get(number)
                && let Some(&(slot, index)) = slots(unit).get(position)
            {
                let value = self.updated_value(unit, index, state);
                self.objects.put(slot, value as u64);
                position += 1;
            }
        }
    }

    /// Value of an object that the drive updates, by its index for the first axis.
    fn updated_value(&self, unit: &AxisUnit, index: u16, state: NmtState) -> i64 {
        let axis = &unit.axis;
        match index {
            object::ERROR_REGISTER => self.emergency.register.into(),
            object::ERROR_CODE => self.emergency.code.into(),
            object::STATUSWORD => self.statusword(unit, state).0.into(),
            object::MODE_DISPLAY => axis.mode.map_or(0, |mode| mode.raw().into()),
            object::POSITION_DEMAND => axis.demand().into(),
            object::POSITION_ACTUAL_INTERNAL => nearest(axis.motor.position),
            object::POSITION_ACTUAL => axis.position().into(),
            object::VELOCITY_DEMAND => i64::from(axis.motion.ramp.velocity as i32),
            object::VELOCITY_ACTUAL => nearest(axis.motor.velocity),
            object::TORQUE_DEMAND => nearest(axis.motor.torque),
            object::TORQUE_ACTUAL => nearest(axis.motor.torque),
            object::FOLLOWING_ERROR => axis.following_error().into(),
            object::DIGITAL_INPUTS => axis.switches().bits().into(),
            object::VL_VELOCITY_DEMAND => axis.rpm(axis.motion.ramp.velocity),
            object::VL_VELOCITY_ACTUAL => axis.rpm(axis.motor.velocity),
            object::PROBE_STATUS => axis.probes.status().into(),
            object::PROBE_1_POSITIVE => axis.probes.position(0, true).into(),
            object::PROBE_1_NEGATIVE => axis.probes.position(0, false).into(),
            object::PROBE_2_POSITIVE => axis.probes.position(1, true).into(),
            object::PROBE_2_NEGATIVE => axis.probes.position(1, false).into(),
            _ => 0,
        }
    }

    /// Writes the data of a PDO to the objects; its commands are applied together.
    pub(super) fn unpack(&mut self, mapping: &Mapping, data: &[u8; PDO_BYTES]) {
        let mut received = [ReceivedCommands::default(); MOST_AXES];
        let mut parameters_changed = false;
        let mut axes = 0;
        for (mapped, raw) in mapping.unpack(*data) {
            let Some(slot) = mapped.slot else { continue };
            if !self.is_within_limits(slot, raw) {
                continue;
            }
            self.objects.put(slot, raw);
            if let Some(object) = self.objects.object(slot).filter(|_| self.is_drive) {
                let number = object.data_type.sign_extend(raw);
                let (axis, index) = split_index(object.index);
                if let Some(unit) = self.units.get_mut(axis)
                    && let Some(received) = received.get_mut(axis)
                {
                    axes = axes.max(axis + 1);
                    parameters_changed |= !unit.axis.store_command(index, number, received);
                }
            }
        }
        if parameters_changed {
            self.load_parameters();
        }
        for (unit, received) in self.units.iter_mut().zip(&received).take(axes) {
            unit.apply(received);
        }
    }

    /// Values outside the limits of an object are rejected in PDOs too.
    fn is_within_limits(&self, slot: Slot, raw: u64) -> bool {
        let Some(object) = self.objects.object(slot) else { return false };
        let number = object.data_type.sign_extend(object.data_type.mask(raw));
        let (low, high) = object.limits;
        let (axis, index) = split_index(object.index);
        let supported = !self.is_drive
            || index != object::MODE_OF_OPERATION
            || self.has_mode(axis, number as i8);
        supported && low.is_none_or(|low| number >= low) && high.is_none_or(|high| number <= high)
    }

    /// Reports a communication error that has already gone.
    pub(super) fn report(&mut self, code: u16) {
        self.emergency.report(code, register_of(code), &mut self.objects);
    }

    /// Turns the reports of the axes into errors.
    pub(super) fn take_reports(&mut self) {
        while let Some(report) = self.units.take_report() {
            match report {
                Report::Fault(code) => self.emergency.raise(code, &mut self.objects),
                Report::FaultReset => self.emergency.clear(ErrorRegister(u8::MAX)),
            }
        }
    }

    /// Clears a communication error whose cause has ended, unless an axis is in a fault.
    pub(super) fn end_communication_error(&mut self) {
        if !self.units.are_faulted() {
            self.emergency.clear(ErrorRegister::COMMUNICATION);
        }
    }
}

/// Keeps the saved value, unless it depends on the node-ID as the default does.
fn carry_over(before: &Object, object: &mut Object) {
    if before.default == object.default {
        object.saved.clone_from(&before.saved);
    }
    if !COMMUNICATION.contains(&object.index) {
        object.value.clone_from(&before.value);
    }
}

/// One axis.
#[derive(Clone, Debug)]
pub(super) struct AxisUnit {
    pub(super) number: usize,
    pub(super) axis: Axis,
    pub(super) parameters: Parameters,
    pub(super) slots: Slots,
    /// Slots that transmit PDOs contain.
    pub(super) pdo_slots: Slots,
}

impl AxisUnit {
    fn new(config: &DriveConfig, number: usize, objects: &Dictionary, is_drive: bool) -> Self {
        let axis = Axis::new(config);
        Self {
            number,
            slots: find_updated(objects, number, is_drive),
            pdo_slots: Slots::default(),
            parameters: Parameters::read(objects, number, &axis.motor),
            axis,
        }
    }

    fn load_parameters(&mut self, objects: &Dictionary) {
        self.parameters = Parameters::read(objects, self.number, &self.axis.motor);
        self.axis.motor.limit_torque(self.parameters.max_torque);
        self.axis.motor.limit_speed(self.parameters.max_motor_speed);
    }

    pub(super) fn apply(&mut self, received: &ReceivedCommands) {
        self.axis.apply(received, &self.parameters);
    }

    pub(super) fn statusword(&self) -> Statusword {
        self.axis.statusword(&self.parameters)
    }

    fn is_faulted(&self) -> bool {
        self.axis.power.is_faulted()
    }
}

/// All axes; every drive has one.
#[derive(Clone, Debug)]
pub(super) struct AxisUnits {
    pub(super) first: AxisUnit,
    further: Vec<AxisUnit>,
}

impl AxisUnits {
    pub(super) fn new(
        config: &DriveConfig,
        count: usize,
        objects: &Dictionary,
        is_drive: bool,
    ) -> Self {
        let unit = |number| AxisUnit::new(config, number, objects, is_drive);
        Self { first: unit(0), further: (1..count).map(unit).collect() }
    }

    pub(super) fn count(&self) -> usize {
        1 + self.further.len()
    }

    pub(super) fn get(&self, number: usize) -> Option<&AxisUnit> {
        match number.checked_sub(1) {
            None => Some(&self.first),
            Some(nth) => self.further.get(nth),
        }
    }

    pub(super) fn get_mut(&mut self, number: usize) -> Option<&mut AxisUnit> {
        match number.checked_sub(1) {
            None => Some(&mut self.first),
            Some(nth) => self.further.get_mut(nth),
        }
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &AxisUnit> {
        [&self.first].into_iter().chain(&self.further)
    }

    pub(super) fn iter_mut(&mut self) -> impl Iterator<Item = &mut AxisUnit> {
        [&mut self.first].into_iter().chain(&mut self.further)
    }

    pub(super) fn load_parameters(&mut self, objects: &Dictionary) {
        self.iter_mut().for_each(|unit| unit.load_parameters(objects));
    }

    pub(super) fn restart(&mut self, supply_lost: bool) {
        self.iter_mut().for_each(|unit| unit.axis.restart(supply_lost));
    }

    pub(super) fn advance(&mut self, now: u64) {
        for unit in self.iter_mut() {
            unit.axis.advance(now, &unit.parameters);
        }
    }

    pub(super) fn host_lost(&mut self, code: u16) {
        for unit in self.iter_mut() {
            unit.axis.host_lost(code, &unit.parameters);
        }
    }

    pub(super) fn are_energised(&self) -> bool {
        self.iter().any(|unit| unit.axis.power.is_energised())
    }

    pub(super) fn are_faulted(&self) -> bool {
        self.iter().any(AxisUnit::is_faulted)
    }

    /// Returns whether the loss of the host makes an axis enter a fault.
    pub(super) fn will_fault_without_host(&self) -> bool {
        self.iter()
            .any(|unit| unit.parameters.node_loss == NodeLossReaction::Fault && !unit.is_faulted())
    }

    pub(super) fn take_report(&mut self) -> Option<Report> {
        let report = self.iter_mut().find_map(|unit| unit.axis.report.take())?;
        // The error of another axis remains.
        let is_over = report != Report::FaultReset || !self.are_faulted();
        is_over.then_some(report)
    }

    pub(super) fn missed_tick(&self, now: u64) -> Option<u64> {
        self.iter().filter_map(|unit| unit.axis.missed_tick(now)).max()
    }

    pub(super) fn next_tick(&self) -> Option<u64> {
        match self.further.as_slice() {
            [] => self.first.axis.next_tick(),
            _ => earliest(self.iter().map(|unit| unit.axis.next_tick())),
        }
    }

    pub(super) fn next_event(&self) -> Option<u64> {
        match self.further.as_slice() {
            [] => self.first.axis.next_event(&self.first.parameters),
            _ => earliest(self.iter().map(next_event_of)),
        }
    }
}

/// Time of the next event of one axis. Not inlined: within the loop over axes the compiler branches on the
/// unused content of `None`, which valgrind reports.
#[inline(never)]
fn next_event_of(unit: &AxisUnit) -> Option<u64> {
    unit.axis.next_event(&unit.parameters)
}
