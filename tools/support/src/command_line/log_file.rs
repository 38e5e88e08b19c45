//! Reading of recordings, writing of candump logs.

use std::fmt::Display;
use std::io;
use std::io::{BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use ecan_can_io::candump::Record;
use ecan_can_io::recording::{ReadOptions, Recording, RecordingError};
use ecan_protocol::can::CanFrame;
use ecan_protocol::text::Printable;
use thiserror::Error;

use super::new_file::{Existing, create, is_standard_stream};

/// Error of a recording.
#[derive(Debug, Error)]
pub enum LogFileError {
    /// The file cannot be read.
    #[error("cannot read {}: {}", Printable(.0.display()), .1)]
    Read(PathBuf, io::Error),
    /// Invalid line.
    #[error("{}, {}", Printable(.0.display()), .1)]
    Line(PathBuf, RecordingError),
    /// The file contains no frame.
    #[error("{} holds no frame", Printable(.0.display()))]
    Empty(PathBuf),
    /// The file cannot be written.
    #[error("cannot write {}: {}", Printable(.0.display()), .1)]
    Write(PathBuf, io::Error),
}

/// Reads a recording of any format; `-` is standard input.
///
/// # Errors
/// The file cannot be read, a line is invalid, or there is no frame.
pub fn read(path: &Path) -> Result<Recording, LogFileError> {
    read_with(path, &ReadOptions::default())
}

/// As [`read`], with settings for text that does not state them.
///
/// # Errors
/// As for [`read`].
pub fn read_with(path: &Path, options: &ReadOptions) -> Result<Recording, LogFileError> {
    let mut bytes = Vec::new();
    let read = match is_standard_stream(path) {
        true => io::stdin().read_to_end(&mut bytes),
        false => std::fs::File::open(path).and_then(|mut file| file.read_to_end(&mut bytes)),
    };
    read.map_err(|error| LogFileError::Read(path.to_owned(), error))?;
    // Comments of Windows programs may have another encoding.
    let recording = Recording::parse(&String::from_utf8_lossy(&bytes), options)
        .map_err(|error| LogFileError::Line(path.to_owned(), error))?;
    if recording.frames.is_empty() {
        return Err(LogFileError::Empty(path.to_owned()));
    }
    Ok(recording)
}

/// Writer of a candump log. Each function fails with [`LogFileError::Write`].
pub struct Writer {
    file: BufWriter<Box<dyn Write + Send>>,
    path: PathBuf,
}

impl Writer {
    /// Creates or truncates the file; `-` is standard output.
    pub fn create(path: &Path) -> Result<Self, LogFileError> {
        Self::create_with(path, Existing::Replace)
    }

    /// As [`create`](Self::create), with a policy for an existing file.
    pub fn create_with(path: &Path, existing: Existing) -> Result<Self, LogFileError> {
        let path = path.to_owned();
        match create(&path, existing) {
            Ok(file) => Ok(Self { file: BufWriter::new(file), path }),
            Err(error) => Err(LogFileError::Write(path, error)),
        }
    }

    /// Appends a frame; `port` counts the channels of all gateways from `can0`.
    pub fn write(
        &mut self,
        time_ns: u64,
        port: usize,
        frame: CanFrame,
    ) -> Result<(), LogFileError> {
        let interface = format!("can{port}");
        self.write_line(Record { time_ns, interface: &interface, frame, direction: None })
    }

    /// Appends a line, given without line break.
    pub fn write_line(&mut self, line: impl Display) -> Result<(), LogFileError> {
        writeln!(self.file, "{line}").map_err(|error| self.fault(error))
    }

    /// Flushes the buffer.
    pub fn flush(&mut self) -> Result<(), LogFileError> {
        self.file.flush().map_err(|error| self.fault(error))
    }

    /// Flushes and closes the file.
    pub fn finish(mut self) -> Result<(), LogFileError> {
        self.flush()
    }

    fn fault(&self, error: io::Error) -> LogFileError {
        LogFileError::Write(self.path.clone(), error)
    }
}

impl std::fmt::Debug for Writer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Writer").field("path", &self.path).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use ecan_can_io::recording::LoggedFrame;

    use super::*;

    #[test]
    fn log_round_trips_and_errors_name_the_line() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.log");
        let frame =
            CanFrame::classic(ecan_protocol::can::CanId::standard(0x123).unwrap(), &[1]).unwrap();
        let mut writer = Writer::create(&path).unwrap();
        writer.write(1_500_000_000, 2, frame).unwrap();
        writer.finish().unwrap();
        let logged =
            LoggedFrame { line: 1, time_ns: 1_500_000_000, interface: "can2".to_owned(), frame };
        assert_eq!(read(&path).unwrap().frames, [logged]);

        std::fs::write(&path, "(1.000000) can0 123#\n(2.000000) can0 12#\n").unwrap();
        let message = read(&path).unwrap_err().to_string();
        assert!(message.contains("a.log, line 2, column"), "{message}");
        let with_errors = "(1.000000) can0 20000080#0000000000000000\n(2.000000) can0 123#\n";
        std::fs::write(&path, with_errors).unwrap();
        let log = read(&path).unwrap();
        assert_eq!((log.frames.len(), log.frames[0].line, log.error_frames), (1, 2, 1));
        std::fs::write(&path, b";\xFC\n 1) 1.0 0123 0\n").unwrap();
        assert_eq!(read(&path).unwrap().format, ecan_can_io::recording::Format::Trc);
        std::fs::write(&path, "# nothing\n").unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("holds no frame"));
        let missing = read(&directory.path().join("none")).unwrap_err().to_string();
        assert!(missing.starts_with("cannot read "), "{missing}");
    }
}
