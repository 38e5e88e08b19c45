//! Services of nodes that wait, with the axes at their last targets.

use std::time::Duration;

use ecan_canopen::{
    BootPhase, BootProgress, BootState, Configurator, Configuring, Lss, LssCommand, LssFailure,
    LssResult, NodeHandle, Step, WaitError, run_cycle_until,
};
use ecan_mcan_port::Port;

use super::cia402::Cia402;
use super::error::{BootTimeout, Cia402Error};

impl Cia402 {
    /// Waits until all mandatory nodes are booted ([`Network::boot`](ecan_canopen::Network::boot)). If one
    /// fails, it waits for the end of the other boot-ups of mandatory nodes. `progress` is called for every
    /// node in every cycle. The axes remain at their last targets. Blocks.
    ///
    /// # Errors
    /// [`Cia402Error::BootTimeout`] names the mandatory nodes that are not booted, with the cause of each;
    /// [`Cia402Error::Wait`].
    pub fn wait_booted_timeout(
        &mut self,
        port: &mut Port,
        timeout: Duration,
        mut progress: impl FnMut(&BootProgress),
    ) -> Result<(), Cia402Error> {
        let start_ns = self.now_ns;
        let ended = run_cycle_until(port, timeout, |cycle, now_ns| {
            self.serve(cycle);
            let mut is_booting = false;
            for node in self.network.boot_progress(now_ns) {
                let has_begun = node.phase != BootPhase::Waiting;
                is_booting |= node.is_mandatory && has_begun && !has_ended(node.phase);
                progress(&node);
            }
            match self.network.boot_state() {
                BootState::Booted => Some(()),
                BootState::Failed if !is_booting => Some(()),
                BootState::Failed | BootState::Running => None,
            }
        });
        match ended {
            Ok(()) | Err(WaitError::TimedOut { .. }) => {}
            Err(error) => return Err(error.into()),
        }
        let is_missing = |node: &BootProgress| node.is_mandatory && node.phase != BootPhase::Booted;
        let nodes: Vec<_> = self.network.boot_progress(self.now_ns).filter(is_missing).collect();
        if nodes.is_empty() {
            return Ok(());
        }
        let waited = Duration::from_nanos(self.now_ns.saturating_sub(start_ns));
        Err(BootTimeout { waited, nodes }.into())
    }

    /// Executes an LSS command on a channel of the network and waits, see
    /// [`Network::lss_blocking`](ecan_canopen::Network::lss_blocking). The axes remain at their last targets.
    /// Blocks.
    ///
    /// # Errors
    /// [`Cia402Error::Wait`] names channel, command and cause, or the timeout, with the command cancelled.
    pub fn lss_timeout(
        &mut self,
        port: &mut Port,
        (slave, channel): (usize, u8),
        command: LssCommand,
        timeout: Duration,
    ) -> Result<LssResult, Cia402Error> {
        self.network.start_lss(slave, channel, command).map_err(WaitError::from)?;
        let ended = run_cycle_until(port, timeout, |cycle, _| {
            self.serve(cycle);
            match self.network.lss_state(slave, channel) {
                Lss::Idle | Lss::Busy => None,
                Lss::Done(result) => Some(Ok(result)),
                Lss::Failed(fault) => Some(Err(LssFailure { slave, channel, command, fault })),
            }
        });
        match ended {
            Ok(result) => Ok(result.map_err(WaitError::from)?),
            Err(error) => {
                self.network.cancel_lss(slave, channel);
                Err(error.into())
            }
        }
    }

    /// Executes steps on a node and waits, for example those of a
    /// [`ParameterGroup`](ecan_canopen::ParameterGroup). The axes remain at their last targets; transfers of
    /// the axis itself come first. Returns the configurator with the values that the steps have read. Blocks.
    ///
    /// # Errors
    /// [`Cia402Error::Wait`] names the step that failed and its cause, or the timeout, with the steps cancelled.
    pub fn execute_timeout(
        &mut self,
        port: &mut Port,
        node: NodeHandle,
        steps: impl IntoIterator<Item = Step>,
        timeout: Duration,
    ) -> Result<Configurator, Cia402Error> {
        let mut configurator = Configurator::new();
        configurator.add(&self.network, node, steps);
        let ended = run_cycle_until(port, timeout, |cycle, now_ns| {
            self.serve(cycle);
            match configurator.step(&mut self.network, now_ns) {
                Configuring::Running => None,
                Configuring::Done => Some(Ok(())),
                Configuring::Failed(failure) => Some(Err(WaitError::from(failure))),
            }
        });
        if ended.is_err() {
            configurator.clear(&mut self.network);
        }
        ended??;
        Ok(configurator)
    }
}

/// Returns whether a boot-up does not continue.
fn has_ended(phase: BootPhase) -> bool {
    matches!(phase, BootPhase::Booted | BootPhase::Failed)
}
