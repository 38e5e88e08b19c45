//! Reading of the objects of a device or of a module.

use alloc::collections::BTreeMap;
use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;

use super::data_type::{DataType, ObjectType};
use super::data_value::ValueError;
use super::deviation::FileProblem;
use super::device_object::{DeviceObject, ObjectEntry, compact_name};
use super::entry_reader::{EntryPlace, EntryReader};
use super::ini::{Line, Section};
use super::sections::{Part, bounded};
use super::value_text;

/// Sections of one object.
#[derive(Debug, Default)]
pub(super) struct ObjectSections {
    main: Option<Section>,
    subs: BTreeMap<u8, Section>,
    names: Option<Section>,
    values: Option<Section>,
    denotations: Option<Section>,
    references: Option<Section>,
    links: Option<Section>,
}

impl ObjectSections {
    /// Adds a section; returns the line of the one that is already there.
    pub(super) fn add(&mut self, part: Part, section: Section) -> Result<(), usize> {
        let place = match part {
            Part::Sub(subindex) => {
                if let Some(first) = self.subs.get(&subindex) {
                    return Err(first.line);
                }
                self.subs.insert(subindex, section);
                return Ok(());
            }
            Part::Object => &mut self.main,
            Part::Names => &mut self.names,
            Part::Values => &mut self.values,
            Part::Denotations => &mut self.denotations,
            Part::References => &mut self.references,
            Part::Links => &mut self.links,
        };
        match place {
            Some(first) => Err(first.line),
            None => {
                *place = Some(section);
                Ok(())
            }
        }
    }

    /// Line of the object.
    pub(super) fn line(&self) -> usize {
        let sub = self.subs.values().map(|section| section.line).min();
        self.main.as_ref().map(|section| section.line).or(sub).unwrap_or(1)
    }

    /// Returns whether the sections describe an object, or only name one.
    pub(super) fn has_object(&self) -> bool {
        self.main.is_some() || !self.subs.is_empty()
    }

    /// Sections that add to an object that is not there.
    pub(super) fn into_additions(self) -> impl Iterator<Item = Section> {
        [self.names, self.values, self.denotations, self.references, self.links]
            .into_iter()
            .flatten()
    }

    /// Simple type of a type definition of the file: sub-object 1 has its index as the
    /// default, as editors of CANFestival write it.
    pub(super) fn derived_type(&self) -> Option<DataType> {
        let default = self.subs.get(&1)?.filled("DefaultValue")?;
        let index = u16::try_from(value_text::number(&default.value)?).ok()?;
        match DataType::from_index(index) {
            DataType::Other(_) => None,
            simple => Some(simple),
        }
    }
}

/// Reads an object; `None` if it has no data type. Sections that do not belong to it are added to `rest`.
pub(super) fn read_object(
    index: u16,
    mut sections: ObjectSections,
    reader: &mut EntryReader,
    rest: &mut Vec<Section>,
) -> Option<DeviceObject> {
    let mut main = sections.main.take().unwrap_or_else(|| {
        let first = sections.subs.values().min_by_key(|section| section.line);
        let (name, line) =
            first.map_or_else(Default::default, |section| (section.name.clone(), section.line));
        reader.report.warn(line, FileProblem::NoOwner { section: name });
        let mut main = Section::empty(&format!("{index:04X}"), line);
        let name = main.name.clone();
        let count = format!("{}", sections.subs.len());
        let entries = [("ObjectType", "9".into()), ("ParameterName", name), ("SubNumber", count)];
        for (key, value) in entries {
            main.put_back(Line { key: key.into(), value, line });
        }
        main
    });
    let compact = compact_count(&mut main, reader);
    let object_type = object_type(&mut main, index, &sections, compact, reader);
    let mut object = if object_type.has_sub_objects() {
        match compact {
            Some(count) => read_compact(index, object_type, &mut main, count, reader)?,
            None => read_main(index, object_type, &mut main, &sections, reader),
        }
    } else if object_type == ObjectType::Null {
        let name = reader.name(&mut main, index, None);
        let mut object = DeviceObject::new(index, &name, object_type);
        main.take("SubNumber");
        object.flags = reader.flags(&mut main);
        object.extra = main.into_rest();
        object
    } else {
        let place = EntryPlace { index, subindex: None, object_type, inherited: None };
        DeviceObject::variable(reader.read(&mut main, place)?)
    };
    let inherited = match compact {
        Some(_) => object.entry(1).map(|entry| entry.data_type),
        None => shared_type(&object),
    };
    for (subindex, mut section) in core::mem::take(&mut sections.subs) {
        let object_type = sub_type(&mut section, reader);
        let subindex = Some(subindex);
        let place = EntryPlace { index, subindex, object_type, inherited };
        reader.read(&mut section, place).into_iter().for_each(|entry| object.insert(entry));
    }
    object.is_compact = compact.is_some();
    add_to(&mut object, sections, reader, rest);
    object.is_compact = object.compact_size().is_some();
    Some(object)
}

/// Subindex 0xFF describes the structure of an object.
const MOST_SUB_OBJECTS: i128 = 254;

/// `CompactSubObj`, if it describes sub-objects.
fn compact_count(main: &mut Section, reader: &mut EntryReader) -> Option<u8> {
    let line = main.take("CompactSubObj")?;
    let data_type = DataType::Unsigned8;
    let number = value_text::number(&line.value);
    let count =
        bounded(&line, data_type, (0, MOST_SUB_OBJECTS), "254 is the most", &mut reader.report)
            .or(number.filter(|number| *number > MOST_SUB_OBJECTS).map(|_| MOST_SUB_OBJECTS))?;
    u8::try_from(count).ok().filter(|count| *count > 0)
}

fn object_type(
    main: &mut Section,
    index: u16,
    sections: &ObjectSections,
    compact: Option<u8>,
    reader: &mut EntryReader,
) -> ObjectType {
    let has_sub_objects = compact.is_some() || !sections.subs.is_empty();
    let fallback = if compact.is_some() {
        ObjectType::Array
    } else if has_sub_objects {
        ObjectType::Record
    } else {
        ObjectType::Var
    };
    let object_type = match main.take("ObjectType") {
        // CiA 306-1: an object without type is a VAR.
        None if !has_sub_objects => ObjectType::Var,
        None => {
            let problem = FileProblem::AssumedKey {
                section: main.name.clone(),
                key: "ObjectType",
                assumed: fallback.name(),
            };
            reader.report.warn(main.line, problem);
            fallback
        }
        Some(line) => type_of(line, fallback, reader),
    };
    if has_sub_objects && !object_type.has_sub_objects() {
        let object_type = object_type.name();
        let problem = FileProblem::SubObjectsOfVariable { index, object_type };
        reader.report.warn(main.line, problem);
        return fallback;
    }
    object_type
}

fn type_of(line: Line, fallback: ObjectType, reader: &mut EntryReader) -> ObjectType {
    let code = value_text::number(&line.value).and_then(|code| u8::try_from(code).ok());
    code.and_then(ObjectType::from_code).unwrap_or_else(|| {
        let problem = FileProblem::UnknownWord {
            key: "ObjectType",
            text: line.value,
            allowed: "0 (NULL), 2 (DOMAIN), 5 (DEFTYPE), 6 (DEFSTRUCT), 7 (VAR), 8 (ARRAY), 9 \
                      (RECORD)",
            assumed: fallback.name(),
        };
        reader.report.warn(line.line, problem);
        fallback
    })
}

fn sub_type(section: &mut Section, reader: &mut EntryReader) -> ObjectType {
    let Some(line) = section.take("ObjectType") else { return ObjectType::Var };
    match type_of(line, ObjectType::Var, reader) {
        ObjectType::Domain => ObjectType::Domain,
        ObjectType::DefType => ObjectType::DefType,
        _ => ObjectType::Var,
    }
}

/// Reads an object whose sub-objects have sections.
fn read_main(
    index: u16,
    object_type: ObjectType,
    main: &mut Section,
    sections: &ObjectSections,
    reader: &mut EntryReader,
) -> DeviceObject {
    let name = reader.name(main, index, None);
    let mut object = DeviceObject::new(index, &name, object_type);
    let found = sections.subs.len();
    match main.take("SubNumber") {
        Some(line) => match value_text::number(&line.value) {
            Some(announced) if usize::try_from(announced) == Ok(found) => {}
            Some(announced) => {
                let problem = FileProblem::WrongSubNumber { index, announced, found };
                reader.report.warn(line.line, problem);
            }
            None => {
                let error = ValueError::NotANumber { text: line.value };
                let reading = "the sub-objects are counted";
                let problem = FileProblem::IgnoredValue { key: line.key, error, reading };
                reader.report.warn(line.line, problem);
            }
        },
        None => {
            let problem = FileProblem::AssumedKey {
                section: main.name.clone(),
                key: "SubNumber",
                assumed: "the number of sub-objects",
            };
            reader.report.warn(main.line, problem);
        }
    }
    object.flags = reader.flags(main);
    object.denotation = main.take("Denotation").map(|line| line.value).unwrap_or_default();
    object.extra = core::mem::replace(main, Section::empty("", 0)).into_rest();
    object
}

/// Data type that an object states for its sub-objects, against the standard.
fn shared_type(object: &DeviceObject) -> Option<DataType> {
    let is_type = |(key, _): &&(String, String)| key.eq_ignore_ascii_case("DataType");
    let (_, text) = object.extra.iter().find(is_type)?;
    let index = u16::try_from(value_text::number(text)?).ok()?;
    Some(DataType::from_index(index)).filter(|data_type| !matches!(data_type, DataType::Other(_)))
}

/// Reads an object that describes all its sub-objects together.
fn read_compact(
    index: u16,
    object_type: ObjectType,
    main: &mut Section,
    count: u8,
    reader: &mut EntryReader,
) -> Option<DeviceObject> {
    let denotation = main.take("Denotation").map(|line| line.value).unwrap_or_default();
    let entry_type = ObjectType::Var;
    let place = EntryPlace { index, subindex: None, object_type: entry_type, inherited: None };
    let mut entry = reader.read(main, place)?;
    let mut object = DeviceObject::new(index, &entry.name, object_type);
    object.denotation = denotation;
    object.flags = entry.flags;
    object.extra = core::mem::take(&mut entry.extra);
    object.insert(DeviceObject::compact_count(index, count));
    for subindex in 1..=count {
        let name = compact_name(&object.name, subindex);
        object.insert(ObjectEntry { subindex, name, ..entry.clone() });
    }
    Some(object)
}

/// Adds names, values, denotations, references and links from their sections.
fn add_to(
    object: &mut DeviceObject,
    sections: ObjectSections,
    reader: &mut EntryReader,
    rest: &mut Vec<Section>,
) {
    let ObjectSections { names, values, denotations, references, links, .. } = sections;
    if let Some(mut section) = links {
        let lines = numbered_lines(&mut section, "ObjectLinks", reader);
        object.links = lines.into_iter().filter_map(|(_, line)| index_of(&line, reader)).collect();
    }
    if !object.object_type.has_sub_objects() {
        rest.extend([names, values, denotations, references].into_iter().flatten());
        return;
    }
    // A sub-object with a section has its name there.
    let common = object.name.clone();
    let is_unnamed = |entry: &ObjectEntry| {
        entry.subindex == 0 || entry.name == compact_name(&common, entry.subindex)
    };
    if object.is_compact || object.entries().all(is_unnamed) {
        each(names, object, reader, |entry, line, _| {
            if is_unnamed(entry) {
                entry.name = line.value;
            }
        });
    } else {
        rest.extend(names);
    }
    each(values, object, reader, |entry, line, reader| {
        if entry.parameter.is_none() {
            entry.parameter = reader.parameter(entry.data_type, &line);
        }
    });
    each(denotations, object, reader, |entry, line, _| entry.denotation = line.value);
    each(references, object, reader, |entry, line, _| entry.reference = line.value);
}

fn each(
    section: Option<Section>,
    object: &mut DeviceObject,
    reader: &mut EntryReader,
    mut set: impl FnMut(&mut ObjectEntry, Line, &mut EntryReader),
) {
    let Some(mut section) = section else { return };
    for (number, line) in numbered_lines(&mut section, "NrOfEntries", reader) {
        let entry = u8::try_from(number).ok().and_then(|subindex| object.entry_mut(subindex));
        match entry {
            Some(entry) => set(entry, line, reader),
            None => {
                let (index, subindex) = (object.index, number);
                reader.report.warn(line.line, FileProblem::NoSubObject { index, subindex });
            }
        }
    }
}

/// The filled entries of a numbered list, whose count is checked.
pub(super) fn numbered_lines(
    section: &mut Section,
    count_key: &'static str,
    reader: &mut EntryReader,
) -> Vec<(u16, Line)> {
    let mut lines = section.take_numbered("");
    check_count(section, count_key, lines.len(), reader);
    lines.retain(|(_, line)| !line.value.is_empty());
    lines
}

/// Compares a count with the number of what it counts.
pub(super) fn check_count(
    section: &mut Section,
    count_key: &'static str,
    found: usize,
    reader: &mut EntryReader,
) {
    if let Some(line) = section.take(count_key) {
        match value_text::number(&line.value) {
            Some(announced) if usize::try_from(announced) == Ok(found) => {}
            Some(announced) => {
                let section = section.name.clone();
                let problem = FileProblem::WrongCount { section, key: count_key, announced, found };
                reader.report.warn(line.line, problem);
            }
            None => {
                let error = ValueError::NotANumber { text: line.value };
                let reading = "the entries are counted";
                let problem = FileProblem::IgnoredValue { key: line.key, error, reading };
                reader.report.warn(line.line, problem);
            }
        }
    }
}

/// The index that a line of a list gives.
pub(super) fn index_of(line: &Line, reader: &mut EntryReader) -> Option<u16> {
    let limits = (0, u16::MAX.into());
    let index = bounded(line, DataType::Unsigned16, limits, "ignored", &mut reader.report)?;
    u16::try_from(index).ok()
}
