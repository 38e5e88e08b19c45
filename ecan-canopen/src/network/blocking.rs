//! Blocking calls for start-up and tools: they run the cycle themselves.
//!
//! Each sends SYNC where it is switched on, and throws away what is not the network's, like TPDOs.
//! To do more meanwhile, use [`run_cycle_until`] with the non-blocking calls.

use crate::{NmtCommand, NmtState};
use ecan_mcan_port::{Cycle, Port};

use super::address::NodeHandle;
use super::configurator::{Configurator, Progress};
use super::error::WaitError;
use super::network::Network;
use super::node_sequence::Configuring;
use super::sdo::Sdo;
use super::wait::run_cycle_until;

impl Network {
    /// One cycle's work of the network, for a loop that has nothing else to do: receive, then
    /// `work`, then SYNC and service frames. Real-time safe as far as `work` is.
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

    /// Reads an object. Blocks.
    ///
    /// # Errors
    /// [`WaitError::Sdo`] names node, object and reason; [`WaitError::TimedOut`] after `timeout_ms`
    /// milliseconds in all, with the transfer given up.
    pub fn upload_blocking(
        &mut self,
        port: &mut Port,
        handle: NodeHandle,
        (index, subindex): (u16, u8),
        timeout_ms: u32,
    ) -> Result<Vec<u8>, WaitError> {
        self.start_upload(handle, index, subindex)?;
        self.finish_blocking(port, handle, timeout_ms)?;
        Ok(self.sdo_data(handle).to_vec())
    }

    /// Writes an object. Blocks.
    ///
    /// # Errors
    /// As [`upload_blocking`](Self::upload_blocking).
    pub fn download_blocking(
        &mut self,
        port: &mut Port,
        handle: NodeHandle,
        (index, subindex): (u16, u8),
        data: &[u8],
        timeout_ms: u32,
    ) -> Result<(), WaitError> {
        self.start_download(handle, index, subindex, data)?;
        self.finish_blocking(port, handle, timeout_ms)
    }

    /// Waits for the end of the transfer with a node that was started before. Blocks.
    ///
    /// # Errors
    /// As [`upload_blocking`](Self::upload_blocking).
    pub fn finish_blocking(
        &mut self,
        port: &mut Port,
        handle: NodeHandle,
        timeout_ms: u32,
    ) -> Result<(), WaitError> {
        let ended = run_cycle_until(port, timeout_ms, |cycle, now_ns| {
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

    /// Sends an NMT command to all nodes and waits until it is on its way. Blocks. What became of
    /// it is in [`nmt_state`](Self::nmt_state).
    ///
    /// # Errors
    /// [`WaitError::Nmt`], or a gateway that does not take it within `timeout_ms` milliseconds.
    pub fn nmt_all_blocking(
        &mut self,
        port: &mut Port,
        command: NmtCommand,
        timeout_ms: u32,
    ) -> Result<(), WaitError> {
        self.nmt_all(command)?;
        run_cycle_until(port, timeout_ms, |cycle, now_ns| {
            self.serve(cycle, now_ns, |_| ());
            (!self.nmt_is_pending()).then_some(())
        })
    }

    /// Waits until every node has reported an NMT state, by boot-up message or heartbeat. Blocks.
    ///
    /// # Errors
    /// [`WaitError::TimedOut`] after `timeout_ms` milliseconds; [`nmt_state`](Self::nmt_state)
    /// tells which node lacks.
    pub fn wait_nmt_state_blocking(
        &mut self,
        port: &mut Port,
        state: NmtState,
        timeout_ms: u32,
    ) -> Result<(), WaitError> {
        run_cycle_until(port, timeout_ms, |cycle, now_ns| {
            self.serve(cycle, now_ns, |network| {
                network.nodes.iter().all(|node| node.nmt.reported() == Some(state)).then_some(())
            })
        })
    }

    /// Runs a configuration to its end. Blocks. `progress` is called in every cycle for every node.
    ///
    /// # Errors
    /// [`WaitError::Step`] with the first node that failed, once no other goes on; or
    /// [`WaitError::TimedOut`] after `timeout_ms` milliseconds.
    pub fn configure_blocking(
        &mut self,
        port: &mut Port,
        configurator: &mut Configurator,
        timeout_ms: u32,
        mut progress: impl FnMut(&Progress),
    ) -> Result<(), WaitError> {
        run_cycle_until(port, timeout_ms, |cycle, now_ns| {
            let outcome = self.serve(cycle, now_ns, |network| configurator.step(network, now_ns));
            configurator.progress(now_ns).for_each(|node| progress(&node));
            match outcome {
                Configuring::Running => None,
                Configuring::Done => Some(Ok(())),
                Configuring::Failed(failure) => Some(Err(failure.into())),
            }
        })?
    }
}
