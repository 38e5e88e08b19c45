//! CAN ID filters of candump and the kernel.

use core::str::FromStr;

use ecan_protocol::can::{CanFrame, FrameKind};
use thiserror::Error;

// SocketCAN flags in the word of the CAN ID: extended format, remote frame, error message.
const EXTENDED: u32 = 0x8000_0000;
const REMOTE: u32 = 0x4000_0000;
const ERROR: u32 = 0x2000_0000;
/// Number of hex digits of an extended CAN ID.
const EXTENDED_DIGITS: usize = 8;

/// Invalid filter text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("expected ID:MASK or ID~MASK in hexadecimal, as in 123:7FF")]
pub struct FilterError;

/// Frame filter by CAN ID and mask, both hexadecimal: `ID:MASK` passes frames whose CAN ID equals
/// `ID` in the bits of the mask, `ID~MASK` passes the others.
///
/// As in the kernel, bit 31 is the extended format and bit 30 a remote frame. An `ID` of 8 digits is
/// extended. `123:7FF` also passes an extended CAN ID with the same lower bits; `123:C00007FF` does
/// not.
///
/// ```
/// use ecan_can_io::candump::{Filter, parse_frame};
///
/// let filter: Filter = "120:7F0".parse()?;
/// assert!(filter.passes(&parse_frame("123#")?));
/// assert!(!filter.passes(&parse_frame("133#")?));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Filter {
    id: u32,
    mask: u32,
    is_inverted: bool,
}

impl Filter {
    /// Returns whether a frame passes.
    #[must_use]
    pub fn passes(&self, frame: &CanFrame) -> bool {
        let id = frame.id();
        let format = if id.is_extended() { EXTENDED } else { 0 };
        let kind = if frame.kind() == FrameKind::Remote { REMOTE } else { 0 };
        let agrees = ((id.raw() | format | kind) ^ self.id) & self.mask == 0;
        agrees != self.is_inverted
    }
}

impl FromStr for Filter {
    type Err = FilterError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let is_inverted = text.contains('~');
        let (id, mask) = text.split_once([':', '~']).ok_or(FilterError)?;
        let format = if id.len() == EXTENDED_DIGITS { EXTENDED } else { 0 };
        Ok(Self { id: hexadecimal(id)? | format, mask: hexadecimal(mask)? & !ERROR, is_inverted })
    }
}

fn hexadecimal(digits: &str) -> Result<u32, FilterError> {
    let is_number = digits.bytes().all(|digit| digit.is_ascii_hexdigit());
    match u32::from_str_radix(digits, 16) {
        Ok(number) if is_number => Ok(number),
        _ => Err(FilterError),
    }
}
