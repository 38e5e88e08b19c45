//! candump log files: reading a recording, writing what came back.

use std::fmt::Display;
use std::io::{BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use ecan_candump::{ParseError, ParseErrorKind, Record};
use ecan_protocol::can::CanFrame;
use thiserror::Error;

use crate::new_file::{Existing, create, is_standard_stream};

/// A log that cannot be read or written.
#[derive(Debug, Error)]
pub enum LogFileError {
    /// The file cannot be read.
    #[error("cannot read {}: {error}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        error: std::io::Error,
    },
    /// A line that the grammar does not allow.
    #[error("{}, line {line}, {cause}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// Column and reason.
        cause: ParseError,
    },
    /// There is no frame in it.
    #[error("{} holds no frame", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// The file cannot be written.
    #[error("cannot write {}: {error}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        error: std::io::Error,
    },
}

/// One frame of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct LoggedFrame {
    /// Line in the file, from 1.
    pub line: usize,
    /// Time stamp in nanoseconds.
    pub time_ns: u64,
    /// Interface of the recording.
    pub interface: String,
    /// The frame.
    pub frame: CanFrame,
}

/// A whole log.
#[derive(Debug, Clone, PartialEq)]
pub struct Log {
    /// Its frames, in its order.
    pub frames: Vec<LoggedFrame>,
    /// Lines with error messages of a CAN interface (`candump -e`), which are no frames of the bus.
    pub error_messages: usize,
}

/// Reads the frames of a whole log, without the error messages in it.
///
/// # Errors
/// As [`read_log`].
pub fn read(path: &Path) -> Result<Vec<LoggedFrame>, LogFileError> {
    read_log(path).map(|log| log.frames)
}

/// Reads a whole log, or standard input where the path is `-`.
///
/// # Errors
/// The file and why it cannot be read, or the line and column where it is no candump log, or that
/// it holds no frame.
pub fn read_log(path: &Path) -> Result<Log, LogFileError> {
    let mut text = String::new();
    let read = match is_standard_stream(path) {
        true => std::io::stdin().read_to_string(&mut text),
        false => std::fs::File::open(path).and_then(|mut file| file.read_to_string(&mut text)),
    };
    read.map_err(|error| LogFileError::Read { path: path.to_owned(), error })?;
    let mut log = Log { frames: Vec::new(), error_messages: 0 };
    for (line, text) in (1..).zip(text.lines()) {
        match ecan_candump::parse_line(text) {
            Ok(Some(record)) => log.frames.push(LoggedFrame {
                line,
                time_ns: record.time_ns,
                interface: record.interface.to_owned(),
                frame: record.frame,
            }),
            Ok(None) => {}
            Err(error) if error.kind == ParseErrorKind::ErrorMessage => log.error_messages += 1,
            Err(cause) => return Err(LogFileError::Line { path: path.to_owned(), line, cause }),
        }
    }
    if log.frames.is_empty() {
        return Err(LogFileError::Empty { path: path.to_owned() });
    }
    Ok(log)
}

/// Writes frames as a candump log.
pub struct Writer {
    file: BufWriter<Box<dyn Write + Send>>,
    path: PathBuf,
}

impl Writer {
    /// Creates the file, or empties it; `-` is standard output.
    ///
    /// # Errors
    /// The file and why it cannot be written.
    pub fn create(path: &Path) -> Result<Self, LogFileError> {
        Self::create_with(path, Existing::Replace)
    }

    /// As [`create`](Self::create), with a choice of what becomes of a file that is there.
    ///
    /// # Errors
    /// The file and why it cannot be written.
    pub fn create_with(path: &Path, existing: Existing) -> Result<Self, LogFileError> {
        let path = path.to_owned();
        match create(&path, existing) {
            Ok(file) => Ok(Self { file: BufWriter::new(file), path }),
            Err(error) => Err(LogFileError::Write { path, error }),
        }
    }

    /// Appends a frame; `port` counts the channels of all gateways, `can0` being the first.
    ///
    /// # Errors
    /// The file and why it cannot be written.
    pub fn write(
        &mut self,
        time_ns: u64,
        port: usize,
        frame: CanFrame,
    ) -> Result<(), LogFileError> {
        let interface = format!("can{port}");
        self.write_line(Record { time_ns, interface: &interface, frame, direction: None })
    }

    /// Appends a line of the log's grammar, given without its end.
    ///
    /// # Errors
    /// The file and why it cannot be written.
    pub fn write_line(&mut self, line: impl Display) -> Result<(), LogFileError> {
        writeln!(self.file, "{line}").map_err(|error| self.fault(error))
    }

    /// Writes out what has been appended so far.
    ///
    /// # Errors
    /// The file and why it cannot be written.
    pub fn flush(&mut self) -> Result<(), LogFileError> {
        self.file.flush().map_err(|error| self.fault(error))
    }

    /// Writes everything out.
    ///
    /// # Errors
    /// The file and why it cannot be written.
    pub fn finish(mut self) -> Result<(), LogFileError> {
        self.flush()
    }

    fn fault(&self, error: std::io::Error) -> LogFileError {
        LogFileError::Write { path: self.path.clone(), error }
    }
}

impl std::fmt::Debug for Writer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Writer").field("path", &self.path).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_written_is_read_and_faults_name_their_line() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.log");
        let frame =
            CanFrame::classic(ecan_protocol::can::CanId::standard(0x123).unwrap(), &[1]).unwrap();
        let mut writer = Writer::create(&path).unwrap();
        writer.write(1_500_000_000, 2, frame).unwrap();
        writer.finish().unwrap();
        let logged =
            LoggedFrame { line: 1, time_ns: 1_500_000_000, interface: "can2".to_owned(), frame };
        assert_eq!(read(&path).unwrap(), [logged]);

        std::fs::write(&path, "(1.000000) can0 123#\n(2.000000) can0 12#\n").unwrap();
        let message = read(&path).unwrap_err().to_string();
        assert!(message.contains("a.log, line 2, column"), "{message}");
        let with_errors = "(1.000000) can0 20000080#0000000000000000\n(2.000000) can0 123#\n";
        std::fs::write(&path, with_errors).unwrap();
        let log = read_log(&path).unwrap();
        assert_eq!((log.frames.len(), log.frames[0].line, log.error_messages), (1, 2, 1));
        std::fs::write(&path, "# nothing\n").unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("holds no frame"));
        let missing = read(&directory.path().join("none")).unwrap_err().to_string();
        assert!(missing.starts_with("cannot read "), "{missing}");
    }
}
