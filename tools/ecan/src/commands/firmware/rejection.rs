//! Why a firmware file was not taken, in words (manual 15.3.1).

use serde::Serialize;

use crate::ethercat_tool::ToolError;

/// A file that was not taken: who said what, and what is to be done.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Rejection {
    /// What kind of refusal.
    pub cause: Cause,
    /// What the tool or the device said.
    pub said: String,
}

/// Kinds of refusals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// No tool, no master, no permission.
    Host,
    /// The slave is not there.
    NoSlave,
    /// The password is not 0.
    Password,
    /// The file is not what the device takes.
    Verify,
    /// The flash could not be erased or written, or is full.
    Flash,
    /// The device has no file of this name.
    Name,
    /// The device does not take firmware now.
    State,
    /// The transfer stopped in the middle.
    Interrupted,
    /// The gateway refused, and the master does not tell why.
    Unexplained,
    /// Something that the manual does not name.
    Other,
}

impl Cause {
    /// By what the device or the tool said. IgH's tool prints the number of an FoE error and a text
    /// of its own; the device's text stands in the kernel log alone. The manual names texts, no
    /// numbers: those here are of ETG.1000.6.
    fn of(said: &str) -> Self {
        // Texts first: a device may give them any number.
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
        let (_, behind) = said.split_once("error code 0x")?;
        let end = behind.find(|letter: char| !letter.is_ascii_hexdigit()).unwrap_or(behind.len());
        Self::of_code(u32::from_str_radix(behind.get(..end)?, 16).ok()?)
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

    /// Cause and treatment.
    pub fn words(self) -> &'static str {
        match self {
            Self::Host => "the master cannot be reached",
            Self::NoSlave => "the slave is not on the bus: supply, cable, position",
            Self::Password => {
                "the gateway refuses the password: it takes 0, so the ethercat tool confuses \
                 position and password, or this gateway has another one"
            }
            Self::Verify => {
                "the gateway refuses the file: not in packaging format (a bare application?), or \
                 its header, version, signature or CRC does not fit this device"
            }
            Self::Flash => {
                "the gateway's flash could not be erased or written: check the supply, the state \
                 of the slave and whether the file fits"
            }
            Self::Name => "the gateway knows no file ecan_lite_app: is it an ECAN-Lite?",
            Self::State => {
                "the gateway takes no firmware in this state: bring it to PREOP with its mailbox \
                 working, and try again"
            }
            Self::Interrupted => {
                "the transfer was interrupted; the version that ran before stays. Check supply and \
                 cable, and try again"
            }
            Self::Unexplained => {
                "the gateway answered with an error, and this version of the master does not tell \
                 which: the file is not in packaging format or does not fit this device, the \
                 password is not 0, or its flash failed; the kernel log (dmesg) may tell more"
            }
            Self::Other => "the ethercat tool failed; the kernel log (dmesg) may tell more",
        }
    }
}

impl Rejection {
    /// A refusal by its words.
    pub fn new(said: impl Into<String>) -> Self {
        let said = said.into();
        Self { cause: Cause::of(&said), said }
    }

    /// Adds what the gateway itself says of the transfer in 0xB000:11. The manual gives no numbers
    /// for it: where it is one of FoE, and nothing else is known, it is the cause.
    pub fn add_status(&mut self, status: u32) {
        if status == 0 {
            return;
        }
        if matches!(self.cause, Cause::Unexplained | Cause::Other) {
            self.cause = Cause::of_code(status).unwrap_or(self.cause);
        }
        self.said.push_str(&format!("; 0xB000:11 of the gateway is {status:#06x}"));
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
        let (said, remedy) = (error.to_string(), error.remedy());
        Self { cause, said: if remedy.is_empty() { said } else { format!("{said}; {remedy}") } }
    }
}

impl std::fmt::Display for Rejection {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{} ({})", self.cause.words(), self.said)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_of_the_manual_and_of_the_tool_have_causes() {
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
