//! Writing of a whole device file.

use alloc::collections::BTreeSet;
use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;
use core::fmt::Display;

use super::device_file::DeviceFile;
use super::device_module::{DeviceModule, SubExtension};
use super::device_object::{DeviceObject, compact_name};
use super::object_entry::ObjectEntry;
use super::object_list::{LISTS, list_of};
use super::object_type::ObjectType;
use super::output::Output;
use super::value_text;

impl DeviceFile {
    /// Writes the file: a DCF if it has a commissioning, otherwise an EDS.
    ///
    /// Counts and lists follow from the objects. [`parse`](Self::parse) reads an equal file, unless
    /// a text has line breaks, blanks at its ends or no character at all, which the format cannot
    /// hold.
    #[must_use]
    pub fn write(&self) -> String {
        let mut out = Output::default();
        out.section("FileInfo");
        self.file_info.write(&mut out);
        out.section("DeviceInfo");
        self.device_info.write(&mut out);
        if let Some(commissioning) = &self.commissioning {
            out.section("DeviceComissioning");
            commissioning.write(&mut out);
        }
        out.section("DummyUsage");
        let dummies: BTreeSet<u16> = (1..=7).chain(self.dummy_usage.iter().copied()).collect();
        for index in dummies {
            let flag = u8::from(self.dummy_usage.contains(&index));
            out.entry(&format!("Dummy{index:04X}"), flag);
        }
        write_comments("Comments", &self.comments, &mut out);
        for list in LISTS {
            let members = || self.objects().filter(|object| list_of(object.index) == list);
            write_list(list, "SupportedObjects", members().map(|object| object.index), &mut out);
            for object in members() {
                write_object("", object, &mut out);
            }
        }
        self.write_modules(&mut out);
        if !self.tools.is_empty() {
            out.section("Tools");
            out.entry("Items", self.tools.len());
        }
        for (number, tool) in (1..).zip(&self.tools) {
            out.section(format_args!("Tool{number}"));
            tool.write(&mut out);
        }
        for section in &self.other_sections {
            out.section(&section.name);
            out.entries(&section.entries);
        }
        out.finish()
    }

    fn write_modules(&self, out: &mut Output) {
        if !self.modules.is_empty() {
            out.section("SupportedModules");
            out.entry("NrOfEntries", self.modules.len());
        }
        for (number, module) in &self.modules {
            write_module(*number, module, out);
        }
        if !self.connected_modules.is_empty() {
            out.section("ConnectedModules");
            out.entry("NrOfEntries", self.connected_modules.len());
            for (position, module) in (1..).zip(&self.connected_modules) {
                out.entry(&format!("{position}"), module);
            }
        }
    }
}

fn write_comments(section: &str, comments: &[String], out: &mut Output) {
    if comments.is_empty() {
        return;
    }
    out.section(section);
    out.entry("Lines", comments.len());
    for (number, comment) in (1..).zip(comments) {
        out.entry(&format!("Line{number}"), comment);
    }
}

fn write_list(
    section: impl Display,
    count: &str,
    indices: impl Iterator<Item = u16>,
    out: &mut Output,
) {
    let indices: Vec<_> = indices.collect();
    out.section(section);
    out.entry(count, indices.len());
    for (position, index) in (1..).zip(indices) {
        out.entry(&format!("{position}"), format_args!("{index:#06X}"));
    }
}

fn write_module(number: u16, module: &DeviceModule, out: &mut Output) {
    out.section(format_args!("M{number}ModuleInfo"));
    module.info.write(out);
    write_comments(&format!("M{number}Comments"), &module.comments, out);
    let fixed = module.fixed_objects.keys().copied();
    write_list(format_args!("M{number}FixedObjects"), "NrOfEntries", fixed, out);
    for object in module.fixed_objects.values() {
        write_object(&format!("M{number}Fixed"), object, out);
    }
    let extended = module.extensions.keys().copied();
    write_list(format_args!("M{number}SubExtends"), "NrOfEntries", extended, out);
    for (index, SubExtension { entry, count, obj_extend }) in &module.extensions {
        out.section(format_args!("M{number}SubExt{index:04X}"));
        out.text("ParameterName", &entry.name);
        write_entry(entry, out);
        out.text("Count", count);
        out.text("ObjExtend", obj_extend);
        out.entries(&entry.extra);
    }
}

/// Writes the sections of an object; their names begin with `prefix`.
fn write_object(prefix: &str, object: &DeviceObject, out: &mut Output) {
    let index = object.index;
    out.section(format_args!("{prefix}{index:04X}"));
    out.text("ParameterName", &object.name);
    out.entry("ObjectType", format_args!("{:#X}", object.object_type.code()));
    if object.object_type.has_sub_objects() || object.object_type == ObjectType::Null {
        match object.compact_size() {
            Some(count) => write_compact(prefix, object, count, out),
            None => write_sub_objects(prefix, object, out),
        }
    } else if let Some(entry) = object.entry(0) {
        write_entry(entry, out);
        out.entries(&entry.extra);
    }
    if !object.links.is_empty() {
        let links = object.links.iter().copied();
        write_list(format_args!("{prefix}{index:04X}ObjectLinks"), "ObjectLinks", links, out);
    }
}

fn write_sub_objects(prefix: &str, object: &DeviceObject, out: &mut Output) {
    if object.object_type != ObjectType::Null {
        out.entry("SubNumber", object.entries().count());
        out.text("Denotation", &object.denotation);
    }
    if object.flags.0 != 0 {
        out.entry("ObjFlags", format_args!("{:#X}", object.flags.0));
    }
    out.entries(&object.extra);
    for entry in object.entries() {
        out.section(format_args!("{prefix}{:04X}sub{:X}", entry.index, entry.subindex));
        out.text("ParameterName", &entry.name);
        out.entry("ObjectType", format_args!("{:#X}", entry.object_type.code()));
        write_entry(entry, out);
        out.entries(&entry.extra);
    }
}

/// Writes an object whose sub-objects are alike.
fn write_compact(prefix: &str, object: &DeviceObject, count: u8, out: &mut Output) {
    let Some(first) = object.entry(1) else { return };
    out.entry("CompactSubObj", count);
    // What differs has sections of its own.
    let shared = ObjectEntry {
        parameter: None,
        reference: String::new(),
        denotation: object.denotation.clone(),
        ..first.clone()
    };
    write_entry(&shared, out);
    out.entries(&object.extra);
    let subs = || object.entries().filter(|entry| entry.subindex > 0);
    if subs().any(|entry| entry.name != compact_name(&object.name, entry.subindex)) {
        write_column(prefix, object, "Name", subs().map(|entry| Some(entry.name.clone())), out);
    }
    let value = |entry: &ObjectEntry| {
        entry.parameter.as_ref().map(|value| value_text::write(entry.data_type, value))
    };
    write_column(prefix, object, "Value", subs().map(value), out);
    let filled = |text: &String| Some(text.clone()).filter(|text| !text.is_empty());
    let denotations = subs().map(|entry| filled(&entry.denotation));
    write_column(prefix, object, "Denotation", denotations, out);
    let references = subs().map(|entry| filled(&entry.reference));
    write_column(prefix, object, "ParamRefd", references, out);
}

/// Writes a property of the sub-objects of a compact object, from subindex 1.
fn write_column(
    prefix: &str,
    object: &DeviceObject,
    name: &str,
    texts: impl Iterator<Item = Option<String>>,
    out: &mut Output,
) {
    let texts: Vec<_> = (1..).zip(texts).filter_map(|(sub, text)| Some((sub, text?))).collect();
    if texts.is_empty() {
        return;
    }
    out.section(format_args!("{prefix}{:04X}{name}", object.index));
    out.entry("NrOfEntries", texts.len());
    for (subindex, text) in texts {
        let subindex: u16 = subindex;
        out.entry(&format!("{subindex}"), text);
    }
}

/// Writes an entry except its name, its type and what CiA 306-1 does not define.
fn write_entry(entry: &ObjectEntry, out: &mut Output) {
    out.entry("DataType", format_args!("{:#06X}", entry.data_type.index()));
    out.entry("AccessType", entry.access);
    let values = [
        ("LowLimit", &entry.low_limit),
        ("HighLimit", &entry.high_limit),
        ("DefaultValue", &entry.default),
        ("ParameterValue", &entry.parameter),
    ];
    for (key, value) in values {
        if let Some(value) = value {
            out.text(key, &value_text::write(entry.data_type, value));
        }
    }
    out.entry("PDOMapping", u8::from(entry.pdo_mapping));
    if entry.flags.0 != 0 {
        out.entry("ObjFlags", format_args!("{:#X}", entry.flags.0));
    }
    let texts = [
        ("ParamRefd", &entry.reference),
        ("Denotation", &entry.denotation),
        ("UploadFile", &entry.upload_file),
        ("DownloadFile", &entry.download_file),
    ];
    for (key, text) in texts {
        out.text(key, text);
    }
}
