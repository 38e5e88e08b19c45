//! New lines of the kernel log about EtherCAT.

use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Seek, SeekFrom};
use std::os::unix::fs::OpenOptionsExt;

use nix::libc::O_NONBLOCK;

/// Largest number of lines in the report of a step.
const LINES: usize = 200;
/// Largest record of the kernel.
const RECORD_BYTES: usize = 8192;

/// Reads `/dev/kmsg` from the time of its opening.
#[derive(Debug)]
pub struct KernelLog(Option<File>);

impl KernelLog {
    /// Begins with the next record. Without permission the log is empty.
    pub fn open() -> Self {
        let file = OpenOptions::new()
            .read(true)
            .custom_flags(O_NONBLOCK)
            .open("/dev/kmsg")
            .and_then(|mut file| file.seek(SeekFrom::End(0)).map(|_| file));
        Self(file.ok())
    }

    pub fn is_readable(&self) -> bool {
        self.0.is_some()
    }

    /// The lines of the master and its drivers since the last call.
    pub fn take(&mut self) -> Vec<String> {
        let Some(file) = &mut self.0 else { return Vec::new() };
        let mut lines = Vec::new();
        let mut record = [0; RECORD_BYTES];
        loop {
            match file.read(&mut record) {
                Ok(0) => break,
                Ok(bytes) => lines.extend(message(&String::from_utf8_lossy(&record[..bytes]))),
                // Records were overwritten before they were read.
                Err(error) if error.kind() == ErrorKind::BrokenPipe => {}
                Err(_) => break,
            }
        }
        let surplus = lines.len().saturating_sub(LINES);
        if surplus > 0 {
            lines.drain(..surplus);
            lines.insert(0, format!("({surplus} earlier lines)"));
        }
        lines
    }
}

/// `6,1234,56789,-;EtherCAT 0: text` with its time in s, if it is about EtherCAT.
fn message(record: &str) -> Option<String> {
    let (head, text) = record.split_once(';')?;
    let text = text.lines().next()?;
    if !text.contains("EtherCAT") && !text.contains("ec_") {
        return None;
    }
    let us: u64 = head.split(',').nth(2)?.parse().ok()?;
    Some(format!("[{:.3}] {text}", us as f64 / 1e6))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_of_the_master_are_kept() {
        let record = "4,1234,56789012,-;EtherCAT WARNING 0: 1 datagram UNMATCHED!\n SUBSYSTEM=x\n";
        let line = "[56.789] EtherCAT WARNING 0: 1 datagram UNMATCHED!";
        assert_eq!(message(record).as_deref(), Some(line));
        assert_eq!(message("6,1,2,-;usb 1-1: new device"), None);
    }
}
