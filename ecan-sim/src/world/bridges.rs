//! Bridges in the world: they come and go while it runs.

use crate::bridge::{BridgeConfig, BridgeInfo, BridgeNode, BridgeServerError};
use crate::node::{Node, SilentNode};
use crate::world::can_side::Owner;
use crate::world::node_slot::{NodeBody, NodeSlot};
use crate::world::{NEVER, World};

impl World {
    /// Puts a bridge on a bus: the index of its node, and what is known of it.
    ///
    /// # Errors
    /// It cannot listen.
    pub(crate) fn attach_bridge(
        &mut self,
        name: &str,
        settings: &BridgeConfig,
    ) -> Result<(usize, BridgeInfo), BridgeServerError> {
        let node = BridgeNode::listen(settings)?;
        let info = node.info().clone();
        let index = self.nodes.len();
        let (bus, station) = self.attach(name, Owner::Node(index));
        let name = format!("bridge {}", info.address().port());
        let node = NodeBody::Other(Box::new(node));
        let slot = NodeSlot::with_node(name, node, bus, station);
        self.add_node(NodeSlot { bridge: Some(info.clone()), ..slot });
        // The gateway's channel may be running already.
        let leader = self.slots.iter().flat_map(|slot| &slot.links).find_map(|link| {
            let config = self.buses.get(link.bus)?.bus.config(link.station)?;
            (link.bus == bus).then_some(config)
        });
        if let Some(config) = leader {
            self.lead_nodes(bus, config);
        }
        Ok((index, info))
    }

    /// Takes a node off its bus for good and gives it back.
    pub(crate) fn detach_node(&mut self, index: usize) -> Option<Box<dyn Node>> {
        let now = self.now;
        let slot = self.nodes.get_mut(index)?;
        let silent = NodeBody::Other(Box::new(SilentNode));
        let node = std::mem::replace(&mut slot.node, silent);
        (slot.fixed, slot.detached, slot.bridge) = (None, true, None);
        slot.config = None;
        slot.output.clear();
        self.nodes_due.set(index, NEVER);
        if let Some(bus) = self.buses.get_mut(slot.bus) {
            bus.bus.configure(now, slot.station, None);
            bus.refresh();
        }
        Some(node.into_node())
    }

    /// The bridges, each with the name of its bus.
    pub fn bridges(&self) -> impl Iterator<Item = (&str, &BridgeInfo)> {
        self.nodes.iter().filter_map(|slot| {
            let bus = self.buses.get(slot.bus)?;
            Some((bus.bus.name(), slot.bridge.as_ref()?))
        })
    }
}
