//! Copies of a world.

use crate::world::World;
use crate::world::node_slot::NodeSlot;

impl World {
    /// A copy in the present state, without the observer of faults; `None` if a node cannot be copied.
    pub(crate) fn try_clone(&self) -> Option<Self> {
        let nodes = self.nodes.iter().map(NodeSlot::try_clone).collect::<Option<_>>()?;
        Some(Self {
            line: self.line.clone(),
            slots: self.slots.clone(),
            ios: self.ios.clone(),
            buses: self.buses.clone(),
            nodes,
            script: self.script.clone(),
            fault_log: self.fault_log.unobserved(),
            events: self.events.clone(),
            recording: self.recording.clone(),
            ..*self
        })
    }
}
