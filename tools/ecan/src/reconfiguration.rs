//! Method `reconfigure` of the service of `ecan serve`.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use ecan_lite::config::{FileFaults, load_profiles, parse_with};
use ecan_mcan_port::Config;
use ecan_service::client::METHOD_NOT_FOUND;
use serde::{Deserialize, Serialize};

use crate::config_changes::Change;
use crate::config_file;
use crate::context::{Failure, Result};
use crate::input_file;
use crate::service_access::ServiceConnection;

pub const METHOD: &str = "reconfigure";

/// Longest startup, and return to the former configuration, of all gateways.
const TIMEOUT: Duration = Duration::from_secs(600);

/// Parameters: a configuration file.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConfigText {
    /// Name for messages.
    pub name: String,
    pub text: String,
    /// Texts of the device profiles that it includes, by their names in it.
    #[serde(default)]
    pub files: BTreeMap<String, String>,
}

/// Result: the gateways are ready.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Report {
    pub gateways: Vec<ReadyGateway>,
    /// Settings that differ from the former configuration.
    pub changes: Vec<Change>,
    pub warnings: Vec<String>,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ReadyGateway {
    pub position: usize,
    /// Index in the file.
    pub gateway: usize,
}

impl ConfigText {
    /// Reads a file and the device profiles that it includes.
    pub fn read(path: &Path) -> Result<Self> {
        let read = |path: &Path| input_file::read_text(path);
        let base = path.parent().unwrap_or(Path::new(""));
        let profiles = load_profiles(path).map_err(config_file::failure)?;
        let mut files = BTreeMap::new();
        for included in profiles {
            let name = included.path.strip_prefix(base).unwrap_or(&included.path);
            files.insert(name.display().to_string(), read(&included.path)?);
        }
        Ok(Self { name: path.display().to_string(), text: read(path)?, files })
    }

    pub fn parse(&self) -> Result<Config, FileFaults> {
        parse_with(self.text.as_bytes(), self.files.clone())
    }
}

/// Configures the gateways of a service. `None` if the service does not have the method.
pub fn request(connection: &ServiceConnection, config: &ConfigText) -> Result<Option<Report>> {
    let unreadable = |error: serde_json::Error| {
        Failure::Master(format!("{}: response cannot be read: {error}", connection.program()))
    };
    let params = serde_json::to_value(config).map_err(unreadable)?;
    match connection.client().call_within(METHOD, params, TIMEOUT) {
        Ok(result) => serde_json::from_value(result).map(Some).map_err(unreadable),
        Err(error) => match error.rpc() {
            Some(rpc) if rpc.code == METHOD_NOT_FOUND => Ok(None),
            Some(rpc) if rpc.code != ecan_service::client::NOT_PERMITTED => {
                Err(Failure::Rejected(format!("{}: {rpc}", connection.program())))
            }
            _ => Err(Failure::Device(connection.error(METHOD, &error))),
        },
    }
}
