//! Blocking calls for startup and tools: they run the cycle themselves.
//!
//! Each sends SYNC if it is enabled, and discards received frames that are not the network's, such
//! as TPDOs. To do more in these cycles, use [`run_cycle_until`] with the non-blocking calls.

use std::time::Duration;

use ecan_mcan_port::{Cycle, Port};

use super::address::NodeHandle;
use super::configurator::{Configurator, Progress};
use super::error::WaitError;
use super::network::Network;
use super::node_sequence::Configuring;
use super::sdo::Sdo;
use super::wait::run_cycle_until;
use crate::NmtState;

impl Network {
    /// Executes the network's part of one cycle: receives, calls `work`, then sends SYNC and
    /// service frames. Real-time safe if `work` is.
    pub fn serve<T>(
        &mut self,
        cycle: &mut Cycle<'_>,
        now_ns: u64,
        work: impl FnOnce(&mut Self) -> T,
    ) -> T {
        self.receive(cycle, now_ns, |_| {});
        let result = work(self);
        self.send_sync(cycle);
        self.send(cycle, now_ns);
        result
    }

    /// Uploads an object, given by index and subindex. Blocks.
    ///
    /// # Errors
    /// [`WaitError::Sdo`] names node, object and cause; [`WaitError::TimedOut`] after `timeout` in
    /// all, with the transfer cancelled.
    pub fn upload_blocking(
        &mut self,
        port: &mut Port,
        handle: NodeHandle,
        (index, subindex): (u16, u8),
        timeout: Duration,
    ) -> Result<Vec<u8>, WaitError> {
        self.start_upload(handle, index, subindex)?;
        self.finish_blocking(port, handle, timeout)?;
        Ok(self.sdo_data(handle).to_vec())
    }

    /// Downloads an object, given by index and subindex. Blocks.
    ///
    /// # Errors
    /// As [`upload_blocking`](Self::upload_blocking).
    pub fn download_blocking(
        &mut self,
        port: &mut Port,
        handle: NodeHandle,
        (index, subindex): (u16, u8),
        data: &[u8],
        timeout: Duration,
    ) -> Result<(), WaitError> {
        self.start_download(handle, index, subindex, data)?;
        self.finish_blocking(port, handle, timeout)
    }

    /// Waits for the end of the transfer with a node that was started before. Blocks.
    ///
    /// # Errors
    /// As [`upload_blocking`](Self::upload_blocking).
    pub fn finish_blocking(
        &mut self,
        port: &mut Port,
        handle: NodeHandle,
        timeout: Duration,
    ) -> Result<(), WaitError> {
        let ended = run_cycle_until(port, timeout, |cycle, now_ns| {
            self.serve(cycle, now_ns, |network| match network.sdo_state(handle) {
                Sdo::Busy => None,
                _ => Some(network.sdo_failure(handle)),
            })
        });
        match ended {
            Ok(None) => Ok(()),
            Ok(Some(failure)) => Err(failure.into()),
            Err(error) => {
                self.cancel_sdo(handle);
                Err(error)
            }
        }
    }

    /// Waits until every node has reported an NMT state by boot-up message, heartbeat or guarding. Blocks.
    ///
    /// # Errors
    /// [`WaitError::TimedOut`]; [`nmt_state`](Self::nmt_state) shows which node is missing.
    pub fn wait_nmt_state_blocking(
        &mut self,
        port: &mut Port,
        state: NmtState,
        timeout: Duration,
    ) -> Result<(), WaitError> {
        run_cycle_until(port, timeout, |cycle, now_ns| {
            self.serve(cycle, now_ns, |network| {
                network.nodes.iter().all(|node| node.nmt.reported() == Some(state)).then_some(())
            })
        })
    }

    /// Executes a configuration to its end. Blocks. `progress` is called in every cycle for every
    /// node.
    ///
    /// # Errors
    /// [`WaitError::Step`] with the first node that failed, after all others have ended;
    /// [`WaitError::TimedOut`].
    pub fn configure_blocking(
        &mut self,
        port: &mut Port,
        configurator: &mut Configurator,
        timeout: Duration,
        mut progress: impl FnMut(&Progress),
    ) -> Result<(), WaitError> {
        run_cycle_until(port, timeout, |cycle, now_ns| {
            let state = self.serve(cycle, now_ns, |network| configurator.step(network, now_ns));
            configurator.progress(now_ns).for_each(|node| progress(&node));
            match state {
                Configuring::Running => None,
                Configuring::Done => Some(Ok(())),
                Configuring::Failed(failure) => Some(Err(failure.into())),
            }
        })?
    }
}
