//! candump log of the CAN buses.

use std::borrow::Cow;
use std::path::Path;

use ecan_can_io::candump::Record;
use ecan_sim::World;
use ecan_tool_support::command_line::log_file::{LogFileError, Writer};

pub struct Dump {
    log: Writer,
    /// Offset from simulated time to the time of day, ns.
    offset_ns: u64,
}

impl Dump {
    /// Creates or truncates the file; `-` is standard output.
    pub fn create(path: &Path, offset_ns: u64) -> Result<Self, LogFileError> {
        Ok(Self { log: Writer::create(path)?, offset_ns })
    }

    /// Writes what was recorded since the last call. The bus names are the interface names.
    pub fn write(&mut self, world: &mut World) -> Result<(), LogFileError> {
        let mut result = Ok(());
        world.drain_recorded(|bus, recorded| {
            // spaces separate the fields of a log
            let interface = match bus.contains(char::is_whitespace) {
                true => Cow::Owned(bus.replace(char::is_whitespace, "_")),
                false => Cow::Borrowed(bus),
            };
            let record = Record {
                time_ns: recorded.end_ns.saturating_add(self.offset_ns),
                interface: &interface,
                frame: recorded.frame,
                direction: None,
            };
            if result.is_ok() {
                result = self.log.write_line(record);
            }
        });
        result
    }

    pub fn flush(&mut self) -> Result<(), LogFileError> {
        self.log.flush()
    }
}
