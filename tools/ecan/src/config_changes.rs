//! Comparison of two configurations, setting by setting.

use ecan_mcan_port::Config;
use serde::{Deserialize, Serialize};
use serde_json::Value;

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
    let ((adapter, port), (new_adapter, new_port)) = (value(before), value(after));
    compare("", &adapter, &new_adapter, &mut found);
    compare("", &port, &new_port, &mut found);
    found
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
            if one.iter().chain(other).all(|it| it.is_object() || it.is_null())
                && !["filters", "startup"].contains(&path) =>
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
        Value::Array(items) => format!("{} entries", items.len()),
        Value::Object(_) => match duration_us(value) {
            Some(us) => format!("{us} us"),
            None => "set".to_owned(),
        },
        other => other.to_string(),
    }
}

fn duration_us(value: &Value) -> Option<f64> {
    let object = value.as_object().filter(|it| it.len() == 2)?;
    Some(object.get("secs")?.as_f64()? * 1e6 + object.get("nanos")?.as_f64()? / 1e3)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use ecan_mcan_port::{ChannelConfig, GatewayConfig};

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
        let expected = ["gateway[1]: none -> set", "gateway[0].can0: none -> set"];
        assert_eq!(texts(&config(), &after), expected);
    }
}
