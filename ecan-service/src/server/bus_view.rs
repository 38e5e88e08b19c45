//! State of the cycle, from its snapshot.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use ecan_cia402::AxesSnapshot;
use ecan_host::{Observer, ObserverError, Snapshot};
use ecan_mcan_port::{
    BusEvent, GatewayCondition, GatewayWatch, ImageLossWatch, PendingStep, PortSnapshot,
    SessionState as PortSession, SlaveStatistics,
};
use hdrhistogram::Histogram;
use serde_json::Value;

use crate::protocol::{
    Axes, AxisState, ChannelChanged, CycleState, GatewayState, MAX_EVENTS, NOT_AVAILABLE,
    RecordedEvent, RecordedEvents, RecordedKind, RpcError, SampledTimes, SessionState, State,
};
use crate::server::metrics::{CycleSample, SlaveSample, TimeHistogram};

/// Longest time in a distribution, in nanoseconds.
const MAX_TIME_NS: u64 = 10_000_000_000;
/// Interval of the events of lost images and frames: steady losses leave room for other events.
pub(crate) const LOSS_INTERVAL: Duration = Duration::from_secs(60);

/// The last events of the bus and the service.
#[derive(Debug, Default)]
pub(crate) struct EventLog {
    events: VecDeque<RecordedEvent>,
    dropped: u64,
}

impl EventLog {
    pub(crate) fn push(&mut self, event: RecordedEvent) {
        if self.events.len() == MAX_EVENTS {
            self.events.pop_front();
            self.dropped += 1;
        }
        self.events.push_back(event);
    }

    pub(crate) fn recorded(&self) -> RecordedEvents {
        RecordedEvents { dropped: self.dropped, events: self.events.iter().cloned().collect() }
    }
}

#[derive(Debug)]
pub(crate) struct BusView {
    snapshot: Snapshot,
    since_1970_ns: u64,
    /// Number of the last sampled cycle.
    sampled_cycle: u64,
    run_time: Histogram<u64>,
    late: Histogram<u64>,
    /// The same samples for metrics.
    buckets: Buckets,
    /// What was last notified of the channels, by gateway and channel.
    channels: BTreeMap<(u16, u8), ChannelState>,
    watches: BTreeMap<u16, SlaveWatch>,
}

/// Watches a gateway for the log of events.
#[derive(Debug)]
struct SlaveWatch {
    gateway: GatewayWatch,
    images: ImageLossWatch,
}

impl SlaveWatch {
    fn new(statistics: &SlaveStatistics) -> Self {
        Self {
            gateway: GatewayWatch::new(false, statistics),
            images: ImageLossWatch::new(statistics, LOSS_INTERVAL),
        }
    }
}

/// State of a channel for notifications.
#[derive(Debug, Clone, Copy, Default)]
struct ChannelState {
    is_bus_off: bool,
    has_warning: bool,
    /// Images with bus-off so far.
    bus_off_images: u64,
}

#[derive(Debug, Clone, Copy, Default)]
struct Buckets {
    run_time: TimeHistogram,
    late: TimeHistogram,
}

fn histogram() -> Histogram<u64> {
    // infallible: the bounds are constants that the crate accepts
    let mut histogram = Histogram::new_with_bounds(1, MAX_TIME_NS, 3).unwrap();
    histogram.auto(false);
    histogram
}

fn times(histogram: &Histogram<u64>) -> SampledTimes {
    if histogram.is_empty() {
        return SampledTimes::default();
    }
    SampledTimes {
        samples: histogram.len(),
        min_ns: histogram.min(),
        p50_ns: histogram.value_at_quantile(0.5),
        p99_ns: histogram.value_at_quantile(0.99),
        max_ns: histogram.max(),
    }
}

impl BusView {
    pub(crate) fn new(observer: &Observer, since_1970_ns: u64) -> Self {
        Self {
            snapshot: observer.snapshot(),
            since_1970_ns,
            sampled_cycle: 0,
            run_time: histogram(),
            late: histogram(),
            buckets: Buckets::default(),
            channels: BTreeMap::new(),
            watches: BTreeMap::new(),
        }
    }

    /// Changes of the channels since the last call, and the events of all gateways. Bus-off between two calls is
    /// reported, too.
    pub(crate) fn changes(&mut self, log: &mut EventLog) -> Vec<ChannelChanged> {
        let mut changes = Vec::new();
        if self.update().is_err() {
            return changes;
        }
        let (time_ns, now_ns) = (self.time_ns(), self.snapshot.time_ns());
        let Some(port) = PortSnapshot::of(&self.snapshot) else { return changes };
        for (slave, gateway) in (0..port.slave_count()).zip(0_u16..) {
            let Some(condition) = GatewayCondition::of_snapshot(port, slave) else { continue };
            let statistics = &condition.statistics;
            let channels = statistics.channels.iter().zip(condition.channels);
            for (channel, (counts, status)) in (0_u8..).zip(channels) {
                let Some(status) = status else { continue };
                let now = ChannelState {
                    is_bus_off: status.bus_off(),
                    has_warning: status.warn(),
                    bus_off_images: counts.bus_off_images,
                };
                let known = self.channels.insert((gateway, channel), now);
                let (mut is_bus_off, mut has_warning) =
                    known.map_or((false, false), |before| (before.is_bus_off, before.has_warning));
                let was_bus_off =
                    known.is_some_and(|before| now.bus_off_images > before.bus_off_images);
                for (bus_off, warning) in [
                    (is_bus_off || was_bus_off, now.has_warning),
                    (now.is_bus_off, now.has_warning),
                ] {
                    if (bus_off, warning) != (is_bus_off, has_warning) {
                        (is_bus_off, has_warning) = (bus_off, warning);
                        changes.push(ChannelChanged {
                            time_ns,
                            gateway,
                            channel,
                            is_bus_off,
                            has_warning,
                        });
                    }
                }
            }
            let watch = self.watches.entry(gateway).or_insert_with(|| SlaveWatch::new(statistics));
            let events = watch.gateway.events(condition, now_ns);
            events.for_each(|event| log.push(recorded(time_ns, gateway, event)));
            for loss in watch.images.losses(statistics, now_ns) {
                let (kind, gateway, text) = (RecordedKind::Losses, Some(gateway), loss.to_string());
                log.push(RecordedEvent { time_ns, kind, gateway, text, ..Default::default() });
            }
        }
        changes
    }

    /// Adds the last cycle to the distributions.
    pub(crate) fn sample(&mut self) {
        if self.snapshot.update().is_ok() && self.snapshot.cycle() != self.sampled_cycle {
            self.sampled_cycle = self.snapshot.cycle();
            self.run_time.saturating_record(self.snapshot.run_time_ns());
            self.buckets.run_time.record(self.snapshot.run_time_ns());
            if let Some(start) = self.snapshot.cycle_start() {
                self.late.saturating_record(start.late_ns);
                self.buckets.late.record(start.late_ns);
            }
        }
    }

    /// Number of the last cycle if the gateway is not ready in it.
    pub(crate) fn cycle_of_lost_session(&mut self, slave: usize) -> Option<u64> {
        self.update().ok()?;
        let session = PortSnapshot::of(&self.snapshot)?.session(slave)?;
        (session != PortSession::Ready).then(|| self.snapshot.cycle())
    }

    /// Reads the last cycle; returns whether the application has ended.
    fn update(&mut self) -> Result<bool, RpcError> {
        match self.snapshot.update() {
            Err(error @ ObserverError::NoCycle) => {
                Err(RpcError::new(NOT_AVAILABLE, error.to_string()))
            }
            result => Ok(result.is_err()),
        }
    }

    fn time_ns(&self) -> u64 {
        self.snapshot.time_ns().wrapping_add(self.since_1970_ns)
    }

    pub(crate) fn state(&mut self, cycle_ns: u64) -> Result<State, RpcError> {
        let is_closed = self.update()?;
        let cycle = self.cycle_state(cycle_ns, is_closed);
        let snapshot = &self.snapshot;
        let port = PortSnapshot::of(snapshot);
        let gateways = port.map_or(0, |port| port.slave_count());
        let gateways = (0..gateways).filter_map(|slave| gateway(snapshot, port?, slave)).collect();
        Ok(State { cycle, run_time: times(&self.run_time), late: times(&self.late), gateways })
    }

    fn cycle_state(&self, cycle_ns: u64, is_closed: bool) -> CycleState {
        let snapshot = &self.snapshot;
        CycleState {
            cycle: snapshot.cycle(),
            time_ns: self.time_ns(),
            cycle_ns,
            run_time_ns: snapshot.run_time_ns(),
            late_ns: snapshot.cycle_start().map(|start| start.late_ns),
            overruns: snapshot.overruns(),
            skipped: snapshot.skipped(),
            is_stop_requested: snapshot.is_stop_requested(),
            is_closed,
        }
    }

    /// The last cycle for metrics; `None` before the first.
    pub(crate) fn cycle_sample(&mut self, cycle_ns: u64) -> Option<CycleSample> {
        let is_closed = self.update().ok()?;
        let snapshot = &self.snapshot;
        let port = PortSnapshot::of(snapshot);
        let slaves = (0..port.map_or(0, |port| port.slave_count())).filter_map(|slave| {
            let port = port?;
            let status = |channel| port.channel_status(slave, channel);
            Some(SlaveSample {
                session: port.session(slave)?,
                report: snapshot.domain_report(slave).unwrap_or_default(),
                statistics: port.statistics(slave)?,
                channels: [status(0), status(1), status(2), status(3)],
            })
        });
        Some(CycleSample {
            state: self.cycle_state(cycle_ns, is_closed),
            run_time: self.buckets.run_time,
            late: self.buckets.late,
            slaves: slaves.collect(),
            axes: AxesSnapshot::of(snapshot).iter().flat_map(|axes| axes.axes()).collect(),
        })
    }

    pub(crate) fn axes(&mut self) -> Result<Axes, RpcError> {
        self.update()?;
        let axes = AxesSnapshot::of(&self.snapshot);
        let axes = axes
            .iter()
            .flat_map(|axes| axes.axes())
            .map(|status| AxisState::from(&status))
            .collect();
        Ok(Axes { cycle: self.snapshot.cycle(), time_ns: self.time_ns(), axes })
    }
}

fn gateway(snapshot: &Snapshot, port: PortSnapshot<'_>, slave: usize) -> Option<GatewayState> {
    let report = snapshot.domain_report(slave).unwrap_or_default();
    let status = |channel| port.channel_status(slave, channel).map(|status| status.raw());
    let statistics = match serde_json::to_value(port.statistics(slave)?) {
        Ok(Value::Object(counters)) => counters,
        _ => return None,
    };
    Some(GatewayState {
        session: match port.session(slave)? {
            PortSession::Waiting => SessionState::Waiting,
            PortSession::Verifying => SessionState::Verifying,
            PortSession::Ready => SessionState::Ready,
            PortSession::Failed => SessionState::Failed,
        },
        waiting_for: text(port.waiting_for(slave)),
        waiting_code: PendingStep::encode(port.waiting_for(slave)),
        working_counter: report.working_counter,
        expected_working_counter: report.expected_working_counter,
        channel_status: [status(0), status(1), status(2), status(3)],
        statistics,
    })
}

fn recorded(time_ns: u64, gateway: u16, event: BusEvent) -> RecordedEvent {
    let (mut channel, mut duration_ns) = (None, None);
    let kind = match event {
        BusEvent::Lost(_) => RecordedKind::Lost,
        BusEvent::Waits(_) => RecordedKind::Waits,
        BusEvent::Failed(_) => RecordedKind::Failed,
        BusEvent::Interrupted => RecordedKind::Interrupted,
        BusEvent::Ready(after) => {
            duration_ns = after.map(nanoseconds);
            RecordedKind::Ready
        }
        BusEvent::Channel(changed, _) => {
            channel = Some(changed);
            RecordedKind::Channel
        }
        _ => RecordedKind::Other,
    };
    let (gateway, text) = (Some(gateway), event.to_string());
    RecordedEvent { time_ns, kind, gateway, channel, duration_ns, text }
}

fn text(value: Option<impl ToString>) -> Option<String> {
    value.map(|value| value.to_string())
}

pub(crate) fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn event_after_the_last_place_pushes_out_the_first() {
        let mut log = EventLog::default();
        (0..MAX_EVENTS as u64)
            .for_each(|time_ns| log.push(RecordedEvent { time_ns, ..Default::default() }));
        assert_eq!((log.recorded().dropped, log.recorded().events[0].time_ns), (0, 0));
        log.push(RecordedEvent { time_ns: 100, ..Default::default() });
        let RecordedEvents { dropped, events } = log.recorded();
        let times: Vec<_> = events.iter().map(|event| event.time_ns).collect();
        assert_eq!((dropped, times), (1, (1..=100).collect()));
    }
}
