//! Reasons why a firmware file was rejected (manual 15.3.1).

use serde::Serialize;

use crate::ethercat_tool::ToolError;

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Rejection {
    pub cause: Cause,
    /// Message of the tool or the device.
    pub said: String,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    Host,
    NoSlave,
    Password,
    Verify,
    Flash,
    Name,
    State,
    Interrupted,
    Unexplained,
    Other,
}

impl Cause {
    /// Finds the cause in a message. IgH's tool prints the number of an FoE error with a text of
    /// its own; the text of the device is only in the kernel log. The manual gives texts without
    /// numbers; the numbers here are from ETG.1000.6.
    fn of(said: &str) -> Self {
        // Texts first: a device may use any number for them.
        let causes: [(Self, &[&str]); 8] = [
            (Self::Password, &["Password invalid"]),
            (Self::Verify, &["OTA verify failed"]),
            (Self::Flash, &["file write fail"]),
            (Self::Unexplained, &["FOE_ACK_ERROR"]),
            (Self::NoSlave, &["does not exist", "matches 0 slaves"]),
            (
                Self::Interrupted,
                &[
                    "FOE_TIMEOUT_ERROR",
                    "FOE_WC_ERROR",
                    "FOE_RECEIVE_ERROR",
                    "FOE_MBOX_FETCH_ERROR",
                    "FOE_PACKETNO_ERROR",
                    "Input/output error",
                    "Interrupted system call",
                    "timed out",
                ],
            ),
            (Self::State, &["FOE_MBOX_PROT_ERROR", "does not support", "not supported"]),
            (Self::Host, &["master device", "version magic", "Operation not permitted"]),
        ];
        let by_text = causes.iter().find(|(_, texts)| texts.iter().any(|text| said.contains(text)));
        by_text.map(|(cause, _)| *cause).or_else(|| Self::of_number(said)).unwrap_or(Self::Other)
    }

    fn of_number(said: &str) -> Option<Self> {
        let (_, rest) = said.split_once("error code 0x")?;
        let end = rest.find(|letter: char| !letter.is_ascii_hexdigit()).unwrap_or(rest.len());
        Self::of_code(u32::from_str_radix(rest.get(..end)?, 16).ok()?)
    }

    fn of_code(code: u32) -> Option<Self> {
        Some(match code {
            0x8001 => Self::Name,
            0x8002 | 0x8004 | 0x8008 | 0x8009 => Self::State,
            0x8003 | 0x8011 => Self::Flash,
            0x8005 => Self::Interrupted,
            0x8007 | 0x800A => Self::Password,
            0x800C | 0x800D | 0x8010 | 0x8012 => Self::Verify,
            _ => return None,
        })
    }

    pub fn text(self) -> &'static str {
        match self {
            Self::Host => "the master is not accessible",
            Self::NoSlave => "the slave is not on the bus; check supply, cable and position",
            Self::Password => {
                "the gateway rejects the password 0: the ethercat tool confuses position and password, \
                 or this gateway uses another password"
            }
            Self::Verify => {
                "the gateway rejects the file: it is not a package, or its header, version, \
                 signature or CRC does not match this device"
            }
            Self::Flash => {
                "the flash of the gateway cannot be erased or written; check the supply, the state \
                 of the slave and the size of the file"
            }
            Self::Name => "the slave has no file ecan_lite_app; check that it is an ECAN-Lite",
            Self::State => {
                "the gateway accepts no firmware in this state; bring it to PREOP and retry"
            }
            Self::Interrupted => {
                "the transfer was interrupted and the previous version stays; check supply and \
                 cable, and retry"
            }
            Self::Unexplained => {
                "the gateway reported an error that this version of the master does not show: the \
                 file is not a package or does not match this device, the password is not 0, or \
                 the flash failed; see the kernel log (dmesg)"
            }
            Self::Other => "the ethercat tool failed; see the kernel log (dmesg)",
        }
    }
}

impl Rejection {
    pub fn new(said: impl Into<String>) -> Self {
        let said = said.into();
        Self { cause: Cause::of(&said), said }
    }

    /// Adds the status of the transfer in 0xB000:11. The manual gives no numbers for it: a number
    /// of FoE is used as the cause if no other is known.
    pub fn add_status(&mut self, status: u32) {
        if status == 0 {
            return;
        }
        if matches!(self.cause, Cause::Unexplained | Cause::Other) {
            self.cause = Cause::of_code(status).unwrap_or(self.cause);
        }
        self.said.push_str(&format!("; status 0xB000:11 = {status:#06x}"));
    }
}

impl From<ToolError> for Rejection {
    fn from(error: ToolError) -> Self {
        let cause = match &error {
            _ if error.is_about_host() => Cause::Host,
            ToolError::Killed { .. } | ToolError::TimedOut { .. } => Cause::Interrupted,
            ToolError::Failed { message, .. } => Cause::of(message),
            _ => Cause::Other,
        };
        Self { cause, said: error.text() }
    }
}

impl std::fmt::Display for Rejection {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{} ({})", self.cause.text(), self.said)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_messages_have_causes() {
        let cases = [
            ("Password invalid", Cause::Password),
            ("FoE OTA verify failed", Cause::Verify),
            ("file write fail", Cause::Flash),
            ("FoE write aborted with error code 0x0000800a: No rights.", Cause::Password),
            ("FoE write aborted with error code 0x00008010: Unknown error code", Cause::Verify),
            ("FoE write aborted with error code 0x00008003: Disk full.", Cause::Flash),
            ("FoE write aborted with error code 0x00008001: Not found.", Cause::Name),
            ("FoE write aborted with error code 0x00008008: Bootstrap only.", Cause::State),
            ("FoE write aborted with error code 0x00001234: Unknown error code", Cause::Other),
            ("Failed to write via FoE: FOE_TIMEOUT_ERROR", Cause::Interrupted),
            ("Failed to write via FoE: FOE_ACK_ERROR", Cause::Unexplained),
            ("Failed to write via FoE: Input/output error", Cause::Interrupted),
            ("Failed to get slave: Slave 3 does not exist!", Cause::NoSlave),
            ("something new", Cause::Other),
        ];
        for (said, cause) in cases {
            assert_eq!(Rejection::new(said).cause, cause, "{said}");
        }
    }
}
