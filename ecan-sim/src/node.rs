//! Nodes on the CAN buses: their interface, and those of this crate: echo, faulty, silent, and a replay of a recorded
//! bus.
//!
//! A node decides what to send and when; its controller (a [`StationConfig`](crate::StationConfig))
//! and its queue belong to the world.

use std::any::Any;
use std::collections::VecDeque;
use std::error::Error;
use std::net::IpAddr;

use ecan_can_io::recording::{LoggedFrame, ReadOptions, Recording, RecordingError};
use ecan_protocol::can::{CanFrame, CanId, FrameKind};
use serde::Deserialize;

use crate::bus::StationConfig;
use crate::event_queue::take_first;
use crate::random::Random;

/// A participant of a CAN bus. All times are simulated nanoseconds.
///
/// Calls come in order of time. A node sends frames by putting them into `out`; the bus sends them
/// in that order.
pub trait Node: Any + Send {
    /// The controller has this configuration from now on. After the first call,
    /// [`started`](Self::started) follows.
    fn configured(&mut self, now: u64, config: &StationConfig) {
        let _ = (now, config);
    }

    /// The node starts, after its controller was configured.
    fn started(&mut self, now: u64, out: &mut NodeOutput) {
        let _ = (now, out);
    }

    /// The node received a frame of another station.
    fn received(&mut self, now: u64, frame: &CanFrame, out: &mut NodeOutput) {
        let _ = (now, frame, out);
    }

    /// The bus has sent a frame of the node.
    fn transmitted(&mut self, now: u64, frame: &CanFrame, out: &mut NodeOutput) {
        let _ = (now, frame, out);
    }

    /// Time of the node's next own event.
    fn next_event(&self) -> Option<u64> {
        None
    }

    /// Returns whether the node's controller takes part in the bus: it then acknowledges and
    /// receives frames. Read after every call.
    fn is_on_bus(&self) -> bool {
        true
    }

    /// Own nominal bit rate in bit/s, for example configured by LSS; `None` uses that of the scenario or the gateway.
    /// Read after every call.
    fn bit_rate(&self) -> Option<u32> {
        None
    }

    /// The time of [`next_event`](Self::next_event) has come. Afterwards it returns a later time,
    /// or `None`.
    fn advance(&mut self, now: u64, out: &mut NodeOutput) {
        let _ = (now, out);
    }

    /// A copy of the node in its present state; `None` if the node cannot be copied, for example
    /// because it has a connection.
    fn try_clone(&self) -> Option<Box<dyn Node>> {
        None
    }

    /// Description of the node in the banner, for example "slcan bridge at 127.0.0.1:29536"; `None`
    /// omits it.
    fn description(&self) -> Option<String> {
        None
    }
}

/// Frames to send, first in, first out.
///
/// Grows to the largest number of waiting frames and then allocates no more.
#[derive(Clone, Debug, Default)]
pub struct NodeOutput {
    waiting: VecDeque<CanFrame>,
}

impl NodeOutput {
    /// An empty queue.
    #[must_use]
    pub const fn new() -> Self {
        Self { waiting: VecDeque::new() }
    }

    /// Appends a frame.
    pub fn send(&mut self, frame: CanFrame) {
        self.waiting.push_back(frame);
    }

    /// The next frame, left in the queue.
    #[must_use]
    pub fn front(&self) -> Option<&CanFrame> {
        self.waiting.front()
    }

    /// Takes the next frame.
    pub fn pop(&mut self) -> Option<CanFrame> {
        take_first(&mut self.waiting)
    }

    /// Number of waiting frames.
    #[must_use]
    pub fn len(&self) -> usize {
        self.waiting.len()
    }

    /// Returns whether the queue is empty.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Discards all frames.
    pub fn clear(&mut self) {
        self.waiting.clear();
    }
}

/// Protocol between a bridge and its clients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BridgeProtocol {
    /// ASCII protocol of Lawicel's serial adapters, over TCP.
    #[default]
    Slcan,
    /// Raw mode of socketcand; classic CAN only.
    Socketcand,
}

/// A node that connects other programs to its bus over TCP. `None` leaves a value to the
/// [`BridgeFactory`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BridgeSpec {
    /// Protocol.
    pub protocol: BridgeProtocol,
    /// Address on which it listens; `None` is the loopback interface.
    pub address: Option<IpAddr>,
    /// TCP port; 0 takes any free one.
    pub port: u16,
    /// Maximum number of clients.
    pub max_clients: Option<usize>,
    /// Capacity in frames of the queue to the bus, and of the queue to each client.
    pub queue: Option<usize>,
}

/// Makes the bridge of a scenario; `ecan-sim-bridge` contains one.
pub type BridgeFactory = fn(&BridgeSpec) -> Result<Box<dyn Node>, Box<dyn Error + Send + Sync>>;

/// Answers every frame with one of the same identifier, format and data.
///
/// Two of them on one bus answer each other forever.
#[derive(Clone, Copy, Debug, Default)]
pub struct EchoNode {
    echoed: u64,
}

impl EchoNode {
    /// A node that has received nothing yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { echoed: 0 }
    }

    /// Number of answered frames.
    #[must_use]
    pub const fn echoed(&self) -> u64 {
        self.echoed
    }
}

impl Node for EchoNode {
    fn try_clone(&self) -> Option<Box<dyn Node>> {
        Some(Box::new(*self))
    }

    fn received(&mut self, _now: u64, frame: &CanFrame, out: &mut NodeOutput) {
        self.echoed += 1;
        out.send(*frame);
    }
}

/// Faults of a [`FaultyNode`]. Without faults it is an echo node.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FaultyConfig {
    /// Frames without answer, per thousand.
    pub drop_permille: u16,
    /// Answers with one inverted data bit, per thousand.
    pub corrupt_permille: u16,
    /// Answers sent twice, per thousand.
    pub repeat_permille: u16,
    /// Interval in microseconds at which it sends a frame of the highest priority; 0 is never.
    pub babble_us: u32,
}

/// Echoes frames, but drops, corrupts or repeats some of them, and babbles.
///
/// Its answers have valid CRCs: the data is wrong. For frames that fail on the wire see
/// [`BusFault::ErrorFrames`](crate::BusFault::ErrorFrames).
#[derive(Clone, Debug)]
pub struct FaultyNode {
    config: FaultyConfig,
    random: Random,
    next_babble: Option<u64>,
    dropped: u64,
    corrupted: u64,
}

impl FaultyNode {
    /// A node with these faults. The same seed and the same frames give the same faults.
    #[must_use]
    pub const fn new(config: FaultyConfig, seed: u64) -> Self {
        Self { config, random: Random::new(seed), next_babble: None, dropped: 0, corrupted: 0 }
    }

    /// Number of frames without answer.
    #[must_use]
    pub const fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Number of answers with wrong data.
    #[must_use]
    pub const fn corrupted(&self) -> u64 {
        self.corrupted
    }

    /// Inverts one data bit; a frame without data stays unchanged.
    fn corrupt(&mut self, frame: &CanFrame) -> CanFrame {
        let mut data = [0; 64];
        let bytes = frame.data();
        if bytes.is_empty() {
            return *frame;
        }
        let bit = self.random.below(8 * bytes.len() as u64) as usize;
        let Some(copy) = data.get_mut(..bytes.len()) else {
            return *frame;
        };
        copy.copy_from_slice(bytes);
        if let Some(byte) = copy.get_mut(bit / 8) {
            *byte ^= 1 << (bit % 8);
        }
        let changed = match frame.kind() {
            FrameKind::Fd { brs, esi } => CanFrame::fd(frame.id(), copy, brs, esi),
            FrameKind::Data | FrameKind::Remote => CanFrame::classic(frame.id(), copy),
        };
        self.corrupted += 1;
        // infallible: identifier and length come from a valid frame
        changed.unwrap_or(*frame)
    }
}

impl Node for FaultyNode {
    fn try_clone(&self) -> Option<Box<dyn Node>> {
        Some(Box::new(self.clone()))
    }

    fn started(&mut self, now: u64, _out: &mut NodeOutput) {
        self.next_babble = (self.config.babble_us > 0).then_some(now);
    }

    fn received(&mut self, _now: u64, frame: &CanFrame, out: &mut NodeOutput) {
        if self.random.chance(self.config.drop_permille) {
            self.dropped += 1;
            return;
        }
        let response = if self.random.chance(self.config.corrupt_permille) {
            self.corrupt(frame)
        } else {
            *frame
        };
        out.send(response);
        if self.random.chance(self.config.repeat_permille) {
            out.send(response);
        }
    }

    fn next_event(&self) -> Option<u64> {
        self.next_babble
    }

    fn advance(&mut self, now: u64, out: &mut NodeOutput) {
        let Some(due) = self.next_babble.filter(|&due| due <= now) else {
            return;
        };
        let interval = u64::from(self.config.babble_us) * 1_000;
        // Missed intervals are not made up for, so the queue stays short.
        if out.is_empty()
            && let Some(frame) = babble()
        {
            out.send(frame);
        }
        let periods = (now - due) / interval + 1;
        self.next_babble = Some(due.saturating_add(periods.saturating_mul(interval)));
    }
}

/// Frame that wins every arbitration.
fn babble() -> Option<CanFrame> {
    CanFrame::classic(CanId::standard(0).ok()?, &[0xBB; 8]).ok()
}

/// Sends nothing; its controller acknowledges frames.
#[derive(Clone, Copy, Debug, Default)]
pub struct SilentNode;

impl Node for SilentNode {
    fn try_clone(&self) -> Option<Box<dyn Node>> {
        Some(Box::new(*self))
    }
}

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
    /// A format that is not recognized, or the first line that cannot be read.
    pub fn from_log(log: &str, interface: Option<&str>) -> Result<Self, RecordingError> {
        let recording = Recording::parse(log, &ReadOptions::default())?.whole()?;
        Ok(Self::from_recording(&recording, interface))
    }

    /// Replays a recording; only of one interface, if given. Error frames are not replayed.
    #[must_use]
    pub fn from_recording(recording: &Recording, interface: Option<&str>) -> Self {
        let is_selected = |name: &str| interface.is_none_or(|interface| interface == name);
        let frames = recording.frames.iter().filter(|frame| is_selected(&frame.interface));
        let record =
            |logged: &LoggedFrame| ReplayRecord { time_ns: logged.time_ns, frame: logged.frame };
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
