//! Errors in electronic data sheets.

/// Error in an EDS.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {kind}")]
pub struct EdsError {
    /// Line, from 1.
    pub line: usize,
    /// Cause.
    pub kind: EdsErrorKind,
}

/// Cause of an EDS error.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EdsErrorKind {
    /// The line is not a section, entry or comment.
    #[error("neither [section] nor key=value")]
    InvalidLine,
    /// A section name lacks its closing bracket.
    #[error("section name without closing bracket")]
    UnclosedSection,
    /// An entry is before the first section.
    #[error("entry outside any section")]
    EntryOutsideSection,
    /// A section is repeated.
    #[error("section [{name}] already exists at line {first}")]
    DuplicateSection {
        /// Section name.
        name: String,
        /// Line of the first occurrence.
        first: usize,
    },
    /// A key is repeated in its section.
    #[error("`{key}` already exists at line {first}")]
    DuplicateKey {
        /// The key.
        key: String,
        /// Line of the first occurrence.
        first: usize,
    },
    /// A required section is missing.
    #[error("section [{name}] is missing")]
    MissingSection {
        /// Section name.
        name: String,
    },
    /// A required entry is missing.
    #[error("[{section}] has no `{key}`")]
    MissingKey {
        /// The section.
        section: String,
        /// The key.
        key: String,
    },
    /// A value is not a number.
    #[error("`{text}` is not a number")]
    NotANumber {
        /// The value.
        text: String,
    },
    /// A number is outside the range of its key or of the object's data type.
    #[error("{text} is out of range; allowed: {low} to {high}")]
    Range {
        /// The value.
        text: String,
        /// Minimum.
        low: i64,
        /// Maximum.
        high: i64,
    },
    /// A byte string does not consist of pairs of hexadecimal digits.
    #[error("`{text}` is not a sequence of bytes in hexadecimal digits")]
    NotBytes {
        /// The value.
        text: String,
    },
    /// A data type is not a static data type of CiA 301.
    #[error("unknown data type {code:#06X}")]
    DataType {
        /// Index of the data type.
        code: u16,
    },
    /// An object type is not DOMAIN, VAR, ARRAY or RECORD.
    #[error("invalid object type {code}; allowed: 2 (DOMAIN), 7 (VAR), 8 (ARRAY), 9 (RECORD)")]
    ObjectType {
        /// Object type.
        code: u8,
    },
    /// An access type is not defined in CiA 306.
    #[error("invalid access type `{text}`; allowed: const, ro, wo, rw, rwr, rww")]
    Access {
        /// The value.
        text: String,
    },
    /// A lower limit is above the upper limit.
    #[error("the lower limit {low} is above the upper limit {high}")]
    Limits {
        /// Lower limit.
        low: i64,
        /// Upper limit.
        high: i64,
    },
    /// A subindex section belongs to no object.
    #[error("[{name}] belongs to no object")]
    Orphan {
        /// Section name.
        name: String,
    },
    /// None of the three object lists contains an object.
    #[error("object {index:04X} is in no object list")]
    Unlisted {
        /// Index of the object.
        index: u16,
    },
    /// The number of subindices of an object is wrong.
    #[error("object {index:04X} has {found} subindices; `SubNumber` is {announced}")]
    SubindexCount {
        /// Index of the object.
        index: u16,
        /// Value of `SubNumber`.
        announced: usize,
        /// Number of subindex sections.
        found: usize,
    },
    /// An object that every CANopen device has is missing.
    #[error("mandatory object {index:04X} is missing")]
    Mandatory {
        /// Index of the object.
        index: u16,
    },
}
