//! 0x8010 / 0x8011 PDO Profile Control (manual 13.2).

use super::ObjectType::{U8, U16, U32};
use super::{Entry, Object};

const STATUS: &[(u32, &str)] = &[
    (0, "OK"),
    (1, "invalid state, the layout cannot change in OP"),
    (2, "invalid PDO size multiplier"),
    (3, "invalid channel mask"),
    (4, "invalid encapsulation profile"),
    (5, "master mapping reload required"),
    (7, "PDO encapsulation error"),
    (8, "PDO overflow or backpressure"),
    (9, "requested profile pending apply"),
    (10, "unsupported option flag"),
];

const CHANNELS: &[(u8, &str)] = &[(0, "CAN0"), (1, "CAN1"), (2, "CAN2"), (3, "CAN3")];

const PROFILE: &[(u32, &str)] = &[
    (0, "variable DLC, no timestamp"),
    (1, "variable DLC, delta16 timestamp allowed"),
    (4, "D64 allowed, no timestamp"),
    (5, "D64 allowed, delta16 timestamp allowed"),
];

const BUDGET: &[(u32, &str)] = &[(0, "Balanced"), (1, "SharedOnly"), (2, "Deterministic")];

const OPTIONS: &[(u8, &str)] = &[
    (0, "TX_RESULT_ENABLE"),
    (1, "ALIGN_4_ENABLE"),
    (2, "NO_CRC16_ENABLE"),
    (3, "APP_BYPASS_ENABLE"),
    (4, "PAYLOAD_ONLY_ENABLE"),
];

const LAST_ERROR: &[(u32, &str)] = &[
    (0, "OK"),
    (2, "frame overrun"),
    (3, "packet overrun"),
    (4, "unknown kind"),
    (5, "invalid DLC"),
    (6, "invalid channel"),
    (7, "invalid TSF"),
    (8, "truncated"),
    (9, "unsupported profile"),
    (10, "duplicate sequence"),
    (11, "unsupported option"),
    (12, "active area"),
    (13, "reserved bit"),
    (14, "bad header"),
    (15, "bad CRC"),
    (16, "bad schedule"),
];

const ENTRIES: &[Entry] = &[
    Entry::highest(16),
    Entry::rw(1, "Apply command", U8).default(0).values(&[(0, "no-op"), (1, "apply")]),
    Entry::ro(2, "Status", U8).default(0).values(STATUS),
    Entry::rw(3, "PDO size multiplier", U8).default(8).range(1, 24).unit("128 bytes"),
    Entry::rw(4, "Channel mask", U8).default(0x0F).range(0, 0x0F).bits(CHANNELS),
    Entry::rw(5, "Encapsulation profile", U8).default(0).range(0, 5).values(PROFILE),
    Entry::rw(6, "Budget policy", U8).default(0).range(0, 2).values(BUDGET),
    Entry::rw(7, "Option flags", U8).default(0).range(0, 0x1F).bits(OPTIONS),
    Entry::rw(8, "Command", U8)
        .default(0)
        .range(0, 3)
        .bits(&[(0, "reset session"), (1, "clear errors")]),
    Entry::ro(9, "Active PDO bytes", U16).default(0).unit("bytes"),
    Entry::ro(10, "Active frame area bytes", U16).default(0).unit("bytes"),
    Entry::ro(11, "Active layout CRC", U32).default(0),
    Entry::ro(12, "Active profile word", U32).default(0),
    Entry::ro(13, "Packet sequence", U16).default(0),
    Entry::ro(14, "Last PDO error", U16).default(0).values(LAST_ERROR),
    Entry::ro(15, "PDO error counter", U32).default(0),
    Entry::ro(16, "PDO overflow counter", U32).default(0),
];

pub(super) const TX_PDO_PROFILE: Object =
    Object::single(0x8010, "TxPDO Profile Control", "13.2", ENTRIES).applied_by(1, 2);

pub(super) const RX_PDO_PROFILE: Object =
    Object::single(0x8011, "RxPDO Profile Control", "13.2", ENTRIES).applied_by(1, 2);
