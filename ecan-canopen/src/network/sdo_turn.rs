//! One transfer with a node, by a part of the application that shares the node's SDO client.

use super::address::NodeHandle;
use super::network::Network;
use super::sdo::Sdo;
use super::sdo_error::{SdoFault, SdoStartError};

/// State of the transfer that was started last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TurnState {
    Busy,
    /// The value is in [`Network::sdo_data`].
    Done,
    /// Another part of the application has used the client since: start again.
    Lost,
    Failed(SdoFault),
}

/// One transfer with a node. Start it, then poll it until it has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct SdoTurn {
    /// Number of the transfer in the client.
    generation: u64,
}

impl SdoTurn {
    /// Starts an upload. Returns `false` if the client is busy.
    pub(super) fn upload(
        &mut self,
        network: &mut Network,
        handle: NodeHandle,
        (index, subindex): (u16, u8),
    ) -> Result<bool, SdoStartError> {
        let started = network.start_upload(handle, index, subindex);
        self.started(network, handle, started)
    }

    /// Starts a download. Returns `false` if the client is busy.
    pub(super) fn download(
        &mut self,
        network: &mut Network,
        handle: NodeHandle,
        (index, subindex): (u16, u8),
        data: &[u8],
    ) -> Result<bool, SdoStartError> {
        let started = network.start_download(handle, index, subindex, data);
        self.started(network, handle, started)
    }

    fn started(
        &mut self,
        network: &Network,
        handle: NodeHandle,
        started: Result<(), SdoStartError>,
    ) -> Result<bool, SdoStartError> {
        match started {
            Ok(()) => {
                self.generation = network.sdo_generation(handle);
                Ok(true)
            }
            Err(SdoStartError::Busy) => Ok(false),
            Err(error) => Err(error),
        }
    }

    /// Returns whether no other part of the application has used the client since.
    pub(super) fn is_current(&self, network: &Network, handle: NodeHandle) -> bool {
        network.sdo_generation(handle) == self.generation
    }

    pub(super) fn poll(&self, network: &Network, handle: NodeHandle) -> TurnState {
        if !self.is_current(network, handle) {
            return TurnState::Lost;
        }
        match network.sdo_state(handle) {
            Sdo::Busy => TurnState::Busy,
            Sdo::Done { .. } => TurnState::Done,
            Sdo::Failed(fault) => TurnState::Failed(fault),
            Sdo::Idle => TurnState::Failed(SdoFault::Cancelled),
        }
    }
}
