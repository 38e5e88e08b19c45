//! Sections with fixed entries: struct, reader and writer from one declaration.

use alloc::collections::BTreeSet;
use alloc::string::String;

use crate::NodeId;

use super::data_type::DataType;
use super::deviation::{FileProblem, Report};
use super::ini::{Line, Section};
use super::output::Output;
use super::value_error::ValueError;
use super::value_text;

/// Field of a section.
pub(super) trait Field: Sized {
    /// Takes the entry from the section. An invalid one is reported and put back.
    fn take(section: &mut Section, key: &str, report: &mut Report) -> Self;

    fn put(&self, key: &str, out: &mut Output);
}

/// Reads a number within limits; an invalid one is reported.
pub(super) fn bounded(
    entry: &Line,
    data_type: DataType,
    (low, high): (i128, i128),
    reading: &'static str,
    report: &mut Report,
) -> Option<i128> {
    let text = entry.value.clone();
    let error = match value_text::number(&entry.value) {
        Some(number) if (low..=high).contains(&number) => return Some(number),
        Some(_) => ValueError::OutOfRange { text, data_type, low, high },
        None => ValueError::NotANumber { text },
    };
    let key = entry.key.clone();
    report.warn(entry.line, FileProblem::IgnoredValue { key, error, reading });
    None
}

fn take_number(
    section: &mut Section,
    key: &str,
    data_type: DataType,
    limits: (i128, i128),
    report: &mut Report,
) -> Option<i128> {
    let entry = section.take(key)?;
    let number = bounded(&entry, data_type, limits, "ignored", report);
    if number.is_none() {
        section.put_back(entry);
    }
    number
}

impl Field for String {
    fn take(section: &mut Section, key: &str, _report: &mut Report) -> Self {
        section.take(key).map(|entry| entry.value).unwrap_or_default()
    }

    fn put(&self, key: &str, out: &mut Output) {
        out.text(key, self);
    }
}

macro_rules! number_fields {
    ($($number:ident: $data_type:ident,)*) => {$(
        impl Field for Option<$number> {
            fn take(section: &mut Section, key: &str, report: &mut Report) -> Self {
                let limits = ($number::MIN.into(), $number::MAX.into());
                let number = take_number(section, key, DataType::$data_type, limits, report)?;
                $number::try_from(number).ok()
            }

            fn put(&self, key: &str, out: &mut Output) {
                if let Some(number) = self {
                    out.entry(key, number);
                }
            }
        }
    )*};
}

number_fields! {
    u8: Unsigned8,
    u16: Unsigned16,
    u32: Unsigned32,
}

impl Field for Option<bool> {
    fn take(section: &mut Section, key: &str, report: &mut Report) -> Self {
        let limits = (i128::MIN, i128::MAX);
        Some(take_number(section, key, DataType::Boolean, limits, report)? != 0)
    }

    fn put(&self, key: &str, out: &mut Output) {
        if let Some(value) = self {
            out.entry(key, u8::from(*value));
        }
    }
}

impl Field for Option<NodeId> {
    fn take(section: &mut Section, key: &str, report: &mut Report) -> Self {
        let limits = (NodeId::MIN.get().into(), NodeId::MAX.get().into());
        let number = take_number(section, key, DataType::Unsigned8, limits, report)?;
        u8::try_from(number).ok().and_then(NodeId::new)
    }

    fn put(&self, key: &str, out: &mut Output) {
        if let Some(node) = self {
            out.entry(key, node);
        }
    }
}

/// Bit rates of a device.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BitRates {
    /// Supported bit rates in kbit/s.
    pub kbit_per_s: BTreeSet<u16>,
}

impl BitRates {
    /// Bit rates of CiA 306-1 in kbit/s.
    pub const STANDARD: [u16; 8] = [10, 20, 50, 125, 250, 500, 800, 1000];

    /// Returns whether the device supports a bit rate, in bit/s.
    #[must_use]
    pub fn contains(&self, bit_rate: u32) -> bool {
        self.kbit_per_s.iter().any(|kbit| u32::from(*kbit) * 1000 == bit_rate)
    }
}

impl Field for BitRates {
    fn take(section: &mut Section, key: &str, report: &mut Report) -> Self {
        let mut rates = Self::default();
        for (rate, entry) in section.take_numbered(key) {
            if entry.value.is_empty() {
                continue;
            }
            let limits = (i128::MIN, i128::MAX);
            let flag = bounded(&entry, DataType::Boolean, limits, "not supported", report);
            if flag.is_some_and(|flag| flag != 0) {
                rates.kbit_per_s.insert(rate);
            }
        }
        rates
    }

    fn put(&self, key: &str, out: &mut Output) {
        let all = Self::STANDARD.iter().chain(&self.kbit_per_s).collect::<BTreeSet<_>>();
        for rate in all {
            let flag = u8::from(self.kbit_per_s.contains(rate));
            out.entry(&alloc::format!("{key}{rate}"), flag);
        }
    }
}

/// Declares the struct of a section: fields with their keys.
macro_rules! section_struct {
    (
        $(#[$attribute:meta])*
        $name:ident {
            $($(#[$field_attribute:meta])* $field:ident: $type:ty = $key:literal,)*
        }
    ) => {
        $(#[$attribute])*
        #[derive(Clone, Debug, Default, PartialEq, Eq)]
        pub struct $name {
            $($(#[$field_attribute])* pub $field: $type,)*
            /// Entries that CiA 306-1 does not define, or whose value is invalid.
            pub extra: alloc::vec::Vec<(alloc::string::String, alloc::string::String)>,
        }

        impl $name {
            pub(super) fn read(
                mut section: $crate::device_file::ini::Section,
                report: &mut $crate::device_file::deviation::Report,
            ) -> Self {
                use $crate::device_file::section_fields::Field;
                $(let $field = Field::take(&mut section, $key, report);)*
                Self { $($field,)* extra: section.into_rest() }
            }

            pub(super) fn write(&self, out: &mut $crate::device_file::output::Output) {
                use $crate::device_file::section_fields::Field;
                $(Field::put(&self.$field, $key, out);)*
                out.entries(&self.extra);
            }
        }
    };
}

pub(super) use section_struct;
