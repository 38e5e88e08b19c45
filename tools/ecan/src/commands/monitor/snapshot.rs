//! Displayed values at one time, and their JSON form.

use std::fmt::Write as _;
use std::sync::Arc;

use ecan_protocol::can::{CanFrame, FrameKind};
use ecan_protocol::mapping::CHANNELS;
use ecan_service::protocol::{AxisState, ServiceStats};
use serde::{Serialize, Serializer};

use crate::frames::signals::DecodedMessage;
use crate::frames::{ServiceEvents, Signals};

pub const CLASSES: usize = 7;
/// Class limits: difference between period and cycle in microseconds.
pub const CLASS_NAMES: [&str; CLASSES] =
    ["< -100", "-100..-10", "-10..-1", "-1..+1", "+1..+10", "+10..+100", "> +100"];

/// Displayed values at one time. Counters count from the start or the last clear.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Snapshot {
    #[serde(flatten)]
    pub head: Head,
    /// `None` on the direct way, and before the service has reported.
    pub service: Option<ServiceStats>,
    pub cycle: CycleView,
    pub gateways: Vec<GatewayView>,
    /// Events, the latest last.
    pub events: Vec<Event>,
    /// Events that the service has recorded, also before this program.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub service_events: Option<ServiceEvents>,
    #[serde(skip)]
    pub ids: IdsView,
    #[serde(skip)]
    pub axes: AxesView,
    /// Signals of the frames of `ids`.
    #[serde(skip)]
    pub signals: Arc<Signals>,
}

/// Values of every view.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Head {
    pub seconds: f64,
    pub is_simulated: bool,
    /// Program whose service is observed; `None` on the direct way.
    pub program: Option<String>,
    /// Reason why the values are old.
    pub interruption: Option<&'static str>,
    /// Frames that this program lost.
    pub frames_lost: u64,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CycleView {
    pub cycle_us: f64,
    pub cycles: u64,
    /// Overruns and skipped deadlines.
    pub overruns: u64,
    pub skipped: u64,
    pub unmeasured: u64,
    /// Number of cycles that a service sampled since its start; `None` if each one is measured.
    pub sampled: Option<u64>,
    /// Time between the starts of two cycles; `None` if the cycle is sampled.
    pub period: Option<Times>,
    /// Time from the start of a cycle to the end of its work.
    pub run_time: Times,
    /// Delay of the start of a cycle, if the cycle is sampled.
    pub late: Option<Times>,
    /// Number of periods by difference from the cycle: below -100 us, to -10, -1, +1, +10, +100 us,
    /// above. `None` if the cycle is sampled.
    pub histogram: Option<[u64; CLASSES]>,
}

/// Distribution of a time; `None` for what a service does not report.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Times {
    pub min_us: f64,
    pub p50_us: f64,
    pub p95_us: Option<f64>,
    pub p99_us: f64,
    pub p99_9_us: Option<f64>,
    pub max_us: f64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum GatewayState {
    /// Not ready since the start.
    #[default]
    Starting,
    Ready,
    /// Not ready after it was ready.
    Lost,
}

impl GatewayState {
    pub fn text(self) -> &'static str {
        match self {
            Self::Starting => "starting",
            Self::Ready => "ready",
            Self::Lost => "LOST",
        }
    }
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct GatewayView {
    pub position: usize,
    pub state: GatewayState,
    /// Awaited event or error; empty if ready.
    pub reason: String,
    pub working_counter: u32,
    pub expected_working_counter: u32,
    /// Cycles with an incomplete working counter.
    pub incomplete_cycles: u64,
    /// Images that were lost.
    pub lost_images: u64,
    /// Most images that can have been lost in outages.
    pub unknown_images: u64,
    /// Invalid images.
    pub faulty_images: u64,
    /// Number of losses, and of changes to ready.
    pub times_lost: u64,
    pub times_in_service: u64,
    pub channels: [ChannelView; CHANNELS],
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ChannelView {
    /// State in the last image; `None` while the gateway is not ready.
    pub state: Option<String>,
    pub is_bus_off: bool,
    /// Error warning, error passive or degraded bus.
    pub has_warning: bool,
    pub has_rx_pressure: bool,
    pub has_tx_pressure: bool,
    /// Pending frames in the gateway, 0 to 7; 7 may be more.
    pub rx_pending: u8,
    pub tx_pending: u8,
    pub rx_per_second: f64,
    pub received: u64,
    /// Minimum bus load of these frames, 0 to 1.
    pub load: f64,
    /// Error counters from the mailbox; `None` without a response.
    pub errors: Option<Errors>,
}

/// Error counters of a channel (0x9000, manual 13.5). Dropped frames and bus-offs are counted by
/// the gateway, from its start or the last clear.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Errors {
    pub transmit: u8,
    /// Receive error counter; 128 if the controller is error passive.
    pub receive: u8,
    pub dropped: u64,
    pub bus_offs: u64,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Event {
    /// Time since the start.
    pub seconds: f64,
    pub words: String,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    Received,
    Sent,
    /// Not sent: the transmit result is a failure or never arrived.
    Failed,
}

impl Direction {
    pub fn text(self) -> &'static str {
        match self {
            Self::Received => "rx",
            Self::Sent => "tx",
            Self::Failed => "err",
        }
    }
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct IdsView {
    /// Frames of CAN IDs that found the table full.
    pub not_listed: u64,
    pub ids: Vec<IdView>,
}

/// Frames of a CAN ID on a channel in one direction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct IdView {
    /// Position of the gateway.
    pub gateway: usize,
    pub channel: u8,
    pub direction: Direction,
    /// The last frame.
    #[serde(flatten, serialize_with = "frame_fields")]
    pub frame: CanFrame,
    pub count: u64,
    /// Time between the last two frames; `None` before the second one, and after a loss.
    pub period_ns: Option<u64>,
    /// Mean of all periods.
    pub mean_period_ns: Option<u64>,
    pub age_ns: u64,
    /// Bit set of the bytes that changed.
    #[serde(serialize_with = "bits")]
    pub changed: u64,
}

/// JSON form of the view of CAN IDs.
#[derive(Debug, Serialize)]
pub struct IdsReport<'a> {
    pub not_listed: u64,
    pub ids: Vec<IdReport<'a>>,
}

#[derive(Debug, Serialize)]
pub struct IdReport<'a> {
    #[serde(flatten)]
    pub row: &'a IdView,
    /// Message and signals, if a DBC file has the CAN ID.
    #[serde(flatten)]
    pub decoded: Option<DecodedMessage>,
}

impl IdView {
    /// Numbers of the bytes that changed.
    pub fn changed_bytes(&self) -> impl Iterator<Item = usize> {
        bits_of(self.changed)
    }
}

fn bits_of(set: u64) -> impl Iterator<Item = usize> {
    (0..64).filter(move |at| set >> at & 1 == 1)
}

fn bits<S: Serializer>(set: &u64, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(bits_of(*set))
}

/// Kind of a frame, as in the JSON form of `ecan dump`.
pub fn kind(frame: &CanFrame) -> &'static str {
    match frame.kind() {
        FrameKind::Data => "data",
        FrameKind::Remote => "remote",
        FrameKind::Fd { .. } => "fd",
    }
}

fn frame_fields<S: Serializer>(frame: &CanFrame, serializer: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Fields {
        id: u32,
        is_extended: bool,
        kind: &'static str,
        dlc: u8,
        data: String,
    }
    let data = frame.data().iter().fold(String::new(), |mut text, byte| {
        // Writing to a String cannot fail.
        let _ = write!(text, "{byte:02X}");
        text
    });
    let (id, is_extended) = (frame.id().raw(), frame.id().is_extended());
    Fields { id, is_extended, kind: kind(frame), dlc: frame.dlc().value(), data }
        .serialize(serializer)
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct AxesView {
    /// Reason why there are no axes.
    pub without_axes: Option<String>,
    /// `gateway` is the position of the gateway.
    pub axes: Vec<AxisState>,
}

/// JSON form of one view.
#[derive(Debug, Serialize)]
pub struct ViewReport<'a, T> {
    #[serde(flatten)]
    pub head: &'a Head,
    #[serde(flatten)]
    pub view: &'a T,
}

impl Snapshot {
    pub fn has_problem(&self) -> bool {
        let has_gateway_problem = |gateway: &GatewayView| {
            gateway.state != GatewayState::Ready
                || gateway.channels.iter().any(|channel| channel.is_bus_off)
        };
        self.gateways.is_empty()
            || self.head.interruption.is_some()
            || self.gateways.iter().any(has_gateway_problem)
            || self.axes.axes.iter().any(|axis| axis.error.is_some())
    }
}
