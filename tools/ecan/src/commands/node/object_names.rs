//! Names and types of the objects of a node: from its device file, else from the standards.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use ecan_canopen::{AccessType, DeviceFile, DeviceObject, FindError, ObjectEntry, ObjectType};
use ecan_protocol::text::Printable;

use crate::context::{Failure, Result, note};
use crate::input_file;
use crate::value::{parse_unsigned, reject_without_prefix};

use super::node_target::SelectedNode;
use super::standard_objects::{PDO_ROWS, PDOS, ROWS, Row};

/// The option for a device file.
#[derive(Clone, Debug, Args)]
pub struct DeviceFileArguments {
    /// Device file of the node (EDS or DCF): names, types and access of its objects
    /// [default: the one of the configuration file]
    #[arg(long, value_name = "FILE")]
    eds: Option<PathBuf>,
}

impl DeviceFileArguments {
    /// The device file of the option, else of the configuration file; with its name for messages.
    ///
    /// # Errors
    /// The file cannot be read or used.
    pub fn load(&self, selected: &SelectedNode) -> Result<Option<(String, Arc<DeviceFile>)>> {
        if let Some(path) = &self.eds {
            return Ok(Some((path.display().to_string(), Arc::new(read_device_file(path)?))));
        }
        let Some(device) = selected.device() else { return Ok(None) };
        let config = selected.config.as_ref().map(|it| it.display().to_string());
        let name = match device.file_info.file_name.as_str() {
            "" => config.unwrap_or_default(),
            name => name.to_owned(),
        };
        Ok(Some((name, Arc::clone(device))))
    }
}

/// Reads a device file and reports its deviations from CiA 306.
///
/// # Errors
/// The file cannot be read or used.
pub fn read_device_file(path: &std::path::Path) -> Result<DeviceFile> {
    let bytes = input_file::read(path)?;
    let file = DeviceFile::parse(&bytes).map_err(|it| Failure::file("use", path, it))?;
    if let Some(first) = file.warnings().first() {
        let (count, path) = (file.warnings().len(), Printable(path.display()));
        note(format_args!("# {path}: {count} deviations from CiA 306; the first: {first}"));
    }
    Ok(file)
}

/// Names of the objects of a node.
#[derive(Debug)]
pub struct ObjectNames {
    device: Arc<DeviceFile>,
    /// Name of the device file; `None` for the standards.
    file: Option<String>,
}

/// Object by index and subindex.
pub type ObjectKey = (u16, u8);

impl ObjectNames {
    /// Names of CiA 301 and CiA 402-2.
    pub fn standard() -> Self {
        let mut device = DeviceFile::default();
        ROWS.iter().for_each(|row| add(&mut device, row, row.0, row.4));
        for number in 0..PDOS {
            for row in PDO_ROWS {
                let name = match row.4.split_once(' ') {
                    Some((kind, rest)) => format!("{kind} {} {rest}", number + 1),
                    None => row.4.to_owned(),
                };
                add(&mut device, row, row.0 + number, &name);
            }
        }
        Self { device: Arc::new(device), file: None }
    }

    /// Names of the device file of a node, if there is one, else of the standards.
    ///
    /// # Errors
    /// The file cannot be read or used.
    pub fn of(arguments: &DeviceFileArguments, selected: &SelectedNode) -> Result<Self> {
        Ok(match arguments.load(selected)? {
            Some((name, device)) => Self { device, file: Some(name) },
            None => Self::standard(),
        })
    }

    /// The device file and its name; `None` for the standards.
    pub fn file(&self) -> Option<(&str, &DeviceFile)> {
        self.file.as_deref().map(|name| (name, &*self.device))
    }

    /// All entries, in the order of index and subindex.
    pub fn entries(&self) -> impl Iterator<Item = &ObjectEntry> {
        self.device.entries()
    }

    pub fn entry(&self, (index, subindex): ObjectKey) -> Option<&ObjectEntry> {
        self.device.entry(index, subindex)
    }

    /// Access of an entry by the device file; the standards state none.
    pub fn access(&self, entry: &ObjectEntry) -> Option<AccessType> {
        self.file.as_ref().map(|_| entry.access)
    }

    /// Name of an object; its number if it has none.
    pub fn name(&self, key: ObjectKey) -> String {
        self.entry(key).map_or_else(|| number(key), |entry| self.device.label(entry))
    }

    /// Finds an object by `INDEX[:SUBINDEX]`, or by its names or parts of them: `OBJECT[/ENTRY]`.
    ///
    /// # Errors
    /// The text is no object, or several.
    pub fn find(&self, text: &str) -> Result<ObjectKey, String> {
        let (object, entry) = match text.split_once([':', '/']) {
            None => (text, None),
            Some((object, entry)) => (object, Some(entry)),
        };
        reject_without_prefix(object, |index| self.device.object(index).is_some())?;
        if let Some(index) = parse_unsigned(object) {
            let index = u16::try_from(index)
                .map_err(|_| format!("invalid object index {object}; allowed: 0 to 0xFFFF"))?;
            let entry = entry.unwrap_or("0");
            if let Some(subindex) = parse_unsigned(entry) {
                let wrong = |_| format!("invalid subindex {entry}; allowed: 0 to 255");
                return u8::try_from(subindex).map(|it| (index, it)).map_err(wrong);
            }
        }
        match self.device.find(text) {
            Ok(entry) => Ok((entry.index, entry.subindex)),
            Err(error @ FindError::NotFound { .. }) => self.find_parts(object, entry, &error),
            Err(error) => Err(error.to_string()),
        }
    }

    /// Finds the only entry whose names contain these parts.
    fn find_parts(
        &self,
        object: &str,
        entry: Option<&str>,
        error: &FindError,
    ) -> Result<ObjectKey, String> {
        let index = parse_unsigned(object);
        let of_object = |it: &&DeviceObject| match index {
            Some(index) => u64::from(it.index) == index,
            None => plain(&it.name).contains(&plain(object)),
        };
        let objects: Vec<_> = self.device.objects().filter(of_object).collect();
        let exact: Vec<_> =
            objects.iter().copied().filter(|it| plain(&it.name) == plain(object)).collect();
        let objects = if exact.is_empty() { objects } else { exact };
        let subindex = entry.and_then(parse_unsigned);
        let is_it = |it: &&ObjectEntry| match (entry, subindex) {
            (None, _) => true,
            (_, Some(subindex)) => u64::from(it.subindex) == subindex,
            (Some(entry), None) => plain(&it.name).contains(&plain(entry)),
        };
        let found: Vec<_> =
            objects.iter().flat_map(|object| object.entries()).filter(is_it).collect();
        let is_same = |it: &&ObjectEntry| entry.is_some_and(|part| plain(&it.name) == plain(part));
        match (&found[..], found.iter().copied().find(is_same)) {
            ([only], _) => Ok((only.index, only.subindex)),
            (_, Some(exact)) if objects.len() == 1 => Ok((exact.index, exact.subindex)),
            ([], _) => Err(format!("{error}; see `ecan node sdo list`")),
            (several, _) => {
                let labels: Vec<_> =
                    several.iter().take(SHOWN).map(|it| self.device.label(it)).collect();
                let more = if several.len() > SHOWN { ", ..." } else { "" };
                Err(format!("ambiguous object; candidates: {}{more}", labels.join(", ")))
            }
        }
    }

    /// Indices of the object of this name, or of those whose names contain it.
    pub fn objects_of(&self, name: &str) -> Vec<u16> {
        let name = plain(name);
        let names = || self.device.objects().map(|it| (it.index, plain(&it.name)));
        match names().find(|it| it.1 == name) {
            Some((index, _)) => vec![index],
            None => names().filter(|it| it.1.contains(&name)).map(|it| it.0).collect(),
        }
    }
}

/// Number of candidates in a message.
const SHOWN: usize = 8;

/// `0x6064:00`.
pub fn number((index, subindex): ObjectKey) -> String {
    format!("0x{index:04X}:{subindex:02X}")
}

/// Adds the entries of a row to an object.
fn add(device: &mut DeviceFile, row: &'static Row, index: u16, object: &str) {
    let (_, first, last, data_type, _, entry) = *row;
    if entry.is_empty() {
        device.insert(DeviceObject::variable(ObjectEntry::new(index, 0, object, data_type)));
        return;
    }
    let known = device.object(index).cloned();
    let mut record = known.unwrap_or_else(|| DeviceObject::new(index, object, ObjectType::Record));
    for subindex in first..=last {
        let name = entry.replace("{}", &subindex.to_string());
        record.insert(ObjectEntry::new(index, subindex, &name, data_type));
    }
    device.insert(record);
}

/// Normalizes a name for comparison: letters and digits, in lower case.
fn plain(name: &str) -> String {
    name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
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
            ("identity/vendor-ID", (0x1018, 1)),
            ("identity:4", (0x1018, 4)),
            ("statusword", (0x6041, 0)),
            ("TPDO 2 mapping:entry 1", (0x1A01, 1)),
            ("0x2000:7", (0x2000, 7)),
        ] {
            assert_eq!(names.find(text), Ok(key), "{text}");
        }
        for (text, part) in [
            ("6064", "6064 is read as the decimal number of 0x17B0, which is no known object"),
            ("6064:0", "write 0x6064"),
            ("velocity", "ambiguous object"),
            ("identity", "has sub-objects; use one of `identity/highest subindex`"),
            ("nonsense", "ecan node sdo list"),
            ("0x10000", "invalid object index"),
            ("0x1018:256", "invalid subindex"),
            ("0x1018:colour", "no object `0x1018:colour`"),
            ("TPDO 2 mapping:entry", "ambiguous object; candidates: TPDO 2 mapping/"),
        ] {
            let error = names.find(text).unwrap_err();
            assert!(error.contains(part), "{text}: {error}");
        }
    }

    #[test]
    fn standard_rows_are_in_order_and_not_repeated() {
        let rows: Vec<_> = ROWS.iter().chain(PDO_ROWS).map(|row| (row.0, row.1, row.2)).collect();
        let is_after = |a: (u16, u8, u8), b: (u16, u8, u8)| (a.0, a.2) < (b.0, b.1);
        assert!(rows[..ROWS.len()].windows(2).all(|pair| is_after(pair[0], pair[1])));
        assert!(rows[ROWS.len()..].windows(2).all(|pair| is_after(pair[0], pair[1])));
        let names = ObjectNames::standard();
        assert_eq!(names.name((0x1400, 1)), "RPDO 1 communication/COB-ID");
        assert_eq!(names.name((0x1003, 4)), "error history/error 4");
        assert_eq!(names.name((0x5FFF, 3)), "0x5FFF:03");
    }
}
