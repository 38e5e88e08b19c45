//! 0xB000 Device Maintenance (manual 13.7).

use super::ObjectType::{U8, U16, U32};
use super::entry::{Entry, Object};

const MODE: &[(u32, &str)] = &[(0, "run"), (1, "engineering"), (2, "factory")];

pub(super) const MAINTENANCE: Object = Object::single(
    0xB000,
    "Device Maintenance",
    "13.7",
    &[
        Entry::highest(12),
        Entry::rw(1, "Access mode request", U8).range(0, 2).values(MODE),
        Entry::ro(2, "Access status", U8).values(MODE),
        Entry::rw(3, "Access timeout s", U16).unit("s"),
        Entry::wo(4, "Maintenance command", U8).range(0, 0x7F).bits(&[
            (0, "save configuration"),
            (1, "load configuration"),
            (2, "restore factory defaults"),
            (3, "validate FoE image"),
            (4, "activate FoE image"),
            (5, "clear diagnostics"),
            (6, "rebuild EEPROM and reboot"),
        ]),
        // The manual gives numbers to these two only.
        Entry::ro(5, "Maintenance status", U8).values(&[(0, "OK"), (2, "denied")]),
        Entry::ro(6, "Legacy maintenance diag flags", U16).bits(&[
            (0, "SHADOW_FALLBACK"),
            (1, "SHADOW_COPY_RETRY"),
            (2, "SHADOW_SIZE_CHANGE"),
            (3, "RXPDO_STAGE_DROP"),
            (4, "TX_RING_DROP"),
            (5, "TX_FIFO_FULL"),
            (6, "SCHED_LATE_DROP"),
            (7, "SCHED_QUEUE_FULL"),
            (8, "SCHED_TX_FAIL"),
            (9, "SCHED_TIMER_MISS"),
        ]),
        Entry::ro(7, "Active config CRC32", U32),
        Entry::ro(8, "Stored config CRC32", U32),
        Entry::ro(9, "FoE image size", U32).unit("bytes"),
        Entry::ro(10, "FoE image CRC32", U32),
        Entry::ro(11, "FoE status code", U32),
        Entry::ro(12, "Maintenance sequence", U32),
    ],
);
