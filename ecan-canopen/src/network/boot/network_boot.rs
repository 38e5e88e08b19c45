//! Boot-up of all nodes of a network.

use super::boot_config::BootConfig;
use super::boot_phase::BootPhase;
use super::node_boot::{BootProgress, NodeBoot};
use crate::network::address::{NodeAddress, NodeHandle};
use crate::network::network::Network;

/// State of the boot-up of a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BootState {
    /// A mandatory node is not booted yet.
    Running,
    /// All mandatory nodes are booted. Optional nodes may still boot, or have failed.
    Booted,
    /// A mandatory node failed.
    Failed,
}

/// The boot-ups of the nodes of a network.
#[derive(Debug, Default)]
pub(in crate::network) struct NetworkBoot {
    nodes: Vec<NodeBoot>,
}

impl NetworkBoot {
    pub(in crate::network) fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Adds a node, or replaces the configuration of one.
    pub(in crate::network) fn add(
        &mut self,
        network: &mut Network,
        (handle, address): (NodeHandle, NodeAddress),
        config: BootConfig,
    ) {
        for node in self.nodes.iter().filter(|node| node.handle == handle) {
            node.cancel(network);
        }
        self.nodes.retain(|node| node.handle != handle);
        self.nodes.push(NodeBoot::new(handle, address, config));
    }

    /// Boots one node again, with its configured reset.
    pub(in crate::network) fn restart(
        &mut self,
        network: &mut Network,
        handle: NodeHandle,
        now_ns: u64,
    ) {
        for node in self.nodes.iter_mut().filter(|node| node.handle == handle) {
            node.cancel(network);
            node.begin(network, node.config.reset, now_ns);
        }
    }

    /// Executes the boot-up of all nodes, once per cycle.
    pub(in crate::network) fn step(&mut self, network: &mut Network, now_ns: u64) {
        for nth in 0..self.nodes.len() {
            let may_begin = self.may_begin(nth);
            if let Some(node) = self.nodes.get_mut(nth) {
                if may_begin {
                    node.begin(network, node.config.reset, now_ns);
                }
                node.advance(network, now_ns);
            }
        }
    }

    /// State of the boot-up.
    pub(in crate::network) fn state(&self) -> BootState {
        let mut state = BootState::Booted;
        for node in self.nodes.iter().filter(|node| node.config.is_mandatory) {
            match node.phase() {
                BootPhase::Booted => {}
                BootPhase::Failed => return BootState::Failed,
                _ => state = BootState::Running,
            }
        }
        state
    }

    /// Progress of each node, in the order in which they were added.
    pub(in crate::network) fn progress(
        &self,
        now_ns: u64,
    ) -> impl Iterator<Item = BootProgress> + '_ {
        self.nodes.iter().map(move |node| node.progress(now_ns))
    }

    /// Progress of one node.
    pub(in crate::network) fn progress_of(
        &self,
        handle: NodeHandle,
        now_ns: u64,
    ) -> Option<BootProgress> {
        self.nodes.iter().find(|node| node.handle == handle).map(|node| node.progress(now_ns))
    }

    /// Returns whether a node waits, and those that boot before have ended.
    fn may_begin(&self, nth: usize) -> bool {
        let Some(node) = self.nodes.get(nth).filter(|it| it.phase() == BootPhase::Waiting) else {
            return false;
        };
        let before = self.nodes.iter().filter(|other| other.config.order < node.config.order);
        before.fold(true, |all, other| {
            let has_ended = match other.phase() {
                BootPhase::Booted => true,
                BootPhase::Failed => !other.config.is_mandatory,
                _ => false,
            };
            all && has_ended
        })
    }
}
