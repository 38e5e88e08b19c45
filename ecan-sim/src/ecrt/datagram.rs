#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Queued {
    Domain { domain: usize, datagram: usize },
    ReferenceClock,
    SlaveClocks,
    ClockMonitor,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum DatagramState {
    /// Never queued since activation.
    #[default]
    Idle,
    Queued,
    /// On the wire; `arrives_ns` is `None` when the frame was lost.
    Sent {
        at_ns: u64,
        arrives_ns: Option<u64>,
    },
    Received,
    /// Not returned in time, or not sent because there is no link.
    Lost,
}
