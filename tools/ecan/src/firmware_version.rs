//! Firmware version and serial number of a gateway (manual 13.8).

use std::fmt;

use serde::Serialize;

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FirmwareVersion {
    /// 0x100A, if the gateway has it.
    pub firmware: Option<String>,
    /// 0xF000:05 and :06 as MAJOR.MINOR.BUILD.
    pub numbers: String,
    /// 0xF000:05, the high byte is major, the low byte minor.
    pub version: u16,
    /// 0xF000:06.
    pub build: u16,
}

impl FirmwareVersion {
    /// Builds the version from 0x100A and the numbers of 0xF000; `number` reads a subindex.
    pub fn read<E>(
        firmware: Option<String>,
        mut number: impl FnMut(u8) -> Result<u32, E>,
    ) -> Result<Self, E> {
        let (version, build) = (number(5)? as u16, number(6)? as u16);
        let [major, minor] = version.to_be_bytes();
        Ok(Self { firmware, numbers: format!("{major}.{minor}.{build}"), version, build })
    }

    /// Returns whether `named` is this version, as text of 0x100A or as numbers.
    pub fn is_version(&self, named: &str) -> bool {
        Some(named) == self.firmware.as_deref() || named == self.numbers
    }
}

impl fmt::Display for FirmwareVersion {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.firmware {
            Some(text) if *text != self.numbers => write!(formatter, "{text} ({})", self.numbers),
            _ => formatter.write_str(&self.numbers),
        }
    }
}

/// Reads the serial number of 0xF000:07 and :08; `number` reads a subindex.
pub fn serial_number<E>(mut number: impl FnMut(u8) -> Result<u32, E>) -> Result<u64, E> {
    Ok(u64::from(number(7)?) | u64::from(number(8)?) << 32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn version_matches_text_or_numbers() {
        let read = |text: Option<&str>| {
            let number = |subindex| Ok::<_, ()>(if subindex == 5 { 0x0E04 } else { 94 });
            FirmwareVersion::read(text.map(str::to_owned), number).unwrap()
        };
        let named = read(Some("v140494"));
        assert_eq!(named.to_string(), "v140494 (14.4.94)");
        assert!(named.is_version("v140494") && named.is_version("14.4.94"));
        assert!(!named.is_version("14.4.9"));
        assert_eq!(read(Some("14.4.94")).to_string(), "14.4.94");
        assert_eq!(read(None).to_string(), "14.4.94");
    }

    #[test]
    fn serial_number_combines_two_halves() {
        let halves = |subindex| if subindex == 7 { Ok(2) } else { Err(subindex) };
        assert_eq!(serial_number(halves), Err(8));
        assert_eq!(serial_number(|subindex| Ok::<_, ()>(subindex.into())), Ok(0x8_0000_0007));
    }
}
