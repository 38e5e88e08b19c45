//! Counters of a network's service frames.

use ecan_mcan_port::SendError;

/// Counters of a network; they only grow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ServiceStatistics {
    /// SDO frames handed to gateways.
    pub sdo_sent: u64,
    /// NMT commands handed to gateways.
    pub nmt_sent: u64,
    /// Heartbeats of the host handed to gateways.
    pub heartbeats_sent: u64,
    /// SYNC messages handed to gateways.
    pub syncs_sent: u64,
    /// Times that a frame found no room, or its gateway out of service, and waited.
    pub waited: u64,
    /// Cycles in which a SYNC was due on a channel and waited: it found no room, or the gateway's
    /// last image was repeated.
    pub syncs_late: u64,
    /// Frames that the Port refused for good.
    pub refused: u64,
    /// Why the last of those was refused.
    pub last_refusal: Option<SendError>,
    /// SDO answers that fitted no transfer.
    pub sdo_strays: u64,
    /// Messages of nodes that CiA 301 does not allow: a heartbeat without a valid state, an
    /// emergency of another length.
    pub malformed: u64,
}

impl ServiceStatistics {
    /// A frame was not taken.
    pub(super) fn note(&mut self, error: SendError) {
        if error.is_temporary() {
            self.waited += 1;
        } else {
            self.refused += 1;
            self.last_refusal = Some(error);
        }
    }
}
