//! Prometheus' text form of a sample.

use std::sync::Arc;

use ecan_host::Ecrt;
use ecan_protocol::image::ChannelStatus;
use prometheus::TextEncoder;
use prometheus::proto::{Bucket, Counter, Gauge, Histogram, LabelPair, MetricFamily, MetricType};

use super::declared::{Metric, MetricKind, Source, metrics};
use super::device_objects::DeviceObjects;
use super::sample::{CycleSample, MetricsSample, SlaveSample, TimeHistogram};
use crate::server::bus_calls::BusCalls;
use crate::server::config::{MetricsConfig, ServiceError};
use crate::server::shared::Shared;

const NS_PER_S: f64 = 1e9;

/// Starts what the metrics of a service need; the function returns their text.
pub(crate) fn source(
    config: &MetricsConfig,
    shared: &Arc<Shared>,
    ecrt: &Ecrt,
    master_index: u32,
) -> Result<impl Fn() -> Result<String, String> + Send + 'static, ServiceError> {
    let objects = config.object_interval.map(|interval| {
        let objects = metrics().filter_map(|metric| match metric.source {
            Source::Object { index, subindex, .. } => Some((index, subindex)),
            _ => None,
        });
        DeviceObjects::start(interval, objects.collect(), shared, ecrt)
    });
    let objects = objects.transpose().map_err(ServiceError::Thread)?;
    let (shared, bus) = (shared.clone(), BusCalls::new(ecrt.clone(), master_index));
    Ok(move || {
        let sample = shared.metrics_sample();
        let mut sample = sample.ok_or("the service did not answer in time\n")?;
        sample.objects = objects.as_ref().map(DeviceObjects::values).unwrap_or_default();
        sample.bus = bus.bus_state().ok();
        text(&sample).map_err(|error| format!("{error}\n"))
    })
}

/// Returns the text of all metrics that have a value.
fn text(sample: &MetricsSample) -> prometheus::Result<String> {
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
                counters
                    .into_iter()
                    .for_each(|counters| self.number(&labels, count(counters) as f64));
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
