use ecan_canopen::{Emcy, ErrorRegister, NodeId};

use crate::drive::Drive;
use crate::fault::DriveFault;
use crate::world::node_slot::{NodeBody, NodeSlot};
use crate::world::{World, ms};

impl World {
    /// The drives with their names, in the order of the scenario.
    pub fn drives(&self) -> impl Iterator<Item = (&str, &Drive)> {
        self.nodes.iter().filter_map(NodeSlot::drive)
    }

    /// A drive by the name of its node.
    pub fn drive(&self, name: &str) -> Option<&Drive> {
        self.drives().find(|(other, _)| *other == name).map(|(_, drive)| drive)
    }

    /// The drive with this node-ID on a gateway's channel.
    pub fn drive_at(&self, gateway: usize, channel: usize, node: NodeId) -> Option<&Drive> {
        self.drive_on(gateway, channel, node).map(|(_, drive)| drive)
    }

    /// Name of the drive with this node-ID on a gateway's channel, for faults.
    pub fn drive_name(&self, gateway: usize, channel: usize, node: NodeId) -> Option<&str> {
        self.drive_on(gateway, channel, node).map(|(name, _)| name)
    }

    fn drive_on(&self, gateway: usize, channel: usize, node: NodeId) -> Option<(&str, &Drive)> {
        let bus = self.slots.get(gateway)?.links.get(channel)?.bus;
        let mut drives =
            self.nodes.iter().filter(|slot| slot.bus == bus).filter_map(NodeSlot::drive);
        drives.find(|(_, drive)| drive.node_id() == node)
    }

    /// Returns whether the drive exists.
    pub(super) fn drive_fault(&mut self, name: &str, fault: DriveFault) -> bool {
        let now = self.now;
        let Some(index) = self.nodes.iter().position(|slot| slot.name == name) else {
            return false;
        };
        let Some(NodeSlot { node: NodeBody::Drive(drive), output, .. }) = self.nodes.get_mut(index)
        else {
            return false;
        };
        match fault {
            DriveFault::Error { code } => drive.fail(now, code, output),
            DriveFault::AxisError { axis, code } => {
                drive.fail_axis(now, axis.into(), code, output);
            }
            DriveFault::Emcy { code, register } => {
                let register = ErrorRegister(register);
                drive.warn(now, Emcy { code, register, manufacturer: [0; 5] }, output);
            }
            DriveFault::PowerCycle { off_ms } => drive.power_cycle(now, now + ms(off_ms)),
            DriveFault::BusOff { for_ms } => drive.bus_off(now, now + ms(for_ms), output),
            DriveFault::Value { index, subindex, value } => {
                drive.set_object(now, (index, subindex), value, output);
            }
            DriveFault::Blocked { for_ms } => drive.block(now, now + ms(for_ms), output),
        }
        self.collect_output(index);
        true
    }
}
