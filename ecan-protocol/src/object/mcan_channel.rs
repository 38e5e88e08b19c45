//! 0x8001..0x8004 MCAN Channel Config (manual 13.4).
//!
//! The manual lists no values for the actions on frames without a filter, nor for filter types
//! and actions; here they are those of the MCAN core's registers (GFC and filter elements).

use super::ObjectType::{U8, U16, U32};
use super::{Entry, Object};

const APPLY_STATUS: &[(u32, &str)] =
    &[(0, "OK"), (1, "fail"), (3, "build fail"), (4, "apply runtime fail")];

const NODE_MODE: &[(u32, &str)] = &[
    (0, "normal"),
    (1, "restricted or monitor"),
    (2, "internal loopback"),
    (3, "external loopback or listen"),
];

const NON_MATCH: &[(u32, &str)] =
    &[(0, "into RX FIFO0"), (1, "into RX FIFO1"), (2, "reject"), (3, "reject")];

const ENTRY_COMMAND: &[(u32, &str)] = &[
    (0, "no-op"),
    (1, "load current"),
    (2, "save current"),
    (3, "clear current"),
    (4, "flash current"),
];

const ENTRY_STATUS: &[(u32, &str)] = &[(0, "OK"), (1, "invalid index"), (2, "invalid command")];

const STANDARD_FILTER_TYPE: &[(u32, &str)] =
    &[(0, "range"), (1, "two identifiers"), (2, "identifier and mask"), (3, "disabled")];

const EXTENDED_FILTER_TYPE: &[(u32, &str)] = &[
    (0, "range"),
    (1, "two identifiers"),
    (2, "identifier and mask"),
    (3, "range without the global mask"),
];

const FILTER_ACTION: &[(u32, &str)] = &[
    (0, "disabled"),
    (1, "into RX FIFO0"),
    (2, "into RX FIFO1"),
    (3, "reject"),
    (4, "priority"),
    (5, "priority, into RX FIFO0"),
    (6, "priority, into RX FIFO1"),
    (7, "into an RX buffer"),
];

const FIFO_MODE: &[(u32, &str)] = &[(0, "blocking"), (1, "overwrite")];

const DATA_SIZE: &[(u32, &str)] = &[
    (0, "8 bytes"),
    (1, "12 bytes"),
    (2, "16 bytes"),
    (3, "20 bytes"),
    (4, "24 bytes"),
    (5, "32 bytes"),
    (6, "48 bytes"),
    (7, "64 bytes"),
];

/// A sample point bound, 0.1 % per unit.
const fn sample_point(subindex: u8, name: &'static str, default: u32) -> Entry {
    Entry::rw(subindex, name, U16).default(default).range(0, 1000).unit("0.1 %")
}

const fn data_size(subindex: u8, name: &'static str) -> Entry {
    Entry::rw(subindex, name, U8).default(7).range(0, 7).values(DATA_SIZE)
}

/// A field of manual bit timing; 0 while automatic timing is used.
const fn timing(subindex: u8, name: &'static str, ty: super::ObjectType, max: u32) -> Entry {
    Entry::rw(subindex, name, ty).default(0).range(0, max)
}

const fn switch(subindex: u8, name: &'static str, default: u32) -> Entry {
    Entry::rw(subindex, name, U8).default(default).flag()
}

pub(crate) const MCAN_CHANNEL: Object = Object::family(
    0x8001,
    4,
    1,
    "MCAN Channel Config",
    "13.4",
    &[
        Entry::highest(87),
        Entry::wo(1, "Apply command", U8)
            .default(0)
            .range(0, 1)
            .values(&[(0, "no-op"), (1, "apply")]),
        Entry::ro(2, "Apply status", U8).default(0).values(APPLY_STATUS),
        Entry::wo(3, "Flash command", U8).default(0).range(0, 7).bits(&[
            (0, "save"),
            (1, "load"),
            (2, "factory reset"),
        ]),
        Entry::ro(4, "Flash status", U8).default(0).values(APPLY_STATUS),
        Entry::ro(5, "Command sequence", U32).default(0),
        Entry::ro(6, "Command Pad0", U32).default(0),
        Entry::rw(7, "Bit timing mode", U8)
            .default(0)
            .range(0, 1)
            .values(&[(0, "automatic"), (1, "manual")]),
        Entry::rw(8, "Node mode", U8).default(0).range(0, 3).values(NODE_MODE),
        switch(9, "Non-ISO enable", 0),
        switch(10, "Transmit pause", 0),
        switch(11, "Edge filter enable", 0),
        switch(12, "Protocol exception disable", 0),
        switch(13, "Wide message marker enable", 0),
        switch(14, "External timestamp use", 0),
        switch(15, "FD enable", 1),
        switch(16, "TDC enable", 1),
        switch(17, "Restricted mode disable", 0),
        switch(18, "Disable auto retransmission", 0),
        Entry::rw(19, "Nominal bitrate", U32).default(500_000).range(1, 1_000_000).unit("bit/s"),
        Entry::rw(20, "Data bitrate", U32).default(5_000_000).range(1, u32::MAX).unit("bit/s"),
        sample_point(21, "Nominal SP min", 750),
        sample_point(22, "Nominal SP max", 875),
        sample_point(23, "Data SP min", 750),
        sample_point(24, "Data SP max", 875),
        timing(25, "Nominal BRP", U16, 512),
        timing(26, "Nominal TSEG1", U8, 255),
        timing(27, "Nominal TSEG2", U8, 128),
        timing(28, "Nominal SJW", U8, 128),
        timing(29, "Data BRP", U16, 32),
        timing(30, "Data TSEG1", U8, 32),
        timing(31, "Data TSEG2", U8, 16),
        timing(32, "Data SJW", U8, 16),
        Entry::rw(33, "TDC offset", U8).default(0).range(0, 127).unit("mtq"),
        Entry::rw(34, "TDC filter", U8).default(0).range(0, 127).unit("mtq"),
        Entry::rw(36, "Accept non-match std", U8).default(0).range(0, 3).values(NON_MATCH),
        Entry::rw(37, "Accept non-match ext", U8).default(0).range(0, 3).values(NON_MATCH),
        switch(38, "Reject remote std", 0),
        switch(39, "Reject remote ext", 0),
        Entry::rw(40, "Ext ID mask", U32).default(0x1FFF_FFFF).range(0, 0x1FFF_FFFF),
        Entry::ro(41, "Std list max", U8).default(64),
        Entry::ro(42, "Ext list max", U8).default(24),
        Entry::rw(43, "Std current index", U8).default(0).range(0, 63),
        Entry::rw(44, "Ext current index", U8).default(0).range(0, 23),
        Entry::rw(45, "Std entry cmd", U8).default(0).range(0, 4).values(ENTRY_COMMAND),
        Entry::rw(46, "Ext entry cmd", U8).default(0).range(0, 4).values(ENTRY_COMMAND),
        Entry::ro(47, "Std entry status", U8).default(0).values(ENTRY_STATUS),
        Entry::ro(48, "Ext entry status", U8).default(0).values(ENTRY_STATUS),
        Entry::rw(49, "Std filter count", U8).default(0).range(0, 64),
        Entry::rw(50, "Std filter type", U8).default(0).range(0, 3).values(STANDARD_FILTER_TYPE),
        Entry::rw(51, "Std filter action", U8).default(0).range(0, 7).values(FILTER_ACTION),
        switch(52, "Std filter sync", 0),
        Entry::rw(53, "Std ID1", U32).default(0).range(0, 0x7FF),
        Entry::rw(54, "Std ID2", U32).default(0).range(0, 0x7FF),
        Entry::rw(55, "Ext filter count", U8).default(0).range(0, 24),
        Entry::rw(56, "Ext filter type", U8).default(0).range(0, 3).values(EXTENDED_FILTER_TYPE),
        Entry::rw(57, "Ext filter action", U8).default(0).range(0, 7).values(FILTER_ACTION),
        switch(58, "Ext filter sync", 0),
        Entry::rw(59, "Ext ID1", U32).default(0).range(0, 0x1FFF_FFFF),
        Entry::rw(60, "Ext ID2", U32).default(0).range(0, 0x1FFF_FFFF),
        Entry::rw(61, "RX FIFO0 op mode", U8).default(0).range(0, 1).values(FIFO_MODE),
        Entry::rw(62, "RX FIFO0 size", U8).default(48).range(0, 64).unit("elements"),
        Entry::rw(63, "RX FIFO1 op mode", U8).default(0).range(0, 1).values(FIFO_MODE),
        Entry::rw(64, "RX FIFO1 size", U8).default(12).range(0, 64).unit("elements"),
        data_size(65, "RX FIFO0 data size"),
        data_size(66, "RX FIFO1 data size"),
        Entry::rw(67, "RX buffer count", U8).default(12).range(0, 64).unit("elements"),
        data_size(68, "RX buffer data size"),
        Entry::rw(69, "TX FIFO queue mode", U8)
            .default(0)
            .range(0, 1)
            .values(&[(0, "FIFO"), (1, "queue by identifier")]),
        Entry::rw(70, "TX FIFO queue size", U8).default(32).range(0, 32).unit("elements"),
        Entry::rw(71, "TX dedicated buffer count", U8).default(0).range(0, 32).unit("elements"),
        data_size(72, "TX buffer data size"),
        Entry::rw(73, "TX event FIFO size", U8).default(32).range(0, 32).unit("elements"),
        Entry::rw(74, "Timestamp selection", U8).default(0).range(0, 2),
        Entry::rw(75, "Timestamp prescaler", U8).default(0),
        switch(76, "TSU enable", 0),
        switch(77, "TSU use external timebase", 0),
        switch(78, "TSU capture on SOF", 0),
        switch(79, "TSU enable 64-bit", 0),
        Entry::ro(80, "Pad2", U8).default(0),
        Entry::rw(81, "TSU prescaler", U16).default(1).range(1, 0xFFFF),
        Entry::rw(82, "TSU external timebase source", U8).default(0),
        Entry::rw(83, "TSU TBSEL option", U8).default(0),
        switch(84, "Timeout enable", 0),
        Entry::rw(85, "Timeout select", U8).default(0).range(0, 3),
        Entry::ro(86, "Pad3", U16).default(0),
        Entry::rw(87, "Timeout period", U16).default(0),
    ],
)
.applied_by(1, 2);
