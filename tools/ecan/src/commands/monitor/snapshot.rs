use ecan_protocol::mapping::CHANNELS;
use serde::Serialize;

pub const CLASSES: usize = 7;
/// Class limits: difference between period and cycle in microseconds.
pub const CLASS_NAMES: [&str; CLASSES] =
    ["< -100", "-100..-10", "-10..-1", "-1..+1", "+1..+10", "+10..+100", "> +100"];

/// Displayed values at one time. Counters count from the start or the last clear.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Snapshot {
    pub seconds: f64,
    pub is_simulated: bool,
    pub cycle: CycleView,
    pub gateways: Vec<GatewayView>,
    /// Events, the latest last.
    pub events: Vec<Event>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CycleView {
    pub cycle_us: f64,
    pub cycles: u64,
    /// Overruns and skipped deadlines.
    pub overruns: u64,
    pub skipped: u64,
    pub unmeasured: u64,
    /// Time between the starts of two cycles.
    pub period: Times,
    /// Time from the start of a cycle to the end of its work.
    pub run_time: Times,
    /// Number of periods by difference from the cycle: below -100 us, to -10, -1, +1, +10, +100 us,
    /// above.
    pub histogram: [u64; CLASSES],
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Times {
    pub min_us: f64,
    pub p50_us: f64,
    pub p95_us: f64,
    pub p99_us: f64,
    pub p99_9_us: f64,
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

impl Snapshot {
    pub fn has_problem(&self) -> bool {
        self.gateways.iter().any(|gateway| {
            gateway.state != GatewayState::Ready
                || gateway.channels.iter().any(|channel| channel.is_bus_off)
        })
    }
}
