//! Counters of a network's service frames.

use ecan_mcan_port::SendError;

/// Counters of a network; they only grow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ServiceStatistics {
    /// SDO frames sent to gateways.
    pub sdo_sent: u64,
    /// NMT commands sent to gateways.
    pub nmt_sent: u64,
    /// Heartbeats of the host sent to gateways.
    pub heartbeats_sent: u64,
    /// TIME messages sent to gateways.
    pub times_sent: u64,
    /// Guarding requests sent to gateways.
    pub guards_sent: u64,
    /// LSS frames sent to gateways.
    pub lss_sent: u64,
    /// SYNC messages sent to gateways.
    pub syncs_sent: u64,
    /// Times that a frame waited: it found no space, or its gateway was not ready.
    pub waited: u64,
    /// Cycles in which a SYNC was due on a channel and waited: it found no space, or the gateway's last
    /// image was unconfirmed.
    pub syncs_late: u64,
    /// Frames that the Port rejected for a permanent reason.
    pub rejected: u64,
    /// Reason of the last of those.
    pub last_rejection: Option<SendError>,
    /// SDO answers that matched no transfer.
    pub sdo_strays: u64,
    /// LSS responses that matched no command.
    pub lss_strays: u64,
    /// Messages of nodes that CiA 301 does not allow: a heartbeat without a valid state, an emergency
    /// message of another length.
    pub malformed: u64,
}

impl ServiceStatistics {
    /// Counts a frame that was not sent.
    pub(super) fn note(&mut self, error: SendError) {
        if error.is_temporary() {
            self.waited += 1;
        } else {
            self.rejected += 1;
            self.last_rejection = Some(error);
        }
    }
}
