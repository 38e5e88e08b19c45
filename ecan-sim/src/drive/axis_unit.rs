//! The axes of a drive, each with its parameters and objects (CiA 402-1: logical devices).

use ecan_canopen::{NodeLossReaction, Statusword};

use super::axis::{Axis, Report};
use super::axis_commands::ReceivedCommands;
use super::config::DriveConfig;
use super::dictionary::{Dictionary, Slots, find_updated};
use super::parameters::Parameters;
use crate::event_queue::earliest;

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
