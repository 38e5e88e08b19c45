//! The metrics of a service, each declared once, and their values.

use ecan_cia402::AxisStatus;
use ecan_mcan_port::{ChannelStatistics, SessionState, SlaveStatistics};
use ecan_protocol::image::{ChannelState, ChannelStatus};

use super::sample::{CycleSample, MetricsSample, SlaveSample, TimeHistogram};
use crate::protocol::BusState;

const NS_PER_S: f64 = 1e9;

/// Makes a metric of each counter of a struct.
macro_rules! counter_metrics {
    ($owner:ident, $source:path) => {{
        const COUNT: usize = $owner::COUNTERS.len();
        const METRICS: [Metric; COUNT] = {
            let mut metrics = [const { Metric::new("", "", Source::Build) }; COUNT];
            let mut at = 0;
            while at < COUNT {
                let counter = &$owner::COUNTERS[at];
                metrics[at] = Metric::new(counter.metric, counter.help, $source(counter.value));
                at += 1;
            }
            metrics
        };
        &METRICS
    }};
}

fn flag(is_set: bool) -> f64 {
    f64::from(u8::from(is_set))
}

/// All metrics.
pub(crate) fn metrics() -> impl Iterator<Item = &'static Metric> {
    [SERVICE, CYCLE, SLAVE, SLAVE_COUNTERS, CHANNEL, CHANNEL_COUNTERS, OBJECTS, AXIS]
        .into_iter()
        .flatten()
}

static SERVICE: &[Metric] = &[
    Metric::new("ecan_build_info", "Program that serves the metrics, always 1.", Source::Build),
    Metric::new(
        "ecan_service_clients",
        "Connected clients of the service.",
        Source::Service(|service| service.clients as f64),
    ),
    Metric::new(
        "ecan_service_clients_accepted_total",
        "Clients that the service accepted.",
        Source::Service(|service| service.stats.clients_accepted as f64),
    ),
    Metric::new(
        "ecan_service_clients_rejected_total",
        "Clients that the service rejected: too many in all or of one user, or no file descriptor.",
        Source::Service(|service| service.stats.clients_rejected as f64),
    ),
    Metric::new(
        "ecan_service_clients_silent_total",
        "Clients that the service disconnected because no hello came in time.",
        Source::Service(|service| service.stats.clients_silent as f64),
    ),
    Metric::new(
        "ecan_service_requests_pending",
        "Requests that wait for a worker or are executed by one.",
        Source::Service(|service| service.stats.requests_pending as f64),
    ),
    Metric::new(
        "ecan_service_requests_rejected_total",
        "Requests rejected because a limit of pending requests was reached.",
        Source::Service(|service| service.stats.requests_rejected as f64),
    ),
    Metric::new(
        "ecan_service_requests_cancelled_total",
        "Requests not executed because their client left.",
        Source::Service(|service| service.stats.requests_cancelled as f64),
    ),
    Metric::new(
        "ecan_service_requests_expired_total",
        "Requests not executed because they waited longer than their age limit.",
        Source::Service(|service| service.stats.requests_expired as f64),
    ),
    Metric::new(
        "ecan_service_frames_lost_total",
        "Frames lost for all subscribers because the ring of the cycle was full.",
        Source::Service(|service| service.stats.frames_lost_in_ring as f64),
    ),
    Metric::new(
        "ecan_service_images_lost_total",
        "PDO images lost for all subscribers because the ring of the cycle was full.",
        Source::Service(|service| service.stats.images_lost_in_ring as f64),
    ),
    Metric::new(
        "ecan_bus_slaves_responding",
        "Slaves that answer, over all links.",
        Source::Bus(|bus| f64::from(bus.slaves_responding)),
    ),
    Metric::new(
        "ecan_bus_link_up",
        "1 while at least one link of the master is up.",
        Source::Bus(|bus| flag(bus.link_up)),
    ),
    Metric::new(
        "ecan_bus_al_state",
        "1 for each AL state that at least one slave has.",
        Source::AlState(&[("init", 1), ("preop", 2), ("safeop", 4), ("op", 8)]),
    ),
    Metric::new(
        "ecan_cycle_active",
        "1 while an application runs the cycle.",
        Source::Service(|service| {
            flag(service.cycle.as_ref().is_some_and(|cycle| !cycle.state.is_closed))
        }),
    ),
];

static CYCLE: &[Metric] = &[
    Metric::new("ecan_cycles_total", "Cycles.", Source::Cycle(|cycle| cycle.state.cycle as f64)),
    Metric::new(
        "ecan_cycle_period_seconds",
        "Configured period of the cycle.",
        Source::Cycle(|cycle| cycle.state.cycle_ns as f64 / NS_PER_S),
    ),
    Metric::new(
        "ecan_cycle_start_timestamp_seconds",
        "Start of the last cycle since 1970; of a simulated time, since its start.",
        Source::Cycle(|cycle| cycle.state.time_ns as f64 / NS_PER_S),
    ),
    Metric::new(
        "ecan_cycle_overruns_total",
        "Cycles that missed a deadline.",
        Source::Cycle(|cycle| cycle.state.overruns as f64),
    ),
    Metric::new(
        "ecan_cycle_deadlines_skipped_total",
        "Deadlines that were skipped after overruns.",
        Source::Cycle(|cycle| cycle.state.skipped as f64),
    ),
    Metric::new(
        "ecan_cycle_run_time_seconds",
        "Time from the start of a cycle to the end of sending, of one cycle in 50 ms.",
        Source::Times(|times| &times.run_time),
    ),
    Metric::new(
        "ecan_cycle_start_delay_seconds",
        "Delay of the start of a cycle after its deadline, of one cycle in 50 ms.",
        Source::Times(|times| &times.late),
    ),
];

static SLAVE: &[Metric] = &[
    Metric::new(
        "ecan_slave_info",
        "Configured alias and position of a slave, always 1.",
        Source::Address,
    ),
    Metric::new(
        "ecan_slave_ready",
        "1 while the gateway is verified and frames can be sent.",
        Source::Slave(|slave| flag(slave.session == SessionState::Ready)),
    ),
    Metric::new(
        "ecan_slave_session_state",
        "1 for the present state of the session with the gateway.",
        Source::Session(&[
            ("waiting", SessionState::Waiting),
            ("verifying", SessionState::Verifying),
            ("ready", SessionState::Ready),
            ("failed", SessionState::Failed),
        ]),
    ),
    Metric::new(
        "ecan_slave_wkc",
        "Working counter of the last cycle.",
        Source::Slave(|slave| f64::from(slave.report.working_counter)),
    ),
    Metric::new(
        "ecan_slave_wkc_expected",
        "Working counter of a complete exchange.",
        Source::Slave(|slave| f64::from(slave.report.expected_working_counter)),
    ),
];

static SLAVE_COUNTERS: &[Metric] = counter_metrics!(SlaveStatistics, Source::SlaveCount);

static CHANNEL: &[Metric] = &[
    Metric::new(
        "ecan_channel_state",
        "1 for the present state of an enabled channel.",
        Source::ChannelState(&[
            ("disabled", ChannelState::Disabled),
            ("init", ChannelState::Init),
            ("run", ChannelState::Run),
            ("bus_off", ChannelState::BusOff),
            ("error", ChannelState::Error),
            ("listen", ChannelState::Listen),
        ]),
    ),
    Metric::new(
        "ecan_channel_error_warning",
        "1 while the channel reports error warning, error passive or a degraded bus.",
        Source::Channel(|channel| flag(channel.warn())),
    ),
    Metric::new(
        "ecan_channel_receive_pressure",
        "1 while the receive FIFO of the channel is nearly full or has overflowed.",
        Source::Channel(|channel| flag(channel.rx_pressure())),
    ),
    Metric::new(
        "ecan_channel_transmit_pressure",
        "1 while the transmit FIFO or queue of the channel is congested.",
        Source::Channel(|channel| flag(channel.tx_pressure())),
    ),
    Metric::new(
        "ecan_channel_frames_pending",
        "Frames without a known result so far.",
        Source::ChannelPending(|channelpending| channelpending.frames_pending),
    ),
];

static CHANNEL_COUNTERS: &[Metric] = counter_metrics!(ChannelStatistics, Source::ChannelCount);

/// Declares a value of an object of a channel.
const fn object(
    name: &'static str,
    help: &'static str,
    (index, subindex): (u16, u8),
    value: fn(u32) -> f64,
) -> Metric {
    Metric::new(name, help, Source::Object { index, subindex, value })
}

const ERROR_COUNTERS: (u16, u8) = (0x9000, 1);

static OBJECTS: &[Metric] = &[
    object(
        "ecan_channel_device_transmit_errors",
        "Transmit error counter of the CAN controller (0x9000:01).",
        ERROR_COUNTERS,
        |raw| f64::from(raw & 0xFF),
    ),
    object(
        "ecan_channel_device_receive_errors",
        "Receive error counter of the CAN controller, up to 127 (0x9000:01).",
        ERROR_COUNTERS,
        |raw| f64::from(raw >> 8 & 0x7F),
    ),
    object(
        "ecan_channel_device_backpressure_total",
        "Times that the transmit queue of the channel was full (0x9000:14).",
        (0x9000, 14),
        f64::from,
    ),
    object(
        "ecan_channel_device_received_dropped_total",
        "Received frames that the gateway dropped (0x9020:05).",
        (0x9020, 5),
        f64::from,
    ),
    object(
        "ecan_channel_device_transmit_fifo_full_total",
        "Times that the transmit FIFO of the CAN controller was full (0x9020:11).",
        (0x9020, 11),
        f64::from,
    ),
    object(
        "ecan_channel_device_stale_dropped_total",
        "Frames to transmit that the gateway dropped because they were too old (0x9020:12).",
        (0x9020, 12),
        f64::from,
    ),
    object(
        "ecan_channel_device_bus_off_total",
        "Times that the channel went bus-off (0x9020:13).",
        (0x9020, 13),
        f64::from,
    ),
    object(
        "ecan_channel_device_recovery_attempts_total",
        "Automatic attempts to recover from bus-off (0x9020:14).",
        (0x9020, 14),
        f64::from,
    ),
    object(
        "ecan_channel_device_degraded",
        "1 while the data path of the channel is degraded or protected (0x9020:15).",
        (0x9020, 15),
        |raw| flag(raw != 0),
    ),
];

static AXIS: &[Metric] = &[
    Metric::new(
        "ecan_axis_running",
        "1 while the axis follows targets.",
        Source::Axis(|axis| Some(flag(axis.is_running))),
    ),
    Metric::new(
        "ecan_axis_hold",
        "1 while the axis holds and waits for the application.",
        Source::Axis(|axis| Some(flag(axis.hold_reason.is_some()))),
    ),
    Metric::new(
        "ecan_axis_emergency_code",
        "Error code of the last emergency message of the drive; 0 for none.",
        Source::Axis(|axis| Some(f64::from(axis.error_code))),
    ),
    Metric::new(
        "ecan_axis_actual_age_cycles",
        "Age of the actual position in cycles; 65535 is more or never.",
        Source::Axis(|axis| Some(f64::from(axis.actual_age))),
    ),
    Metric::new(
        "ecan_axis_following_error_steps",
        "Target minus actual position, in steps of the drive.",
        Source::Axis(|axis| axis.following_error().map(|steps| steps as f64)),
    ),
];

/// A metric: its name, its text and the source of its values.
#[derive(Debug)]
pub(crate) struct Metric {
    pub(crate) name: &'static str,
    pub(crate) help: &'static str,
    pub(crate) source: Source,
}

/// Source of the values, which decides the labels. A time is in nanoseconds, shown in seconds.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Source {
    /// Name and version of the program, as labels.
    Build,
    Service(fn(&MetricsSample) -> f64),
    Bus(fn(&BusState) -> f64),
    /// Bit of an AL state that occurs on the bus.
    AlState(&'static [(&'static str, u8)]),
    Cycle(fn(&CycleSample) -> f64),
    Times(fn(&CycleSample) -> &TimeHistogram),
    /// Alias and position of each slave, as labels.
    Address,
    Slave(fn(&SlaveSample) -> f64),
    SlaveCount(fn(&SlaveStatistics) -> u64),
    Session(&'static [(&'static str, SessionState)]),
    Channel(fn(ChannelStatus) -> f64),
    ChannelPending(fn(&ChannelStatistics) -> u64),
    ChannelCount(fn(&ChannelStatistics) -> u64),
    ChannelState(&'static [(&'static str, ChannelState)]),
    /// Object of a channel, read by SDO; the index is that of channel 0.
    Object {
        index: u16,
        subindex: u8,
        value: fn(u32) -> f64,
    },
    Axis(fn(&AxisStatus) -> Option<f64>),
}

/// Type of a metric.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum MetricKind {
    Counter,
    Gauge,
    Histogram,
}

impl Metric {
    pub(crate) const fn new(name: &'static str, help: &'static str, source: Source) -> Self {
        Self { name, help, source }
    }

    pub(crate) fn kind(&self) -> MetricKind {
        match self.source {
            Source::Times(_) => MetricKind::Histogram,
            _ if self.name.ends_with("_total") => MetricKind::Counter,
            _ => MetricKind::Gauge,
        }
    }

    pub(crate) fn labels(&self) -> &'static [&'static str] {
        match self.source {
            Source::Build => &["program", "version"],
            Source::Service(_) | Source::Bus(_) | Source::Cycle(_) | Source::Times(_) => &[],
            Source::AlState(_) => &["state"],
            Source::Address => &["slave", "alias", "position"],
            Source::Slave(_) | Source::SlaveCount(_) => &["slave"],
            Source::Session(_) => &["slave", "state"],
            Source::Channel(_)
            | Source::ChannelPending(_)
            | Source::ChannelCount(_)
            | Source::Object { .. } => &["slave", "channel"],
            Source::ChannelState(_) => &["slave", "channel", "state"],
            Source::Axis(_) => &["slave", "channel", "node"],
        }
    }
}
