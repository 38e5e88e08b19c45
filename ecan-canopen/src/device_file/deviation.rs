//! Deviations of a file from CiA 306-1.

use alloc::string::String;
use alloc::vec::Vec;
use core::fmt;

use super::data_value::ValueError;
use super::value_text::ValueNote;

/// Deviation of a device file from CiA 306-1: a warning if the file is usable nevertheless, a fault
/// otherwise.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {problem}")]
pub struct FileDeviation {
    /// Line, from 1.
    pub line: usize,
    /// Description.
    pub problem: FileProblem,
}

/// Kind of a [`FileDeviation`]. The text states what was found, what is allowed, and how the file
/// is read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FileProblem {
    /// The file begins with a byte order mark.
    #[error("byte order mark; allowed: ASCII without it; ignored")]
    ByteOrderMark,
    /// The file has characters that are not ASCII.
    #[error("character outside ASCII; read as {encoding}")]
    NotAscii {
        /// Encoding that was assumed.
        encoding: &'static str,
    },
    /// A line ends with CR alone.
    #[error("line ends with CR alone; allowed: CR LF or LF; read as the end of the line")]
    LoneCarriageReturn,
    /// A line is neither a section nor an entry.
    #[error("line is neither [section] nor key=value; ignored")]
    NotAnEntry,
    /// The name of a section has no closing bracket.
    #[error("section [{section} has no closing bracket; read as if it had one")]
    OpenSection {
        /// Name of the section.
        section: String,
    },
    /// A text follows the closing bracket.
    #[error("text after [{section}]; ignored")]
    TextAfterSection {
        /// Name of the section.
        section: String,
    },
    /// An entry precedes the first section.
    #[error("`{key}` is outside any section; ignored")]
    OutsideSection {
        /// Key of the entry.
        key: String,
    },
    /// A section exists twice.
    #[error("section [{section}] already exists at line {first}; the first one counts")]
    DuplicateSection {
        /// Name of the section.
        section: String,
        /// Line of the first one.
        first: usize,
    },
    /// A key exists twice in a section.
    #[error("`{key}` already exists at line {first}; the first one counts")]
    DuplicateKey {
        /// Key.
        key: String,
        /// Line of the first one.
        first: usize,
    },
    /// The file describes no object.
    #[error(
        "no object is described; a device file has sections like [1000]; check that the file is an \
         EDS or a DCF"
    )]
    NoObjects,
    /// A section that each device file has is missing.
    #[error("section [{section}] is missing; read as if it were empty")]
    MissingSection {
        /// Name of the section.
        section: &'static str,
    },
    /// One of the objects 0x1000, 0x1001 and 0x1018 is missing.
    #[error("mandatory object {index:04X} is missing; the device is used without it")]
    MandatoryMissing {
        /// Index.
        index: u16,
    },
    /// A list names an object that has no section.
    #[error("section [{index:04X}] of a listed object is missing; the object is left out")]
    ListedMissing {
        /// Index.
        index: u16,
    },
    /// A list names an object twice.
    #[error("object {index:04X} is listed twice; read once")]
    ListedTwice {
        /// Index.
        index: u16,
    },
    /// An object is in no list.
    #[error("object {index:04X} is in no object list; read nevertheless")]
    Unlisted {
        /// Index.
        index: u16,
    },
    /// A count is not the number of what it counts.
    #[error("`{key}` of [{section}] is {announced}, but {found} exist; the latter counts")]
    WrongCount {
        /// Section.
        section: String,
        /// Key.
        key: &'static str,
        /// Value of the count.
        announced: i128,
        /// Number that was found.
        found: usize,
    },
    /// `SubNumber` is not the number of sub-objects.
    #[error(
        "object {index:04X} has {found} sub-objects, but `SubNumber` is {announced}; the former \
         counts"
    )]
    WrongSubNumber {
        /// Index.
        index: u16,
        /// Value of `SubNumber`.
        announced: i128,
        /// Number of sections.
        found: usize,
    },
    /// A sub-object belongs to no object.
    #[error("[{section}] belongs to no object; read as part of a RECORD")]
    NoOwner {
        /// Name of the section.
        section: String,
    },
    /// A sub-object that a list names does not exist.
    #[error("sub-object {index:04X}:{subindex:02X} does not exist; ignored")]
    NoSubObject {
        /// Index.
        index: u16,
        /// Subindex.
        subindex: u16,
    },
    /// A variable has sub-objects.
    #[error("object {index:04X} of type {object_type} has sub-objects; read as RECORD")]
    SubObjectsOfVariable {
        /// Index.
        index: u16,
        /// Name of its type.
        object_type: &'static str,
    },
    /// An object or sub-object has no data type.
    #[error("[{section}] has no valid `DataType`; it is left out")]
    NoDataType {
        /// Section.
        section: String,
    },
    /// A key is missing.
    #[error("[{section}] has no `{key}`; {assumed} is assumed")]
    AssumedKey {
        /// Section.
        section: String,
        /// Key.
        key: &'static str,
        /// Value that is assumed.
        assumed: &'static str,
    },
    /// A value is invalid and ignored, or a default is used.
    #[error("`{key}`: {error}; {reading}")]
    IgnoredValue {
        /// Key.
        key: String,
        /// Error.
        error: ValueError,
        /// Reading of the file.
        reading: &'static str,
    },
    /// A value is invalid, and the file cannot be used without it.
    #[error("`{key}`: {error}; correct it")]
    InvalidValue {
        /// Key.
        key: String,
        /// Error.
        error: ValueError,
    },
    /// A value is written in an unusual way.
    #[error("`{key}` = {text}: {}", note.text())]
    UnusualValue {
        /// Key.
        key: String,
        /// Text.
        text: String,
        /// Reading of the value.
        note: ValueNote,
    },
    /// A word is not an allowed one.
    #[error("`{key}` = {text}; allowed: {allowed}; {assumed} is assumed")]
    UnknownWord {
        /// Key.
        key: &'static str,
        /// Text.
        text: String,
        /// Allowed words.
        allowed: &'static str,
        /// Word that is assumed.
        assumed: &'static str,
    },
    /// A data type is neither in CiA 301 nor described by the file.
    #[error("unknown data type {index:#06X}; its values are read as bytes")]
    UnknownDataType {
        /// Index of the type.
        index: u16,
    },
    /// The lower limit is above the upper one.
    #[error("`LowLimit` {low} is above `HighLimit` {high}; both are ignored")]
    CrossedLimits {
        /// Lower limit.
        low: i128,
        /// Upper limit.
        high: i128,
    },
    /// A value is outside the limits of its object.
    #[error("`{key}` {value} is outside the limits {low} to {high}; read nevertheless")]
    OutsideLimits {
        /// Key.
        key: &'static str,
        /// Value.
        value: i128,
        /// Lower limit.
        low: i128,
        /// Upper limit.
        high: i128,
    },
}

/// Faults of a device file that cannot be used: all of them, in the order of their lines.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceFileFaults {
    /// Faults; at least one.
    pub faults: Vec<FileDeviation>,
    /// Warnings of the same file.
    pub warnings: Vec<FileDeviation>,
}

impl fmt::Display for DeviceFileFaults {
    /// All faults, separated by `; `.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (position, fault) in self.faults.iter().enumerate() {
            let separator = if position == 0 { "" } else { "; " };
            write!(f, "{separator}{fault}")?;
        }
        Ok(())
    }
}

impl core::error::Error for DeviceFileFaults {}

/// Deviations that are found while a file is read.
#[derive(Debug, Default)]
pub(super) struct Report {
    pub(super) warnings: Vec<FileDeviation>,
    pub(super) faults: Vec<FileDeviation>,
}

impl Report {
    pub(super) fn warn(&mut self, line: usize, problem: FileProblem) {
        self.warnings.push(FileDeviation { line, problem });
    }

    pub(super) fn fault(&mut self, line: usize, problem: FileProblem) {
        self.faults.push(FileDeviation { line, problem });
    }
}
