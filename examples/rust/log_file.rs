//! candump log files: reading a recording, writing what came back.

use std::error::Error;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use ecan_candump::Record;
use ecan_protocol::CanFrame;

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

/// Reads a whole log.
///
/// # Errors
/// The file and why it cannot be read, or the line and column where it is no candump log, or that
/// it holds no frame.
pub fn read(path: &Path) -> Result<Vec<LoggedFrame>, Box<dyn Error>> {
    let name = path.display();
    let text = std::fs::read_to_string(path).map_err(|e| format!("cannot read {name}: {e}"))?;
    let mut frames = Vec::new();
    for (nth, line) in text.lines().enumerate() {
        let record =
            ecan_candump::parse_line(line).map_err(|e| format!("{name}, line {}, {e}", nth + 1))?;
        if let Some(record) = record {
            frames.push(LoggedFrame {
                line: nth + 1,
                time_ns: record.time_ns,
                interface: record.interface.to_owned(),
                frame: record.frame,
            });
        }
    }
    if frames.is_empty() {
        return Err(format!("{name} holds no frame").into());
    }
    Ok(frames)
}

/// Writes frames as a candump log.
#[derive(Debug)]
pub struct Writer {
    file: BufWriter<File>,
    name: String,
}

impl Writer {
    /// Creates the file, or empties it.
    ///
    /// # Errors
    /// The file and why it cannot be written.
    pub fn create(path: &Path) -> Result<Self, Box<dyn Error>> {
        let name = path.display().to_string();
        let file = File::create(path).map_err(|e| format!("cannot write {name}: {e}"))?;
        Ok(Self { file: BufWriter::new(file), name })
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
    ) -> Result<(), Box<dyn Error>> {
        let interface = format!("can{port}");
        let record = Record { time_ns, interface: &interface, frame, direction: None };
        writeln!(self.file, "{record}").map_err(|e| self.fault(&e))
    }

    /// Writes everything out.
    ///
    /// # Errors
    /// The file and why it cannot be written.
    pub fn finish(mut self) -> Result<(), Box<dyn Error>> {
        self.file.flush().map_err(|e| self.fault(&e))
    }

    fn fault(&self, error: &std::io::Error) -> Box<dyn Error> {
        format!("cannot write {}: {error}", self.name).into()
    }
}
