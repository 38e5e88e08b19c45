use ecan_mcan_port::Received;

#[derive(Clone, Copy, Debug)]
pub struct Arrival {
    /// Time of the cycle clock in nanoseconds.
    pub time_ns: u64,
    pub received: Received,
}
