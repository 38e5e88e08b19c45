//! JSON schema of the configuration file, for editors: recorded from the functions that read the file.

use std::collections::BTreeMap;

use serde_json::{Map, Value, json};

use crate::config_file::bus;
use crate::config_file::document::{Document, Form, Recorder, Table};

/// A commented file with every key. The values are the defaults, unless a comment says otherwise.
pub const EXAMPLE: &str = include_str!("example.toml");

/// A first file with one gateway and one channel.
pub const INIT: &str = include_str!("init.toml");

/// Returns the JSON schema of a configuration file, for editors such as those with taplo.
pub fn schema() -> String {
    let recorder = Document::record(|document, root| drop(bus::read(Table::root(document, root))));
    let mut schema = recorder.table(("", "#"), &descriptions(EXAMPLE));
    schema.insert("$schema".to_owned(), json!("http://json-schema.org/draft-07/schema#"));
    schema.insert("title".to_owned(), json!("Configuration of ECAN-Lite gateways"));
    let mut text = serde_json::to_string_pretty(&schema).unwrap_or_default();
    text.push('\n');
    text
}

/// Path of the first element of an array of tables, and of others that are read like it.
fn element(path: &str) -> String {
    format!("{path}[0]")
}

impl Recorder {
    /// Schema of a table with this path, at this place of the schema.
    fn table(
        &self,
        (path, place): (&str, &str),
        descriptions: &Descriptions,
    ) -> Map<String, Value> {
        let keys = self.keys.borrow().get(path).cloned().unwrap_or_default();
        let mut properties = Map::new();
        let mut required = Vec::new();
        let mut tables: Vec<(String, Value)> = Vec::new();
        for (key, form) in keys {
            let own = join(path, key);
            let place = format!("{place}/properties/{key}");
            let mut property = self.property((&own, &place), form, descriptions);
            if let Some(text) = descriptions.get(&described(&own)) {
                property.insert("description".to_owned(), json!(text));
            }
            let property = Value::Object(property);
            // The channels are equal.
            let equal = tables.iter().find(|(_, other)| *other == property);
            let reference = equal.map(|(place, _)| json!({ "$ref": place }));
            if reference.is_none() && !property["properties"].is_null() {
                tables.push((place, property.clone()));
            }
            properties.insert(key.to_owned(), reference.unwrap_or(property));
            if self.required.borrow().contains(&own) {
                required.push(key);
            }
        }
        let mut table = Map::new();
        table.insert("type".to_owned(), json!("object"));
        table.insert("properties".to_owned(), Value::Object(properties));
        let others = match self.open.borrow().contains(path) {
            true => json!({ "type": ["number", "boolean", "string"] }),
            false => json!(false),
        };
        table.insert("additionalProperties".to_owned(), others);
        if !required.is_empty() {
            table.insert("required".to_owned(), json!(required));
        }
        table
    }

    fn property(
        &self,
        (path, place): (&str, &str),
        form: Form,
        descriptions: &Descriptions,
    ) -> Map<String, Value> {
        let value = match form {
            Form::Flag => json!({ "type": "boolean" }),
            Form::Integer { min, max } => {
                json!({ "type": "integer", "minimum": min, "maximum": max })
            }
            Form::Number { min, max } => {
                json!({ "type": "number", "minimum": min, "maximum": max })
            }
            Form::AnyNumber => json!({ "type": "number" }),
            Form::Text => json!({ "type": "string" }),
            Form::Texts => json!({ "type": "array", "items": { "type": "string" } }),
            // TOML has dates of its own; an editor passes their text.
            Form::Date => json!({ "type": "string", "format": "date-time" }),
            Form::Word(words) => json!({ "enum": words }),
            Form::Words(words) => json!({ "type": "array", "items": { "enum": words } }),
            Form::Integers { min, max, count } => {
                let items = json!({ "type": "integer", "minimum": min, "maximum": max });
                match count {
                    None => json!({ "type": "array", "items": items }),
                    Some(count) => json!({
                        "type": "array", "items": items, "minItems": count, "maxItems": count
                    }),
                }
            }
            Form::Percentages => {
                let percentage = json!({ "type": "number", "minimum": 0, "maximum": 100 });
                json!({ "anyOf": [
                    percentage,
                    { "type": "array", "items": percentage, "minItems": 2, "maxItems": 2 },
                ] })
            }
            Form::Table => Value::Object(self.table((path, place), descriptions)),
            Form::Tables => {
                let items = self.table((&element(path), &format!("{place}/items")), descriptions);
                json!({ "type": "array", "items": items })
            }
            Form::TableOrTables => {
                let one = format!("{place}/anyOf/0");
                json!({ "anyOf": [
                    self.table((&element(path), &one), descriptions),
                    { "type": "array", "items": { "$ref": one } },
                ] })
            }
        };
        match value {
            Value::Object(property) => property,
            _ => Map::new(),
        }
    }
}

fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") }
}

/// Texts by the paths of their keys, without indices.
type Descriptions = BTreeMap<String, String>;

/// Path of a key in the example, which shows the keys of one channel and of one direction with comments.
fn described(path: &str) -> String {
    let mut path = path.replace("[0]", "");
    for channel in ["can1", "can2", "can3"] {
        path = path.replace(&format!("gateway.{channel}."), "gateway.can0.");
    }
    path.replace("node.axis.", "axis.")
}

/// Reads the comments after the keys of an example, also of keys that are commented out.
fn descriptions(example: &str) -> Descriptions {
    let mut found = Descriptions::new();
    let mut table = String::new();
    let mut last: Option<String> = None;
    for line in example.lines() {
        let is_continued = line.starts_with("   ") && line.trim_start().starts_with("# ");
        if let (true, Some(path)) = (is_continued, &last) {
            let text = line.trim_start().trim_start_matches("# ");
            if let Some(known) = found.get_mut(path) {
                known.push(' ');
                known.push_str(text);
            }
            continue;
        }
        last = None;
        let line = line.strip_prefix("# ").unwrap_or(line);
        if let Some(header) = line.strip_prefix('[') {
            table = header.trim_start_matches('[').split(']').next().unwrap_or("").to_owned();
            continue;
        }
        let Some((key, rest)) = line.split_once(" = ") else { continue };
        let is_key = key
            .bytes()
            .all(|byte| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'_');
        if let (true, Some((_, text))) = (is_key, rest.split_once(" # ")) {
            let path = join(&table, key);
            found.entry(path.clone()).or_insert_with(|| text.trim().to_owned());
            last = Some(path);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at<'s>(schema: &'s Value, path: &[&str]) -> &'s Value {
        path.iter().fold(schema, |value, key| match value["items"].is_null() {
            true => &value["properties"][key],
            false => &value["items"]["properties"][key],
        })
    }

    #[test]
    fn schema_has_ranges_words_and_comments() {
        let schema: Value = serde_json::from_str(&schema()).unwrap();
        let n = at(&schema, &["gateway", "n"]);
        assert_eq!((&n["minimum"], &n["maximum"]), (&json!(1), &json!(24)));
        assert!(n["description"].as_str().unwrap().starts_with("size of both PDOs"), "{n}");
        let others = ["can1", "can2", "can3"].map(|key| &at(&schema, &["gateway", key])["$ref"]);
        let first = json!("#/properties/gateway/items/properties/can0");
        assert_eq!(others, [&first, &first, &first]);
        let mode = at(&schema, &["gateway", "can0", "node_mode"]);
        assert_eq!(
            mode["enum"],
            json!(["normal", "listen", "internal_loopback", "external_loopback"])
        );
        assert_eq!(at(&schema, &["gateway", "can0"])["required"], json!(["bitrate"]));
        let filter = at(&schema, &["gateway", "can0", "standard_filter"]);
        assert_eq!(filter["items"]["required"], json!(["action", "id1"]));
        assert!(filter["items"]["properties"]["rx_buffer"].is_object(), "{filter}");
        let inputs = at(&schema, &["axis", "inputs"])["description"].as_str().unwrap();
        assert!(inputs.contains("probe_2_negative, vl_velocity"), "{inputs}");
        assert_eq!(schema["additionalProperties"], json!(false));
        let parameters = at(&schema, &["node", "parameters"]);
        assert_eq!(
            parameters["additionalProperties"]["type"],
            json!(["number", "boolean", "string"])
        );
    }

    #[test]
    fn first_file_is_valid() {
        let file = crate::config_file::parse(crate::config_file::INIT.as_bytes()).unwrap();
        assert_eq!(file.adapter.slaves[0].rx_multiplier, 3);
        assert_eq!(file.port.gateways[0].channel_mask(), 1);
    }
}
