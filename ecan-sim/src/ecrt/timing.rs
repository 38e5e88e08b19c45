//! Durations of the simulated master.
//!
//! Typical of a master with a kernel tick of 4 ms and a cycle of 1 ms. In the operation phase every
//! step takes at least one send in addition, because the master's own datagrams travel with the
//! application's.

/// One register access: queue, send, receive.
pub(super) const REGISTER_NS: u64 = 1_000_000;
/// One step of a dictionary fetch before activation: the master's thread does not sleep then.
pub(super) const DICTIONARY_STEP_NS: u64 = 90_000;
/// From PREOP to the fetch of the dictionary.
pub(super) const DICTIONARY_WAIT_NS: u64 = 3_000_000_000;
/// Longest wait of the fetch for a response.
pub(super) const DICTIONARY_TIMEOUT_NS: u64 = 1_000_000_000;
/// One tick of the kernel.
pub(super) const TICK_NS: u64 = 4_000_000;
/// Longest sleep of the master's thread while it polls the slaves.
pub(super) const POLL_STEP_NS: u64 = 8_000_000;
/// Time between receive and send that the master's thread needs to advance.
pub(super) const THREAD_GAP_NS: u64 = 100_000;
/// Response time of the device in the operation phase, where request, mailbox check and fetch also
/// wait for a send each.
pub(super) const SDO_NS: u64 = 2_000_000;
/// Activation: the master's threads are exchanged.
pub(super) const ACTIVATE_NS: u64 = 3_000_000;
/// Polling interval of the AL status during a state change.
pub(super) const STATE_POLL_NS: u64 = 2_000_000;
/// Longest state change.
pub(super) const STATE_TIMEOUT_NS: u64 = 10_000_000_000;
/// Fixed part of a bus scan.
pub(super) const SCAN_BASE_NS: u64 = 20_000_000;
/// Scan of one slave: SII, mailbox, assigned PDOs.
pub(super) const SCAN_SLAVE_NS: u64 = 200_000_000;
/// Polling interval of all slaves while the master is idle.
pub(super) const IDLE_POLL_NS: u64 = 100_000_000;
/// The same in the operation phase: the slave states lag by this time.
pub(super) const ACTIVE_POLL_NS: u64 = 1_000_000_000;
/// Settling of the slaves' clocks before Sync0 is started.
pub(super) const CLOCK_SETTLE_NS: u64 = 100_000_000;
/// Difference of a slave's clock at which it counts as settled.
pub(super) const CLOCK_NEAR_NS: u64 = 10_000;
/// Longest wait for that.
pub(super) const CLOCK_TIMEOUT_NS: u64 = 5_000_000_000;
/// Distance of the first Sync0 pulse.
pub(super) const SYNC0_AHEAD_NS: u64 = 100_000_000;
/// Longest wait for the response of an SDO transfer.
pub(super) const MAILBOX_TIMEOUT_NS: u64 = 1_000_000_000;
/// Longest wait of a blocking call that would wait for ever in a real master: the send queue is
/// blocked, or the application does not send.
pub(super) const BLOCKED_GIVE_UP_NS: u64 = 10_000_000_000;
/// Time after which a datagram counts as lost.
pub(super) const DATAGRAM_TIMEOUT_NS: u64 = 500_000;
/// Latency of the host, both directions.
pub(super) const HOST_LATENCY_NS: u64 = 20_000;
/// Latency of one slave, both directions.
pub(super) const SLAVE_LATENCY_NS: u64 = 1_000;
/// One byte on a 100 Mbit/s link.
pub(super) const BYTE_NS: u64 = 80;
