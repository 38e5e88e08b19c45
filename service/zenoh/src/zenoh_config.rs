//! Configuration file of Zenoh.

use std::path::Path;

use serde_json::Value;
use zenoh::Config;

use crate::publication_error::PublicationError;

/// Reads a configuration file of Zenoh. What it does not set has the default of Zenoh, except that
/// nothing listens and multicast scouting is off.
pub(crate) fn read(path: &Path) -> Result<Config, PublicationError> {
    let failed = |reason: String| PublicationError::ConfigFile { path: path.to_owned(), reason };
    let text = std::fs::read_to_string(path).map_err(|error| failed(error.to_string()))?;
    let value: Value = json5::from_str(&text).map_err(|error| failed(error.to_string()))?;
    let mut config = Config::from_json5(&text).map_err(|error| failed(error.to_string()))?;
    let listens = value.pointer("/listen/endpoints");
    let multicast = value.pointer("/scouting/multicast/enabled");
    let mut set =
        |key, value| config.insert_json5(key, value).map_err(|error| failed(error.to_string()));
    if listens.is_none() {
        set("listen/endpoints", "[]")?;
    }
    if multicast.is_none() {
        set("scouting/multicast/enabled", "false")?;
    }
    let has_endpoints = |it: Option<&Value>| match it {
        Some(Value::Array(endpoints)) => !endpoints.is_empty(),
        Some(Value::Object(modes)) => !modes.is_empty(),
        _ => false,
    };
    let connects = value.pointer("/connect/endpoints");
    if has_endpoints(listens) || has_endpoints(connects) || multicast == Some(&true.into()) {
        Ok(config)
    } else {
        Err(PublicationError::NoEndpoint { path: path.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(text: &str) -> Result<Config, PublicationError> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        read(file.path())
    }

    fn network(config: &Config) -> [String; 2] {
        ["listen/endpoints", "scouting/multicast/enabled"].map(|key| config.get_json(key).unwrap())
    }

    #[test]
    fn nothing_listens_unless_configured() {
        let silent = config("{ connect: { endpoints: ['tcp/10.0.0.1:7447'] } }").unwrap();
        assert_eq!(network(&silent), ["[]", "false"]);
        let listening = config("{ listen: { endpoints: ['tcp/127.0.0.1:7447'] } }").unwrap();
        assert_eq!(network(&listening), ["[\"tcp/127.0.0.1:7447\"]", "false"]);
        let scouting = config("{ scouting: { multicast: { enabled: true } } }").unwrap();
        assert_eq!(network(&scouting), ["[]", "true"]);
    }

    #[test]
    fn other_settings_are_unchanged() {
        let text = "{ mode: 'client', connect: { endpoints: ['tls/a:1'] }, \
                    access_control: { enabled: true, default_permission: 'deny' } }";
        let config = config(text).unwrap();
        assert_eq!(config.get_json("mode").unwrap(), "\"client\"");
        assert_eq!(config.get_json("access_control/default_permission").unwrap(), "\"deny\"");
    }

    #[test]
    fn wrong_files_are_rejected_with_the_reason() {
        for (text, words) in [
            ("{", "expected"),
            ("{ no_such_key: 1 }", "no_such_key"),
            ("{ mode: 'fast' }", "fast"),
            ("{}", "permits no connection"),
            ("{ connect: { endpoints: [] } }", "permits no connection"),
        ] {
            let error = config(text).unwrap_err().to_string();
            assert!(error.contains(words), "{text}: {error}");
        }
        let error = read(Path::new("/none/zenoh.json5")).unwrap_err().to_string();
        assert!(error.contains("/none/zenoh.json5: No such file"), "{error}");
    }
}
