//! Reports of boot-ups to the application.

use std::ffi::CString;

use ecan_canopen::{BootPhase, BootProgress, Network, NodeAddress};

use crate::callback::ProgressCallback;

/// Calls the application when the phase of a node changes.
pub(super) struct BootReporter {
    callback: Option<ProgressCallback>,
    /// By node.
    nodes: Vec<(NodeAddress, Option<BootPhase>)>,
}

impl BootReporter {
    pub(super) fn new(callback: Option<ProgressCallback>, network: &Network) -> Self {
        let addresses = network.handles().filter_map(|handle| network.address(handle));
        Self { callback, nodes: addresses.map(|address| (address, None)).collect() }
    }

    pub(super) fn see(&mut self, progress: &BootProgress) {
        let Some(callback) = self.callback else { return };
        let found = self.nodes.iter_mut().enumerate();
        let mut found = found.filter(|(_, (address, _))| *address == progress.address);
        let Some((node, (_, reported))) = found.next() else { return };
        if reported.replace(progress.phase) != Some(progress.phase) {
            let text = CString::new(progress.to_string()).unwrap_or_default();
            callback.report(node, &text);
        }
    }
}
