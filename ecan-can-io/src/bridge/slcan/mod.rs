//! slcan: the ASCII protocol of Lawicel's serial CAN adapters, with the CAN FD commands of the
//! CANable 2 firmware.

mod bit_rate;
mod command;
mod encode;
mod session;

#[cfg(test)]
mod command_tests;
#[cfg(test)]
mod session_tests;

pub(super) use encode::encode_losses;
pub(super) use session::{SlcanReceiveSettings, SlcanSession};

/// Ends a command; alone it is the answer "done".
const OK: u8 = b'\r';
/// The answer "rejected".
const BELL: u8 = 0x07;
