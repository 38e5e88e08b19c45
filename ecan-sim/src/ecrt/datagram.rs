//! Datagrams in the send queue and their states.

/// A datagram in the send queue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Queued {
    Domain { domain: usize, datagram: usize },
    ReferenceClock,
    SlaveClocks,
    ClockMonitor,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum DatagramState {
    /// Never queued since activation.
    Init,
    /// Waiting in the send queue.
    Queued,
    /// On the wire; `arrives_ns` is `None` when the frame was lost.
    Sent { at_ns: u64, arrives_ns: Option<u64> },
    /// Returned.
    Received,
    /// Not returned in time.
    TimedOut,
    /// Could not be sent: no link.
    Error,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum ClockDatagram {
    #[default]
    Idle,
    Queued,
    Sent {
        at_ns: u64,
        arrives_ns: Option<u64>,
    },
    Received,
    Lost,
}
