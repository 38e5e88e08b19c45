//! A firmware file, looked at before anything is written.
//!
//! The manual says that a package has a header (13.8, 15.3.1), not how it looks: so a file is
//! refused only where it can be no firmware at all, and what else is noticed is told.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use ecan_sim::{FirmwarePackage, FirmwarePackageError};

use crate::failure::Failure;

/// Less is no application.
const SMALLEST: usize = 256;
/// More than the flash of any such device.
const BIGGEST: u64 = 16 << 20;

/// A file that may be firmware.
#[derive(Clone, Debug)]
pub struct FirmwareFile {
    /// Where it is.
    pub path: PathBuf,
    /// What is in it.
    pub bytes: Vec<u8>,
}

impl FirmwareFile {
    /// Reads it.
    ///
    /// # Errors
    /// [`Failure::File`] if it cannot be read, is empty, or can be no firmware by its size.
    pub fn read(path: &Path) -> Result<Self, Failure> {
        let fault = |reason: String| Failure::File { what: "use", path: path.to_owned(), reason };
        let unread = |error: std::io::Error| Failure::File {
            what: "read",
            path: path.to_owned(),
            reason: match error.kind() {
                ErrorKind::IsADirectory => "it is a directory".to_owned(),
                _ => error.to_string(),
            },
        };
        let known = std::fs::metadata(path).map_err(unread)?;
        if known.len() > BIGGEST {
            return Err(fault(format!("{} bytes are too many for firmware", known.len())));
        }
        let bytes = std::fs::read(path).map_err(unread)?;
        match bytes.len() {
            0 => Err(fault("it is empty".to_owned())),
            few if few < SMALLEST => Err(fault(format!("{few} bytes are too few for firmware"))),
            _ => Ok(Self { path: path.to_owned(), bytes }),
        }
    }

    /// What the file seems to be, where that speaks against it.
    pub fn doubts(&self, is_simulated: bool) -> Option<String> {
        let bytes = &self.bytes[..];
        match FirmwarePackage::parse(bytes) {
            Ok(_) if is_simulated => return None,
            Ok(_) => {
                return Some(
                    "it is a package for simulated gateways (of ecan-sim); a real one refuses it"
                        .to_owned(),
                );
            }
            Err(FirmwarePackageError::NotAPackage | FirmwarePackageError::NoHeader { .. }) => {}
            Err(error) => {
                return Some(format!(
                    "it is a package for simulated gateways (of ecan-sim), and damaged: {error}"
                ));
            }
        }
        let bare = "a gateway takes the packaged ecan_lite_v*.bin";
        let kind = match bytes {
            [0x7F, b'E', b'L', b'F', ..] => "an ELF program",
            [b':', digit, ..] if digit.is_ascii_hexdigit() => "an Intel HEX file",
            [b'S', b'0'..=b'3', ..] => "an S-record file",
            [b'P', b'K', 3, 4, ..] => "a ZIP archive: unpack it first",
            [0x1F, 0x8B, ..] => "a gzip archive: unpack it first",
            _ if bytes.iter().all(|byte| Some(byte) == bytes.first()) => "the same byte all over",
            // The first instruction of a RISC-V start: jal, auipc, lui, csr.
            [first, ..] if matches!(first & 0x7F, 0x6F | 0x17 | 0x37 | 0x73) => {
                "a bare application that begins with an instruction"
            }
            _ if is_simulated => "no package of ecan-sim's format",
            _ => return None,
        };
        Some(format!("it looks like {kind}; {bare}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn doubts(bytes: &[u8], is_simulated: bool) -> Option<String> {
        FirmwareFile { path: PathBuf::new(), bytes: bytes.to_vec() }.doubts(is_simulated)
    }

    #[test]
    fn doubtful_files_are_named() {
        let package = FirmwarePackage::new(0, 1, vec![7; 1000]).to_bytes();
        assert_eq!(doubts(&package, true), None);
        assert!(doubts(&package, false).unwrap().contains("simulated"));
        let mut damaged = package;
        damaged[100] ^= 1;
        assert!(doubts(&damaged, true).unwrap().contains("damaged: payload CRC32"));
        for (bytes, words) in [
            (&b"\x7fELF...."[..], "ELF"),
            (b":10000000AB", "HEX"),
            (b"\x97\x01\x00\x00....", "bare application"),
            (b"\x6f\x00\x80\x00....", "bare application"),
            (b"\xff\xff\xff\xff", "same byte"),
        ] {
            assert!(doubts(bytes, false).unwrap().contains(words), "{words}");
        }
        assert_eq!(doubts(b"\x00\x01 a header that nobody here knows", false), None);
        assert!(doubts(b"\x00\x01 a header that nobody here knows", true).is_some());
    }
}
