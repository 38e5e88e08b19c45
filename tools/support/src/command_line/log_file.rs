//! Reading of recordings, writing of candump logs and BLF files.

use std::fmt::Display;
use std::fs::File;
use std::io;
use std::io::{BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use ecan_can_io::candump::Record;
use ecan_can_io::recording::{BlfWriter, ReadOptions, Recording, RecordingError};
use ecan_protocol::can::CanFrame;
use ecan_protocol::text::Printable;
use thiserror::Error;

use super::new_file::{Existing, create, create_seekable, is_standard_stream};

/// Error of a recording.
#[derive(Debug, Error)]
pub enum LogFileError {
    /// The file cannot be read.
    #[error("cannot read {}: {}", Printable(.0.display()), .1)]
    Read(PathBuf, io::Error),
    /// Invalid line.
    #[error("{}, {}", Printable(.0.display()), .1)]
    Line(PathBuf, RecordingError),
    /// The name is that of a format that is only read.
    #[error(
        "{} is not written: this program writes BLF (*.blf) and candump logs (other names, for example *.log), \
         and pcapng with --capture",
        Printable(.0.display())
    )]
    ReadOnlyFormat(PathBuf),
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
    let recording = Recording::read(&bytes, options)
        .map_err(|error| LogFileError::Line(path.to_owned(), error))?;
    match (recording.frames.first(), recording.skipped.first()) {
        (Some(_), _) => Ok(recording),
        (None, Some(skipped)) => Err(LogFileError::Line(path.to_owned(), skipped.error.clone())),
        (None, None) => Err(LogFileError::Empty(path.to_owned())),
    }
}

/// Most lines of a recording that are reported one by one.
const MOST_SKIPPED: usize = 10;

/// What a recording does not give back: lines that cannot be read, and frames that were lost when it was made.
pub fn losses(path: &Path, recording: &Recording) -> Vec<String> {
    let name = Printable(path.display());
    let skipped = recording.skipped.iter().take(MOST_SKIPPED);
    let mut losses: Vec<_> = skipped.map(|line| format!("{name}, {line}; left out")).collect();
    if let Some(more @ 1..) = recording.skipped.len().checked_sub(MOST_SKIPPED) {
        losses.push(format!("{name}: {more} more lines left out"));
    }
    if recording.dropped > 0 {
        losses.push(format!("{name}: {} frames lost when it was recorded", recording.dropped));
    }
    losses
}

/// Writer of a candump log, or of a BLF file if the name ends in `.blf`. Each function fails with
/// [`LogFileError::Write`].
pub struct Writer {
    log: Log,
    path: PathBuf,
}

enum Log {
    Candump(BufWriter<Box<dyn Write + Send>>),
    Blf { writer: BlfWriter<File>, flushed: Instant },
}

/// Extensions of formats that a candump log would pass for.
const READ_ONLY: [&str; 6] = ["asc", "trc", "pcap", "pcapng", "mf4", "mdf"];
/// Longest time that frames of a BLF file wait for others to be compressed with.
const BLF_FLUSH: Duration = Duration::from_secs(1);

impl Writer {
    /// Creates or truncates the file; `-` is standard output.
    pub fn create(path: &Path) -> Result<Self, LogFileError> {
        Self::create_with(path, Existing::Replace)
    }

    /// As [`create`](Self::create), with a policy for an existing file.
    pub fn create_with(path: &Path, existing: Existing) -> Result<Self, LogFileError> {
        let has_extension = |known: &str| {
            path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(known))
        };
        if READ_ONLY.iter().any(|known| has_extension(known)) {
            return Err(LogFileError::ReadOnlyFormat(path.to_owned()));
        }
        if !has_extension("blf") {
            return Self::candump(path, existing);
        }
        let path = path.to_owned();
        match create_seekable(&path, existing).and_then(BlfWriter::new) {
            Ok(writer) => Ok(Self { log: Log::Blf { writer, flushed: Instant::now() }, path }),
            Err(error) => Err(LogFileError::Write(path, error)),
        }
    }

    /// As [`create_with`](Self::create_with), of a candump log with any name.
    pub fn candump(path: &Path, existing: Existing) -> Result<Self, LogFileError> {
        let path = path.to_owned();
        match create(&path, existing) {
            Ok(file) => Ok(Self { log: Log::Candump(BufWriter::new(file)), path }),
            Err(error) => Err(LogFileError::Write(path, error)),
        }
    }

    /// Appends a frame that was received; `port` counts the channels of all gateways from `can0`.
    pub fn write(
        &mut self,
        time_ns: u64,
        port: usize,
        frame: CanFrame,
    ) -> Result<(), LogFileError> {
        let interface = format!("can{port}");
        let line = Record { time_ns, interface: &interface, frame, direction: None };
        self.write_frame((time_ns, port), &frame, false, line)
    }

    /// Appends a frame; `line` is its line in a candump log, without line break.
    pub fn write_frame(
        &mut self,
        (time_ns, port): (u64, usize),
        frame: &CanFrame,
        is_sent: bool,
        line: impl Display,
    ) -> Result<(), LogFileError> {
        let written = match &mut self.log {
            Log::Candump(file) => writeln!(file, "{line}"),
            Log::Blf { writer, .. } => {
                let port = u16::try_from(port).unwrap_or(u16::MAX);
                writer.write(time_ns, port, frame, is_sent)
            }
        };
        written.map_err(|error| self.fault(error))
    }

    /// Appends a comment on the place before the next frame.
    pub fn comment(&mut self, time_ns: u64, text: &str) -> Result<(), LogFileError> {
        let written = match &mut self.log {
            Log::Candump(file) => writeln!(file, "# {text}"),
            Log::Blf { writer, .. } => writer.comment(time_ns, text),
        };
        written.map_err(|error| self.fault(error))
    }

    /// Flushes the buffer; that of a BLF file at most once in a second.
    pub fn flush(&mut self) -> Result<(), LogFileError> {
        let flushed = match &mut self.log {
            Log::Candump(file) => file.flush(),
            Log::Blf { writer, flushed } if flushed.elapsed() >= BLF_FLUSH => {
                *flushed = Instant::now();
                writer.flush()
            }
            Log::Blf { .. } => Ok(()),
        };
        flushed.map_err(|error| self.fault(error))
    }

    /// Flushes and closes the file.
    pub fn finish(self) -> Result<(), LogFileError> {
        let Self { log, path } = self;
        let finished = match log {
            Log::Candump(mut file) => file.flush(),
            Log::Blf { writer, .. } => writer.finish().map(|_| ()),
        };
        finished.map_err(|error| LogFileError::Write(path, error))
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

        let text = "(1.000000) can0 123#\n(2.000000) can0 12#\nDROPCOUNT: dropped 3 CAN frames on 'can0'\n";
        std::fs::write(&path, text).unwrap();
        let log = read(&path).unwrap();
        let losses = losses(&path, &log);
        assert!(losses[0].contains("a.log, line 2, column"), "{losses:?}");
        assert!(losses[0].ends_with(": (2.000000) can0 12#; left out"), "{losses:?}");
        assert!(losses[1].ends_with("a.log: 3 frames lost when it was recorded"), "{losses:?}");
        std::fs::write(&path, "(2.000000) can0 12#\n").unwrap();
        let message = read(&path).unwrap_err().to_string();
        assert!(message.contains("a.log, line 1, column"), "{message}");
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
