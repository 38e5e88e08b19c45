//! SDO abort codes (ETG.1000.6, CiA 301).

use core::fmt;

/// The code with which a device aborts an SDO transfer.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct AbortCode(pub u32);

impl AbortCode {
    /// Toggle bit not alternated.
    pub const TOGGLE: Self = Self(0x0503_0000);
    /// Transfer timed out.
    pub const TIMEOUT: Self = Self(0x0504_0000);
    /// Command specifier unknown.
    pub const COMMAND: Self = Self(0x0504_0001);
    /// Out of memory.
    pub const OUT_OF_MEMORY: Self = Self(0x0504_0005);
    /// Access not supported.
    pub const UNSUPPORTED_ACCESS: Self = Self(0x0601_0000);
    /// Read of a write-only object.
    pub const WRITE_ONLY: Self = Self(0x0601_0001);
    /// Write to a read-only object.
    pub const READ_ONLY: Self = Self(0x0601_0002);
    /// Subindex 0 must be 0 before this one can be written.
    pub const SUBINDEX_LOCKED: Self = Self(0x0601_0003);
    /// Complete access not supported for this object.
    pub const NO_COMPLETE_ACCESS: Self = Self(0x0601_0004);
    /// Longer than the mailbox.
    pub const EXCEEDS_MAILBOX: Self = Self(0x0601_0005);
    /// No such object.
    pub const NO_OBJECT: Self = Self(0x0602_0000);
    /// Object cannot be mapped.
    pub const NOT_MAPPABLE: Self = Self(0x0604_0041);
    /// Mapped objects exceed the PDO.
    pub const PDO_LENGTH: Self = Self(0x0604_0042);
    /// Parameters are incompatible.
    pub const PARAMETER_INCOMPATIBLE: Self = Self(0x0604_0043);
    /// Hardware error.
    pub const HARDWARE: Self = Self(0x0606_0000);
    /// Wrong length.
    pub const LENGTH: Self = Self(0x0607_0010);
    /// Too long.
    pub const TOO_LONG: Self = Self(0x0607_0012);
    /// Too short.
    pub const TOO_SHORT: Self = Self(0x0607_0013);
    /// No such subindex.
    pub const NO_SUBINDEX: Self = Self(0x0609_0011);
    /// Value out of range.
    pub const RANGE: Self = Self(0x0609_0030);
    /// Value too large.
    pub const TOO_GREAT: Self = Self(0x0609_0031);
    /// Value too small.
    pub const TOO_SMALL: Self = Self(0x0609_0032);
    /// General error.
    pub const GENERAL: Self = Self(0x0800_0000);
    /// Cannot be transferred or stored.
    pub const NOT_STORED: Self = Self(0x0800_0020);
    /// Not possible because of local control.
    pub const LOCAL_CONTROL: Self = Self(0x0800_0021);
    /// Not possible in the present device state.
    pub const DEVICE_STATE: Self = Self(0x0800_0022);

    /// Meaning of the code, `None` for a code that the standards do not list.
    pub const fn meaning(self) -> Option<&'static str> {
        Some(match self.0 {
            0x0503_0000 => "toggle bit not alternated",
            0x0504_0000 => "SDO protocol timeout",
            0x0504_0001 => "command specifier invalid or unknown",
            0x0504_0002 => "invalid block size",
            0x0504_0003 => "invalid sequence number",
            0x0504_0004 => "CRC error",
            0x0504_0005 => "out of memory",
            0x0601_0000 => "access to the object not supported",
            0x0601_0001 => "object is write-only",
            0x0601_0002 => "object is read-only",
            0x0601_0003 => "subindex cannot be written while subindex 0 is not 0",
            0x0601_0004 => "complete access not supported",
            0x0601_0005 => "object is longer than the mailbox",
            0x0601_0006 => "object is mapped to an RxPDO and cannot be written",
            0x0602_0000 => "object does not exist",
            0x0604_0041 => "object cannot be mapped to a PDO",
            0x0604_0042 => "mapped objects exceed the PDO length",
            0x0604_0043 => "parameters are incompatible",
            0x0604_0047 => "internal incompatibility in the device",
            0x0606_0000 => "hardware error",
            0x0607_0010 => "data length does not match the object",
            0x0607_0012 => "data is too long for the object",
            0x0607_0013 => "data is too short for the object",
            0x0609_0011 => "subindex does not exist",
            0x0609_0030 => "value range exceeded",
            0x0609_0031 => "value too great",
            0x0609_0032 => "value too small",
            0x0609_0033 => "configured and detected modules differ",
            0x0609_0036 => "maximum is below minimum",
            0x060A_0023 => "no SDO connection available",
            0x0800_0000 => "general error",
            0x0800_0020 => "data cannot be transferred or stored",
            0x0800_0021 => "data cannot be transferred because of local control",
            0x0800_0022 => "data cannot be transferred in the present device state",
            0x0800_0023 => "object dictionary missing",
            0x0800_0024 => "no data available",
            _ => return None,
        })
    }
}

impl fmt::Display for AbortCode {
    /// `0x06090030 value range exceeded`
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "0x{:08X} {}", self.0, self.meaning().unwrap_or("unknown abort code"))
    }
}

impl fmt::Debug for AbortCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "AbortCode({self})")
    }
}

impl core::error::Error for AbortCode {}
