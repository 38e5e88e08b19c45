//! Axes of one node.

use ecan_canopen::OperatingMode;
use ecan_cia402::AxisConfig;

use super::{PER_MILLE, Plan};

impl Plan {
    /// The axes that the node of an axis has, the axis included.
    pub fn axes_of_node(&self, axis: usize) -> impl Iterator<Item = usize> + '_ {
        let address = self.axes[axis].config.address;
        (0..self.axes.len()).filter(move |n| self.axes[*n].config.address == address)
    }

    /// Makes pairs of axes on a channel the axes of one node; `None` without a pair.
    pub fn with_shared_nodes(mut self) -> Option<Self> {
        let mut is_shared = false;
        for second in 1..self.axes.len() {
            let channel = |axis: &AxisConfig| (axis.address.slave, axis.address.channel);
            let found = (0..second).find(|first| {
                channel(&self.axes[*first].config) == channel(&self.axes[second].config)
                    && self.axes_of_node(*first).count() == 1
            });
            let Some(first) = found else { continue };
            self.share(first, second);
            is_shared = true;
        }
        is_shared.then_some(self)
    }

    fn share(&mut self, first: usize, second: usize) {
        self.axes[first].drive.axes = 2;
        let drive = self.axes[first].drive.clone();
        let node = self.axes[first].config.clone();
        let layout = node.layout();
        let pdos = layout.rpdo_count().max(layout.tpdo_count()) as u16;
        let axis = &mut self.axes[second];
        let start = drive.motor.start_position - axis.drive.motor.start_position;
        let friction = |friction: u32| (friction / PER_MILLE) as i32;
        let torque = friction(drive.motor.friction) - friction(axis.drive.motor.friction);
        axis.config.bounds = axis.config.bounds.map(|(low, high)| match axis.config.mode {
            OperatingMode::CyclicPosition
            | OperatingMode::InterpolatedPosition
            | OperatingMode::ProfilePosition => (low + start, high + start),
            OperatingMode::CyclicTorque | OperatingMode::ProfileTorque => {
                (low - torque, high + torque)
            }
            _ => (low, high),
        });
        axis.config = axis.config.clone().with_node_axis(1, node.pdos.number + pdos);
        axis.config.address = node.address;
        axis.config.drive.host_heartbeat_ms = node.drive.host_heartbeat_ms;
        axis.drive = drive;
    }
}
