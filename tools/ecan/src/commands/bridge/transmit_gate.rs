use crate::commands::bridge::endpoint::Endpoint;
use crate::commands::bridge::lane_id::LaneId;
use crate::context::note;

/// Rejects frames of clients while the gateway is not ready or the channel is bus-off or stalled.
/// Frames that are sent later, all at once, would be outdated and could move an axis.
#[derive(Debug)]
pub struct TransmitGate {
    lane: LaneId,
    is_open: bool,
    /// Frames rejected before the gate was closed.
    rejected_before: u64,
}

impl TransmitGate {
    pub fn closed(lane: LaneId, endpoints: &[Endpoint]) -> Self {
        for endpoint in endpoints {
            endpoint.clients().set_accepting(false, 0);
        }
        Self { lane, is_open: false, rejected_before: rejected(endpoints) }
    }

    /// Opens or closes the gate and reports lost frames, also to their clients. `held` pending frames
    /// are dropped with those in the queues.
    pub fn set_open(
        &mut self,
        is_open: bool,
        (held, time_ns): (usize, u64),
        endpoints: &[Endpoint],
    ) {
        if is_open == self.is_open {
            return;
        }
        self.is_open = is_open;
        let lane = self.lane;
        // Before the first endpoint is closed: from then on its frames are rejected.
        let rejected_before = rejected(endpoints);
        let waiting: usize = endpoints
            .iter()
            .map(|endpoint| endpoint.clients().set_accepting(is_open, time_ns))
            .sum();
        let dropped = held + waiting;
        if !is_open {
            self.rejected_before = rejected_before + waiting as u64;
            if dropped > 0 {
                note(format_args!(
                    "# {lane}: {dropped} client frames dropped: channel not available"
                ));
            }
            return;
        }
        let rejected = rejected(endpoints) - self.rejected_before;
        if rejected > 0 {
            note(format_args!(
                "# {lane}: {rejected} client frames rejected: channel not available"
            ));
        }
    }
}

fn rejected(endpoints: &[Endpoint]) -> u64 {
    endpoints.iter().map(|endpoint| endpoint.clients().statistics().discarded).sum()
}
