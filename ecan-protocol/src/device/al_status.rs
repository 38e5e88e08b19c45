//! EtherCAT states and AL status codes (ETG.1000.6).

use core::fmt;

use crate::object::raw_enum;

raw_enum! {
    /// EtherCAT state of a slave.
    pub enum AlState: u8;
    /// INIT: no communication.
    Init = 1, "INIT";
    /// PREOP: mailbox.
    PreOp = 2, "PREOP";
    /// BOOT: firmware update.
    Boot = 3, "BOOT";
    /// SAFEOP: mailbox and inputs.
    SafeOp = 4, "SAFEOP";
    /// OP: mailbox, inputs and outputs.
    Op = 8, "OP";
}

impl AlState {
    /// The state in an AL status or control value, whose bit 4 is the error flag.
    pub const fn from_status(status: u16) -> Option<Self> {
        Self::from_raw((status & 0x0F) as u8)
    }

    /// True if the mailbox works.
    pub const fn has_mailbox(self) -> bool {
        !matches!(self, Self::Init)
    }
}

/// Reason why a slave did not change its state, or left it (AL status code).
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct AlStatusCode(pub u16);

impl AlStatusCode {
    /// No error.
    pub const OK: Self = Self(0x0000);
    /// The state change is not allowed.
    pub const INVALID_STATE_CHANGE: Self = Self(0x0011);
    /// The requested state does not exist.
    pub const UNKNOWN_STATE: Self = Self(0x0012);
    /// Mailbox sync managers are wrong for BOOT.
    pub const BOOT_MAILBOX_CONFIGURATION: Self = Self(0x0015);
    /// Mailbox sync managers are wrong.
    pub const MAILBOX_CONFIGURATION: Self = Self(0x0016);
    /// Outputs and synchronisation signal do not fit each other.
    pub const SYNC_ERROR: Self = Self(0x001A);
    /// Outputs did not arrive in time.
    pub const SM_WATCHDOG: Self = Self(0x001B);
    /// Output sync manager is wrong.
    pub const OUTPUT_CONFIGURATION: Self = Self(0x001D);
    /// Input sync manager is wrong.
    pub const INPUT_CONFIGURATION: Self = Self(0x001E);
    /// Synchronisation lost.
    pub const FATAL_SYNC: Self = Self(0x002C);
    /// Sync signal missing.
    pub const NO_SYNC: Self = Self(0x002D);
    /// Invalid configuration of the distributed clock.
    pub const DC_CONFIGURATION: Self = Self(0x0030);

    /// Meaning of the code, `None` for a code that the standard does not list.
    pub const fn meaning(self) -> Option<&'static str> {
        Some(match self.0 {
            0x0000 => "no error",
            0x0001 => "unspecified error",
            0x0002 => "no memory",
            0x0003 => "invalid device setup",
            0x0004 => "invalid revision",
            0x0006 => "EEPROM does not match the firmware",
            0x0007 => "firmware update failed",
            0x000E => "licence error",
            0x0011 => "invalid requested state change",
            0x0012 => "unknown requested state",
            0x0013 => "BOOT not supported",
            0x0014 => "no valid firmware",
            0x0015 => "invalid mailbox configuration for BOOT",
            0x0016 => "invalid mailbox configuration for PREOP",
            0x0017 => "invalid sync manager configuration",
            0x0018 => "no valid inputs available",
            0x0019 => "no valid outputs available",
            0x001A => "synchronisation error",
            0x001B => "sync manager watchdog: outputs did not arrive in time",
            0x001C => "invalid sync manager types",
            0x001D => "invalid output configuration: SM2 and PDO assignment differ",
            0x001E => "invalid input configuration: SM3 and PDO assignment differ",
            0x001F => "invalid watchdog configuration",
            0x0020 => "slave needs a cold start",
            0x0021 => "slave needs INIT",
            0x0022 => "slave needs PREOP",
            0x0023 => "slave needs SAFEOP",
            0x0024 => "invalid input mapping",
            0x0025 => "invalid output mapping",
            0x0026 => "inconsistent settings",
            0x0027 => "free run not supported",
            0x0028 => "synchronisation mode not supported",
            0x0029 => "free run needs three buffers",
            0x002A => "background watchdog",
            0x002B => "no valid inputs and outputs",
            0x002C => "fatal sync error: Sync0 and process data do not go together",
            0x002D => "no sync: the Sync0 signal is missing",
            0x002E => "cycle time too small",
            0x0030 => "invalid DC sync configuration",
            0x0031 => "invalid DC latch configuration",
            0x0032 => "DC PLL error",
            0x0033 => "DC sync IO error",
            0x0034 => "DC sync timeout",
            0x0035 => "invalid DC sync cycle time",
            0x0036 => "invalid DC Sync0 cycle time",
            0x0037 => "invalid DC Sync1 cycle time",
            0x0041 => "AoE mailbox error",
            0x0042 => "EoE mailbox error",
            0x0043 => "CoE mailbox error",
            0x0044 => "FoE mailbox error",
            0x0045 => "SoE mailbox error",
            0x004F => "VoE mailbox error",
            0x0050 => "EEPROM not assigned to the slave",
            0x0051 => "EEPROM error",
            0x0052 => "external hardware not ready",
            0x0060 => "slave restarted by itself",
            0x0061 => "device identification updated",
            0x0070 => "detected modules differ from the configured ones",
            0x0080 => "supply voltage too low",
            0x0081 => "supply voltage too high",
            0x0082 => "temperature too low",
            0x0083 => "temperature too high",
            0x00F0 => "application controller available",
            _ => return None,
        })
    }
}

impl fmt::Display for AlStatusCode {
    /// `0x001B sync manager watchdog: outputs did not arrive in time`
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "0x{:04X} {}", self.0, self.meaning().unwrap_or("unknown AL status code"))
    }
}

impl fmt::Debug for AlStatusCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "AlStatusCode({self})")
    }
}
