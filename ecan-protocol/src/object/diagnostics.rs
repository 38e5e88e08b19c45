//! 0x8030 PDO Diagnostic Test Control, 0x9011 Cycle Performance Diagnostics and
//! 0x9020..0x9023 MCAN Data Path Diagnostics (manual 13.2.3 to 13.2.5).

use super::ObjectType::{I32, U8, U16, U32};
use super::{Entry, Object};

const SIDES: &[(u32, &str)] = &[(0, "off"), (1, "Tx"), (2, "Rx"), (3, "Tx and Rx")];

pub(crate) const DIAGNOSTIC_TEST: Object = Object::single(
    0x8030,
    "PDO Diagnostic Test Control",
    "13.2.3",
    &[
        Entry::highest(10),
        Entry::rw(1, "Test enable key", U32)
            .default(0)
            .values(&[(0, "test mode off"), (0x4543_414E, "test controls allowed")]),
        Entry::rw(2, "TxPDO bypass flags", U32).default(0).range(0, 0x1C).bits(&[
            (2, "MCAN_READ"),
            (3, "BUILD"),
            (4, "COPY"),
        ]),
        Entry::rw(3, "RxPDO bypass flags", U32).default(0).range(0, 0x3C).bits(&[
            (2, "STAGE"),
            (3, "PARSE"),
            (4, "TX_RING"),
            (5, "MCAN_WRITE"),
        ]),
        Entry::rw(4, "CRC test policy", U8).default(0).range(0, 2).values(&[
            (0, "follow PDO option"),
            (1, "force CRC16"),
            (2, "force no CRC16"),
        ]),
        Entry::rw(5, "Payload only policy", U8).default(0).range(0, 3).values(SIDES),
        Entry::rw(6, "App link bypass policy", U8).default(0).range(0, 3).values(SIDES),
        Entry::ro(7, "ReservedPad", U8).default(0),
        Entry::ro(8, "Legal combination mask", U32).default(0x1F).bits(&[
            (0, "TX_BYPASS"),
            (1, "RX_BYPASS"),
            (2, "CRC_POLICY"),
            (3, "PAYLOAD_ONLY"),
            (4, "APP_BYPASS"),
        ]),
        Entry::ro(9, "Last reject reason", U32).default(0),
        Entry::ro(10, "Reserved0", U32).default(0),
    ],
);

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
