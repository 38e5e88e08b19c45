//! Metrics of a sample in the text form of Prometheus.

use super::declared::metrics;
use crate::protocol::{BusState, CycleState, Hello, ServiceStats};
use crate::server::listener::enter_background;
use crate::server::service::Shared;
use ecan_cia402::AxisStatus;
use ecan_host::{AdapterConfig, Diagnostics, DomainReport, Ecrt, Error};
use ecan_mcan_port::{ChannelStatistics, SessionState, SlaveStatistics};
use ecan_protocol::image::{ChannelState, ChannelStatus};
use ecan_protocol::mapping::CHANNELS;
use prometheus::TextEncoder;
use prometheus::proto::{Bucket, Counter, Gauge, Histogram, LabelPair, MetricFamily, MetricType};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

const NS_PER_S: f64 = 1e9;

/// Returns the text of all metrics that have a value.
pub(crate) fn text(sample: &MetricsSample) -> prometheus::Result<String> {
    let families = metrics().filter_map(|metric| {
        let mut values = Values { labels: metric.labels(), found: Vec::new() };
        values.add(metric, sample);
        (!values.found.is_empty()).then(|| family(metric, values.found))
    });
    TextEncoder::new().encode_to_string(&families.collect::<Vec<_>>())
}

enum Value {
    Number(f64),
    Times(TimeHistogram),
}

struct Values {
    labels: &'static [&'static str],
    found: Vec<(Vec<LabelPair>, Value)>,
}

impl Values {
    fn add(&mut self, metric: &Metric, sample: &MetricsSample) {
        let cycle = sample.cycle.as_ref();
        match metric.source {
            Source::Build => {
                let hello = &sample.hello;
                self.number(&[&hello.server, &hello.server_version], 1.0);
            }
            Source::Service(value) => self.number(&[], value(sample)),
            Source::Bus(value) => {
                sample.bus.iter().for_each(|bus| self.number(&[], value(bus)));
            }
            Source::AlState(states) => {
                for (bus, (name, bit)) in
                    sample.bus.iter().flat_map(|bus| states.iter().map(move |state| (bus, state)))
                {
                    self.state(&[name], bus.al_states & bit != 0);
                }
            }
            Source::Cycle(value) => {
                cycle.into_iter().for_each(|cycle| self.number(&[], value(cycle)));
            }
            Source::Times(times) => {
                let times = cycle.map(|cycle| *times(cycle));
                self.found.extend(times.map(|times| (Vec::new(), Value::Times(times))));
            }
            Source::Address => {
                for (slave, gateway) in sample.hello.gateways.iter().enumerate() {
                    let (alias, position) = (gateway.alias, gateway.position);
                    self.number(&[&slave, &alias, &position], 1.0);
                }
            }
            Source::Slave(_) | Source::SlaveCount(_) | Source::Session(_) => {
                for (slave, found) in slaves(cycle) {
                    self.add_of_slave(metric.source, slave, found);
                }
            }
            Source::Channel(_)
            | Source::ChannelPending(_)
            | Source::ChannelCount(_)
            | Source::ChannelState(_) => {
                for (slave, found) in slaves(cycle) {
                    for (channel, status) in (0..).zip(found.channels) {
                        if let Some(status) = status {
                            self.add_of_channel(metric.source, (slave, channel), status, found);
                        }
                    }
                }
            }
            Source::Object { index, subindex, value } => {
                for (&(slave, channel, of_index, of_subindex), raw) in &sample.objects {
                    if (of_index, of_subindex) == (index, subindex) {
                        self.number(&[&slave, &channel], value(*raw));
                    }
                }
            }
            Source::Axis(value) => {
                for axis in cycle.into_iter().flat_map(|cycle| &cycle.axes) {
                    let address = axis.address;
                    let labels: [&dyn ToString; 3] =
                        [&address.slave, &address.channel, &address.node.get()];
                    value(axis).into_iter().for_each(|value| self.number(&labels, value));
                }
            }
        }
    }

    fn add_of_slave(&mut self, source: Source, slave: usize, found: &SlaveSample) {
        match source {
            Source::Slave(value) => self.number(&[&slave], value(found)),
            Source::SlaveCount(count) => self.number(&[&slave], count(&found.statistics) as f64),
            Source::Session(states) => {
                for (name, state) in states {
                    self.state(&[&slave, name], found.session == *state);
                }
            }
            _ => {}
        }
    }

    fn add_of_channel(
        &mut self,
        source: Source,
        (slave, channel): (usize, usize),
        status: ChannelStatus,
        found: &SlaveSample,
    ) {
        let labels: [&dyn ToString; 2] = [&slave, &channel];
        match source {
            Source::Channel(value) => self.number(&labels, value(status)),
            Source::ChannelPending(count) | Source::ChannelCount(count) => {
                let counters = found.statistics.channels.get(channel);
                counters.into_iter().for_each(|it| self.number(&labels, count(it) as f64));
            }
            Source::ChannelState(states) => {
                for (name, state) in states {
                    self.state(&[&slave, &channel, name], status.state() == *state);
                }
            }
            _ => {}
        }
    }

    fn state(&mut self, labels: &[&dyn ToString], is_present: bool) {
        self.number(labels, f64::from(u8::from(is_present)));
    }

    fn number(&mut self, labels: &[&dyn ToString], value: f64) {
        let pairs = self.labels.iter().zip(labels).map(|(name, value)| {
            let mut pair = LabelPair::default();
            pair.set_name((*name).to_owned());
            pair.set_value(value.to_string());
            pair
        });
        self.found.push((pairs.collect(), Value::Number(value)));
    }
}

fn slaves(cycle: Option<&CycleSample>) -> impl Iterator<Item = (usize, &SlaveSample)> {
    cycle.into_iter().flat_map(|cycle| cycle.slaves.iter().enumerate())
}

fn family(metric: &Metric, values: Vec<(Vec<LabelPair>, Value)>) -> MetricFamily {
    let kind = metric.kind();
    let mut family = MetricFamily::default();
    family.set_name(metric.name.to_owned());
    family.set_help(metric.help.to_owned());
    family.set_field_type(match kind {
        MetricKind::Counter => MetricType::COUNTER,
        MetricKind::Gauge => MetricType::GAUGE,
        MetricKind::Histogram => MetricType::HISTOGRAM,
    });
    let metrics = values.into_iter().map(|(labels, value)| {
        let mut one = prometheus::proto::Metric::from_label(labels);
        match value {
            Value::Times(times) => one.set_histogram(histogram(&times)),
            Value::Number(value) if kind == MetricKind::Counter => {
                let mut counter = Counter::default();
                counter.set_value(value);
                one.set_counter(counter);
            }
            Value::Number(value) => {
                let mut gauge = Gauge::default();
                gauge.set_value(value);
                one.set_gauge(gauge);
            }
        }
        one
    });
    family.set_metric(metrics.collect());
    family
}

fn histogram(times: &TimeHistogram) -> Histogram {
    let buckets = times.cumulative().map(|(bound_ns, count)| {
        let mut bucket = Bucket::default();
        bucket.set_upper_bound(bound_ns as f64 / NS_PER_S);
        bucket.set_cumulative_count(count);
        bucket
    });
    let mut histogram = Histogram::default();
    histogram.set_bucket(buckets.collect());
    histogram.set_sample_count(times.samples);
    histogram.set_sample_sum(times.sum_ns as f64 / NS_PER_S);
    histogram
}

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

/// Upper bounds of the buckets, in nanoseconds.
pub(crate) const BOUNDS_NS: [u64; 14] = [
    5_000,
    10_000,
    25_000,
    50_000,
    100_000,
    250_000,
    500_000,
    1_000_000,
    2_500_000,
    5_000_000,
    10_000_000,
    25_000_000,
    50_000_000,
    100_000_000,
];

/// Number of samples up to each bound, with their sum.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct TimeHistogram {
    /// Samples in each bucket alone.
    counts: [u64; BOUNDS_NS.len()],
    pub(crate) samples: u64,
    pub(crate) sum_ns: u64,
}

impl TimeHistogram {
    pub(crate) fn record(&mut self, time_ns: u64) {
        let bucket = BOUNDS_NS.partition_point(|bound| *bound < time_ns);
        if let Some(count) = self.counts.get_mut(bucket) {
            *count += 1;
        }
        self.samples += 1;
        self.sum_ns = self.sum_ns.saturating_add(time_ns);
    }

    /// Bounds in nanoseconds, with the samples that are not above them.
    pub(crate) fn cumulative(&self) -> impl Iterator<Item = (u64, u64)> {
        BOUNDS_NS.into_iter().zip(self.counts).scan(0, |total, (bound, count)| {
            *total += count;
            Some((bound, *total))
        })
    }
}

/// Time that the end of the thread waits for a transfer. One that the bus does not answer ends later.
const END_WAIT: Duration = Duration::from_secs(2);

/// Values by slave, channel, index of channel 0 and subindex.
pub(crate) type ObjectValues = BTreeMap<(usize, u8, u16, u8), u32>;

/// Reader of the objects. Dropping it ends its thread.
#[derive(Debug)]
pub(crate) struct DeviceObjects {
    values: Arc<Mutex<ObjectValues>>,
    end: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl DeviceObjects {
    pub(crate) fn start(
        interval: Duration,
        shared: &Arc<Shared>,
        ecrt: &Ecrt,
    ) -> std::io::Result<Self> {
        let values = Arc::<Mutex<ObjectValues>>::default();
        let (end, is_ended) = channel();
        let (shared, ecrt, written) = (shared.clone(), ecrt.clone(), values.clone());
        let run = move || {
            enter_background();
            loop {
                let found = read(&shared, &ecrt);
                *written.lock().unwrap_or_else(PoisonError::into_inner) = found;
                if is_ended.recv_timeout(interval) != Err(RecvTimeoutError::Timeout) {
                    return;
                }
            }
        };
        let thread = thread::Builder::new().name("ecan objects".into()).spawn(run)?;
        Ok(Self { values, end: Some(end), thread: Some(thread) })
    }

    /// The last values.
    pub(crate) fn values(&self) -> ObjectValues {
        self.values.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Drop for DeviceObjects {
    fn drop(&mut self) {
        self.end = None;
        let Some(thread) = self.thread.take() else { return };
        let end = Instant::now() + END_WAIT;
        while !thread.is_finished() && Instant::now() < end {
            thread::sleep(Duration::from_millis(1));
        }
        if thread.is_finished() {
            let _ = thread.join();
        }
    }
}

/// Reads every object of the enabled channels. What does not answer is missing.
fn read(shared: &Shared, ecrt: &Ecrt) -> ObjectValues {
    let mut values = ObjectValues::new();
    let Some(sample) = shared.metrics_sample() else { return values };
    let (Some(adapter), Some(cycle)) = (sample.adapter, sample.cycle) else { return values };
    // The handle exists only during the transfers, as those of requests.
    let Ok(bus) = Diagnostics::open(ecrt, &adapter) else { return values };
    let objects = metrics().filter_map(|metric| match metric.source {
        Source::Object { index, subindex, .. } => Some((index, subindex)),
        _ => None,
    });
    let objects: BTreeSet<_> = objects.collect();
    for (slave, found) in cycle.slaves.iter().enumerate() {
        let channels = (0..).zip(found.channels).filter(|(_, status)| status.is_some());
        let entries =
            channels.flat_map(|(channel, _)| objects.iter().map(move |object| (channel, *object)));
        for (channel, (index, subindex)) in entries {
            match bus.sdo_upload_u32(slave, index + u16::from(channel), subindex) {
                Ok(value) => {
                    values.insert((slave, channel, index, subindex), value);
                }
                // Firmware without this entry.
                Err(Error::Sdo { abort_code: Some(_), .. }) => {}
                // Each further transfer would wait as long.
                Err(_) => break,
            }
        }
    }
    values
}

#[derive(Debug)]
pub(crate) struct MetricsSample {
    pub(crate) hello: Hello,
    /// Without the list of clients.
    pub(crate) stats: ServiceStats,
    /// Connected clients.
    pub(crate) clients: usize,
    /// `None` without a cycle.
    pub(crate) cycle: Option<CycleSample>,
    /// `None` if the master did not answer.
    pub(crate) bus: Option<BusState>,
    /// Configuration of the slaves of the cycle.
    pub(crate) adapter: Option<AdapterConfig>,
    /// Objects of the gateways that were read.
    pub(crate) objects: ObjectValues,
}

#[derive(Debug)]
pub(crate) struct CycleSample {
    pub(crate) state: CycleState,
    pub(crate) run_time: TimeHistogram,
    pub(crate) late: TimeHistogram,
    pub(crate) slaves: Vec<SlaveSample>,
    pub(crate) axes: Vec<AxisStatus>,
}

#[derive(Debug)]
pub(crate) struct SlaveSample {
    pub(crate) session: SessionState,
    pub(crate) report: DomainReport,
    pub(crate) statistics: SlaveStatistics,
    /// Of the enabled channels.
    pub(crate) channels: [Option<ChannelStatus>; CHANNELS],
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bound_belongs_to_its_bucket() {
        let mut histogram = TimeHistogram::default();
        for time_ns in [5_000, 5_001, 100_000_000, 100_000_001] {
            histogram.record(time_ns);
        }
        let counts: Vec<_> = histogram.cumulative().map(|(_, count)| count).collect();
        assert_eq!(counts, [1, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 3]);
        assert_eq!((histogram.samples, histogram.sum_ns), (4, 200_010_002));
    }
}
