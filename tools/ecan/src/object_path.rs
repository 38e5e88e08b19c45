//! Objects by number or by the names of the manual's tables.

use std::str::FromStr;

use ecan_protocol::object::{Entry, objects};

use crate::value::parse_unsigned;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ObjectPath {
    pub index: u16,
    pub subindex: u8,
}

/// Normalizes a name for comparison: letters and digits, in lower case.
fn plain(name: &str) -> String {
    name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

/// Finds the item of this name, or the only one whose name contains it; else returns all of these.
fn find<T: Copy>(
    items: impl IntoIterator<Item = T>,
    name: fn(T) -> &'static str,
    text: &str,
) -> Result<T, Vec<T>> {
    let text = plain(text);
    let found: Vec<_> = items.into_iter().filter(|it| plain(name(*it)).contains(&text)).collect();
    let exact = found.iter().find(|it| plain(name(**it)) == text);
    match (exact, &found[..]) {
        (Some(item), _) | (None, [item]) => Ok(*item),
        _ => Err(found),
    }
}

/// Finds the index of a number or name; `@N` selects one object of a family.
fn find_index(text: &str) -> Result<u16, String> {
    if let Some(number) = parse_unsigned(text) {
        return u16::try_from(number)
            .map_err(|_| format!("invalid object index {text}; allowed: 0 to 0xFFFF"));
    }
    let (name, nth) = match text.split_once('@') {
        None => (text, None),
        Some((name, nth)) => {
            let nth =
                nth.parse::<u16>().map_err(|_| format!("invalid number \"{nth}\" after @"))?;
            (name, Some(nth))
        }
    };
    let object = match find(objects().iter().copied(), |it| it.name, name) {
        Ok(object) => object,
        Err(several) if several.is_empty() => {
            return Err(format!("unknown object \"{name}\"; see `ecan sdo list`"));
        }
        Err(several) => {
            let names: Vec<_> = several.iter().map(|object| object.name).collect();
            return Err(format!("ambiguous object \"{name}\"; candidates: {}", names.join(", ")));
        }
    };
    match (nth, object.count) {
        (Some(nth), count) if nth >= count => {
            Err(format!("{}@{nth} does not exist; allowed: @0 to @{}", object.name, count - 1))
        }
        (None, count) if count > 1 => {
            Err(format!("{} is a family; select @0 to @{}", object.name, count - 1))
        }
        (nth, _) => Ok(object.first + nth.unwrap_or(0) * object.stride),
    }
}

fn find_subindex(index: u16, text: &str) -> Result<u8, String> {
    if let Some(number) = parse_unsigned(text) {
        return u8::try_from(number)
            .map_err(|_| format!("invalid subindex {text}; allowed: 0 to 255"));
    }
    let object = ecan_protocol::object::object(index)
        .ok_or_else(|| format!("entries of 0x{index:04X} have no names; use a number"))?;
    find(object.entries, |entry| entry.name, text).map(|entry| entry.subindex).map_err(|several| {
        let name = |entry: &&Entry| format!("{} (:{})", entry.name, entry.subindex);
        let names: Vec<_> = several.iter().map(name).collect();
        match names.is_empty() {
            true => format!("{} has no entry \"{text}\"", object.name),
            false => {
                let names = names.join(", ");
                format!("ambiguous entry \"{text}\" of {}; candidates: {names}", object.name)
            }
        }
    })
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
    fn numbers_and_names_select_objects() {
        assert_eq!(parse("0x8010:3"), Ok((0x8010, 3)));
        assert_eq!(parse("32784:0x03"), Ok((0x8010, 3)));
        assert_eq!(parse("0x1008"), Ok((0x1008, 0)));
        assert_eq!(parse("TxPDO profile control:PDO size multiplier"), Ok((0x8010, 3)));
        assert_eq!(parse("mcan channel config@2:fd enable"), Ok((0x8003, 15)));
    }

    #[test]
    fn ambiguous_or_unknown_path_is_rejected() {
        assert!(parse("0x8010:300").unwrap_err().contains("invalid subindex"));
        assert!(parse("0x18010:0").unwrap_err().contains("invalid object index"));
        assert!(parse("nonsense").unwrap_err().contains("ecan sdo list"));
        assert!(parse("mcan channel config:1").unwrap_err().contains("@0 to @3"));
        assert!(parse("mcan channel config@4:1").unwrap_err().contains("@0 to @3"));
        assert!(parse("0x8010:nonsense").unwrap_err().contains("has no entry"));
        assert!(parse("pdo profile:1").unwrap_err().contains("ambiguous"));
        assert!(parse("0x5555:name").unwrap_err().contains("use a number"));
    }
}
