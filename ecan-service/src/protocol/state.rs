//! Methods `state` and `config`.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Counters by name.
pub type Counters = Map<String, Value>;

/// Result of `state`: all of it belongs to one cycle, except the sampled times.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// The cycle.
    pub cycle: CycleState,
    /// Run time of the cycles that the service sampled.
    pub run_time: SampledTimes,
    /// Delay of the start of these cycles after their deadline.
    pub late: SampledTimes,
    /// The gateways.
    pub gateways: Vec<GatewayState>,
}

/// Times of a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct CycleState {
    /// Number of the cycle, from 1.
    pub cycle: u64,
    /// Start of the cycle, in nanoseconds, as in a frame record.
    pub time_ns: u64,
    /// Period in nanoseconds.
    pub cycle_ns: u64,
    /// Time from the start to the end of sending, in nanoseconds.
    pub run_time_ns: u64,
    /// Delay of the start after the deadline in nanoseconds; `None` without a wait for the cycle.
    pub late_ns: Option<u64>,
    /// Cycles that missed a deadline.
    pub overruns: u64,
    /// Deadlines that were skipped.
    pub skipped: u64,
    /// The application was requested to stop.
    pub is_stop_requested: bool,
    /// The application ended: this was the last cycle.
    pub is_closed: bool,
}

/// Distribution of a time over sampled cycles, in nanoseconds.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct SampledTimes {
    /// Number of samples.
    pub samples: u64,
    /// Shortest time.
    pub min_ns: u64,
    /// Median.
    pub p50_ns: u64,
    /// 99 % of the samples are not above it.
    pub p99_ns: u64,
    /// Longest time.
    pub max_ns: u64,
}

/// State of a gateway's session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SessionState {
    /// Not in OP, or process data not confirmed.
    Waiting,
    /// In OP, being verified.
    Verifying,
    /// Verified; frames can be sent.
    Ready,
    /// Verification failed.
    Failed,
}

/// A gateway in one cycle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GatewayState {
    /// State of the session.
    pub session: SessionState,
    /// Step that the gateway waits for until it is ready.
    pub waiting_for: Option<String>,
    /// Working counter of the cycle, and the expected one.
    pub working_counter: u32,
    /// Expected working counter.
    pub expected_working_counter: u32,
    /// Status word of each enabled channel (manual 7); `None` for the others.
    pub channel_status: [Option<u16>; 4],
    /// Counters of gateway and channels: `SlaveStatistics` of the crate `ecan-mcan-port`.
    pub statistics: Counters,
}

/// Result of `config`: by serde of the crates `ecan-host` and `ecan-mcan-port`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ActiveConfig {
    /// An `AdapterConfig`.
    pub adapter: Value,
    /// A `PortConfig`.
    pub port: Value,
}
