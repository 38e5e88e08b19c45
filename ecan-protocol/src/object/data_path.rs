//! 0x8020 Data Path Global Control and 0x8021..0x8024 MCAN Data Path Control
//! (manual 13.2.1, 13.2.2).

use super::ObjectType::{U8, U16, U32};
use super::{Entry, Object};

const APPLY: &[(u32, &str)] = &[(0, "no-op"), (1, "apply")];

pub(crate) const GLOBAL_DATA_PATH: Object = Object::single(
    0x8020,
    "Data Path Global Control",
    "13.2.1",
    &[
        Entry::highest(10),
        Entry::ro(1, "Control format", U16).default(1),
        Entry::rw(2, "Apply command", U8).default(0).range(0, 1).values(APPLY),
        Entry::ro(3, "Apply status", U8).default(0),
        Entry::rw(4, "Compat mode", U16).default(3),
        // The capability masks 0xF000:26 and :27 are 0, so 0 is the only valid value.
        Entry::rw(5, "Runtime option flags", U32).default(0).range(0, 0),
        Entry::rw(6, "Diagnostic option flags", U32).default(0).range(0, 0),
        Entry::rw(7, "Max service budget us", U16).default(1000).range(0, 1000).unit("us"),
        Entry::ro(8, "Reserved0", U16).default(0),
        Entry::ro(9, "Reserved1", U32).default(0),
        Entry::ro(10, "Reserved2", U32).default(0),
    ],
)
.applied_by(2, 3);

const RX_BUDGET: &[(u32, &str)] =
    &[(0, "balanced"), (1, "limited"), (2, "performance"), (3, "adaptive")];

const RX_CACHE_DEPTH: &[(u32, &str)] = &[
    (0, "32 frames"),
    (1, "8 frames"),
    (2, "16 frames"),
    (3, "24 frames"),
    (8, "8 frames"),
    (16, "16 frames"),
    (24, "24 frames"),
    (32, "32 frames"),
];

const RX_OVERFLOW: &[(u32, &str)] =
    &[(0, "drop oldest"), (1, "drop newest"), (2, "preserve critical"), (3, "degraded")];

const CRITICAL_FRAMES: &[(u32, &str)] = &[(0, "none"), (1, "CANopen safety"), (2, "CANopen all")];

const TX_OVERFLOW: &[(u32, &str)] =
    &[(0, "drop newest"), (1, "drop oldest"), (2, "backoff"), (3, "degraded")];

const BUS_OFF: &[(u32, &str)] = &[(0, "manual"), (1, "auto"), (2, "aggressive"), (3, "degraded")];

pub(crate) const CHANNEL_DATA_PATH: Object = Object::family(
    0x8021,
    4,
    1,
    "MCAN Data Path Control",
    "13.2.2",
    &[
        Entry::highest(20),
        Entry::rw(1, "Enable", U8).default(1).flag(),
        Entry::rw(2, "Apply command", U8).default(0).range(0, 1).values(APPLY),
        Entry::ro(3, "Apply status", U8).default(0),
        Entry::rw(4, "RX drain budget min", U8).default(0).range(0, 8).unit("frames"),
        Entry::rw(5, "RX drain budget max", U8).default(2).range(0, 8).unit("frames"),
        Entry::rw(6, "RX budget policy", U8).default(1).range(0, 3).values(RX_BUDGET),
        Entry::rw(7, "RX cache depth", U8).default(2).range(0, 32).values(RX_CACHE_DEPTH),
        Entry::rw(8, "RX overflow policy", U8).default(1).range(0, 3).values(RX_OVERFLOW),
        Entry::rw(9, "Critical frame policy", U16).default(1).range(0, 2).values(CRITICAL_FRAMES),
        Entry::rw(10, "CAN ID priority policy", U16).default(0),
        Entry::rw(11, "TX budget min", U8).default(0).range(0, 8).unit("frames"),
        Entry::rw(12, "TX budget max", U8).default(4).range(0, 8).unit("frames"),
        Entry::rw(13, "TX overflow policy", U8).default(1).range(0, 3).values(TX_OVERFLOW),
        Entry::rw(14, "Bus-off recovery policy", U8).default(1).range(0, 3).values(BUS_OFF),
        Entry::rw(15, "Backoff base cycles", U16).default(2).unit("cycles"),
        Entry::rw(16, "Degraded threshold", U16).default(64),
        Entry::rw(17, "Reserved0", U32).default(0),
        Entry::rw(18, "Reserved1", U32).default(0),
        Entry::rw(19, "Reserved2", U32).default(0),
        // The manual's column says 0; with the defaults applied the device reports 0x54059201.
        Entry::ro(20, "Active control word", U32).default(0),
    ],
)
.applied_by(2, 3);
