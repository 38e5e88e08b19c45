//! Comparison of two configurations, setting by setting, and the method `reconfigure` of a service.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::time::Duration;

use ecan_lite::config::{FileFaults, load_profiles, parse_with};
use ecan_mcan_port::Config;
use ecan_service::client::METHOD_NOT_FOUND;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::config_file;
use crate::context::{Failure, Result};
use crate::service_access::ServiceConnection;

/// A setting in which two configurations differ.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Change {
    /// The setting, for example `gateway[0].can1.nominal_bitrate`.
    pub setting: String,
    pub before: String,
    pub after: String,
}

impl std::fmt::Display for Change {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { setting, before, after } = self;
        match before == after {
            true => write!(f, "{setting}: other {after}"),
            false => write!(f, "{setting}: {before} -> {after}"),
        }
    }
}

/// All differences, those of the EtherCAT side first.
pub fn changes(before: &Config, after: &Config) -> Vec<Change> {
    let mut found = Vec::new();
    // infallible: plain data
    let value = |config: &Config| {
        (
            serde_json::to_value(config.adapter).unwrap_or_default(),
            serde_json::to_value(config.port).unwrap_or_default(),
        )
    };
    let ((mut adapter, mut port), (mut new_adapter, mut new_port)) = (value(before), value(after));
    let lists =
        [("startup", &mut adapter, &mut new_adapter), ("filters", &mut port, &mut new_port)];
    let lists =
        lists.map(|(name, before, after)| (of_gateways(name, before), of_gateways(name, after)));
    compare("", &adapter, &new_adapter, &mut found);
    compare("", &port, &new_port, &mut found);
    for (before, after) in &lists {
        let none = Value::Array(Vec::new());
        let keys: BTreeSet<_> = before.keys().chain(after.keys()).collect();
        for key in keys {
            let list = |lists: &BTreeMap<_, _>| lists.get(key).cloned().unwrap_or(none.clone());
            compare(key, &list(before), &list(after), &mut found);
        }
    }
    found
}

/// Takes a list whose entries have the index of a gateway, by their settings.
fn of_gateways(name: &str, side: &mut Value) -> BTreeMap<String, Value> {
    let mut lists = BTreeMap::new();
    let entries = side.as_object_mut().and_then(|object| object.remove(name)).unwrap_or_default();
    for entry in entries.as_array().into_iter().flatten() {
        let number = |key| entry.get(key).and_then(Value::as_u64);
        let channel =
            number("channel").map_or_else(String::new, |channel| format!(".can{channel}"));
        let setting = format!("gateway[{}]{channel}.{name}", number("slave").unwrap_or_default());
        let list = lists.entry(setting).or_insert_with(|| Value::Array(Vec::new()));
        list.as_array_mut().into_iter().for_each(|entries| entries.push(entry.clone()));
    }
    lists
}

fn compare(path: &str, before: &Value, after: &Value, found: &mut Vec<Change>) {
    match (before, after) {
        _ if before == after => {}
        (Value::Object(one), Value::Object(other))
            if duration_us(before).is_none() && one.keys().eq(other.keys()) =>
        {
            for ((key, before), after) in one.iter().zip(other.values()) {
                compare(&member(path, key), before, after, found);
            }
        }
        // A list of filters or SDOs is one setting, those of gateways and channels are not.
        (Value::Array(one), Value::Array(other))
            if one.iter().chain(other).all(|entry| entry.is_object() || entry.is_null())
                && !path.ends_with(".filters")
                && !path.ends_with(".startup") =>
        {
            for at in 0..one.len().max(other.len()) {
                let item = |list: &[Value]| list.get(at).cloned().unwrap_or_default();
                let path = match path.strip_suffix(".channels") {
                    Some(gateway) => format!("{gateway}.can{at}"),
                    None => format!("{path}[{at}]"),
                };
                compare(&path, &item(one), &item(other), found);
            }
        }
        _ => {
            let (before, after) = (text(before), text(after));
            let change = Change { setting: path.to_owned(), before, after };
            // A gateway is an entry of both sides.
            if !found.contains(&change) {
                found.push(change);
            }
        }
    }
}

/// Path of a member, with the names of the configuration file.
fn member(path: &str, name: &str) -> String {
    match (path, name) {
        ("", "slaves" | "gateways") => "gateway".to_owned(),
        ("", name) => name.to_owned(),
        (path, "can") => path.to_owned(),
        (path, name) => format!("{path}.{name}"),
    }
}

fn text(value: &Value) -> String {
    match value {
        Value::Null => "none".to_owned(),
        Value::String(text) => text.clone(),
        Value::Array(items) if items.len() == 1 => "1 entry".to_owned(),
        Value::Array(items) => format!("{} entries", items.len()),
        Value::Object(_) => match duration_us(value) {
            Some(us) => format!("{us} us"),
            None => "set".to_owned(),
        },
        other => other.to_string(),
    }
}

fn duration_us(value: &Value) -> Option<f64> {
    let object = value.as_object().filter(|object| object.len() == 2)?;
    Some(object.get("secs")?.as_f64()? * 1e6 + object.get("nanos")?.as_f64()? / 1e3)
}

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
        let read = |path: &Path| config_file::read_input_text(path);
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

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use ecan_mcan_port::{ChannelConfig, GatewayConfig};
    use ecan_protocol::config::StandardFilter;

    use super::*;

    fn config() -> Config {
        let channel = ChannelConfig::classic(500_000);
        Config::new(Duration::from_millis(1)).with_gateway(GatewayConfig::on_channel(1, channel))
    }

    fn texts(before: &Config, after: &Config) -> Vec<String> {
        changes(before, after).iter().map(ToString::to_string).collect()
    }

    #[test]
    fn changes_have_names_and_values() {
        let before = config();
        assert_eq!(texts(&before, &before), [""; 0]);
        let mut after = config();
        after.adapter.cycle = Duration::from_micros(1500);
        after.adapter.slaves[0].rx_multiplier = 8;
        after.port.gateways[0].hold_limit = 20;
        let channel = after.port.gateways[0].channels[1].as_mut().unwrap();
        channel.can.nominal_bitrate = 250_000;
        channel.data_path.rx_drain_max = 4;
        let expected = [
            "cycle: 1000 us -> 1500 us",
            "gateway[0].rx_multiplier: 3 -> 8",
            "gateway[0].can1.nominal_bitrate: 500000 -> 250000",
            "gateway[0].can1.data_path.rx_drain_max: 8 -> 4",
            "gateway[0].hold_limit: 10 -> 20",
        ];
        assert_eq!(texts(&before, &after), expected);
    }

    #[test]
    fn added_parts_are_one_change_each() {
        let mut after = config().with_gateway(GatewayConfig::default());
        after.port.gateways[0].channels[0] = Some(ChannelConfig::classic(125_000));
        let filter = |id1| StandardFilter { id1, ..StandardFilter::default() };
        after.port.add_filter(0, 1, filter(1)).unwrap();
        let expected = [
            "gateway[1]: none -> set",
            "gateway[0].can0: none -> set",
            "gateway[0].can1.filters: 0 entries -> 1 entry",
        ];
        assert_eq!(texts(&config(), &after), expected);
        let before = after;
        after.port.filters.clear();
        after.port.add_filter(0, 1, filter(2)).unwrap();
        assert_eq!(texts(&before, &after), ["gateway[0].can1.filters: other 1 entry"]);
    }
}
