//! 0x9000..0x9003 MCAN Channel Information (manual 13.5).

use super::ObjectType::{U16, U32};
use super::entry::{Entry, Object};

pub(super) const CHANNEL_INFORMATION: Object = Object::family(
    0x9000,
    4,
    1,
    "MCAN Channel Information",
    "13.5",
    &[
        Entry::highest(16),
        Entry::ro(1, "ECR raw", U32),
        Entry::ro(2, "PSR raw", U32),
        Entry::ro(3, "IR raw", U32),
        Entry::ro(4, "RXF0S raw", U32),
        Entry::ro(5, "RXF1S raw", U32),
        Entry::ro(6, "TXFQS raw", U32),
        Entry::ro(7, "TXEFS raw", U32),
        Entry::ro(8, "HPMS raw", U32),
        Entry::ro(9, "PDO channel status", U16),
        Entry::ro(10, "RX pending count", U16).unit("frames"),
        Entry::ro(11, "TX pending count", U16).unit("frames"),
        Entry::ro(12, "Channel event flags", U16),
        Entry::ro(13, "RX dropped counter", U32).unit("frames"),
        Entry::ro(14, "TX backpressure counter", U32),
        Entry::ro(15, "Bus off counter", U32),
        Entry::ro(16, "Detail sequence", U32),
    ],
);
