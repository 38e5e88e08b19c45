use std::fmt::Display;
use std::io::{self, Write};

use ecan_tool_support::command_line::screen::{CleanWriter, Stream};
use ecan_tool_support::{print_error_line, print_line};

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
        match self {
            Self::Output => print_line!("{line}"),
            Self::OutputIsData => print_error_line!("{line}"),
        }
    }

    pub fn error(error: &dyn Display) {
        print_error_line!("ecan-sim: {error}");
    }
}

/// Prints data on standard output. A closed pipe is not an error.
pub fn print(data: &[u8]) -> Result<(), Failure> {
    let mut output = CleanWriter::new(Stream::Output);
    match output.write_all(data).and_then(|()| output.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(Failure::Output(error)),
        _ => Ok(()),
    }
}
