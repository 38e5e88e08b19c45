//! 0xA000..0xA003 MCAN Register Service, and the mode of a CAN controller by its registers (manual 13.6).

use core::fmt;

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
        Entry::rw(2, "Command", U8)
            .range(0, 2)
            .values(&[(0, "no-op"), (1, "read"), (2, "write")])
            .result(3),
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

/// Offset of the register CCCR.
pub const CCCR: u16 = 0x18;
/// Offset of the register TEST.
pub const TEST: u16 = 0x10;
/// CCCR.INIT: the controller is off its bus.
pub const CCCR_INIT: u32 = 1 << 0;
/// CCCR.MON: bus monitoring.
const CCCR_MON: u32 = 1 << 5;
/// TEST.LBCK: loopback.
const TEST_LBCK: u32 = 1 << 4;

/// Mode of a CAN controller, by its registers [`CCCR`] and [`TEST`] in the layout of the M_CAN core.
///
/// The numbers of the node modes (0x8001:08, manual 13.4) depend on the firmware; the registers show
/// the mode that is active.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ControllerMode {
    /// Takes part in the bus.
    Normal,
    /// Receives only.
    Listen,
    /// Receives its own frames; the bus does not see them.
    InternalLoopback,
    /// Receives its own frames and drives the bus.
    ExternalLoopback,
}

impl ControllerMode {
    /// Mode of register values.
    pub const fn of(cccr: u32, test: u32) -> Self {
        match (cccr & CCCR_MON != 0, test & TEST_LBCK != 0) {
            (false, false) => Self::Normal,
            (true, false) => Self::Listen,
            (true, true) => Self::InternalLoopback,
            (false, true) => Self::ExternalLoopback,
        }
    }

    /// Name in a sentence.
    pub const fn text(self) -> &'static str {
        match self {
            Self::Normal => "normal operation",
            Self::Listen => "listen-only",
            Self::InternalLoopback => "internal loopback",
            Self::ExternalLoopback => "external loopback",
        }
    }
}

impl fmt::Display for ControllerMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.text())
    }
}
