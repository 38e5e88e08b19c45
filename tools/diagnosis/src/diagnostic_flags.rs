//! The legacy maintenance diag flags of 0xB000:06 (manual 13.7).

use ecan_protocol::object::lookup;

use crate::bit_words::set_words;

/// What each flag of 0xB000:06 means: bit, name of the manual, explanation.
pub const DIAGNOSTIC_FLAGS: [(u8, &str, &str); 10] = [
    (0, "SHADOW_FALLBACK", "the TxPDO was published by the fallback way"),
    (1, "SHADOW_COPY_RETRY", "copying a TxPDO image had to be repeated"),
    (2, "SHADOW_SIZE_CHANGE", "the size of the TxPDO changed while it was published"),
    (3, "RXPDO_STAGE_DROP", "RxPDO data were dropped before they were parsed"),
    (4, "TX_RING_DROP", "the queue towards the CAN controllers was full and dropped frames"),
    (5, "TX_FIFO_FULL", "a CAN controller's transmit FIFO was full"),
    (6, "SCHED_LATE_DROP", "scheduled frames came too late for their phase and were dropped"),
    (7, "SCHED_QUEUE_FULL", "more frames were scheduled than the gateway holds"),
    (8, "SCHED_TX_FAIL", "a scheduled frame was not taken by its CAN controller"),
    (9, "SCHED_TIMER_MISS", "the timer of the schedule was served too late"),
];

/// The names of the flags that are set in a value of 0xB000:06.
pub fn flag_words(flags: u32) -> Vec<&'static str> {
    lookup(0xB000, 6).map_or_else(Vec::new, |(_, entry)| set_words(flags, entry.bits))
}
