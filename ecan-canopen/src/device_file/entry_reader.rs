//! Reading of an object without sub-objects, or of one sub-object.

use alloc::collections::BTreeMap;
use alloc::format;
use alloc::string::String;

use super::data_type::{AccessType, DataType, ObjectType};
use super::data_value::FileValue;
use super::deviation::{FileProblem, Report};
use super::device_object::{ObjectEntry, ObjectFlags};
use super::ini::{Line, Section};
use super::sections::bounded;
use super::value_text;

/// Reader of entries.
#[derive(Debug, Default)]
pub(super) struct EntryReader {
    /// Simple types of the types that the file itself defines, by their index.
    pub(super) derived: BTreeMap<u16, DataType>,
    pub(super) report: Report,
}

/// Properties of an entry that its section does not state.
#[derive(Clone, Copy, Debug)]
pub(super) struct EntryPlace {
    pub(super) index: u16,
    /// `None` for an object without sub-objects.
    pub(super) subindex: Option<u8>,
    pub(super) object_type: ObjectType,
    /// Data type if the section gives none.
    pub(super) inherited: Option<DataType>,
}

impl EntryReader {
    /// Reads an entry; `None` without data type, which is reported.
    pub(super) fn read(&mut self, section: &mut Section, place: EntryPlace) -> Option<ObjectEntry> {
        let EntryPlace { index, subindex, object_type, .. } = place;
        let name = self.name(section, index, subindex);
        // Objects without sub-objects may state that they have none.
        section.take("SubNumber");
        let Some(data_type) = self.data_type(section, place) else {
            let problem = FileProblem::NoDataType { section: section.name.clone() };
            self.report.warn(section.line, problem);
            return None;
        };
        let access = self.access(section, object_type);
        let (low_limit, high_limit) = self.limits(section, data_type);
        let default = section.take("DefaultValue").and_then(|line| {
            let value = self.optional(section, data_type, &line);
            let limits = (&low_limit, &high_limit);
            self.check_limits("DefaultValue", &line, data_type, value.as_ref(), limits);
            value
        });
        let parameter = section.take("ParameterValue").and_then(|line| {
            let value = self.parameter(data_type, &line);
            let limits = (&low_limit, &high_limit);
            self.check_limits("ParameterValue", &line, data_type, value.as_ref(), limits);
            value
        });
        let reference = section.take("ParamRefd").or_else(|| section.take("ParameterRefd"));
        let text = |line: Option<Line>| line.map(|line| line.value).unwrap_or_default();
        Some(ObjectEntry {
            index,
            subindex: subindex.unwrap_or(0),
            name,
            object_type,
            data_type,
            access,
            pdo_mapping: self.flag(section, "PDOMapping"),
            low_limit,
            high_limit,
            default,
            parameter,
            reference: text(reference),
            denotation: text(section.take("Denotation")),
            flags: self.flags(section),
            upload_file: text(section.take("UploadFile")),
            download_file: text(section.take("DownloadFile")),
            extra: core::mem::replace(section, Section::empty("", 0)).into_rest(),
        })
    }

    pub(super) fn name(
        &mut self,
        section: &mut Section,
        index: u16,
        subindex: Option<u8>,
    ) -> String {
        if let Some(line) = section.take("ParameterName") {
            return line.value;
        }
        let problem = FileProblem::AssumedKey {
            section: section.name.clone(),
            key: "ParameterName",
            assumed: "the index",
        };
        self.report.warn(section.line, problem);
        match subindex {
            Some(subindex) => format!("{index:04X}sub{subindex:X}"),
            None => format!("{index:04X}"),
        }
    }

    fn data_type(&mut self, section: &mut Section, place: EntryPlace) -> Option<DataType> {
        let Some(line) = section.take("DataType") else {
            return self.missing_data_type(section, place);
        };
        let number = u16::try_from(value_text::number(&line.value)?).ok()?;
        Some(match DataType::from_index(number) {
            DataType::Other(index) => match self.derived.get(&index) {
                Some(simple) => *simple,
                None => {
                    self.report.warn(line.line, FileProblem::UnknownDataType { index });
                    DataType::Other(index)
                }
            },
            known => known,
        })
    }

    fn missing_data_type(&mut self, section: &Section, place: EntryPlace) -> Option<DataType> {
        let (data_type, assumed) = match (place.object_type, place.inherited) {
            (ObjectType::Domain, _) => return Some(DataType::Domain),
            (_, Some(inherited)) => (inherited, "that of the object"),
            // The value of a type definition is its length in bits.
            (ObjectType::DefType, None) => (DataType::Unsigned32, "UNSIGNED32"),
            _ => return None,
        };
        let section_name = section.name.clone();
        let problem = FileProblem::AssumedKey { section: section_name, key: "DataType", assumed };
        self.report.warn(section.line, problem);
        Some(data_type)
    }

    fn access(&mut self, section: &mut Section, object_type: ObjectType) -> AccessType {
        let assumed = AccessType::ReadWrite;
        let Some(line) = section.take("AccessType") else {
            if object_type != ObjectType::Domain {
                let section_name = section.name.clone();
                let problem = FileProblem::AssumedKey {
                    section: section_name,
                    key: "AccessType",
                    assumed: assumed.word(),
                };
                self.report.warn(section.line, problem);
            }
            return assumed;
        };
        let word = line.value.split(';').next().unwrap_or_default().trim_end();
        AccessType::from_word(word).unwrap_or_else(|| {
            let problem = FileProblem::UnknownWord {
                key: "AccessType",
                text: line.value.clone(),
                allowed: AccessType::WORDS,
                assumed: assumed.word(),
            };
            self.report.warn(line.line, problem);
            assumed
        })
    }

    fn flag(&mut self, section: &mut Section, key: &str) -> bool {
        let Some(line) = section.take(key) else { return false };
        let limits = (i128::MIN, i128::MAX);
        let reading = "0 is assumed";
        bounded(&line, DataType::Boolean, limits, reading, &mut self.report)
            .is_some_and(|flag| flag != 0)
    }

    pub(super) fn flags(&mut self, section: &mut Section) -> ObjectFlags {
        let Some(line) = section.take("ObjFlags") else { return ObjectFlags::default() };
        let limits = (0, u32::MAX.into());
        let reading = "0 is assumed";
        let flags = bounded(&line, DataType::Unsigned32, limits, reading, &mut self.report);
        ObjectFlags(flags.unwrap_or(0) as u32)
    }

    fn limits(
        &mut self,
        section: &mut Section,
        data_type: DataType,
    ) -> (Option<FileValue>, Option<FileValue>) {
        // Limits of other types have no meaning; some files give the length of a text.
        let is_number = data_type.is_integer()
            || matches!(data_type, DataType::Boolean | DataType::Real32 | DataType::Real64);
        if !is_number {
            return (None, None);
        }
        let (low_line, high_line) = (section.take("LowLimit"), section.take("HighLimit"));
        let low = low_line.as_ref().and_then(|line| self.optional(section, data_type, line));
        let high = high_line.as_ref().and_then(|line| self.optional(section, data_type, line));
        if let (Some(low), Some(high)) = (fixed(low.as_ref()), fixed(high.as_ref()))
            && low > high
        {
            let line = low_line.as_ref().map_or(section.line, |line| line.line);
            self.report.warn(line, FileProblem::CrossedLimits { low, high });
            [low_line, high_line].into_iter().flatten().for_each(|line| section.put_back(line));
            return (None, None);
        }
        (low, high)
    }

    /// Reads a value that is dispensable: an invalid one is reported and kept as text.
    fn optional(
        &mut self,
        section: &mut Section,
        data_type: DataType,
        line: &Line,
    ) -> Option<FileValue> {
        match value_text::read(data_type, &line.value) {
            Ok((value, note)) => {
                self.note(line, note);
                Some(value)
            }
            Err(error) => {
                let key = line.key.clone();
                let problem = FileProblem::IgnoredValue { key, error, reading: "ignored" };
                self.report.warn(line.line, problem);
                section.put_back(line.clone());
                None
            }
        }
    }

    /// Reads a value that is meant for the device: an invalid one is a fault.
    pub(super) fn parameter(&mut self, data_type: DataType, line: &Line) -> Option<FileValue> {
        match value_text::read(data_type, &line.value) {
            Ok((value, note)) => {
                self.note(line, note);
                Some(value)
            }
            Err(error) => {
                let problem = FileProblem::InvalidValue { key: line.key.clone(), error };
                self.report.fault(line.line, problem);
                None
            }
        }
    }

    fn note(&mut self, line: &Line, note: Option<value_text::ValueNote>) {
        if let Some(note) = note {
            let (key, text) = (line.key.clone(), line.value.clone());
            self.report.warn(line.line, FileProblem::UnusualValue { key, text, note });
        }
    }

    fn check_limits(
        &mut self,
        key: &'static str,
        line: &Line,
        data_type: DataType,
        value: Option<&FileValue>,
        (low, high): (&Option<FileValue>, &Option<FileValue>),
    ) {
        let Some(value) = fixed(value) else { return };
        let (lowest, highest) = data_type.range().unwrap_or_default();
        let low = fixed(low.as_ref()).unwrap_or(lowest);
        let high = fixed(high.as_ref()).unwrap_or(highest);
        if !(low..=high).contains(&value) {
            let problem = FileProblem::OutsideLimits { key, value, low, high };
            self.report.warn(line.line, problem);
        }
    }
}

/// The number of a value that does not depend on the node-ID.
fn fixed(value: Option<&FileValue>) -> Option<i128> {
    match value? {
        FileValue::Fixed(value) => value.to_integer(),
        FileValue::NodeId { .. } => None,
    }
}
