//! Support bundle: everything that was read, with versions and the state of the host.

use std::path::Path;

use ecan_tool_support::command_line::new_file;
use ecan_tool_support::diagnosis::Snapshot;
use serde::{Deserialize, Serialize};

use crate::context::{Failure, Result};
use crate::input_file;

const FORMAT: &str = "ecan-diagnosis";
const VERSION: u32 = 1;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Bundle {
    format: String,
    version: u32,
    pub(super) program: String,
    /// Time in seconds since 1970, UTC.
    pub(super) taken_s: u64,
    pub(super) host: Host,
    pub(super) master: Master,
    pub(super) gateway: Gateway,
    pub(super) snapshot: Snapshot,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Host {
    pub(super) kernel: String,
    pub(super) system: String,
    pub(super) cpus: usize,
    pub(super) library: String,
    pub(super) module: Option<String>,
    pub(super) is_simulated: bool,
    /// Results of `ecan doctor`.
    pub(super) checks: serde_json::Value,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Master {
    pub(super) index: u32,
    pub(super) link_up: bool,
    pub(super) slaves_responding: u32,
    pub(super) slaves: Vec<Slave>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Slave {
    pub(super) position: u16,
    pub(super) alias: u16,
    pub(super) name: String,
    pub(super) vendor_id: u32,
    pub(super) product_code: u32,
    pub(super) revision: u32,
    pub(super) al_state: u8,
    pub(super) has_error_flag: bool,
    pub(super) sync_managers: u8,
    /// Link state of the ports 0 to 3.
    pub(super) links: [bool; 4],
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Gateway {
    pub(super) name: String,
    /// 0x100A and 0x1009; `None` if not read.
    pub(super) firmware: Option<String>,
    pub(super) hardware: Option<String>,
    pub(super) serial: Option<u64>,
}

impl Bundle {
    pub(super) fn new(host: Host, master: Master, gateway: Gateway, snapshot: Snapshot) -> Self {
        let since_1970 = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
        Self {
            format: FORMAT.to_owned(),
            version: VERSION,
            program: format!("ecan {}", env!("CARGO_PKG_VERSION")),
            taken_s: since_1970.map_or(0, |time| time.as_secs()),
            host,
            master,
            gateway,
            snapshot,
        }
    }

    pub(super) fn save(&self, path: &Path) -> Result {
        let mut text = serde_json::to_string_pretty(self)
            .map_err(|error| Failure::file("write", path, error))?;
        text.push('\n');
        new_file::write(path, text).map_err(|error| Failure::file("write", path, error))
    }

    pub(super) fn load(path: &Path) -> Result<Self> {
        let text = input_file::read_text(path)?;
        let wrong = |reason: String| Failure::file("understand", path, reason);
        // Check format and version first: this gives a better message than the first missing field.
        let value: serde_json::Value =
            serde_json::from_str(&text).map_err(|error| wrong(format!("invalid JSON: {error}")))?;
        if value["format"] != FORMAT {
            return Err(wrong("not a bundle of `ecan diag --record`".to_owned()));
        }
        if value["version"] != VERSION {
            let version = &value["version"];
            return Err(wrong(format!(
                "bundle version {version} is not supported; supported: {VERSION}"
            )));
        }
        serde_json::from_value(value).map_err(|error| wrong(error.to_string()))
    }
}
