//! Names and types of the objects of a node: from its device file, else from the standards.

use std::path::PathBuf;

use clap::Args;
use ecan_canopen::{AccessType, DataType, DeviceFile};

use crate::context::{Failure, Result, note};
use crate::value::parse_unsigned;

use super::standard_objects::{PDO_ROWS, PDOS, ROWS, Row};

/// The option for a device file.
#[derive(Clone, Debug, Args)]
pub struct DeviceFileArguments {
    /// Device file of the node (EDS or DCF): names, types and access of its objects
    #[arg(long, value_name = "FILE")]
    eds: Option<PathBuf>,
}

/// An entry of the object dictionary of a node.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedEntry {
    pub index: u16,
    pub subindex: u8,
    /// Name of the object.
    pub object: String,
    /// Name of the entry; empty for an object without subindices.
    pub entry: String,
    pub data_type: DataType,
    /// `None` without a device file.
    pub access: Option<AccessType>,
}

impl NamedEntry {
    /// Name of object and entry.
    pub fn name(&self) -> String {
        match self.entry.is_empty() {
            true => self.object.clone(),
            false => format!("{}: {}", self.object, self.entry),
        }
    }
}

/// Identity of the device that a device file describes.
#[derive(Clone, Debug)]
pub struct FileIdentity {
    pub path: PathBuf,
    pub vendor_id: Option<u32>,
    pub product_code: Option<u32>,
}

/// Names of the objects of a node.
#[derive(Debug)]
pub struct ObjectNames {
    entries: Vec<NamedEntry>,
    file: Option<FileIdentity>,
}

/// Object by index and subindex.
pub type ObjectKey = (u16, u8);

impl ObjectNames {
    /// Names of CiA 301 and CiA 402-2.
    pub fn standard() -> Self {
        let mut entries: Vec<_> = ROWS.iter().flat_map(|row| of_row(row, 0)).collect();
        for number in 0..PDOS {
            entries.extend(PDO_ROWS.iter().flat_map(|row| of_row(row, number)).map(|entry| {
                let object = match entry.object.split_once(' ') {
                    Some((kind, rest)) => format!("{kind} {} {rest}", number + 1),
                    None => entry.object.clone(),
                };
                NamedEntry { object, ..entry }
            }));
        }
        entries.sort_by_key(|it| (it.index, it.subindex));
        Self { entries, file: None }
    }

    /// Names of a device file, if one is given, else of the standards.
    ///
    /// # Errors
    /// The file cannot be read or used.
    pub fn of(arguments: &DeviceFileArguments) -> Result<Self> {
        let Some(path) = &arguments.eds else { return Ok(Self::standard()) };
        let bytes = std::fs::read(path).map_err(|error| Failure::file("read", path, error))?;
        let file = DeviceFile::parse(&bytes).map_err(|it| Failure::file("use", path, it))?;
        if let Some(first) = file.warnings().first() {
            let (count, path) = (file.warnings().len(), path.display());
            note(format_args!("# {path}: {count} deviations from CiA 306; the first: {first}"));
        }
        let entry_of = |object: &ecan_canopen::DeviceObject| -> Vec<NamedEntry> {
            let has_subindices = object.object_type.has_sub_objects();
            let named = |entry: &ecan_canopen::ObjectEntry| NamedEntry {
                index: entry.index,
                subindex: entry.subindex,
                object: object.name.clone(),
                entry: if has_subindices { entry.name.clone() } else { String::new() },
                data_type: entry.data_type,
                access: Some(entry.access),
            };
            object.entries().map(named).collect()
        };
        Ok(Self {
            entries: file.objects().flat_map(entry_of).collect(),
            file: Some(FileIdentity {
                path: path.clone(),
                vendor_id: file.device_info.vendor_number,
                product_code: file.device_info.product_number,
            }),
        })
    }

    /// The identity by the device file.
    pub fn file(&self) -> Option<&FileIdentity> {
        self.file.as_ref()
    }

    /// All entries, in the order of index and subindex.
    pub fn entries(&self) -> &[NamedEntry] {
        &self.entries
    }

    pub fn entry(&self, (index, subindex): ObjectKey) -> Option<&NamedEntry> {
        self.entries.iter().find(|it| (it.index, it.subindex) == (index, subindex))
    }

    /// Name of an object; its number if it has none.
    pub fn name(&self, key: ObjectKey) -> String {
        self.entry(key).map_or_else(|| number(key), NamedEntry::name)
    }

    /// Finds an object by `INDEX[:SUBINDEX]`, or by (parts of) its names, `OBJECT[:ENTRY]`.
    ///
    /// # Errors
    /// The text is no object, or several.
    pub fn find(&self, text: &str) -> Result<ObjectKey, String> {
        let (object, entry) = match text.split_once(':') {
            None => (text, None),
            Some((object, entry)) => (object, Some(entry)),
        };
        if let Some(index) = parse_unsigned(object) {
            let index = u16::try_from(index)
                .map_err(|_| format!("invalid object index {object}; allowed: 0 to 0xFFFF"))?;
            let entry = entry.unwrap_or("0");
            if let Some(subindex) = parse_unsigned(entry) {
                let wrong = |_| format!("invalid subindex {entry}; allowed: 0 to 255");
                return u8::try_from(subindex).map(|it| (index, it)).map_err(wrong);
            }
            let of_index: Vec<_> = self.entries.iter().filter(|it| it.index == index).collect();
            return only(&of_index, |it| &it.entry, entry, text);
        }
        let objects = self.objects_of(object);
        let of_object = |index: u16| self.entries.iter().filter(move |it| it.index == index);
        match (&objects[..], entry) {
            ([], _) => Err(format!("unknown object \"{object}\"; see `ecan node sdo list`")),
            ([index], Some(entry)) => {
                if let Some(subindex) = parse_unsigned(entry).and_then(|it| u8::try_from(it).ok()) {
                    return Ok((*index, subindex));
                }
                only(&of_object(*index).collect::<Vec<_>>(), |it| &it.entry, entry, text)
            }
            ([index], None) => match of_object(*index).collect::<Vec<_>>()[..] {
                [entry] => Ok((entry.index, entry.subindex)),
                ref several => {
                    let names: Vec<_> = several.iter().map(|it| it.name()).collect();
                    Err(format!("\"{text}\" has entries; select one: {}", names.join(", ")))
                }
            },
            (several, _) => {
                let first = several.iter().filter_map(|it| of_object(*it).next());
                let names: Vec<_> = first.map(|it| it.object.as_str()).take(8).collect();
                Err(format!("ambiguous object \"{object}\"; candidates: {}", names.join(", ")))
            }
        }
    }

    /// Indices of the object of this name, or of those whose names contain it.
    pub fn objects_of(&self, name: &str) -> Vec<u16> {
        let name = plain(name);
        let exact = |it: &&NamedEntry| plain(&it.object) == name;
        let found: Vec<_> = match self.entries.iter().find(exact) {
            Some(entry) => return vec![entry.index],
            None => self.entries.iter().filter(|it| plain(&it.object).contains(&name)),
        }
        .map(|it| it.index)
        .collect();
        let mut found = found;
        found.dedup();
        found
    }
}

/// `0x6064:00`.
pub fn number((index, subindex): ObjectKey) -> String {
    format!("0x{index:04X}:{subindex:02X}")
}

/// Entries of a row, of the PDO with this number from 0.
fn of_row(row: &'static Row, number: u16) -> impl Iterator<Item = NamedEntry> {
    let (index, first, last, data_type, object, entry) = *row;
    (first..=last).map(move |subindex| NamedEntry {
        index: index + number,
        subindex,
        object: object.to_owned(),
        entry: entry.replace("{}", &subindex.to_string()),
        data_type,
        access: None,
    })
}

/// Normalizes a name for comparison: letters and digits, in lower case.
fn plain(name: &str) -> String {
    name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

/// Finds the only entry whose name is, or contains, the text.
fn only(
    entries: &[&NamedEntry],
    name: fn(&NamedEntry) -> &String,
    part: &str,
    text: &str,
) -> Result<ObjectKey, String> {
    let part = plain(part);
    let key = |it: &NamedEntry| (it.index, it.subindex);
    if let Some(exact) = entries.iter().find(|it| plain(name(it)) == part) {
        return Ok(key(exact));
    }
    let found: Vec<_> = entries.iter().filter(|it| plain(name(it)).contains(&part)).collect();
    match found[..] {
        [only] => Ok(key(only)),
        [] => {
            let names: Vec<_> = entries.iter().map(|it| name(it).as_str()).collect();
            Err(format!("unknown entry in \"{text}\"; allowed: {}", names.join(", ")))
        }
        _ => {
            let names: Vec<_> = found.iter().map(|it| name(it).as_str()).collect();
            Err(format!("ambiguous entry in \"{text}\"; candidates: {}", names.join(", ")))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_are_found_by_number_and_name() {
        let names = ObjectNames::standard();
        for (text, key) in [
            ("0x6064", (0x6064, 0)),
            ("0x1018:1", (0x1018, 1)),
            ("4120:0x02", (0x1018, 2)),
            ("0x1018:serial", (0x1018, 4)),
            ("Position actual value", (0x6064, 0)),
            ("identity:vendor", (0x1018, 1)),
            ("identity:4", (0x1018, 4)),
            ("statusword", (0x6041, 0)),
            ("TPDO 2 mapping:entry 1", (0x1A01, 1)),
            ("0x2000:7", (0x2000, 7)),
        ] {
            assert_eq!(names.find(text), Ok(key), "{text}");
        }
        for (text, part) in [
            ("velocity", "ambiguous object"),
            ("identity", "has entries; select one: identity: highest subindex"),
            ("nonsense", "ecan node sdo list"),
            ("0x10000", "invalid object index"),
            ("0x1018:256", "invalid subindex"),
            ("0x1018:colour", "unknown entry"),
            ("TPDO 2 mapping:entry", "ambiguous entry"),
        ] {
            let error = names.find(text).unwrap_err();
            assert!(error.contains(part), "{text}: {error}");
        }
    }

    #[test]
    fn standard_rows_are_in_order_and_not_repeated() {
        let names = ObjectNames::standard();
        let keys: Vec<_> = names.entries().iter().map(|it| (it.index, it.subindex)).collect();
        assert!(keys.windows(2).all(|pair| pair[0] < pair[1]));
        assert_eq!(names.name((0x1400, 1)), "RPDO 1 communication: COB-ID");
        assert_eq!(names.name((0x1003, 4)), "error history: error 4");
        assert_eq!(names.name((0x5FFF, 3)), "0x5FFF:03");
    }
}
