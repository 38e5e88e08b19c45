//! Checks of a firmware file before it is written.
//!
//! The manual mentions a package header (13.8, 15.3.1) but not its format, nor an object with the size of a
//! partition: a file is rejected only if it cannot be firmware of any format. Other findings are remarks, the
//! file is sent, and the gateway decides.

use std::fmt;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use ecan_sim::{FirmwarePackage, FirmwarePackageError};

use crate::context::{Failure, Result};

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
}
