//! 0xA000..0xA003 MCAN Register Service (manual 13.6).

use super::ObjectType::{U8, U32};
use super::entry::{Entry, Object};

/// The MCAN registers that the service lets a host write, by offset and name (manual 13.6).
pub const WRITABLE_REGISTERS: [(u16, &str); 17] = [
    (0x000C, "DBTP"),
    (0x0010, "TEST"),
    (0x0014, "RWD"),
    (0x0018, "CCCR"),
    (0x001C, "NBTP"),
    (0x0048, "TDCR"),
    (0x0050, "IR"),
    (0x0054, "IE"),
    (0x0058, "ILS"),
    (0x005C, "ILE"),
    (0x0080, "GFC"),
    (0x0090, "XIDAM"),
    (0x00A8, "RXF0A"),
    (0x00B8, "RXF1A"),
    (0x00D0, "TXBAR"),
    (0x00D4, "TXBCR"),
    (0x00F8, "TXEFA"),
];

pub(super) const REGISTER_SERVICE: Object = Object::family(
    0xA000,
    4,
    1,
    "MCAN Register Service",
    "13.6",
    &[
        Entry::highest(7),
        Entry::rw(1, "Offset", U32).range(0x0004, 0x0404),
        Entry::rw(2, "Command", U8).range(0, 2).values(&[(0, "no-op"), (1, "read"), (2, "write")]),
        Entry::ro(3, "Status", U8).values(&[
            (0, "OK"),
            (1, "offset invalid"),
            (2, "write denied"),
            (3, "busy"),
            (4, "access denied"),
        ]),
        Entry::rw(4, "Write value", U32),
        Entry::ro(5, "Read value", U32),
        Entry::ro(6, "Timestamp low", U32),
        Entry::ro(7, "Timestamp high", U32),
    ],
);
