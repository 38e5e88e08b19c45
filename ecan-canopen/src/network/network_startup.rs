//! Boot-up of the nodes of a network (CiA 302-2).

use std::time::Duration;

use ecan_mcan_port::Port;

use super::address::NodeHandle;
use super::boot::{BootConfig, BootProgress, BootState};
use super::error::WaitError;
use super::network::Network;
use super::wait::run_cycle_until;

impl Network {
    /// Boots a node from the next cycle on, as CiA 302-2 specifies: reset, response, identity,
    /// software, default parameters, parameters with readback, PDOs, heartbeat, start. All nodes of
    /// all channels boot in parallel. Replaces an earlier configuration. Allocates; the cycle does
    /// not.
    ///
    /// A node whose configuration date 0x1020 is the expected one keeps its parameters. While it
    /// boots, its SDO client belongs to the boot-up; if the application starts a transfer in between,
    /// the boot-up waits. A node that fails does not stop the others. A boot-up message of a node
    /// that is booted or failed starts its boot-up again: it restarted, was switched on late, or was
    /// replaced.
    ///
    /// Nodes with an axis are configured by the axis table, not here.
    pub fn boot(&mut self, handle: NodeHandle, config: BootConfig) {
        let Some(address) = self.address(handle) else { return };
        let mut boot = std::mem::take(&mut self.boot);
        boot.add(self, (handle, address), config);
        self.boot = boot;
    }

    /// Boots a node again, with its configured reset. Real-time safe.
    pub fn boot_again(&mut self, handle: NodeHandle, now_ns: u64) {
        let mut boot = std::mem::take(&mut self.boot);
        boot.restart(self, handle, now_ns);
        self.boot = boot;
    }

    /// State of the boot-up of all nodes; [`BootState::Booted`] without any. Real-time safe.
    pub fn boot_state(&self) -> BootState {
        self.boot.state()
    }

    /// Progress of each boot-up, in the order of the calls of [`boot`](Self::boot); real-time safe.
    pub fn boot_progress(&self, now_ns: u64) -> impl Iterator<Item = BootProgress> + '_ {
        self.boot.progress(now_ns)
    }

    /// Progress of the boot-up of a node; real-time safe.
    pub fn boot_progress_of(&self, handle: NodeHandle, now_ns: u64) -> Option<BootProgress> {
        self.boot.progress_of(handle, now_ns)
    }

    /// Waits until all mandatory nodes are booted, or one has failed. Blocks. `progress` is called in
    /// every cycle for every node.
    ///
    /// # Errors
    /// [`WaitError::TimedOut`], [`WaitError::Stopped`] or [`WaitError::Cycle`].
    pub fn wait_booted_blocking(
        &mut self,
        port: &mut Port,
        timeout: Duration,
        mut progress: impl FnMut(&BootProgress),
    ) -> Result<BootState, WaitError> {
        run_cycle_until(port, timeout, |cycle, now_ns| {
            self.serve(cycle, now_ns, |network| {
                network.boot_progress(now_ns).for_each(|node| progress(&node));
                Some(network.boot_state()).filter(|state| *state != BootState::Running)
            })
        })
    }

    pub(super) fn step_boot(&mut self, now_ns: u64) {
        if !self.boot.is_empty() {
            let mut boot = std::mem::take(&mut self.boot);
            boot.step(self, now_ns);
            self.boot = boot;
        }
    }
}
