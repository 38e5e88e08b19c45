//! A node that plays a recorded bus back.

use ecan_candump::{ParseError, ParseErrorKind, parse_line};
use ecan_protocol::can::CanFrame;

use super::{Node, NodeOutput};

/// One recorded frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReplayRecord {
    /// When it was recorded, in nanoseconds since any instant.
    pub time_ns: u64,
    /// The frame.
    pub frame: CanFrame,
}

/// A log that cannot be played back.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("candump log, line {line}: {cause}")]
pub struct ReplayError {
    /// The line, counted from 1.
    pub line: usize,
    /// What is wrong with it.
    pub cause: ParseError,
}

/// Sends recorded frames with their recorded distances in time.
///
/// The first goes out when the node starts (or after its start delay). A record that is older
/// than the one before it goes out together with that one.
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
    /// Plays these records once.
    #[must_use]
    pub const fn new(records: Vec<ReplayRecord>) -> Self {
        Self { records, start_delay_ns: 0, repeat_gap_ns: None, next: 0, due: None, sent: 0 }
    }

    /// Plays a candump log; of one interface only, if one is named.
    ///
    /// # Errors
    /// The first line that is not a record, a comment or blank; error messages are left out.
    pub fn from_log(log: &str, interface: Option<&str>) -> Result<Self, ReplayError> {
        let mut records = Vec::new();
        for (number, line) in log.lines().enumerate() {
            let parsed = match parse_line(line) {
                // Of the interface that recorded it, not of the bus.
                Err(error) if error.kind == ParseErrorKind::ErrorMessage => None,
                parsed => parsed.map_err(|cause| ReplayError { line: number + 1, cause })?,
            };
            if let Some(record) = parsed
                && interface.is_none_or(|wanted| wanted == record.interface)
            {
                records.push(ReplayRecord { time_ns: record.time_ns, frame: record.frame });
            }
        }
        Ok(Self::new(records))
    }

    /// Waits this long after the start before the first record.
    #[must_use]
    pub const fn with_start_delay(mut self, delay_ns: u64) -> Self {
        self.start_delay_ns = delay_ns;
        self
    }

    /// Starts over this long after the last record; 0 counts as 1.
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

    /// Frames handed out so far.
    #[must_use]
    pub const fn sent(&self) -> u64 {
        self.sent
    }

    /// The time of the record behind the one that was due at `due`.
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
