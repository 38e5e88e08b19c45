//! `ecan-sim firmware`: writes a firmware package for simulated gateways.

use std::path::PathBuf;
use std::str::FromStr;

use clap::Args;
use ecan_protocol::text::Printable;
use ecan_sim::FirmwarePackage;
use ecan_tool_support::command_line::new_file;

use crate::failure::Failure;
use crate::screen::Screen;

/// Size of the default application: some packets and flash sectors.
const APPLICATION_BYTES: usize = 64 << 10;

/// Write a firmware package for simulated gateways.
///
/// The FoE file name is ecan_lite_app. Real gateways reject it: the package format is the
/// simulator's own.
#[derive(Debug, Args)]
#[command(after_help = "Example: ecan-sim firmware --version 2.3.1 --out new.bin")]
pub struct FirmwareArguments {
    /// Firmware version: MAJOR.MINOR.BUILD, 0xF000:05 and :06
    #[arg(long)]
    version: Version,
    /// Output file
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Device type, 0xF000:01; a gateway rejects other types than its own
    #[arg(long, default_value_t = 0, value_name = "N")]
    device_type: u8,
    /// Application file [default: a pattern of 64 KiB]
    #[arg(long, value_name = "FILE")]
    application: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Version {
    major: u8,
    minor: u8,
    build: u16,
}

impl FromStr for Version {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let parse = || {
            let parts: Vec<_> = text.split('.').collect();
            let [major, minor, build] = parts.try_into().ok()?;
            Some(Self {
                major: u8::from_str(major).ok()?,
                minor: u8::from_str(minor).ok()?,
                build: u16::from_str(build).ok()?,
            })
        };
        parse().ok_or_else(|| "expected MAJOR.MINOR.BUILD, at most 255.255.65535".to_owned())
    }
}

impl Version {
    fn raw(self) -> u32 {
        u32::from_be_bytes([self.major, self.minor, 0, 0]) | u32::from(self.build)
    }
}

pub fn run(arguments: &FirmwareArguments) -> Result<(), Failure> {
    let FirmwareArguments { version, out, device_type, application } = arguments;
    let application = match application {
        Some(path) => std::fs::read(path).map_err(Failure::file("read", path))?,
        None => (0..APPLICATION_BYTES).map(|at| (at ^ (at >> 8)) as u8).collect(),
    };
    let file = FirmwarePackage::new(*device_type, version.raw(), application).to_bytes();
    new_file::write(out, &file).map_err(Failure::file("write", out))?;
    let Version { major, minor, build } = version;
    Screen::Output.line(format_args!(
        "{}: version {major}.{minor}.{build}, {} bytes, for simulated gateways only",
        Printable(out.display()),
        file.len()
    ));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_three_numbers() {
        let version: Version = "14.4.24079".parse().unwrap();
        assert_eq!(version.raw(), 0x0E04_5E0F);
        for wrong in ["", "1", "1.2", "1.2.3.4", "256.0.0", "1.2.65536", "a.b.c", "-1.0.0"] {
            assert!(wrong.parse::<Version>().is_err(), "{wrong}");
        }
    }
}
