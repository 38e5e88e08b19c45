use alloc::string::String;

use super::data_type::DataType;

/// Reason why a value cannot be read, encoded or decoded.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ValueError {
    /// The text is not a number.
    #[error("`{text}` is not a number; allowed: decimal, hexadecimal with 0x, octal with 0")]
    NotANumber {
        /// Text.
        text: String,
    },
    /// The number does not fit into the type.
    #[error("{text} is out of range for {data_type}; allowed: {low} to {high}")]
    OutOfRange {
        /// Text.
        text: String,
        /// Type.
        data_type: DataType,
        /// Smallest value.
        low: i128,
        /// Largest value.
        high: i128,
    },
    /// The text is not a sequence of bytes.
    #[error("`{text}` is not a sequence of bytes; allowed: pairs of hexadecimal digits")]
    NotBytes {
        /// Text.
        text: String,
    },
    /// The text has a character that the type cannot hold.
    #[error(
        "{character:?} is not a character of {data_type}; allowed: characters up to U+00FF (ISO \
         8859-1)"
    )]
    Character {
        /// First such character.
        character: char,
        /// Type.
        data_type: DataType,
    },
    /// The number of bytes is not that of the type.
    #[error("{data_type} cannot have {found} bytes; allowed: {}", sizes(*.data_type))]
    Length {
        /// Type.
        data_type: DataType,
        /// Number of bytes.
        found: usize,
    },
    /// The value is of another kind than the type.
    #[error("{kind} cannot be encoded as {data_type}; use a value of this type")]
    Kind {
        /// Kind of the value.
        kind: &'static str,
        /// Type.
        data_type: DataType,
    },
}

fn sizes(data_type: DataType) -> String {
    match data_type.size() {
        Some(size) => alloc::format!("{size} bytes"),
        None if data_type == DataType::UnicodeString => "an even number of bytes".into(),
        None => "any number of bytes".into(),
    }
}
