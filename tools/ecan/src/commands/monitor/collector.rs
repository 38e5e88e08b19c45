//! Converts raw counters to displayed values: rates, differences, percentiles, events.
//!
//! Runs on a thread other than the cycle: histograms and texts allocate.

use std::collections::VecDeque;
use std::sync::Arc;

use ecan_mcan_port::{BusEvent, GatewayCondition, GatewayWatch, SessionState, SlaveStatistics};
use ecan_protocol::image::ChannelState;
use ecan_protocol::mapping::CHANNELS;
use ecan_service::protocol::{AxisState, ServiceStats};

use super::cycle_times::CycleTimes;
use super::id_table::IdTable;
use super::observation::{
    FrameItem, GatewayErrors, GatewayObservation, Layout, LayoutGateway, Observation,
    ObservedFrame, Origin,
};
use super::snapshot::{
    AxesView, ChannelView, Direction, Errors, Event, GatewayState, GatewayView, Head, IdsView,
    Snapshot,
};

const EVENTS: usize = 200;

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

#[derive(Debug)]
struct Memory {
    layout: LayoutGateway,
    now: GatewayObservation,
    /// Counters at the last clear.
    base: SlaveStatistics,
    /// Bus time of the frames since the start, in seconds.
    busy_s: [f64; CHANNELS],
    errors: GatewayErrors,
    errors_base: GatewayErrors,
    watch: GatewayWatch,
}

#[derive(Debug)]
pub struct Collector {
    origin: Origin,
    window_ns: u64,
    start_ns: Option<u64>,
    now_ns: u64,
    interruption: Option<&'static str>,
    cycle: CycleTimes,
    history: VecDeque<Moment>,
    gateways: Vec<Memory>,
    ids: IdTable,
    frames_lost: u64,
    axes: Vec<AxisState>,
    service: Option<ServiceStats>,
    events: VecDeque<Event>,
}

impl Collector {
    /// Creates a collector; rates are computed over the last `window_ns`.
    pub fn new(origin: Origin, window_ns: u64) -> Self {
        Self {
            origin,
            window_ns,
            start_ns: None,
            now_ns: 0,
            interruption: None,
            cycle: CycleTimes::new(&Layout::default()),
            history: VecDeque::new(),
            gateways: Vec::new(),
            ids: IdTable::default(),
            frames_lost: 0,
            axes: Vec::new(),
            service: None,
            events: VecDeque::new(),
        }
    }

    pub fn take(&mut self, observation: &Observation) {
        self.now_ns = observation.now_ns;
        self.start_ns.get_or_insert(observation.now_ns);
        self.cycle.take(observation);
        observation.frames.items().for_each(|item| self.take_frame(&item));
        // Its gateways are those of the frames that follow.
        if let Some(layout) = &observation.layout {
            self.set_layout(layout);
        }
        self.interruption = observation.interruption;
        if self.interruption.is_none() {
            for (at, seen) in observation.gateways.iter().enumerate() {
                self.report_changes(at, seen);
                if let Some(gateway) = self.gateways.get_mut(at) {
                    gateway.now = *seen;
                }
            }
            self.report_axis_errors(&observation.axes);
            self.axes.clone_from(&observation.axes);
            self.service.clone_from(&observation.service);
        }
        let counted = |gateway: &Memory| Counted {
            received: gateway
                .now
                .condition
                .statistics
                .channels
                .map(|channel| channel.frames_received),
            busy_s: gateway.busy_s,
        };
        let gateways = self.gateways.iter().map(counted).collect();
        self.history.push_back(Moment { now_ns: self.now_ns, gateways });
        // Keep one moment at or before the start of the window.
        let begin_ns = self.window_begin_ns();
        while self.history.get(1).is_some_and(|second| second.now_ns <= begin_ns) {
            self.history.pop_front();
        }
    }

    fn window_begin_ns(&self) -> u64 {
        self.now_ns.saturating_sub(self.window_ns)
    }

    fn set_layout(&mut self, layout: &Layout) {
        let memory = |gateway: &LayoutGateway| Memory {
            layout: gateway.clone(),
            base: gateway.base,
            now: GatewayObservation {
                condition: GatewayCondition { statistics: gateway.base, ..Default::default() },
                ..Default::default()
            },
            busy_s: [0.0; CHANNELS],
            errors: None,
            errors_base: None,
            watch: GatewayWatch::new(false, &gateway.base),
        };
        self.gateways = layout.gateways.iter().map(memory).collect();
        self.cycle = CycleTimes::new(layout);
        self.ids = IdTable::default();
        self.history.clear();
        layout.event.iter().for_each(|event| self.add_event(event.clone()));
    }

    fn take_frame(&mut self, item: &FrameItem) {
        match item {
            FrameItem::Frame(frame) => {
                self.ids.add(frame);
                self.count_bus_time(frame);
            }
            FrameItem::Lost(count) => {
                self.ids.lose();
                self.frames_lost += count;
            }
        }
    }

    fn count_bus_time(&mut self, frame: &ObservedFrame) {
        let (Some(gateway), channel) =
            (self.gateways.get_mut(frame.gateway), usize::from(frame.channel))
        else {
            return;
        };
        let rates = gateway.layout.rates.get(channel);
        if let (Some(rates), Some(busy_s)) = (rates, gateway.busy_s.get_mut(channel))
            && frame.direction != Direction::Failed
        {
            *busy_s += rates.seconds(&frame.frame);
        }
    }

    /// Takes the error counters of the gateway at a position.
    pub fn take_errors(&mut self, position: usize, errors: GatewayErrors) {
        if let Some(gateway) =
            self.gateways.iter_mut().find(|gateway| gateway.layout.position == position)
        {
            gateway.errors = errors;
        }
    }

    pub fn clear(&mut self) {
        self.cycle.clear();
        for gateway in &mut self.gateways {
            gateway.base = gateway.now.condition.statistics;
            gateway.errors_base = gateway.errors;
        }
        self.ids = IdTable::default();
        self.frames_lost = 0;
        self.events.clear();
    }

    fn add_event(&mut self, words: String) {
        let seconds = self.seconds();
        if self.events.len() == EVENTS {
            self.events.pop_front();
        }
        self.events.push_back(Event { seconds, words });
    }

    fn seconds(&self) -> f64 {
        self.now_ns.saturating_sub(self.start_ns.unwrap_or(self.now_ns)) as f64 / 1e9
    }

    fn report_changes(&mut self, at: usize, seen: &GatewayObservation) {
        let Some(memory) = self.gateways.get_mut(at) else { return };
        let position = memory.layout.position;
        let lines = memory.watch.events(seen.condition, self.now_ns).map(|event| match event {
            BusEvent::Channel(channel, change) => {
                format!("gateway {position} can{channel}: {change}")
            }
            event => format!("gateway {position}: {event}"),
        });
        let lines: Vec<_> = lines.collect();
        lines.into_iter().for_each(|line| self.add_event(line));
    }

    fn report_axis_errors(&mut self, axes: &[AxisState]) {
        let address = |axis: &AxisState| (axis.gateway, axis.channel, axis.node_id);
        for axis in axes {
            let before = self.axes.iter().find(|known| address(known) == address(axis));
            if let (Some(error), false) =
                (&axis.error, before.is_some_and(|before| before.error == axis.error))
            {
                let (gateway, channel, node) = address(axis);
                self.add_event(format!("gateway {gateway} can{channel} node {node}: {error}"));
            }
        }
    }

    pub fn snapshot(&self) -> Snapshot {
        let positions: Vec<_> =
            self.gateways.iter().map(|gateway| gateway.layout.position).collect();
        let has_axes = !self.axes.is_empty();
        Snapshot {
            head: Head {
                seconds: self.seconds(),
                is_simulated: self.origin.is_simulated,
                program: self.origin.program.clone(),
                interruption: self.interruption,
                frames_lost: self.frames_lost,
            },
            service: self.service.clone(),
            cycle: self.cycle.view(),
            gateways: (0..)
                .zip(&self.gateways)
                .map(|(at, memory)| self.gateway(at, memory))
                .collect(),
            events: self.events.iter().cloned().collect(),
            ids: IdsView {
                not_listed: self.ids.not_listed(),
                ids: self.ids.rows(&positions, self.now_ns, self.window_begin_ns()),
            },
            axes: AxesView {
                without_axes: (!has_axes).then(|| self.origin.without_axes.clone()),
                axes: self.axes.clone(),
            },
            service_events: None,
            signals: Arc::default(),
        }
    }

    fn gateway(&self, at: usize, memory: &Memory) -> GatewayView {
        let condition = &memory.now.condition;
        let (now, base) = (&condition.statistics, &memory.base);
        let since = |count: fn(&SlaveStatistics) -> u64| count(now).saturating_sub(count(base));
        let state = match condition.is_ready() {
            true => GatewayState::Ready,
            false if now.sessions > 0 => GatewayState::Lost,
            false => GatewayState::Starting,
        };
        let reason = match (condition.fault, condition.waiting_for) {
            _ if condition.is_ready() => String::new(),
            (Some(fault), _) => fault.to_string(),
            (None, Some(step)) if condition.session != SessionState::Failed => {
                format!("waiting for {step}")
            }
            _ => condition.session.to_string(),
        };
        GatewayView {
            position: memory.layout.position,
            state,
            reason,
            working_counter: memory.now.working_counter,
            expected_working_counter: memory.now.expected_working_counter,
            incomplete_cycles: since(|statistics| statistics.incomplete_cycles),
            lost_images: since(|statistics| statistics.txpdo_lost),
            unknown_images: since(|statistics| statistics.txpdo_unknown),
            faulty_images: since(|statistics| statistics.parse_errors),
            times_lost: since(|statistics| statistics.sessions_lost),
            times_in_service: since(|statistics| statistics.sessions),
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
        let condition = &memory.now.condition;
        let received = |statistics: &SlaveStatistics| {
            statistics.channels.get(channel).map_or(0, |channel| channel.frames_received)
        };
        let total = received(&condition.statistics).saturating_sub(received(&memory.base));
        let (rx_per_second, load) = self.rates(at, channel);
        let of =
            |errors: &GatewayErrors| errors.and_then(|channels| channels.get(channel).copied());
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
        let status = condition.channels.get(channel).copied().flatten().unwrap_or_default();
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

#[cfg(test)]
#[path = "collector_tests.rs"]
mod tests;
