use std::fmt::Display;
use std::io::{self, Write};

use crate::failure::Failure;

/// Stream of the messages: standard output, or standard error if standard output carries data.
/// Write errors are ignored, so that a closed pipe does not end the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Screen {
    Output,
    OutputIsData,
}

impl Screen {
    pub fn line(self, line: impl Display) {
        let _ = match self {
            Self::Output => writeln!(std::io::stdout(), "{line}"),
            Self::OutputIsData => writeln!(std::io::stderr(), "{line}"),
        };
    }

    pub fn error(error: &dyn Display) {
        let _ = writeln!(std::io::stderr(), "ecan-sim: {error}");
    }
}

/// Prints data on standard output. A closed pipe is not an error.
pub fn print(data: &[u8]) -> Result<(), Failure> {
    let mut output = io::stdout().lock();
    match output.write_all(data).and_then(|()| output.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(Failure::Output(error)),
        _ => Ok(()),
    }
}
