//! What cannot be used of a file.

use core::fmt;

use thiserror::Error;

/// Fault in a line.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("line {line}: {kind}")]
pub struct DbcFault {
    /// Line, from 1.
    pub line: usize,
    /// Kind of fault.
    pub kind: FaultKind,
}

/// Kind of fault.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum FaultKind {
    /// The statement has another form.
    #[error("column {column}: syntax error in \"{text}\"")]
    Syntax {
        /// Column, from 1.
        column: usize,
        /// Text of the line.
        text: String,
    },
    /// A number that is out of range.
    #[error("{what} {value} is out of range; allowed: {allowed}")]
    Value {
        /// What the number is.
        what: String,
        /// Text of the number.
        value: String,
        /// Numbers that are allowed.
        allowed: &'static str,
    },
    /// CAN ID of a message.
    #[error(
        "CAN ID {0} is out of range; allowed: 0 to 2047, or 2147483648 plus an extended CAN ID of 0 \
         to 536870911"
    )]
    CanId(String),
    /// Length of a message.
    #[error("message length {0} is out of range; allowed: 0 to 64 bytes")]
    Length(String),
    /// CAN ID or name of another message.
    #[error("{what} {value} is also in line {line}")]
    Duplicate {
        /// Kind of the name.
        what: &'static str,
        /// CAN ID or name.
        value: String,
        /// Line of the first one.
        line: usize,
    },
    /// Bits of a signal.
    #[error(
        "signal {signal}: {bits} bits from bit {start} are not in {bytes} bytes; allowed: 1 to 64 bits"
    )]
    Bits {
        /// Name of the signal.
        signal: String,
        /// Start bit.
        start: String,
        /// Length in bits.
        bits: String,
        /// Length of the message in bytes.
        bytes: usize,
    },
    /// A float of another length.
    #[error("signal {signal}: a {expected} bit float has {bits} bits")]
    FloatLength {
        /// Name of the signal.
        signal: String,
        /// Length in bits.
        bits: u32,
        /// Length of the type.
        expected: u32,
    },
    /// A reference to a message or signal that does not exist.
    #[error("{0} does not exist")]
    Reference(String),
    /// A multiplexed signal in a message without multiplexer or with several.
    #[error(
        "signal {signal} is multiplexed, but the message has {count} multiplexers; expected 1, or SG_MUL_VAL_"
    )]
    Multiplexer {
        /// Name of the signal.
        signal: String,
        /// Number of multiplexers.
        count: usize,
    },
    /// A multiplexer that depends on itself.
    #[error("signal {0} is multiplexed by itself")]
    MultiplexerCycle(String),
}

/// Faults of a file in which no message can be used, in the order of their lines.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub struct DbcFaults(pub Vec<DbcFault>);

impl fmt::Display for DbcFaults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0.as_slice() {
            [only] => write!(f, "{only}"),
            all => {
                write!(f, "{} faults", all.len())?;
                all.iter().try_for_each(|fault| write!(f, "\n  - {fault}"))
            }
        }
    }
}
