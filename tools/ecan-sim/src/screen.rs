//! Where the program's messages go.

use std::fmt::Display;
use std::io::Write;

/// Standard output, or standard error where standard output carries data. A reader that went away
/// does not end the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Screen {
    /// Messages are what the program prints.
    Output,
    /// Standard output belongs to the dump.
    BesideData,
}

impl Screen {
    /// Prints a line.
    pub fn line(self, line: impl Display) {
        let _ = match self {
            Self::Output => writeln!(std::io::stdout(), "{line}"),
            Self::BesideData => writeln!(std::io::stderr(), "{line}"),
        };
    }

    /// Prints why the program ends.
    pub fn error(error: &dyn Display) {
        let _ = writeln!(std::io::stderr(), "ecan-sim: {error}");
    }
}
