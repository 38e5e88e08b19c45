//! A whole device file as text: reader and writer.

use alloc::collections::{BTreeMap, BTreeSet};
use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;
use core::fmt::Display;

use super::contents::{DeviceFile, DeviceModule, FileSection, SubExtension};
use super::data_type::{DataType, ObjectType};
use super::deviation::{DeviceFileFaults, FileProblem, Report};
use super::device_object::{DeviceObject, LISTS, MANDATORY, ObjectEntry, compact_name, list_of};
use super::entry_reader::{EntryPlace, EntryReader};
use super::ini::{Document, Output, Section};
use super::object_reader::{ObjectSections, check_count, index_of, numbered_lines, read_object};
use super::sections::{
    Commissioning, DeviceInfo, FileInfo, ModuleInfo, Owner, Part, SectionName, Tool, bounded,
};
use super::value_text;
use crate::object;

impl DeviceFile {
    /// Reads an EDS or a DCF.
    ///
    /// The file may be ASCII, UTF-8, UTF-16 with a byte order mark, or ISO 8859-1. Deviations from
    /// CiA 306-1 that leave a useful reading are [`warnings`](Self::warnings): wrong counts, objects
    /// in no list, missing sections, duplicates (the first one counts), values out of range.
    ///
    /// # Errors
    /// All faults that prevent the use of the file, each with its line: no object at all, an entry
    /// without a usable `DataType`, and a `ParameterValue` that does not fit its data type.
    pub fn parse(bytes: &[u8]) -> Result<Self, DeviceFileFaults> {
        let mut report = Report::default();
        let document = Document::parse(bytes, &mut report);
        let mut reader = FileReader {
            reader: EntryReader { report, ..EntryReader::default() },
            objects: BTreeMap::new(),
            modules: BTreeMap::new(),
            extensions: Vec::new(),
            tools: BTreeMap::new(),
            rest: Vec::new(),
        };
        let mut file = reader.read(document);
        let Report { mut warnings, mut faults } = reader.reader.report;
        warnings.sort_by_key(|deviation| deviation.line);
        faults.sort_by_key(|deviation| deviation.line);
        if !faults.is_empty() {
            return Err(DeviceFileFaults { faults, warnings });
        }
        file.set_warnings(warnings);
        Ok(file)
    }
}

struct FileReader {
    reader: EntryReader,
    objects: BTreeMap<(Owner, u16), ObjectSections>,
    modules: BTreeMap<u16, DeviceModule>,
    extensions: Vec<(u16, u16, Section)>,
    tools: BTreeMap<u16, Section>,
    /// Sections that are kept as they are.
    rest: Vec<Section>,
}

impl FileReader {
    fn read(&mut self, mut document: Document) -> DeviceFile {
        let mut file = DeviceFile::default();
        if let Some(section) = self.wanted(&mut document, "FileInfo") {
            file.file_info = FileInfo::read(section, &mut self.reader.report);
        }
        if let Some(section) = self.wanted(&mut document, "DeviceInfo") {
            file.device_info = DeviceInfo::read(section, &mut self.reader.report);
        }
        file.commissioning = self.commissioning(&mut document);
        file.comments = self.comments(document.take("Comments"));
        file.dummy_usage = self.dummy_usage(document.take("DummyUsage"));
        let lists = LISTS.map(|list| document.take(list));
        // Their contents follow from the sections that they announce.
        let tools = document.take("Tools");
        let supported_modules = document.take("SupportedModules");
        if let Some(mut section) = document.take("ConnectedModules") {
            let lines = numbered_lines(&mut section, "NrOfEntries", &mut self.reader);
            let modules = lines.iter().filter_map(|(_, line)| index_of(line, &mut self.reader));
            file.connected_modules = modules.collect();
        }
        for section in document.into_sections() {
            self.sort(section);
        }
        self.derive_types();
        let lines: BTreeMap<u16, usize> = self
            .objects
            .iter()
            .filter(|((owner, _), sections)| owner.is_none() && sections.has_object())
            .map(|((_, index), sections)| (*index, sections.line()))
            .collect();
        for ((owner, index), sections) in core::mem::take(&mut self.objects) {
            if !sections.has_object() {
                self.rest.extend(sections.into_additions());
                continue;
            }
            let object = read_object(index, sections, &mut self.reader, &mut self.rest);
            let Some(object) = object else { continue };
            match owner {
                None => file.insert(object),
                Some(module) => {
                    self.module(module).fixed_objects.insert(index, object);
                }
            }
        }
        match file.objects().next() {
            Some(_) => self.check_lists(lists, &lines),
            None => self.reader.report.fault(1, FileProblem::NoObjects),
        }
        self.read_extensions();
        if let Some(mut section) = supported_modules {
            check_count(&mut section, "NrOfEntries", self.modules.len(), &mut self.reader);
        }
        if let Some(mut section) = tools {
            check_count(&mut section, "Items", self.tools.len(), &mut self.reader);
        }
        file.modules = core::mem::take(&mut self.modules);
        let tools = core::mem::take(&mut self.tools).into_values();
        file.tools = tools.map(|section| Tool::read(section, &mut self.reader.report)).collect();
        self.rest.sort_by_key(|section| section.line);
        file.other_sections = self.rest.drain(..).map(kept).collect();
        file
    }

    /// A section that each file has; a missing one is reported.
    fn wanted(&mut self, document: &mut Document, name: &'static str) -> Option<Section> {
        let section = document.take(name);
        if section.is_none() {
            self.reader.report.warn(1, FileProblem::MissingSection { section: name });
        }
        section
    }

    fn commissioning(&mut self, document: &mut Document) -> Option<Commissioning> {
        let standard = document.take("DeviceComissioning");
        let corrected = document.take("DeviceCommissioning");
        let (section, second) = match standard {
            Some(section) => (section, corrected),
            None => (corrected?, None),
        };
        if let Some(second) = second {
            let problem =
                FileProblem::DuplicateSection { section: second.name, first: section.line };
            self.reader.report.warn(second.line, problem);
        }
        Some(Commissioning::read(section, &mut self.reader.report))
    }

    fn comments(&mut self, section: Option<Section>) -> Vec<String> {
        let Some(mut section) = section else { return Vec::new() };
        let lines = section.take_numbered("Line");
        check_count(&mut section, "Lines", lines.len(), &mut self.reader);
        lines.into_iter().map(|(_, line)| line.value).collect()
    }

    fn dummy_usage(&mut self, section: Option<Section>) -> BTreeSet<u16> {
        let mut usage = BTreeSet::new();
        for line in section.into_iter().flat_map(|section| section.entries) {
            let index = line
                .key
                .split_at_checked("Dummy".len())
                .filter(|(prefix, _)| prefix.eq_ignore_ascii_case("Dummy"))
                .and_then(|(_, digits)| u16::from_str_radix(digits, 16).ok());
            let (Some(index), false) = (index, line.value.is_empty()) else { continue };
            let limits = (i128::MIN, i128::MAX);
            let report = &mut self.reader.report;
            let flag = bounded(&line, DataType::Boolean, limits, "ignored", report);
            if flag.is_some_and(|flag| flag != 0) {
                usage.insert(index);
            }
        }
        usage
    }

    fn module(&mut self, number: u16) -> &mut DeviceModule {
        self.modules.entry(number).or_default()
    }

    /// Assigns a section to what it describes.
    fn sort(&mut self, section: Section) {
        let (name, line) = (section.name.clone(), section.line);
        let first = match SectionName::of(&section.name) {
            SectionName::Object(owner, index, part) => {
                self.objects.entry((owner, index)).or_default().add(part, section).err()
            }
            SectionName::ShortObject(index, part) if is_object(&section, part) => {
                self.objects.entry((None, index)).or_default().add(part, section).err()
            }
            SectionName::ModuleInfo(module) => {
                let info = ModuleInfo::read(section, &mut self.reader.report);
                self.module(module).info = info;
                None
            }
            SectionName::ModuleComments(module) => {
                let comments = self.comments(Some(section));
                self.module(module).comments = comments;
                None
            }
            SectionName::ModuleList(module) => {
                let mut section = section;
                numbered_lines(&mut section, "NrOfEntries", &mut self.reader);
                self.module(module);
                None
            }
            SectionName::ModuleExtension(module, index) => {
                self.extensions.push((module, index, section));
                None
            }
            SectionName::Tool(number) => match self.tools.get(&number) {
                Some(first) => Some(first.line),
                None => {
                    self.tools.insert(number, section);
                    None
                }
            },
            SectionName::ShortObject(..) | SectionName::Other => {
                self.rest.push(section);
                None
            }
        };
        if let Some(first) = first {
            let problem = FileProblem::DuplicateSection { section: name, first };
            self.reader.report.warn(line, problem);
        }
    }

    fn derive_types(&mut self) {
        let own_types = (None, 0x20)..(None, object::DEVICE_TYPE);
        self.reader.derived = self
            .objects
            .range(own_types)
            .filter_map(|((_, index), sections)| Some((*index, sections.derived_type()?)))
            .collect();
    }

    /// Compares the lists with the objects, whose lines are given.
    fn check_lists(&mut self, lists: [Option<Section>; 3], lines: &BTreeMap<u16, usize>) {
        let [mandatory, ..] = &lists;
        let mandatory_line = mandatory.as_ref().map_or(1, |section| section.line);
        if mandatory.is_none() {
            let problem = FileProblem::MissingSection { section: "MandatoryObjects" };
            self.reader.report.warn(1, problem);
        }
        let mut listed = BTreeMap::new();
        for mut section in lists.into_iter().flatten() {
            for (_, line) in numbered_lines(&mut section, "SupportedObjects", &mut self.reader) {
                let Some(index) = index_of(&line, &mut self.reader) else { continue };
                let problem = if listed.insert(index, line.line).is_some() {
                    FileProblem::ListedTwice { index }
                } else if !lines.contains_key(&index) {
                    FileProblem::ListedMissing { index }
                } else {
                    continue;
                };
                self.reader.report.warn(line.line, problem);
            }
        }
        for (index, line) in lines.iter().filter(|(index, _)| !listed.contains_key(index)) {
            self.reader.report.warn(*line, FileProblem::Unlisted { index: *index });
        }
        for index in MANDATORY.into_iter().filter(|index| !lines.contains_key(index)) {
            self.reader.report.warn(mandatory_line, FileProblem::MandatoryMissing { index });
        }
    }

    fn read_extensions(&mut self) {
        for (module, index, mut section) in core::mem::take(&mut self.extensions) {
            let text = |section: &mut Section, key| {
                section.take(key).map(|line| line.value).unwrap_or_default()
            };
            let count = text(&mut section, "Count");
            let obj_extend = text(&mut section, "ObjExtend");
            section.take("ObjectType");
            let object_type = ObjectType::Var;
            let place = EntryPlace { index, subindex: None, object_type, inherited: None };
            let Some(entry) = self.reader.read(&mut section, place) else { continue };
            let extension = SubExtension { entry, count, obj_extend };
            let extensions = &mut self.module(module).extensions;
            extensions.entry(index).or_insert(extension);
        }
    }
}

/// Returns whether a section with a short name describes an object.
fn is_object(section: &Section, part: Part) -> bool {
    part != Part::Object
        || ["ObjectType", "DataType", "ParameterName"]
            .iter()
            .any(|key| section.filled(key).is_some())
}

fn kept(section: Section) -> FileSection {
    let entries = section.entries.into_iter().map(|line| (line.key, line.value)).collect();
    FileSection { name: section.name, entries }
}

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
