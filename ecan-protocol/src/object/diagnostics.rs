//! 0x9011 Cycle Performance Diagnostics and 0x9020..0x9023 MCAN Data Path Diagnostics
//! (manual 13.2.4, 13.2.5).

use super::ObjectType::{I32, U8, U16, U32};
use super::entry::{Entry, Object};

pub(super) const CYCLE_PERFORMANCE: Object = Object::single(
    0x9011,
    "Cycle Performance Diagnostics",
    "13.2.4",
    &[
        Entry::highest(24),
        Entry::ro(1, "PDI IRQ count", U32),
        Entry::ro(2, "Sync0 IRQ count", U32),
        Entry::ro(3, "Sync1 IRQ count", U32),
        Entry::ro(4, "PDI to Sync0 phase min", I32).unit("CPU cycles"),
        Entry::ro(5, "PDI to Sync0 phase max", I32).unit("CPU cycles"),
        Entry::ro(6, "APPL OutputMapping max cycles", U32).unit("CPU cycles"),
        Entry::ro(7, "APPL InputMapping max cycles", U32).unit("CPU cycles"),
        Entry::ro(8, "MCAN PDO service max cycles", U32).unit("CPU cycles"),
        Entry::ro(9, "TxPDO shadow max cycles", U32).unit("CPU cycles"),
        Entry::ro(10, "RxPDO parse max cycles", U32).unit("CPU cycles"),
        Entry::ro(11, "ESC read max cycles", U32).unit("CPU cycles"),
        Entry::ro(12, "ESC write max cycles", U32).unit("CPU cycles"),
        Entry::ro(13, "Schedule service max cycles", U32).unit("CPU cycles"),
        Entry::rw(14, "Clear command", U8).values(&[(0, "no-op"), (1, "clear")]),
        Entry::ro(15, "ReservedPad", U8),
        Entry::ro(16, "Reserved0", U32),
        Entry::ro(17, "Reserved1", U32),
        Entry::ro(18, "Reserved2", U32),
        Entry::ro(19, "Reserved3", U32),
        Entry::ro(20, "Reserved4", U32),
        Entry::ro(21, "Reserved5", U32),
        Entry::ro(22, "Reserved6", U32),
        Entry::ro(23, "Reserved7", U32),
        Entry::ro(24, "Reserved8", U32),
    ],
);

pub(super) const DATA_PATH_DIAGNOSTICS: Object = Object::family(
    0x9020,
    4,
    1,
    "MCAN Data Path Diagnostics",
    "13.2.5",
    &[
        Entry::highest(20),
        Entry::ro(1, "RX cache count", U16).unit("frames"),
        Entry::ro(2, "RX cache high watermark", U16).unit("frames"),
        Entry::ro(3, "RX drain last", U16).unit("frames"),
        Entry::ro(4, "RX drain max", U16).unit("frames"),
        Entry::ro(5, "RX dropped total", U32).unit("frames"),
        Entry::ro(6, "RX dropped old", U32).unit("frames"),
        Entry::ro(7, "RX dropped new", U32).unit("frames"),
        Entry::ro(8, "RX dropped critical", U32).unit("frames"),
        Entry::ro(9, "TxPDO consumed last", U16).unit("frames"),
        Entry::ro(10, "TxPDO consumed max", U16).unit("frames"),
        Entry::ro(11, "TX fifo full count", U32),
        Entry::ro(12, "TX stale dropped", U32).unit("frames"),
        Entry::ro(13, "Bus off count", U32),
        Entry::ro(14, "Recovery attempts", U16),
        Entry::ro(15, "Degraded state", U16),
        Entry::ro(16, "Last error", U32),
        Entry::ro(17, "Service max cycles", U32).unit("CPU cycles"),
        Entry::ro(18, "Service last cycles", U32).unit("CPU cycles"),
        Entry::ro(19, "Reserved0", U32),
        Entry::ro(20, "Reserved1", U32),
    ],
);
