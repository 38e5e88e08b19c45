//! SDO transfers of the application with the drives, in parallel with the axes' own.

use std::time::Duration;

use ecan_canopen::{Network, NodeHandle, Sdo, SdoStartError, WaitError, run_cycle_until};
use ecan_mcan_port::Port;

use super::cia402::Cia402;
use super::error::Cia402Error;
use crate::axis::command_error::CommandError;

impl Cia402 {
    /// The node of an axis in [`network`](Self::network).
    pub fn node(&self, axis: usize) -> Option<NodeHandle> {
        self.axes.get(axis).map(|axis| axis.node)
    }

    /// Uploads an object of a drive, given by index and subindex, and waits; the axes remain at
    /// their last targets. Transfers of the axis itself come first. Blocks.
    ///
    /// # Errors
    /// [`Cia402Error::Wait`] names node, object and cause, or the timeout;
    /// [`CommandError::NoSuchAxis`].
    pub fn upload_timeout(
        &mut self,
        port: &mut Port,
        axis: usize,
        (index, subindex): (u16, u8),
        timeout: Duration,
    ) -> Result<Vec<u8>, Cia402Error> {
        let node = self.node(axis).ok_or(CommandError::NoSuchAxis { axis })?;
        self.upload_node_timeout(port, node, (index, subindex), timeout)
    }

    /// Downloads an object of a drive and waits, as [`upload_timeout`](Self::upload_timeout).
    ///
    /// # Errors
    /// As there.
    pub fn download_timeout(
        &mut self,
        port: &mut Port,
        axis: usize,
        (index, subindex): (u16, u8),
        data: &[u8],
        timeout: Duration,
    ) -> Result<(), Cia402Error> {
        let node = self.node(axis).ok_or(CommandError::NoSuchAxis { axis })?;
        self.download_node_timeout(port, node, (index, subindex), data, timeout)
    }

    /// As [`upload_timeout`](Self::upload_timeout), of any node of the network.
    ///
    /// # Errors
    /// [`Cia402Error::Wait`].
    pub fn upload_node_timeout(
        &mut self,
        port: &mut Port,
        node: NodeHandle,
        (index, subindex): (u16, u8),
        timeout: Duration,
    ) -> Result<Vec<u8>, Cia402Error> {
        self.transfer_timeout(port, node, timeout, |network| {
            network.start_upload(node, index, subindex)
        })
    }

    /// As [`download_timeout`](Self::download_timeout), to any node of the network.
    ///
    /// # Errors
    /// [`Cia402Error::Wait`].
    pub fn download_node_timeout(
        &mut self,
        port: &mut Port,
        node: NodeHandle,
        (index, subindex): (u16, u8),
        data: &[u8],
        timeout: Duration,
    ) -> Result<(), Cia402Error> {
        self.transfer_timeout(port, node, timeout, |network| {
            network.start_download(node, index, subindex, data)
        })?;
        Ok(())
    }

    fn transfer_timeout(
        &mut self,
        port: &mut Port,
        node: NodeHandle,
        timeout: Duration,
        start: impl Fn(&mut Network) -> Result<(), SdoStartError>,
    ) -> Result<Vec<u8>, Cia402Error> {
        let mut own = None;
        let ended = run_cycle_until(port, timeout, |cycle, _| {
            self.serve(cycle);
            let network = &mut self.network;
            // An axis may use the client in the cycle in which a transfer ends. The result is
            // lost then, and the transfer starts again.
            if own == Some(network.sdo_generation(node)) {
                return match network.sdo_state(node) {
                    Sdo::Busy => None,
                    _ => Some(match network.sdo_failure(node) {
                        None => Ok(network.sdo_data(node).to_vec()),
                        Some(failure) => Err(WaitError::from(failure)),
                    }),
                };
            }
            match start(network) {
                Ok(()) => own = Some(network.sdo_generation(node)),
                Err(SdoStartError::Busy) => {}
                Err(error) => return Some(Err(error.into())),
            }
            None
        });
        if ended.is_err() && own == Some(self.network.sdo_generation(node)) {
            self.network.cancel_sdo(node);
        }
        Ok(ended??)
    }
}
