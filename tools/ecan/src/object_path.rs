//! Objects by number or by the names of the manual's tables.

use std::str::FromStr;

use ecan_protocol::object::{Entry, Object, objects};

use crate::value::{parse_unsigned, reject_without_prefix};

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
    let found: Vec<_> =
        items.into_iter().filter(|candidate| plain(name(*candidate)).contains(&text)).collect();
    let exact = found.iter().find(|candidate| plain(name(**candidate)) == text);
    match (exact, &found[..]) {
        (Some(item), _) | (None, [item]) => Ok(*item),
        _ => Err(found),
    }
}

/// Number of similar names in a message.
const SIMILAR: usize = 3;
/// Number of candidates in a message.
const SHOWN: usize = 8;

/// The most similar names, in the form `; similar: A, B`.
fn similar(text: &str, names: impl Iterator<Item = String>) -> String {
    let text = plain(text);
    // An entry counts by its own name, too.
    let likeness = |name: &str| {
        let own = name.rsplit(':').next().unwrap_or(name);
        let of = |name: &str| strsim::normalized_damerau_levenshtein(&plain(name), &text);
        of(name).max(of(own))
    };
    let mut near: Vec<_> = names.map(|name| (likeness(&name), name)).collect();
    near.retain(|(likeness, _)| *likeness > 0.6);
    near.sort_by(|a, b| b.0.total_cmp(&a.0));
    let near: Vec<_> = near.into_iter().take(SIMILAR).map(|(_, name)| name).collect();
    if near.is_empty() { String::new() } else { format!("; similar: {}", near.join(", ")) }
}

fn is_known(index: u16) -> bool {
    ecan_protocol::object::object(index).is_some()
}

/// A name, and the number after `@`, which selects one object of a family.
fn split_number(text: &str) -> Result<(&str, Option<u16>), String> {
    let Some((name, nth)) = text.split_once('@') else { return Ok((text, None)) };
    let number = nth.parse().map_err(|_| format!("invalid number \"{nth}\" after @"))?;
    Ok((name, Some(number)))
}

/// The index of an object, or of one object of a family.
fn index_of(object: &Object, nth: Option<u16>) -> Result<u16, String> {
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

/// Finds an entry by its name without that of its object, if only one has it.
fn find_entry(text: &str) -> Result<ObjectPath, String> {
    let (name, nth) = split_number(text)?;
    let entries = || {
        objects().iter().flat_map(|object| object.entries.iter().map(move |entry| (*object, entry)))
    };
    let full_name = |(object, entry): (&Object, &Entry)| format!("{}:{}", object.name, entry.name);
    let wanted = plain(name);
    let all: Vec<_> = entries().filter(|(_, it)| plain(it.name).contains(&wanted)).collect();
    let exact: Vec<_> = all.iter().copied().filter(|(_, it)| plain(it.name) == wanted).collect();
    match if exact.is_empty() { &all[..] } else { &exact[..] } {
        [(object, entry)] => {
            Ok(ObjectPath { index: index_of(object, nth)?, subindex: entry.subindex })
        }
        [] => {
            let names = objects()
                .iter()
                .map(|object| object.name.to_owned())
                .chain(entries().map(full_name));
            let near = similar(name, names);
            Err(format!("unknown object \"{name}\"{near}; see `ecan sdo list`"))
        }
        several => {
            let names: Vec<_> = several.iter().take(SHOWN).copied().map(full_name).collect();
            let more = if several.len() > SHOWN { ", ..." } else { "" };
            Err(format!("ambiguous entry \"{name}\"; candidates: {}{more}", names.join(", ")))
        }
    }
}

/// Finds the index of a number or name; `@N` selects one object of a family. `None` for an unknown
/// name.
fn find_index(text: &str) -> Result<Option<u16>, String> {
    reject_without_prefix(text, is_known)?;
    if let Some(number) = parse_unsigned(text) {
        return u16::try_from(number)
            .map(Some)
            .map_err(|_| format!("invalid object index {text}; allowed: 0 to 0xFFFF"));
    }
    let (name, nth) = split_number(text)?;
    match find(objects().iter().copied(), |object| object.name, name) {
        Ok(object) => index_of(object, nth).map(Some),
        Err(several) if several.is_empty() => Ok(None),
        Err(several) => {
            let names: Vec<_> = several.iter().map(|object| object.name).collect();
            Err(format!("ambiguous object \"{name}\"; candidates: {}", names.join(", ")))
        }
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
            true => {
                let near = similar(text, object.entries.iter().map(|entry| entry.name.to_owned()));
                format!("{} has no entry \"{text}\"{near}", object.name)
            }
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
        match text.split_once(':') {
            None => match find_index(text)? {
                Some(index) => Ok(Self { index, subindex: 0 }),
                None => find_entry(text),
            },
            Some((object, entry)) => {
                let index = find_index(object)?.ok_or_else(|| {
                    let near =
                        similar(object, objects().iter().map(|object| object.name.to_owned()));
                    format!("unknown object \"{object}\"{near}; see `ecan sdo list`")
                })?;
                Ok(Self { index, subindex: find_subindex(index, entry)? })
            }
        }
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
    fn entry_is_found_without_its_object() {
        assert_eq!(parse("serial number low"), Ok((0xF000, 7)));
        assert_eq!(parse("Maintenance status"), Ok((0xB000, 5)));
        assert_eq!(parse("fd enable@2"), Ok((0x8003, 15)));
        let several = parse("pdo size multiplier").unwrap_err();
        let expected = "ambiguous entry \"pdo size multiplier\"; candidates: TxPDO Profile Control:PDO \
                        size multiplier, RxPDO Profile Control:PDO size multiplier";
        assert!(several.starts_with(expected), "{several}");
        assert!(parse("fd enable").unwrap_err().contains("@0 to @3"));
    }

    #[test]
    fn similar_names_are_listed() {
        let error = parse("serial numbr low").unwrap_err();
        assert!(error.contains("; similar: Device Objects:Serial number low"), "{error}");
        let error = parse("0xB000:maintenance sttus").unwrap_err();
        assert!(error.contains("; similar: Maintenance status"), "{error}");
        let error = parse("device maintenence:1").unwrap_err();
        assert!(error.contains("; similar: Device Maintenance"), "{error}");
        assert!(!parse("nonsense").unwrap_err().contains("similar"));
    }

    #[test]
    fn hexadecimal_index_without_prefix_is_asked_for() {
        let expected = "8010 is read as the decimal number of 0x1F4A, which is no known object; for the \
                        hexadecimal index 0x8010 write 0x8010, or 0x1F4A for the other";
        assert_eq!(parse("8010:3").unwrap_err(), expected);
        assert!(parse("8010").unwrap_err().contains("write 0x8010"));
        assert!(parse("F000:2").unwrap_err().contains("for 0xF000 write 0xF000"));
        // Neither number is an object of the table.
        assert_eq!(parse("5000:3"), Ok((5000, 3)));
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
