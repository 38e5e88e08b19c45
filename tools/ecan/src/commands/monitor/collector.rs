//! Converts raw counters to displayed values: rates, differences, percentiles, events.
//!
//! Runs on a thread other than the cycle: histograms and texts allocate.

use std::collections::VecDeque;

use ecan_host::{CycleStatistics, Distribution};
use ecan_mcan_port::{Session, SlaveStatistics};
use ecan_protocol::image::ChannelState;
use ecan_protocol::mapping::CHANNELS;

use super::observation::{GatewayObservation, Observation};
use super::snapshot::{
    CLASSES, ChannelView, CycleView, Errors, Event, GatewayState, GatewayView, Snapshot, Times,
};

const EVENTS: usize = 200;

/// Error counters of one gateway; `None` if it does not respond.
pub type GatewayErrors = Option<[Errors; CHANNELS]>;

#[derive(Clone, Debug)]
struct Moment {
    now_ns: u64,
    gateways: Vec<Counted>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Counted {
    received: [u64; CHANNELS],
    busy_s: [f64; CHANNELS],
}

#[derive(Clone, Debug, Default)]
struct Memory {
    position: usize,
    now: GatewayObservation,
    /// Counters at the last clear.
    base: SlaveStatistics,
    errors: GatewayErrors,
    errors_base: GatewayErrors,
    lost_ns: Option<u64>,
}

#[derive(Debug)]
pub struct Collector {
    is_simulated: bool,
    cycle_ns: u32,
    window_ns: u64,
    start_ns: Option<u64>,
    cycles: CycleStatistics,
    histogram: [u64; CLASSES],
    unmeasured: u64,
    last_begin_ns: Option<u64>,
    history: VecDeque<Moment>,
    gateways: Vec<Memory>,
    events: VecDeque<Event>,
}

impl Collector {
    /// Creates a collector for the gateways at these positions; rates are computed over the last
    /// `window_ns`.
    pub fn new(positions: &[usize], cycle_ns: u32, window_ns: u64, is_simulated: bool) -> Self {
        let memory = |position: &usize| Memory { position: *position, ..Memory::default() };
        Self {
            is_simulated,
            cycle_ns,
            window_ns,
            start_ns: None,
            cycles: CycleStatistics::new(cycle_ns),
            histogram: [0; CLASSES],
            unmeasured: 0,
            last_begin_ns: None,
            history: VecDeque::new(),
            gateways: positions.iter().map(memory).collect(),
            events: VecDeque::new(),
        }
    }

    pub fn take(&mut self, observation: &Observation) {
        self.start_ns.get_or_insert(observation.now_ns);
        self.measure(observation);
        for (at, seen) in observation.gateways.iter().enumerate() {
            self.report_changes(at, seen, observation.now_ns);
            if let Some(gateway) = self.gateways.get_mut(at) {
                gateway.now = *seen;
            }
        }
        let counted = |gateway: &GatewayObservation| Counted {
            received: gateway.statistics.channels.map(|channel| channel.frames_received),
            busy_s: gateway.busy_s,
        };
        let gateways = observation.gateways.iter().map(counted).collect();
        self.history.push_back(Moment { now_ns: observation.now_ns, gateways });
        // Keep one moment at or before the start of the window.
        let begin_ns = observation.now_ns.saturating_sub(self.window_ns);
        while self.history.get(1).is_some_and(|second| second.now_ns <= begin_ns) {
            self.history.pop_front();
        }
    }

    pub fn take_errors(&mut self, at: usize, errors: GatewayErrors) {
        if let Some(gateway) = self.gateways.get_mut(at) {
            gateway.errors = errors;
        }
    }

    pub fn clear(&mut self) {
        self.cycles.clear();
        self.histogram = [0; CLASSES];
        (self.unmeasured, self.last_begin_ns) = (0, None);
        for gateway in &mut self.gateways {
            gateway.base = gateway.now.statistics;
            gateway.errors_base = gateway.errors;
        }
        self.events.clear();
    }

    fn measure(&mut self, observation: &Observation) {
        for mark in &observation.marks {
            self.cycles.begin(&mark.start);
            self.cycles.end(mark.end_ns);
            let begin_ns = mark.start.begun_ns();
            if let Some(before_ns) = self.last_begin_ns.replace(begin_ns) {
                let class = class(begin_ns.saturating_sub(before_ns), self.cycle_ns);
                if let Some(count) = self.histogram.get_mut(class) {
                    *count += 1;
                }
            }
        }
        self.unmeasured += observation.unmeasured;
        if observation.unmeasured > 0 {
            // Unmeasured cycles came after the marks: the next mark starts a new period.
            self.cycles.pause();
            self.last_begin_ns = None;
        }
    }

    fn add_event(&mut self, now_ns: u64, words: String) {
        let seconds = self.seconds(now_ns);
        if self.events.len() == EVENTS {
            self.events.pop_front();
        }
        self.events.push_back(Event { seconds, words });
    }

    fn seconds(&self, now_ns: u64) -> f64 {
        now_ns.saturating_sub(self.start_ns.unwrap_or(now_ns)) as f64 / 1e9
    }

    fn report_changes(&mut self, at: usize, seen: &GatewayObservation, now_ns: u64) {
        let Some(memory) = self.gateways.get(at) else { return };
        let (before, position, lost_ns) = (memory.now, memory.position, memory.lost_ns);
        let (was, is) = (before.session == Session::Ready, seen.session == Session::Ready);
        let mut lines = Vec::new();
        // Check the counter too: a gateway may be lost and ready again between two observations.
        let is_lost_again = seen.statistics.sessions_lost > before.statistics.sessions_lost;
        let mut lost_ns = if is_lost_again { Some(now_ns) } else { lost_ns };
        if is_lost_again {
            lines.push(format!("gateway {position}: lost"));
        }
        if is && (!was || is_lost_again) {
            lines.push(match lost_ns.take() {
                Some(since_ns) => {
                    let away_s = now_ns.saturating_sub(since_ns) as f64 / 1e9;
                    format!("gateway {position}: ready again after {away_s:.1} s")
                }
                None => format!("gateway {position}: ready"),
            });
        }
        if let (false, Session::Failed(fault)) = (seen.session == before.session, seen.session) {
            lines.push(format!("gateway {position}: {fault}"));
        }
        if is {
            let channels = before.channels.iter().zip(seen.channels).zip(seen.has_been_bus_off);
            for (channel, ((old, new), has_been_off)) in channels.enumerate() {
                let was_off = was && old.bus_off();
                if !was_off && (new.bus_off() || has_been_off) {
                    lines.push(format!("gateway {position} can{channel}: bus-off"));
                }
                if !new.bus_off() && (was_off || has_been_off) {
                    lines.push(format!("gateway {position} can{channel}: recovered"));
                }
            }
        }
        if let Some(memory) = self.gateways.get_mut(at) {
            memory.lost_ns = lost_ns;
        }
        for line in lines {
            self.add_event(now_ns, line);
        }
    }

    pub fn snapshot(&self) -> Snapshot {
        let now_ns = self.history.back().map_or(0, |moment| moment.now_ns);
        Snapshot {
            seconds: self.seconds(now_ns),
            is_simulated: self.is_simulated,
            cycle: CycleView {
                cycle_us: f64::from(self.cycle_ns) / 1e3,
                cycles: self.cycles.cycles(),
                overruns: self.cycles.overruns(),
                skipped: self.cycles.skipped(),
                unmeasured: self.unmeasured,
                period: times(&self.cycles.period()),
                run_time: times(&self.cycles.run_time()),
                histogram: self.histogram,
            },
            gateways: (0..).zip(&self.gateways).map(|(at, it)| self.gateway(at, it)).collect(),
            events: self.events.iter().cloned().collect(),
        }
    }

    fn gateway(&self, at: usize, memory: &Memory) -> GatewayView {
        let (now, base) = (&memory.now.statistics, &memory.base);
        let since = |count: fn(&SlaveStatistics) -> u64| count(now).saturating_sub(count(base));
        let state = match memory.now.session {
            Session::Ready => GatewayState::Ready,
            _ if now.sessions > 0 => GatewayState::Lost,
            _ => GatewayState::Starting,
        };
        let reason = match (memory.now.session, memory.now.waiting_for) {
            (Session::Ready, _) => String::new(),
            (Session::Failed(fault), _) => fault.to_string(),
            (_, Some(awaited)) => format!("waiting for {awaited}"),
            (session, None) => session.to_string(),
        };
        let domain = &memory.now.domain;
        GatewayView {
            position: memory.position,
            state,
            reason,
            working_counter: domain.working_counter,
            expected_working_counter: domain.expected_working_counter,
            incomplete_cycles: since(|it| it.incomplete_cycles),
            lost_images: since(|it| it.txpdo_lost),
            unknown_images: since(|it| it.txpdo_unknown),
            faulty_images: since(|it| it.parse_errors),
            times_lost: since(|it| it.sessions_lost),
            times_in_service: since(|it| it.sessions),
            channels: std::array::from_fn(|channel| self.channel(at, memory, state, channel)),
        }
    }

    fn channel(
        &self,
        at: usize,
        memory: &Memory,
        state: GatewayState,
        channel: usize,
    ) -> ChannelView {
        let received = |statistics: &SlaveStatistics| {
            statistics.channels.get(channel).map_or(0, |it| it.frames_received)
        };
        let total = received(&memory.now.statistics).saturating_sub(received(&memory.base));
        let (rx_per_second, load) = self.rates(at, channel);
        let of = |errors: &GatewayErrors| errors.and_then(|it| it.get(channel).copied());
        let errors = of(&memory.errors).map(|now| {
            let base = of(&memory.errors_base).unwrap_or_default();
            Errors {
                dropped: since(now.dropped, base.dropped),
                bus_offs: since(now.bus_offs, base.bus_offs),
                ..now
            }
        });
        let view = ChannelView { received: total, ..ChannelView::default() };
        if state != GatewayState::Ready {
            return view;
        }
        let status = memory.now.channels.get(channel).copied().unwrap_or_default();
        let state = if status.bus_off() { ChannelState::BusOff } else { status.state() };
        ChannelView {
            state: Some(state.to_string()),
            is_bus_off: state == ChannelState::BusOff,
            has_warning: status.warn(),
            has_rx_pressure: status.rx_pressure(),
            has_tx_pressure: status.tx_pressure(),
            rx_pending: status.rx_pending(),
            tx_pending: status.tx_pending(),
            rx_per_second,
            load,
            errors,
            ..view
        }
    }

    fn rates(&self, at: usize, channel: usize) -> (f64, f64) {
        let of = |moment: &Moment| {
            let counted = moment.gateways.get(at)?;
            Some((*counted.received.get(channel)?, *counted.busy_s.get(channel)?))
        };
        let (Some(first), Some(last)) = (self.history.front(), self.history.back()) else {
            return (0.0, 0.0);
        };
        let seconds = last.now_ns.saturating_sub(first.now_ns) as f64 / 1e9;
        match (of(first), of(last)) {
            (Some(first), Some(last)) if seconds > 0.0 => {
                let frames = last.0.saturating_sub(first.0) as f64;
                (frames / seconds, (last.1 - first.1) / seconds)
            }
            _ => (0.0, 0.0),
        }
    }
}

/// Counter of the gateway since the last clear; starts at 0 after a restart.
fn since(now: u64, base: u64) -> u64 {
    now.checked_sub(base).unwrap_or(now)
}

fn class(period_ns: u64, cycle_ns: u32) -> usize {
    let difference_ns = period_ns as i64 - i64::from(cycle_ns);
    let ends_ns = [-100_000, -10_000, -1_000, 1_001, 10_001, 100_001];
    ends_ns.iter().take_while(|end| difference_ns >= **end).count()
}

fn times(of: &Distribution) -> Times {
    let us = |ns: u64| ns as f64 / 1e3;
    Times {
        min_us: us(of.min_ns),
        p50_us: us(of.p50_ns),
        p95_us: us(of.p95_ns),
        p99_us: us(of.p99_ns),
        p99_9_us: us(of.p99_9_ns),
        max_us: us(of.max_ns),
    }
}

#[cfg(test)]
mod tests {
    use ecan_host::CycleStart;

    use super::super::observation::Mark;
    use super::*;

    #[test]
    fn periods_are_classified() {
        let table = [
            (0, 0),
            (899_999, 0),
            (900_000, 1),
            (990_000, 2),
            (999_000, 3),
            (1_000_000, 3),
            (1_001_000, 3),
            (1_001_001, 4),
            (1_010_001, 5),
            (1_100_000, 5),
            (1_100_001, 6),
        ];
        for (period_ns, expected) in table {
            assert_eq!(class(period_ns, 1_000_000), expected, "{period_ns}");
        }
    }

    fn observe(collector: &mut Collector, now_ns: u64, change: impl Fn(&mut GatewayObservation)) {
        let mut observation = Observation::new(1);
        observation.now_ns = now_ns;
        change(&mut observation.gateways[0]);
        collector.take(&observation);
    }

    #[test]
    fn gap_of_unmeasured_cycles_is_not_a_period() {
        let mut collector = Collector::new(&[0], 1_000_000, u64::MAX, true);
        let mut observe = |starts_ns: [u64; 2], unmeasured| {
            let mut observation = Observation::new(1);
            for start_ns in starts_ns {
                let start =
                    CycleStart { deadline_ns: start_ns, late_ns: 0, skipped: 1, has_overrun: true };
                observation.mark(Mark { start, end_ns: start_ns + 200_000 });
            }
            observation.unmeasured = unmeasured;
            collector.take(&observation);
            collector.snapshot().cycle
        };
        observe([1_000_000, 2_000_000], 3);
        // Five milliseconds after the last measured one.
        let cycle = observe([7_000_000, 8_000_000], 0);
        assert_eq!((cycle.cycles, cycle.unmeasured), (4, 3));
        assert_eq!(cycle.histogram, [0, 0, 0, 2, 0, 0, 0]);
        assert_eq!((cycle.period.min_us, cycle.period.max_us), (1000.0, 1000.0));
        assert_eq!((cycle.overruns, cycle.skipped), (2, 2));
        let cycle = observe([9_000_000, 10_000_000], 0);
        assert_eq!(cycle.histogram, [0, 0, 0, 4, 0, 0, 0]);
    }

    #[test]
    fn loss_and_recovery_between_observations_is_reported() {
        let mut collector = Collector::new(&[4], 1_000_000, u64::MAX, true);
        let ready = |lost| {
            move |gateway: &mut GatewayObservation| {
                gateway.session = Session::Ready;
                gateway.statistics.sessions = lost + 1;
                gateway.statistics.sessions_lost = lost;
            }
        };
        observe(&mut collector, 0, ready(0));
        observe(&mut collector, 500_000_000, ready(1));
        let snapshot = collector.snapshot();
        let words: Vec<_> = snapshot.events.iter().map(|it| it.words.as_str()).collect();
        let expected = ["gateway 4: ready", "gateway 4: lost", "gateway 4: ready again"];
        assert_eq!(words.len(), 3);
        assert!(words.iter().zip(expected).all(|(is, begin)| is.starts_with(begin)), "{words:?}");
        assert_eq!(snapshot.gateways[0].times_lost, 1);
    }

    #[test]
    fn rates_use_the_window_and_counters_the_last_clear() {
        let mut collector = Collector::new(&[0], 1_000_000, 1_000_000_000, true);
        let at = |frames: u64| {
            move |gateway: &mut GatewayObservation| {
                gateway.session = Session::Ready;
                gateway.statistics.channels[2].frames_received = frames;
                gateway.busy_s[2] = frames as f64 / 1e3;
            }
        };
        for (second, frames) in [(0, 0), (1, 1000), (2, 1100)] {
            observe(&mut collector, second * 1_000_000_000, at(frames));
        }
        let channel = |collector: &Collector| collector.snapshot().gateways[0].channels[2].clone();
        assert_eq!(channel(&collector).received, 1100);
        assert!((channel(&collector).rx_per_second - 100.0).abs() < 1e-9);
        assert!((channel(&collector).load - 0.1).abs() < 1e-9);
        collector.clear();
        observe(&mut collector, 3_000_000_000, at(1103));
        assert_eq!(channel(&collector).received, 3);
    }
}
