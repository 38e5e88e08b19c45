//! Contents of a device file, and its entries by name.

use alloc::collections::{BTreeMap, BTreeSet};
use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;
use core::fmt;

use super::data_type::DataType;
use super::data_value::{DataValue, FileValue, ValueError};
use super::deviation::FileDeviation;
use super::device_object::{DeviceObject, ObjectEntry};
use super::sections::{Commissioning, DeviceInfo, FileInfo, ModuleInfo, Tool};
use crate::{NodeId, object};

/// Contents of an electronic data sheet (EDS) or a device configuration file (DCF, CiA 306-1).
///
/// Plain data that keeps everything that the file states, so that it can be written again. Two
/// files are equal if their contents are, without regard to [`warnings`](Self::warnings).
#[derive(Clone, Debug, Default)]
pub struct DeviceFile {
    /// About the file.
    pub file_info: FileInfo,
    /// About the device.
    pub device_info: DeviceInfo,
    /// Commissioning of the node; `None` in an EDS.
    pub commissioning: Option<Commissioning>,
    /// Comments.
    pub comments: Vec<String>,
    /// Dummy entries that an RPDO may contain: indices of data types.
    pub dummy_usage: BTreeSet<u16>,
    /// Modules that the device supports, by their number.
    pub modules: BTreeMap<u16, DeviceModule>,
    /// Numbers of the connected modules.
    pub connected_modules: Vec<u16>,
    /// Programs for the device.
    pub tools: Vec<Tool>,
    /// Sections that CiA 306-1 does not define, or that this model leaves as they are.
    pub other_sections: Vec<FileSection>,
    objects: BTreeMap<u16, DeviceObject>,
    warnings: Vec<FileDeviation>,
}

/// A section that is kept as it is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FileSection {
    /// Name.
    pub name: String,
    /// Keys and values.
    pub entries: Vec<(String, String)>,
}

/// Returns whether writing an object executes a command instead of setting a parameter.
pub(super) const fn is_command(index: u16) -> bool {
    matches!(index, object::ERROR_HISTORY | object::STORE_PARAMETERS | object::RESTORE_PARAMETERS)
}

impl PartialEq for DeviceFile {
    fn eq(&self, other: &Self) -> bool {
        let Self {
            file_info,
            device_info,
            commissioning,
            comments,
            dummy_usage,
            modules,
            connected_modules,
            tools,
            other_sections,
            objects,
            warnings: _,
        } = self;
        *file_info == other.file_info
            && *device_info == other.device_info
            && *commissioning == other.commissioning
            && *comments == other.comments
            && *dummy_usage == other.dummy_usage
            && *modules == other.modules
            && *connected_modules == other.connected_modules
            && *tools == other.tools
            && *other_sections == other.other_sections
            && *objects == other.objects
    }
}

impl Eq for DeviceFile {}

impl DeviceFile {
    /// Stores the deviations that the reader of the file found.
    pub(super) fn set_warnings(&mut self, warnings: Vec<FileDeviation>) {
        self.warnings = warnings;
    }

    /// Deviations from CiA 306-1 in the order of their lines.
    #[must_use]
    pub fn warnings(&self) -> &[FileDeviation] {
        &self.warnings
    }

    /// Number of warnings and the text of the first; `None` if there are none.
    #[must_use]
    pub fn warning_summary(&self) -> Option<String> {
        let first = self.warnings().first()?;
        let count = self.warnings().len();
        let plural = if count == 1 { "" } else { "s" };
        Some(format!("{count} deviation{plural} from CiA 306; the first: {first}"))
    }

    /// Returns whether the file is a DCF: it states the commissioning of a node.
    #[must_use]
    pub const fn is_dcf(&self) -> bool {
        self.commissioning.is_some()
    }

    /// The node-ID of the commissioning.
    #[must_use]
    pub fn node_id(&self) -> Option<NodeId> {
        self.commissioning.as_ref()?.node_id
    }

    /// The objects in the order of their indices.
    pub fn objects(&self) -> impl Iterator<Item = &DeviceObject> {
        self.objects.values()
    }

    /// All entries in the order of index and subindex.
    pub fn entries(&self) -> impl Iterator<Item = &ObjectEntry> {
        self.objects.values().flat_map(DeviceObject::entries)
    }

    /// The object with this index.
    #[must_use]
    pub fn object(&self, index: u16) -> Option<&DeviceObject> {
        self.objects.get(&index)
    }

    /// The object with this index, to change it.
    #[must_use]
    pub fn object_mut(&mut self, index: u16) -> Option<&mut DeviceObject> {
        self.objects.get_mut(&index)
    }

    /// Adds or replaces the object with the index of `object`.
    pub fn insert(&mut self, object: DeviceObject) {
        self.objects.insert(object.index, object);
    }

    /// The entry with this index and subindex.
    #[must_use]
    pub fn entry(&self, index: u16, subindex: u8) -> Option<&ObjectEntry> {
        self.object(index)?.entry(subindex)
    }

    /// The entry with this index and subindex, to change it.
    #[must_use]
    pub fn entry_mut(&mut self, index: u16, subindex: u8) -> Option<&mut ObjectEntry> {
        self.object_mut(index)?.entry_mut(subindex)
    }

    /// A DCF for a node: this file without any `ParameterValue`, with the commissioning and the name
    /// of this file as `LastEDS`. [`set_parameter`](Self::set_parameter) adds what the node
    /// returns for the [`parameters`](Self::parameters).
    #[must_use]
    pub fn to_dcf(&self, commissioning: Commissioning) -> Self {
        let mut dcf = self.clone();
        dcf.commissioning = Some(commissioning);
        if !self.is_dcf() {
            dcf.file_info.last_eds.clone_from(&self.file_info.file_name);
        }
        for object in dcf.objects.values_mut() {
            object.entries.values_mut().for_each(|entry| entry.parameter = None);
        }
        dcf
    }

    /// The entries whose values make up the configuration of a node, in the order of index and
    /// subindex: readable and writable, neither a DOMAIN nor excluded from scans (`ObjFlags`),
    /// without 0x1003, 0x1010 and 0x1011.
    pub fn parameters(&self) -> impl Iterator<Item = &ObjectEntry> {
        self.objects.values().filter(|object| !is_command(object.index)).flat_map(|object| {
            object.entries().filter(|entry| {
                entry.access.is_readable()
                    && entry.access.is_writable()
                    && entry.data_type != DataType::Domain
                    && !entry.flags.refuses_read_on_scan()
                    && !object.flags.refuses_read_on_scan()
            })
        })
    }

    /// Sets `ParameterValue` from the bytes that a node returned in an SDO.
    ///
    /// Returns `false` if the file has no such entry.
    ///
    /// # Errors
    /// [`ValueError::Length`] if the number of bytes is not that of the data type.
    pub fn set_parameter(
        &mut self,
        index: u16,
        subindex: u8,
        bytes: &[u8],
    ) -> Result<bool, ValueError> {
        let Some(entry) = self.entry_mut(index, subindex) else { return Ok(false) };
        let value: DataValue = entry.data_type.decode(bytes)?;
        entry.parameter = Some(FileValue::Fixed(value));
        Ok(true)
    }
}

/// Module that a modular device supports (CiA 306-1, 8.3).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DeviceModule {
    /// Identification of the module.
    pub info: ModuleInfo,
    /// Comments.
    pub comments: Vec<String>,
    /// Objects that exist if at least one such module is connected (`[MxFixedxxxx]`), by index.
    pub fixed_objects: BTreeMap<u16, DeviceObject>,
    /// Sub-objects that each such module adds (`[MxSubExtxxxx]`), by index.
    pub extensions: BTreeMap<u16, SubExtension>,
}

/// Sub-objects that a module adds to an object.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SubExtension {
    /// Description of each added sub-object; its subindex is 0.
    pub entry: ObjectEntry,
    /// `Count`: number of added sub-objects, as in the file.
    pub count: String,
    /// `ObjExtend`: what happens if the object has no free subindex, as in the file.
    pub obj_extend: String,
}

/// Reason why a name does not identify one entry.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FindError {
    /// No entry has this name, index or denotation.
    NotFound {
        /// Name.
        name: String,
        /// Similar labels, the most similar one first.
        similar: Vec<String>,
    },
    /// Several entries have this name.
    Ambiguous {
        /// Name.
        name: String,
        /// Their labels.
        labels: Vec<String>,
    },
    /// The name is that of an object with sub-objects.
    NeedsSubObject {
        /// Name.
        name: String,
        /// Labels of its entries.
        labels: Vec<String>,
    },
}

/// Number of labels in a message.
const SHOWN: usize = 5;

impl fmt::Display for FindError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let list = |labels: &[String]| {
            let more = if labels.len() > SHOWN { ", ..." } else { "" };
            let shown: Vec<_> =
                labels.iter().take(SHOWN).map(|label| format!("`{label}`")).collect();
            format!("{}{more}", shown.join(", "))
        };
        match self {
            Self::NotFound { name, similar } if similar.is_empty() => write!(
                f,
                "no object `{name}`; allowed: `Object`, `Object/Sub-object`, a unique name of a \
                 sub-object, or an index like 0x6040 or 0x1018:1"
            ),
            Self::NotFound { name, similar } => {
                write!(f, "no object `{name}`; similar: {}", list(similar))
            }
            Self::Ambiguous { name, labels } => {
                write!(f, "`{name}` is the name of several entries; use one of {}", list(labels))
            }
            Self::NeedsSubObject { name, labels } => {
                write!(f, "object `{name}` has sub-objects; use one of {}", list(labels))
            }
        }
    }
}

impl core::error::Error for FindError {}

impl DeviceFile {
    /// Finds an entry by its name, without regard to case.
    ///
    /// The name is that of an object (`Controlword`), of an object and a sub-object
    /// (`Identity object/Vendor-ID`, also with a subindex: `Identity object/1`), of a sub-object if
    /// no other has it, or a denotation. `0x6040`, `0x1018:1` and `1018sub1` are indices; the
    /// subindex is decimal after `:` or `/`, hexadecimal after `sub`.
    ///
    /// # Errors
    /// [`FindError`] with similar or matching names.
    pub fn find(&self, name: &str) -> Result<&ObjectEntry, FindError> {
        let name = name.trim();
        match self.look_up(name) {
            Matches::One(entry) => Ok(entry),
            Matches::None => Err(self.not_found(name)),
            Matches::Many(entries) => Err(FindError::Ambiguous {
                name: name.into(),
                labels: entries.into_iter().map(|entry| self.label(entry)).collect(),
            }),
            Matches::SubObjects(object) => Err(FindError::NeedsSubObject {
                name: object.name.clone(),
                labels: object.entries().map(|entry| self.label(entry)).collect(),
            }),
        }
    }

    /// Name of an entry that [`find`](Self::find) accepts: `Object` or `Object/Sub-object`, or an
    /// index if this name is not unique.
    #[must_use]
    pub fn label(&self, entry: &ObjectEntry) -> String {
        let label = self.full_name(entry);
        match self.look_up(&label) {
            Matches::One(found) if core::ptr::eq(found, entry) || found == entry => label,
            _ => format!("{:#06X}:{}", entry.index, entry.subindex),
        }
    }

    fn full_name(&self, entry: &ObjectEntry) -> String {
        match self.object(entry.index) {
            Some(object) if object.object_type.has_sub_objects() => {
                format!("{}/{}", object.name, entry.name)
            }
            _ => entry.name.clone(),
        }
    }

    fn look_up(&self, name: &str) -> Matches<'_> {
        if let Some((index, subindex)) = parse_key(name)
            && let Some(object) = self.object(index)
        {
            match subindex {
                None => return Matches::of_object(object),
                Some(subindex) => {
                    if let Some(entry) = object.entry(subindex) {
                        return Matches::One(entry);
                    }
                }
            }
        }
        let objects: Vec<_> = self.objects().filter(|object| is_same(&object.name, name)).collect();
        match objects.as_slice() {
            [] => {}
            [object] => return Matches::of_object(object),
            _ => {
                return Matches::Many(objects.iter().flat_map(|object| object.entries()).collect());
            }
        }
        let mut found: Vec<_> = self.pairs(name).collect();
        if found.is_empty() {
            found = self.entries().filter(|entry| is_same(&entry.name, name)).collect();
        }
        if found.is_empty() {
            found = self.entries().filter(|entry| is_same(&entry.denotation, name)).collect();
        }
        match found.as_slice() {
            [] => Matches::None,
            [entry] => Matches::One(entry),
            _ => Matches::Many(found),
        }
    }

    /// Entries whose object and sub-object have the names before and after a slash.
    fn pairs(&self, name: &str) -> impl Iterator<Item = &ObjectEntry> {
        let slashes = name.match_indices('/').map(|(position, _)| position);
        slashes.flat_map(move |position| {
            let (object_name, sub) = (&name[..position], name[position + 1..].trim());
            let subindex = sub.parse::<u8>().ok();
            let is_sub = move |entry: &&ObjectEntry| {
                is_same(&entry.name, sub) || Some(entry.subindex) == subindex
            };
            let objects = self.objects().filter(|object| is_same(&object.name, object_name.trim()));
            objects.flat_map(move |object| object.entries().filter(is_sub))
        })
    }

    fn not_found(&self, name: &str) -> FindError {
        let wanted = name.to_lowercase();
        let mut similar: Vec<_> = self
            .entries()
            .filter_map(|entry| {
                let full_name = self.full_name(entry);
                let texts = [&*full_name, &*entry.name, &*entry.denotation];
                let distance = texts.iter().map(|text| distance(&wanted, text)).min()?;
                let is_similar = distance <= wanted.chars().count() / 3;
                is_similar.then(|| (distance, self.label(entry)))
            })
            .collect();
        similar.sort();
        similar.truncate(SHOWN);
        let similar = similar.into_iter().map(|(_, label)| label).collect();
        FindError::NotFound { name: name.into(), similar }
    }
}

fn is_same(text: &str, name: &str) -> bool {
    if text.is_ascii() && name.is_ascii() {
        return !name.is_empty() && text.eq_ignore_ascii_case(name);
    }
    text.to_lowercase() == name.to_lowercase()
}

/// Entries of a name.
enum Matches<'a> {
    None,
    One(&'a ObjectEntry),
    Many(Vec<&'a ObjectEntry>),
    SubObjects(&'a DeviceObject),
}

impl<'a> Matches<'a> {
    fn of_object(object: &'a DeviceObject) -> Self {
        match object.entry(0) {
            Some(entry) if !object.object_type.has_sub_objects() => Self::One(entry),
            _ => Self::SubObjects(object),
        }
    }
}

/// Index and subindex of `0x1018`, `0x1018:1`, `0x1018/1`, `1018`, `1018:1` or `1018sub1`.
fn parse_key(name: &str) -> Option<(u16, Option<u8>)> {
    let hexadecimal = name.strip_prefix("0x").or_else(|| name.strip_prefix("0X"));
    let text = hexadecimal.unwrap_or(name);
    let length = text.find(|digit: char| !digit.is_ascii_hexdigit()).unwrap_or(text.len());
    let (digits, rest) = text.split_at(length);
    // Names may begin with letters that are digits, too.
    if digits.len() > 4 || (hexadecimal.is_none() && digits.len() != 4) {
        return None;
    }
    let index = u16::from_str_radix(digits, 16).ok()?;
    if rest.is_empty() {
        return Some((index, None));
    }
    let subindex = match rest.strip_prefix([':', '/']) {
        Some(sub) => match sub.strip_prefix("0x") {
            Some(sub) => u8::from_str_radix(sub, 16).ok()?,
            None => sub.parse().ok()?,
        },
        None => u8::from_str_radix(rest.strip_prefix("sub")?, 16).ok()?,
    };
    Some((index, Some(subindex)))
}

/// Number of characters to insert, remove or replace between a name and a text, without regard to
/// case (Levenshtein).
fn distance(name: &str, text: &str) -> usize {
    let text: Vec<char> = text.to_lowercase().chars().collect();
    let mut row: Vec<usize> = (0..=text.len()).collect();
    for (above, character) in (1..).zip(name.chars()) {
        let mut diagonal = above - 1;
        let mut left = above;
        if let Some(first) = row.first_mut() {
            *first = above;
        }
        for (cell, other) in row.iter_mut().skip(1).zip(&text) {
            let replaced = diagonal + usize::from(character != *other);
            diagonal = *cell;
            left = replaced.min(*cell + 1).min(left + 1);
            *cell = left;
        }
    }
    row.last().copied().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distance_counts_changes() {
        assert_eq!(distance("kitten", "sitting"), 3);
        assert_eq!(distance("", "abc"), 3);
        assert_eq!(distance("controlwort", "Controlword"), 1);
    }

    #[test]
    fn keys_have_several_forms() {
        assert_eq!(parse_key("0x6040"), Some((0x6040, None)));
        assert_eq!(parse_key("1018:10"), Some((0x1018, Some(10))));
        assert_eq!(parse_key("0x1018/0x10"), Some((0x1018, Some(16))));
        assert_eq!(parse_key("1018sub1F"), Some((0x1018, Some(0x1F))));
        assert_eq!(parse_key("Deceleration"), None);
        assert_eq!(parse_key("0x"), None);
        assert_eq!(parse_key("1018:256"), None);
    }
}
