//! Declaration of a metric.

use ecan_cia402::AxisStatus;
use ecan_mcan_port::{ChannelStatistics, SessionState, SlaveStatistics};
use ecan_protocol::image::{ChannelState, ChannelStatus};

use super::cycle_sample::{CycleSample, SlaveSample};
use super::metrics_sample::MetricsSample;
use super::time_histogram::TimeHistogram;
use crate::protocol::BusState;

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
