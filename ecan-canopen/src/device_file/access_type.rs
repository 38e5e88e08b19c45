use core::fmt;

/// Access to an object (CiA 306-1, `AccessType`), as seen from the bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum AccessType {
    /// Readable; the value never changes.
    Const,
    /// Readable.
    ReadOnly,
    /// Writable.
    WriteOnly,
    /// Readable and writable.
    #[default]
    ReadWrite,
    /// Readable and writable; a TPDO may contain it.
    ReadWriteInput,
    /// Readable and writable; an RPDO may contain it.
    ReadWriteOutput,
}

impl AccessType {
    /// All types, in the order of their words in [`WORDS`](Self::WORDS).
    const ALL: [Self; 6] = [
        Self::Const,
        Self::ReadOnly,
        Self::WriteOnly,
        Self::ReadWrite,
        Self::ReadWriteInput,
        Self::ReadWriteOutput,
    ];
    /// Allowed words of a file.
    pub(super) const WORDS: &str = "const, ro, wo, rw, rwr, rww";

    /// The access with this word, without regard to case.
    pub(super) fn from_word(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|access| access.word().eq_ignore_ascii_case(word))
    }

    /// The word in a file.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Const => "const",
            Self::ReadOnly => "ro",
            Self::WriteOnly => "wo",
            Self::ReadWrite => "rw",
            Self::ReadWriteInput => "rwr",
            Self::ReadWriteOutput => "rww",
        }
    }

    /// Returns whether an SDO can read the object.
    #[must_use]
    pub const fn is_readable(self) -> bool {
        !matches!(self, Self::WriteOnly)
    }

    /// Returns whether an SDO can write the object.
    #[must_use]
    pub const fn is_writable(self) -> bool {
        !matches!(self, Self::Const | Self::ReadOnly)
    }
}

impl fmt::Display for AccessType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}
