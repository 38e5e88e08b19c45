//! Mode of a CAN controller, by its registers (manual 13.6).

use core::fmt;

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
