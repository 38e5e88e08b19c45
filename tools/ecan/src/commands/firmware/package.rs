//! Firmware files: checks before one is written, and reasons why a gateway rejects it (manual 15.3.1).
//!
//! The manual mentions a package header (13.8, 15.3.1) but not its format, nor an object with the size of a
//! partition: a file is rejected only if it cannot be firmware of any format. Other findings are remarks, the
//! file is sent, and the gateway decides.

use std::fmt;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use ecan_sim::{FirmwarePackage, FirmwarePackageError};
use serde::Serialize;

use crate::context::{Failure, Result};
use crate::ethercat_tool::ToolError;

const MIN_BYTES: usize = 256;
const MAX_BYTES: u64 = 16 << 20;

/// Remark on the format of a file, which is sent in any case.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Remark {
    /// The format is unknown, as that of a package of the manufacturer.
    Unknown,
    /// The file looks like something else than a package for the gateway.
    Suspicious(String),
}

impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown => f.write_str("format not recognised; the gateway checks the package"),
            Self::Suspicious(text) => write!(f, "warning: {text}"),
        }
    }
}

#[derive(Clone, Debug)]
pub struct FirmwareFile {
    pub path: PathBuf,
    pub bytes: Vec<u8>,
}

impl FirmwareFile {
    /// Reads a file.
    pub fn read(path: &Path) -> Result<Self> {
        let fault = |reason: String| Failure::file("use", path, reason);
        let unread = |error: std::io::Error| match error.kind() {
            ErrorKind::IsADirectory => Failure::file("read", path, "is a directory"),
            _ => Failure::file("read", path, error),
        };
        let known = std::fs::metadata(path).map_err(unread)?;
        if known.len() > MAX_BYTES {
            return Err(fault(format!("{} bytes are too large for firmware", known.len())));
        }
        let bytes = std::fs::read(path).map_err(unread)?;
        match bytes.len() {
            0 => Err(fault("file is empty".to_owned())),
            few if few < MIN_BYTES => Err(fault(format!("{few} bytes are too small for firmware"))),
            _ => Ok(Self { path: path.to_owned(), bytes }),
        }
    }

    /// Returns what the file looks like; `None` for a package of the simulator on a simulated gateway.
    pub fn remark(&self, is_simulated: bool) -> Option<Remark> {
        let bytes = &self.bytes[..];
        match FirmwarePackage::parse(bytes) {
            Ok(_) if is_simulated => return None,
            Ok(_) => {
                let text =
                    "package for simulated gateways (from ecan-sim); a real gateway rejects it";
                return Some(Remark::Suspicious(text.to_owned()));
            }
            Err(FirmwarePackageError::NotAPackage | FirmwarePackageError::NoHeader(_)) => {}
            Err(error) => {
                let text =
                    format!("damaged package for simulated gateways (from ecan-sim): {error}");
                return Some(Remark::Suspicious(text));
            }
        }
        let bare = "expected a package ecan_lite_v*.bin";
        let kind = match bytes {
            [0x7F, b'E', b'L', b'F', ..] => "an ELF program",
            [b':', digit, ..] if digit.is_ascii_hexdigit() => "an Intel HEX file",
            [b'S', b'0'..=b'3', ..] => "an S-record file",
            [b'P', b'K', 3, 4, ..] => "a ZIP archive (unpack it first)",
            [0x1F, 0x8B, ..] => "a gzip archive (unpack it first)",
            _ if bytes.iter().all(|byte| Some(byte) == bytes.first()) => "a single repeated byte",
            // The first instruction of a RISC-V start: jal, auipc, lui, csr. A package may begin alike.
            [first, ..] if matches!(first & 0x7F, 0x6F | 0x17 | 0x37 | 0x73) => {
                "a bare application without package header"
            }
            _ if is_simulated => "something else than a package of ecan-sim",
            _ => return Some(Remark::Unknown),
        };
        Some(Remark::Suspicious(format!("looks like {kind}; {bare}")))
    }
}

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

    fn remark(bytes: &[u8], is_simulated: bool) -> Option<Remark> {
        FirmwareFile { path: PathBuf::new(), bytes: bytes.to_vec() }.remark(is_simulated)
    }

    #[test]
    fn suspicious_file_gets_a_warning() {
        let warning = |bytes: &[u8], is_simulated| match remark(bytes, is_simulated) {
            Some(Remark::Suspicious(text)) => text,
            other => panic!("{other:?}"),
        };
        let package = FirmwarePackage::new(0, 1, vec![7; 1000]).to_bytes();
        assert_eq!(remark(&package, true), None);
        assert!(warning(&package, false).contains("simulated"));
        let mut damaged = package;
        damaged[100] ^= 1;
        assert!(warning(&damaged, true).contains("payload CRC32"));
        for (bytes, message) in [
            (&b"\x7fELF...."[..], "ELF"),
            (b":10000000AB", "HEX"),
            (b"\x97\x01\x00\x00....", "bare application"),
            (b"\x6f\x00\x80\x00....", "bare application"),
            (b"\xff\xff\xff\xff", "repeated byte"),
        ] {
            assert!(warning(bytes, false).contains(message), "{message}");
        }
        warning(b"\x00\x01 an unknown package header", true);
    }

    #[test]
    fn unknown_format_is_stated() {
        let unknown = remark(b"\x00\x01 an unknown package header", false).unwrap();
        assert_eq!(unknown, Remark::Unknown);
        assert_eq!(unknown.to_string(), "format not recognised; the gateway checks the package");
    }

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
