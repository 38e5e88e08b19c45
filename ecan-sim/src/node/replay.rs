//! A node that replays a recorded bus.

use ecan_candump::{ParseError, ParseErrorKind, parse_line};
use ecan_protocol::can::CanFrame;

use super::{Node, NodeOutput};

/// One recorded frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReplayRecord {
    /// Time of the recording in nanoseconds, since any reference.
    pub time_ns: u64,
    /// The frame.
    pub frame: CanFrame,
}

/// Error in a log.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("candump log, line {line}: {cause}")]
pub struct ReplayError {
    /// Line, from 1.
    pub line: usize,
    /// Cause.
    pub cause: ParseError,
}

/// Sends recorded frames with their recorded intervals.
///
/// The first is sent when the node starts (or after its start delay). A record that is older than
/// the previous one is sent together with it.
#[derive(Clone, Debug, Default)]
pub struct ReplayNode {
    records: Vec<ReplayRecord>,
    start_delay_ns: u64,
    repeat_gap_ns: Option<u64>,
    next: usize,
    due: Option<u64>,
    sent: u64,
}

impl ReplayNode {
    /// Replays these records once.
    #[must_use]
    pub const fn new(records: Vec<ReplayRecord>) -> Self {
        Self { records, start_delay_ns: 0, repeat_gap_ns: None, next: 0, due: None, sent: 0 }
    }

    /// Replays a candump log; only of one interface, if given.
    ///
    /// # Errors
    /// The first line that is not a record, a comment or blank; error messages are skipped.
    pub fn from_log(log: &str, interface: Option<&str>) -> Result<Self, ReplayError> {
        let mut records = Vec::new();
        for (number, line) in log.lines().enumerate() {
            let parsed = match parse_line(line) {
                // Concerns the recording interface, not the bus.
                Err(error) if error.kind == ParseErrorKind::ErrorMessage => None,
                parsed => parsed.map_err(|cause| ReplayError { line: number + 1, cause })?,
            };
            if let Some(record) = parsed
                && interface.is_none_or(|name| name == record.interface)
            {
                records.push(ReplayRecord { time_ns: record.time_ns, frame: record.frame });
            }
        }
        Ok(Self::new(records))
    }

    /// Adds a delay between the start and the first record.
    #[must_use]
    pub const fn with_start_delay(mut self, delay_ns: u64) -> Self {
        self.start_delay_ns = delay_ns;
        self
    }

    /// Repeats the log this long after the last record; 0 counts as 1.
    #[must_use]
    pub const fn with_repeat(mut self, gap_ns: u64) -> Self {
        self.repeat_gap_ns = Some(if gap_ns == 0 { 1 } else { gap_ns });
        self
    }

    /// The records.
    #[must_use]
    pub fn records(&self) -> &[ReplayRecord] {
        &self.records
    }

    /// Number of sent frames.
    #[must_use]
    pub const fn sent(&self) -> u64 {
        self.sent
    }

    /// Time of the record after the one due at `due`.
    fn following(&mut self, due: u64) -> Option<u64> {
        let before = self.records.get(self.next)?;
        if let Some(after) = self.records.get(self.next + 1) {
            self.next += 1;
            return Some(due.saturating_add(after.time_ns.saturating_sub(before.time_ns)));
        }
        let gap = self.repeat_gap_ns?;
        self.next = 0;
        Some(due.saturating_add(gap))
    }
}

impl Node for ReplayNode {
    fn started(&mut self, now: u64, _out: &mut NodeOutput) {
        self.next = 0;
        self.due = (!self.records.is_empty()).then(|| now.saturating_add(self.start_delay_ns));
    }

    fn next_event(&self) -> Option<u64> {
        self.due
    }

    fn advance(&mut self, now: u64, out: &mut NodeOutput) {
        while let Some(due) = self.due.filter(|&due| due <= now) {
            if let Some(record) = self.records.get(self.next) {
                out.send(record.frame);
                self.sent += 1;
            }
            self.due = self.following(due);
        }
    }
}
