//! SDO transfers of the application with the drives, beside the axes' own.

use ecan_mcan_port::Port;

use ecan_canopen::{Network, NodeHandle, Sdo, SdoStartError, WaitError, run_cycle_until};

use super::context::Cia402;
use super::error::{Cia402Error, CommandError};

impl Cia402 {
    /// The node of an axis in [`network`](Self::network).
    pub fn node(&self, axis: usize) -> Option<NodeHandle> {
        self.axes.get(axis).map(|axis| axis.node)
    }

    /// Reads an object of a drive and waits, with the axes at their last targets meanwhile. What
    /// the axis itself transfers comes first. Blocks.
    ///
    /// # Errors
    /// [`Cia402Error::Wait`] names node, object and reason, or says that it was not done within
    /// `timeout_ms` milliseconds; [`CommandError::NoSuchAxis`].
    pub fn upload_timeout(
        &mut self,
        port: &mut Port,
        axis: usize,
        (index, subindex): (u16, u8),
        timeout_ms: u32,
    ) -> Result<Vec<u8>, Cia402Error> {
        self.transfer_timeout(port, axis, timeout_ms, |network, node| {
            network.start_upload(node, index, subindex)
        })
    }

    /// Writes an object of a drive and waits, as [`upload_timeout`](Self::upload_timeout).
    ///
    /// # Errors
    /// As there.
    pub fn download_timeout(
        &mut self,
        port: &mut Port,
        axis: usize,
        (index, subindex): (u16, u8),
        data: &[u8],
        timeout_ms: u32,
    ) -> Result<(), Cia402Error> {
        self.transfer_timeout(port, axis, timeout_ms, |network, node| {
            network.start_download(node, index, subindex, data)
        })?;
        Ok(())
    }

    fn transfer_timeout(
        &mut self,
        port: &mut Port,
        axis: usize,
        timeout_ms: u32,
        start: impl Fn(&mut Network, NodeHandle) -> Result<(), SdoStartError>,
    ) -> Result<Vec<u8>, Cia402Error> {
        let node = self.node(axis).ok_or(CommandError::NoSuchAxis { axis })?;
        let mut ours = None;
        let ended = run_cycle_until(port, timeout_ms, |cycle, _| {
            self.serve(cycle);
            let network = &mut self.network;
            // An axis may take the client in the cycle in which a transfer ends, and its result
            // with it: then it starts over.
            if ours == Some(network.sdo_generation(node)) {
                return match network.sdo_state(node) {
                    Sdo::Busy => None,
                    _ => Some(match network.sdo_failure(node) {
                        None => Ok(network.sdo_data(node).to_vec()),
                        Some(failure) => Err(WaitError::from(failure)),
                    }),
                };
            }
            match start(network, node) {
                Ok(()) => ours = Some(network.sdo_generation(node)),
                Err(SdoStartError::Busy) => {}
                Err(error) => return Some(Err(error.into())),
            }
            None
        });
        if ended.is_err() && ours == Some(self.network.sdo_generation(node)) {
            self.network.cancel_sdo(node);
        }
        Ok(ended??)
    }
}
