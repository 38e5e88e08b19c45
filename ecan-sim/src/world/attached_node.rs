//! Nodes that join and leave a bus while the world runs.

use crate::node::{Node, SilentNode};
use crate::world::can_side::Owner;
use crate::world::node_slot::{NodeBody, NodeSlot};
use crate::world::{NEVER, World};

impl World {
    /// Puts a node on an existing or a new bus and returns its index.
    pub(crate) fn attach_node(&mut self, bus: &str, name: &str, node: Box<dyn Node>) -> usize {
        let index = self.nodes.len();
        let (bus, station) = self.attach(bus, Owner::Node(index));
        let slot = NodeSlot::with_node(name.to_owned(), NodeBody::Other(node), bus, station);
        self.add_node(NodeSlot { is_external: true, ..slot });
        // The gateway's channel may be running already.
        let config_of_channel = self.slots.iter().flat_map(|slot| &slot.links).find_map(|link| {
            let config = self.buses.get(link.bus)?.bus.config(link.station)?;
            (link.bus == bus).then_some(config)
        });
        if let Some(config) = config_of_channel {
            self.configure_followers(bus, config);
        }
        index
    }

    /// Takes a node off its bus for good and returns it.
    pub(crate) fn detach_node(&mut self, index: usize) -> Option<Box<dyn Node>> {
        let now = self.now;
        let slot = self.nodes.get_mut(index)?;
        let silent = NodeBody::Other(Box::new(SilentNode));
        let node = std::mem::replace(&mut slot.node, silent);
        (slot.fixed, slot.detached) = (None, true);
        slot.config = None;
        slot.controller = None;
        slot.output.clear();
        if let Some(bus) = self.buses.get_mut(slot.bus) {
            bus.nodes_due.set(slot.station.index(), NEVER);
            bus.bus.configure(now, slot.station, None);
            bus.refresh();
        }
        Some(node.into_node())
    }

    /// The nodes, each with the name of its bus.
    pub fn nodes(&self) -> impl Iterator<Item = (&str, &dyn Node)> {
        self.nodes.iter().filter(|slot| !slot.detached).filter_map(|slot| {
            let bus = self.buses.get(slot.bus)?;
            Some((bus.bus.name(), slot.node.as_node()))
        })
    }

    /// The nodes that a banner has to name, each as ", `description` on bus `name`".
    pub fn node_descriptions(&self) -> String {
        let text = |(bus, node): (&str, &dyn Node)| {
            Some(format!(", {} on bus {bus}", node.description()?))
        };
        self.nodes().filter_map(text).collect()
    }
}
