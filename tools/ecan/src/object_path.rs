//! Objects as a user names them: by numbers, or by the names of the manual's tables.

use std::str::FromStr;

use ecan_protocol::object::{Object, objects};

use crate::value::parse_unsigned;

/// An entry of the object dictionary.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ObjectPath {
    pub index: u16,
    pub subindex: u8,
}

/// A name as it is compared: letters and digits, in lower case.
fn plain(name: &str) -> String {
    name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

/// The index that a text names, with `@N` for one of a family.
fn find_index(text: &str) -> Result<u16, String> {
    if let Some(number) = parse_unsigned(text) {
        return u16::try_from(number).map_err(|_| format!("{text} is no object index"));
    }
    let (name, nth) = match text.split_once('@') {
        None => (text, None),
        Some((name, nth)) => {
            let nth = nth.parse::<u16>().map_err(|_| format!("\"{nth}\" is no number"))?;
            (name, Some(nth))
        }
    };
    let wanted = plain(name);
    let found: Vec<_> = objects().iter().filter(|it| plain(it.name).contains(&wanted)).collect();
    let exact = found.iter().find(|object| plain(object.name) == wanted);
    let object: &Object = match (exact, &found[..]) {
        (Some(exact), _) => exact,
        (None, [only]) => only,
        (None, []) => return Err(format!("no object is called \"{name}\"; see `ecan sdo list`")),
        (None, several) => {
            let names: Vec<_> = several.iter().map(|object| object.name).collect();
            return Err(format!("\"{name}\" may be {}", names.join(", ")));
        }
    };
    match (nth, object.count) {
        (Some(nth), count) if nth >= count => {
            Err(format!("{} has only {count}, from @0 on", object.name))
        }
        (None, count) if count > 1 => {
            Err(format!("there are {count} of {}: write @0 to @{}", object.name, count - 1))
        }
        (nth, _) => Ok(object.first + nth.unwrap_or(0) * object.stride),
    }
}

fn find_subindex(index: u16, text: &str) -> Result<u8, String> {
    if let Some(number) = parse_unsigned(text) {
        return u8::try_from(number).map_err(|_| format!("{text} is no subindex"));
    }
    let object = ecan_protocol::object::object(index)
        .ok_or_else(|| format!("0x{index:04X} has no names; write the subindex as a number"))?;
    let wanted = plain(text);
    let entries = object.entries.iter().filter(|entry| plain(entry.name).contains(&wanted));
    let found: Vec<_> = entries.collect();
    let exact = found.iter().find(|entry| plain(entry.name) == wanted);
    match (exact, &found[..]) {
        (Some(entry), _) => Ok(entry.subindex),
        (None, [only]) => Ok(only.subindex),
        (None, []) => Err(format!("{} has no entry \"{text}\"", object.name)),
        (None, several) => {
            let names: Vec<_> = several
                .iter()
                .map(|entry| format!("{} (:{})", entry.name, entry.subindex))
                .collect();
            Err(format!("\"{text}\" of {} may be {}", object.name, names.join(", ")))
        }
    }
}

impl FromStr for ObjectPath {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (object, entry) = text.split_once(':').unwrap_or((text, "0"));
        let index = find_index(object)?;
        Ok(Self { index, subindex: find_subindex(index, entry)? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<(u16, u8), String> {
        text.parse::<ObjectPath>().map(|path| (path.index, path.subindex))
    }

    #[test]
    fn numbers_and_names_mean_the_same() {
        assert_eq!(parse("0x8010:3"), Ok((0x8010, 3)));
        assert_eq!(parse("32784:0x03"), Ok((0x8010, 3)));
        assert_eq!(parse("0x1008"), Ok((0x1008, 0)));
        assert_eq!(parse("TxPDO profile control:PDO size multiplier"), Ok((0x8010, 3)));
        assert_eq!(parse("mcan channel config@2:fd enable"), Ok((0x8003, 15)));
    }

    #[test]
    fn what_is_not_clear_is_said() {
        assert!(parse("0x8010:300").unwrap_err().contains("no subindex"));
        assert!(parse("0x18010:0").unwrap_err().contains("no object index"));
        assert!(parse("nonsense").unwrap_err().contains("ecan sdo list"));
        assert!(parse("mcan channel config:1").unwrap_err().contains("@0 to @3"));
        assert!(parse("mcan channel config@4:1").unwrap_err().contains("only 4"));
        assert!(parse("0x8010:nonsense").unwrap_err().contains("has no entry"));
        assert!(parse("pdo profile:1").unwrap_err().contains("may be"));
        assert!(parse("0x5555:name").unwrap_err().contains("as a number"));
    }
}
