//! Register names.

use ecan_protocol::object::WRITABLE_REGISTERS;

/// Register of the M_CAN core.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Register {
    /// Offset in bytes.
    pub offset: u16,
    /// Name.
    pub name: &'static str,
    /// Description.
    pub description: &'static str,
}

impl Register {
    /// Returns whether the register service accepts writes (whitelist of manual 13.6).
    pub fn is_writable(&self) -> bool {
        WRITABLE_REGISTERS.iter().any(|(offset, _)| *offset == self.offset)
    }
}

const fn named(offset: u16, name: &'static str, description: &'static str) -> Register {
    Register { offset, name, description }
}

/// Named registers in the range of the service, 0x0004 to 0x0404.
pub const REGISTERS: [Register; 45] = [
    named(0x0004, "ENDN", "endianness"),
    named(0x000C, "DBTP", "data bit timing and prescaler"),
    named(0x0010, "TEST", "test"),
    named(0x0014, "RWD", "RAM watchdog"),
    named(0x0018, "CCCR", "control"),
    named(0x001C, "NBTP", "nominal bit timing and prescaler"),
    named(0x0020, "TSCC", "timestamp configuration"),
    named(0x0024, "TSCV", "timestamp value"),
    named(0x0028, "TOCC", "timeout configuration"),
    named(0x002C, "TOCV", "timeout value"),
    named(0x0040, "ECR", "error counters"),
    named(0x0044, "PSR", "protocol status"),
    named(0x0048, "TDCR", "transmitter delay compensation"),
    named(0x0050, "IR", "interrupt flags, write 1 to clear"),
    named(0x0054, "IE", "interrupt enable"),
    named(0x0058, "ILS", "interrupt line select"),
    named(0x005C, "ILE", "interrupt line enable"),
    named(0x0080, "GFC", "global filter configuration"),
    named(0x0084, "SIDFC", "standard filter list"),
    named(0x0088, "XIDFC", "extended filter list"),
    named(0x0090, "XIDAM", "extended identifier mask"),
    named(0x0094, "HPMS", "high priority message status"),
    named(0x0098, "NDAT1", "new data in receive buffers 0 to 31"),
    named(0x009C, "NDAT2", "new data in receive buffers 32 to 63"),
    named(0x00A0, "RXF0C", "RX FIFO0 configuration"),
    named(0x00A4, "RXF0S", "RX FIFO0 status"),
    named(0x00A8, "RXF0A", "RX FIFO0 acknowledge"),
    named(0x00AC, "RXBC", "receive buffer configuration"),
    named(0x00B0, "RXF1C", "RX FIFO1 configuration"),
    named(0x00B4, "RXF1S", "RX FIFO1 status"),
    named(0x00B8, "RXF1A", "RX FIFO1 acknowledge"),
    named(0x00BC, "RXESC", "receive element sizes"),
    named(0x00C0, "TXBC", "transmit buffer configuration"),
    named(0x00C4, "TXFQS", "transmit FIFO or queue status"),
    named(0x00C8, "TXESC", "transmit element size"),
    named(0x00CC, "TXBRP", "transmit requests pending"),
    named(0x00D0, "TXBAR", "transmit add request"),
    named(0x00D4, "TXBCR", "transmit cancellation request"),
    named(0x00D8, "TXBTO", "transmissions that occurred"),
    named(0x00DC, "TXBCF", "cancellations finished"),
    named(0x00E0, "TXBTIE", "transmission interrupt enable"),
    named(0x00E4, "TXBCIE", "cancellation interrupt enable"),
    named(0x00F0, "TXEFC", "transmit event FIFO configuration"),
    named(0x00F4, "TXEFS", "transmit event FIFO status"),
    named(0x00F8, "TXEFA", "transmit event FIFO acknowledge"),
];

/// Named register at an offset.
pub fn register(offset: u16) -> Option<Register> {
    REGISTERS.into_iter().find(|register| register.offset == offset)
}

/// Register by name, case-insensitive.
pub fn register_named(name: &str) -> Option<Register> {
    REGISTERS.into_iter().find(|register| register.name.eq_ignore_ascii_case(name))
}
