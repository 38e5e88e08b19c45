//! Registers of the M_CAN core in words.

use ecan_protocol::object::WRITABLE_REGISTERS;
use ecan_tool_support::diagnosis::registers::{REGISTERS, register, register_named, text};

#[test]
fn register_values_are_decoded() {
    for (offset, value, expected) in [
        (0x40, 0x0002_8410, "16 transmit errors, 128 or more receive errors (passive), 2 logged"),
        (0x40, 0x0000_0300, "0 transmit errors, 3 receive errors"),
        (0x44, 0x0000_070F, "idle, error active, last error: no change"),
        (0x44, 0x0000_07EB, "idle, bus-off, last error: acknowledge error"),
        (
            0x44,
            0x0011_3660,
            "synchronising, error passive, last error: no error, in the data phase: CRC error, CAN \
             FD frame received, with bit rate switch, transmitter delay 17 mtq",
        ),
        (0x50, 0x0000_0009, "new frame in RX FIFO0, frame lost in RX FIFO0"),
        (0x50, 0, "none"),
        (0x94, 0x8281, "in RX FIFO0, element 1, by extended filter 2"),
        (0xA4, 0x0300_0030, "48 frames pending, full, frame lost"),
        (0xC4, 0x0020_0000, "0 elements free, full"),
        (0xF4, 0x0000_0002, "2 events pending"),
    ] {
        assert_eq!(text(offset, value).unwrap(), expected, "0x{offset:02X}");
    }
    assert_eq!(text(0x18, 1), None);
}

#[test]
fn whitelist_matches_the_manual() {
    for (offset, name) in WRITABLE_REGISTERS {
        assert_eq!(register(offset).unwrap().name, name);
        assert!(register_named(&name.to_lowercase()).unwrap().is_writable());
    }
    assert_eq!(REGISTERS.iter().filter(|register| register.is_writable()).count(), 17);
    assert!(REGISTERS.windows(2).all(|pair| pair[0].offset < pair[1].offset));
    assert!(!register_named("PSR").unwrap().is_writable());
}
