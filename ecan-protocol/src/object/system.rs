//! 0x8000 System Config (manual 13.3).

use super::ObjectType::{U8, U16, U32};
use super::entry::{Entry, Object};

pub(super) const SYSTEM: Object = Object::single(
    0x8000,
    "System Config",
    "13.3",
    &[
        Entry::highest(15),
        Entry::wo(1, "Reboot command", U8).default(0).values(&[(0, "no-op"), (1, "restart")]),
        Entry::rw(3, "CPU voltage", U16).default(1275).unit("mV"),
        Entry::ro(4, "CPU clock hz", U32).default(400_000_000).unit("Hz"),
        Entry::ro(5, "BUS clock hz", U32).default(200_000_000).unit("Hz"),
        Entry::ro(6, "MCAN0 clock hz", U32).default(80_000_000).unit("Hz"),
        Entry::ro(7, "MCAN1 clock hz", U32).default(80_000_000).unit("Hz"),
        Entry::ro(8, "MCAN2 clock hz", U32).default(80_000_000).unit("Hz"),
        Entry::ro(9, "MCAN3 clock hz", U32).default(80_000_000).unit("Hz"),
        Entry::rw(10, "Config version", U32).default(0),
        Entry::ro(11, "Last apply result", U32).default(0),
        Entry::rw(12, "CAN pin rotation", U8).default(0).range(0, 3),
        Entry::ro(13, "Active CAN pin rotation", U8).default(0).range(0, 3),
        Entry::ro(14, "CAN pin rotation mask", U8).default(0x0F).bits(&[
            (0, "rotation 0"),
            (1, "rotation 1"),
            (2, "rotation 2"),
            (3, "rotation 3"),
        ]),
        Entry::ro(15, "CAN pin apply status", U8).default(0),
    ],
)
.saved();
