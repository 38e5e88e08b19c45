use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use ecan_candump::Record;
use ecan_sim::World;
use thiserror::Error;

#[derive(Debug, Error)]
#[error("cannot write {}: {error}", path.display())]
pub struct DumpError {
    path: PathBuf,
    error: std::io::Error,
}

pub struct Dump {
    path: PathBuf,
    output: BufWriter<Box<dyn Write>>,
    /// Offset from simulated time to the time of day, ns.
    offset_ns: u64,
    is_flushed: bool,
}

impl Dump {
    /// Creates or truncates the file; `-` is standard output. `offset_ns` is added to simulated
    /// time.
    pub fn create(path: &Path, offset_ns: u64) -> Result<Self, DumpError> {
        let path = path.to_owned();
        let output: Box<dyn Write> = if is_standard_output(&path) {
            Box::new(std::io::stdout())
        } else {
            match File::create(&path) {
                Ok(file) => Box::new(file),
                Err(error) => return Err(DumpError { path, error }),
            }
        };
        Ok(Self { path, output: BufWriter::new(output), offset_ns, is_flushed: true })
    }

    /// Writes what was recorded since the last call. The bus names are the interface names.
    pub fn write(&mut self, world: &mut World) -> Result<(), DumpError> {
        let mut outcome = Ok(());
        world.drain_recorded(|bus, recorded| {
            let record = Record {
                time_ns: recorded.end_ns.saturating_add(self.offset_ns),
                interface: bus,
                frame: recorded.frame,
                direction: None,
            };
            self.is_flushed = false;
            if outcome.is_ok() {
                // Spaces separate the fields of a log.
                outcome = if bus.contains(char::is_whitespace) {
                    let interface = bus.replace(char::is_whitespace, "_");
                    writeln!(self.output, "{}", Record { interface: &interface, ..record })
                } else {
                    writeln!(self.output, "{record}")
                };
            }
        });
        outcome.map_err(|error| self.fault(error))
    }

    pub fn flush(&mut self) -> Result<(), DumpError> {
        if std::mem::replace(&mut self.is_flushed, true) {
            return Ok(());
        }
        self.output.flush().map_err(|error| self.fault(error))
    }

    fn fault(&self, error: std::io::Error) -> DumpError {
        DumpError { path: self.path.clone(), error }
    }
}

pub fn is_standard_output(path: &Path) -> bool {
    path.as_os_str() == "-"
}
