//! What is shown: everything at one moment, as plain values.

use ecan_protocol::mapping::CHANNELS;
use serde::Serialize;

/// Number of classes of the histogram.
pub const CLASSES: usize = 7;
/// What each class holds: by how many microseconds a period differs from the cycle.
pub const CLASS_NAMES: [&str; CLASSES] =
    ["< -100", "-100..-10", "-10..-1", "-1..+1", "+1..+10", "+10..+100", "> +100"];

/// Everything at one moment. Counters count since the start, or since they were cleared.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Snapshot {
    /// Since the watching began.
    pub seconds: f64,
    /// The master is a simulated one.
    pub is_simulated: bool,
    pub cycle: CycleView,
    pub gateways: Vec<GatewayView>,
    /// What has changed, the latest last.
    pub events: Vec<Event>,
}

/// How the cycle is kept.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CycleView {
    /// As it should be.
    pub cycle_us: f64,
    pub cycles: u64,
    /// Cycles whose next point had passed already, and points left out.
    pub overruns: u64,
    pub skipped: u64,
    /// Cycles that the display did not get to measure.
    pub unmeasured: u64,
    /// From the start of a cycle to the next.
    pub period: Times,
    /// From the start of a cycle to the end of its work.
    pub run_time: Times,
    /// Periods by their difference from the cycle: below -100 us, to -10, to -1, to +1, to +10, to
    /// +100 us, above.
    pub histogram: [u64; CLASSES],
}

/// Times in microseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Times {
    pub min_us: f64,
    pub p50_us: f64,
    pub p95_us: f64,
    pub p99_us: f64,
    pub p99_9_us: f64,
    pub max_us: f64,
}

/// Where a gateway stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum GatewayState {
    /// Not yet in service.
    #[default]
    Starting,
    InService,
    /// It was in service.
    Lost,
}

impl GatewayState {
    pub fn words(self) -> &'static str {
        match self {
            Self::Starting => "starting",
            Self::InService => "in service",
            Self::Lost => "LOST",
        }
    }
}

/// One gateway.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct GatewayView {
    /// Its place in the ring.
    pub position: usize,
    pub standing: GatewayState,
    /// What it waits for, or what is wrong; empty in service.
    pub reason: String,
    pub working_counter: u32,
    pub expected_working_counter: u32,
    /// Cycles whose working counter was not complete.
    pub incomplete_cycles: u64,
    /// Images of the gateway that did not arrive, or with faults.
    pub lost_images: u64,
    pub faulty_images: u64,
    /// Times that it was lost while in service, and came into service.
    pub times_lost: u64,
    pub times_in_service: u64,
    pub channels: [ChannelView; CHANNELS],
}

/// One CAN channel.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ChannelView {
    /// As the gateway's last image tells; none while it is not in service.
    pub state: Option<String>,
    pub is_bus_off: bool,
    /// Error warning, error passive or a degraded bus.
    pub has_warning: bool,
    pub has_rx_pressure: bool,
    pub has_tx_pressure: bool,
    /// Frames that wait in the gateway, 0 to 7 where 7 may be more.
    pub rx_pending: u8,
    pub tx_pending: u8,
    /// Frames a second from the bus.
    pub rx_per_second: f64,
    /// Frames from the bus.
    pub received: u64,
    /// Share of the bus that these frames take at least; 1 is all of it.
    pub load: f64,
    /// What only the mailbox tells; none where it did not answer yet.
    pub errors: Option<Errors>,
}

/// Error counters of a channel (0x9000, manual 13.5). Dropped frames and bus-offs are the gateway's,
/// since it was switched on, or since they were cleared here.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Errors {
    /// Transmit error counter.
    pub transmit: u8,
    /// Receive error counter, 128 where the controller says that it is passive.
    pub receive: u8,
    /// Frames from the bus that the gateway dropped.
    pub dropped: u64,
    /// Times that the channel went off the bus.
    pub bus_offs: u64,
}

/// Something that has changed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Event {
    /// Since the watching began.
    pub seconds: f64,
    pub words: String,
}

impl Snapshot {
    /// Whether a gateway is out of service, or a channel off the bus.
    pub fn has_problem(&self) -> bool {
        self.gateways.iter().any(|gateway| {
            gateway.standing != GatewayState::InService
                || gateway.channels.iter().any(|channel| channel.is_bus_off)
        })
    }
}
