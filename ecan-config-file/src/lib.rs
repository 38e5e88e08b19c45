//! One TOML file that describes the gateways of a bus, for applications and tools (manual 5.4.3,
//! 13.2 to 13.4, 14).
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let directory = tempfile::tempdir()?;
//! # let path = directory.path().join("cell.toml");
//! # std::fs::write(&path, ecan_config_file::EXAMPLE)?;
//! # use ecan_sim::{EcrtSetting, SimOptions};
//! # let setting = EcrtSetting::resolve(Some("sim"))?;
//! # let ecrt = ecan_sim::open(&setting, &SimOptions::default())?.ecrt;
//! // `ecrt` is the loaded library, `path` the file.
//! let file = ecan_config_file::load(path)?;
//! let port = ecan_mcan_port::Port::open(&ecrt, (file.adapter, file.port))?;
//! assert_eq!(port.slave_count(), 1);
//! # Ok(()) }
//! ```
//!
//! [`EXAMPLE`] is such a file with every key in it. A key that is not known is a fault, and so is a
//! value that the gateway would refuse; all of them are told at once, with line and column.
//!
//! What a file says is plain data ([`ConfigFile`]). [`apply`] writes it to a gateway, [`differences`]
//! compares, [`FlashCommand::run`] keeps it in the gateway's Flash, and [`export`] makes startup
//! lists for other masters of it. All of these block and allocate: they are not for the cycle.
#![deny(missing_docs)]
#![forbid(unsafe_code)]

mod bus;
mod channel;
mod check;
mod compare;
mod device;
mod difference;
mod document;
pub mod export;
mod fault;
mod fields;
mod filter;
mod filter_compare;
mod flash;
mod gateway;
mod idle_keys;
mod warning;

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;
use std::str::FromStr;

use ecan_host::{AdapterConfig, Expectation, StartupStep};
use ecan_mcan_port::PortConfig;

pub use compare::differences;
pub use device::{ResolveError, ResolvedGateway, apply, find};
pub use difference::{Difference, Expected};
pub use fault::{ConfigFileError, FileFault, FileFaults};
pub use flash::{ConfigChecksums, FlashCommand};
pub use warning::{Elements, FileWarning};

use document::{Document, Table};

/// A commented file with every key that there is, at the values that are taken where a key is left
/// out, as far as there are such values.
pub const EXAMPLE: &str = include_str!("example.toml");

/// What a file says: the configurations of Adapter and Port, checked together.
#[derive(Clone, Debug, PartialEq)]
pub struct ConfigFile {
    /// The EtherCAT side. Policies of 0x8020, if the file has any, are in its
    /// [`startup`](AdapterConfig::startup).
    pub adapter: AdapterConfig,
    /// The CAN side, one gateway for each slave.
    pub port: PortConfig,
}

impl ConfigFile {
    /// The complete startup sequence of a gateway (manual 5.4.3, phases A to E, and 13.2.2): checks
    /// of its abilities, PDO assignment, profiles, channels with their filters and data paths, each
    /// with its readback. Checks that any value meets, as of the bits of no option, are left out.
    /// Empty for a gateway that the file does not have.
    pub fn startup(&self, gateway: usize) -> Vec<StartupStep> {
        let mut steps = self.port.startup_plan(&self.adapter).steps(&self.adapter, gateway);
        steps.retain(|step| {
            let StartupStep::Expect { expected, .. } = step else { return true };
            !matches!(expected, Expectation::HasBits(0) | Expectation::AtLeast(0))
        });
        steps
    }
}

impl FromStr for ConfigFile {
    type Err = FileFaults;

    /// Reads a configuration from the text of a file.
    fn from_str(text: &str) -> Result<Self, FileFaults> {
        read(text, &[])
    }
}

/// Reads the text; `foreign` are the places in it of what was no text.
fn read(text: &str, foreign: &[(usize, u8)]) -> Result<ConfigFile, FileFaults> {
    let (mut document, root) = Document::parse(text);
    for (at, byte) in foreign {
        document.invalid_byte(*at, *byte);
    }
    let file = bus::read(&mut document, Table::root(&root));
    if document.is_valid_toml() {
        check::check(&mut document, &file);
    }
    document.finish()?;
    Ok(file)
}

/// Reads a configuration from the bytes of a file, which are UTF-8.
///
/// # Errors
/// Everything that is wrong with it, with line and column; bytes that are not UTF-8 hide nothing
/// else.
pub fn parse(bytes: &[u8]) -> Result<ConfigFile, FileFaults> {
    let mut text = String::with_capacity(bytes.len());
    let mut foreign = Vec::new();
    for chunk in bytes.utf8_chunks() {
        text.push_str(chunk.valid());
        if let Some(byte) = chunk.invalid().first() {
            foreign.push((text.len(), *byte));
            text.push(char::REPLACEMENT_CHARACTER);
        }
    }
    read(&text, &foreign)
}

/// No configuration has so many bytes: what is read instead is a device, or a log by mistake.
const MAX_BYTES: u64 = 16 << 20;

fn bytes(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    File::open(path)?.take(MAX_BYTES + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MAX_BYTES {
        let reason = "more than 16 MiB is no configuration";
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, reason));
    }
    Ok(bytes)
}

/// Reads a configuration from a file of at most 16 MiB.
///
/// # Errors
/// The file cannot be read, or everything that is wrong with it, with line and column.
pub fn load(path: impl AsRef<Path>) -> Result<ConfigFile, ConfigFileError> {
    let path = path.as_ref();
    let bytes =
        bytes(path).map_err(|reason| ConfigFileError::Read { path: path.to_owned(), reason })?;
    parse(&bytes).map_err(|faults| ConfigFileError::Faults { path: path.to_owned(), faults })
}
