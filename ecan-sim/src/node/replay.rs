//! A node that replays a recorded bus.

use ecan_can_io::recording::{LoggedFrame, ReadOptions, Recording, RecordingError};
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

    /// Replays a recording of a format that is recognized; only of one interface, if given.
    ///
    /// # Errors
    /// As for [`Recording::parse`].
    pub fn from_log(log: &str, interface: Option<&str>) -> Result<Self, RecordingError> {
        let recording = Recording::parse(log, &ReadOptions::default())?;
        Ok(Self::from_recording(&recording, interface))
    }

    /// Replays a recording; only of one interface, if given. Error frames are not replayed.
    #[must_use]
    pub fn from_recording(recording: &Recording, interface: Option<&str>) -> Self {
        let is_selected = |name: &str| interface.is_none_or(|interface| interface == name);
        let frames = recording.frames.iter().filter(|it| is_selected(&it.interface));
        let record = |it: &LoggedFrame| ReplayRecord { time_ns: it.time_ns, frame: it.frame };
        Self::new(frames.map(record).collect())
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
    fn try_clone(&self) -> Option<Box<dyn Node>> {
        Some(Box::new(self.clone()))
    }

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
