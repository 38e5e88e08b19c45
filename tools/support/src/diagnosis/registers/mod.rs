//! Decoder of the MCAN registers in 0x9000..0x9003 and 0xA000..0xA003 (manual 13.5, 13.6).
//!
//! The manual names the registers; their bits are defined by the Bosch M_CAN core.

/// Declares a decoded register: its fields with their values in the raw register.
macro_rules! decoded_register {
    (
        $(#[$doc:meta])*
        pub struct $name:ident($raw:ident) {
            $($(#[$field_doc:meta])* $field:ident: $ty:ty = $value:expr,)*
        }
    ) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
        pub struct $name {
            $($(#[$field_doc])* pub $field: $ty,)*
        }

        impl $name {
            /// Decodes the register.
            pub const fn from_raw($raw: u32) -> Self {
                Self { $($field: $value,)* }
            }
        }
    };
}

/// Bits of a register from `shift` on, at most 8.
const fn field(raw: u32, shift: u32, mask: u32) -> u8 {
    (raw >> shift & mask & 0xFF) as u8
}

const fn bit(raw: u32, at: u32) -> bool {
    raw >> at & 1 == 1
}

mod catalogue;
mod error_counters;
mod fifos;
mod interrupts;
mod protocol_status;

pub use catalogue::{REGISTERS, Register, register, register_named};
pub use error_counters::ErrorCounters;
pub use fifos::{EventFifoStatus, HighPriorityStatus, ReceiveFifoStatus, TransmitQueueStatus};
pub use interrupts::{INTERRUPTS, Interrupts};
pub use protocol_status::{Activity, LastErrorCode, ProtocolStatus};

/// Text of a register value; `None` if the register is not decoded.
pub fn text(offset: u16, value: u32) -> Option<String> {
    Some(match offset {
        0x0040 => ErrorCounters::from_raw(value).to_string(),
        0x0044 => ProtocolStatus::from_raw(value).to_string(),
        0x0050 => Interrupts(value).to_string(),
        0x0094 => HighPriorityStatus::from_raw(value).to_string(),
        0x00A4 | 0x00B4 => ReceiveFifoStatus::from_raw(value).to_string(),
        0x00C4 => TransmitQueueStatus::from_raw(value).to_string(),
        0x00F4 => EventFifoStatus::from_raw(value).to_string(),
        _ => return None,
    })
}
