//! Access to the drives of the world.

use ecan_canopen::{Emcy, NodeId};

use crate::drive::Drive;
use crate::fault::DriveFault;
use crate::node::NodeOutput;
use crate::world::node_slot::{NodeBody, NodeSlot};
use crate::world::{World, ms};

impl World {
    /// The drives with their names, in the order of the scenario.
    pub fn drives(&self) -> impl Iterator<Item = (&str, &Drive)> {
        self.nodes.iter().filter_map(|slot| match &slot.node {
            NodeBody::Drive(drive) => Some((slot.name.as_str(), &**drive)),
            NodeBody::Other(_) => None,
        })
    }

    /// A drive by the name of its node.
    pub fn drive(&self, name: &str) -> Option<&Drive> {
        self.drives().find(|(other, _)| *other == name).map(|(_, drive)| drive)
    }

    /// The drive with this node-ID on a gateway's channel.
    pub fn drive_at(&self, gateway: usize, channel: usize, node: NodeId) -> Option<&Drive> {
        let place = self.drive_place(gateway, channel, node)?;
        match &self.nodes.get(place)?.node {
            NodeBody::Drive(drive) => Some(drive),
            NodeBody::Other(_) => None,
        }
    }

    /// Name of the drive with this node-ID on a gateway's channel, for faults.
    pub fn drive_name(&self, gateway: usize, channel: usize, node: NodeId) -> Option<&str> {
        let place = self.drive_place(gateway, channel, node)?;
        self.nodes.get(place).map(|slot| slot.name.as_str())
    }

    fn drive_place(&self, gateway: usize, channel: usize, node: NodeId) -> Option<usize> {
        let bus = self.slots.get(gateway)?.links.get(channel)?.bus;
        self.nodes.iter().position(|slot| {
            let is_it = matches!(&slot.node, NodeBody::Drive(drive) if drive.node_id() == node);
            is_it && slot.bus == bus
        })
    }

    /// Injects a fault into a drive.
    pub(super) fn drive_fault(&mut self, name: &str, fault: DriveFault) {
        let now = self.now;
        let Some(place) = self.nodes.iter().position(|slot| slot.name == name) else { return };
        let Some(NodeSlot { node: NodeBody::Drive(drive), output, .. }) = self.nodes.get_mut(place)
        else {
            return;
        };
        strike(drive, now, fault, output);
        self.collect_output(place);
    }
}

fn strike(drive: &mut Drive, now: u64, fault: DriveFault, output: &mut NodeOutput) {
    match fault {
        DriveFault::Error { code } => drive.fail(now, code, output),
        DriveFault::Emcy { code, register } => {
            let register = ecan_canopen::ErrorRegister(register);
            drive.warn(now, Emcy { code, register, manufacturer: [0; 5] }, output);
        }
        DriveFault::PowerCycle { off_ms } => drive.power_cycle(now, now + ms(off_ms)),
        DriveFault::Blocked { for_ms } => drive.block(now, now + ms(for_ms), output),
    }
}
