//! Legacy maintenance diagnostic flags of 0xB000:06 (manual 13.7).

use ecan_protocol::object::lookup;

use crate::diagnosis::bit_names::set_names;

/// Flags of 0xB000:06: bit, name in the manual, description.
pub const DIAGNOSTIC_FLAGS: [(u8, &str, &str); 10] = [
    (0, "SHADOW_FALLBACK", "the TxPDO was published by the fallback path"),
    (1, "SHADOW_COPY_RETRY", "the copy of a TxPDO image was repeated"),
    (2, "SHADOW_SIZE_CHANGE", "the TxPDO size changed during publishing"),
    (3, "RXPDO_STAGE_DROP", "RxPDO data were dropped before parsing"),
    (4, "TX_RING_DROP", "the queue to the CAN controllers was full and dropped frames"),
    (5, "TX_FIFO_FULL", "the transmit FIFO of a CAN controller was full"),
    (6, "SCHED_LATE_DROP", "scheduled frames missed their phase and were dropped"),
    (7, "SCHED_QUEUE_FULL", "the queue of scheduled frames was full"),
    (8, "SCHED_TX_FAIL", "a CAN controller rejected a scheduled frame"),
    (9, "SCHED_TIMER_MISS", "the schedule timer was serviced too late"),
];

/// Names of the set flags in a value of 0xB000:06.
pub fn flag_names(flags: u32) -> Vec<&'static str> {
    lookup(0xB000, 6).map_or_else(Vec::new, |(_, entry)| set_names(flags, entry.bits))
}
