//! Gateways with the cycle of another program, through its service.

use std::time::{Duration, SystemTime};

use ecan_host::{AdapterConfig, Clock as _, Errno, MonotonicClock, SlaveAccess as _};
use ecan_mcan_port::{GatewayCondition, PortConfig};
use ecan_protocol::can::CanFrame;
use ecan_protocol::image::{ChannelState, ChannelStatus, Timestamp};
use ecan_protocol::mapping::{CHANNELS, Direction};
use ecan_service::client::{ClientError, Event as ServiceEvent, ReceivedImage, SendError};
use ecan_service::protocol::{
    EventKind, FrameEvent, FrameReport, Gateway, GatewayState, ImageSubscription, NOT_AVAILABLE,
    Subscription,
};
use serde_json::Value;

use crate::context::{Failure, Result, note};
use crate::frames::channels::Channels;
use crate::frames::link::{Arrival, BusFrame, Event, FrameLink, Outcome, Ticket};
use crate::service_access::{ServiceConnection, condition};

/// Longest age of the state while own frames are sent, and otherwise.
const SENDING_NS: u64 = 1_000_000_000;
const STATE_NS: u64 = 50_000_000;
/// Most events of one cycle.
const MAX_EVENTS: usize = 4096;
const LOSS_REPORT_NS: u64 = 1_000_000_000;
/// Time between two attempts to connect again.
const RECONNECT_NS: u64 = 200_000_000;

/// A gateway of the command.
#[derive(Debug)]
struct LinkedGateway {
    /// Index in the service.
    index: u16,
    position: u16,
    /// Its counters are those since the start of the command.
    condition: GatewayCondition,
    /// Channels in the last state; those of `condition` differ for one cycle after a bus-off between two states.
    last_channels: [Option<ChannelStatus>; CHANNELS],
    /// Counters at the start of the command.
    start: Value,
    /// Images while there was no connection, at most.
    missed: u64,
}

/// Cycles of the service that this program has observed, for limits of responses.
///
/// The service may read a state before it passes on the frames of the same cycle. A cycle is settled
/// when a later state was received and the events after it were read: then its frames are known. Cycles
/// are not counted while the results of own frames are missing, because the service reads frames and
/// passes on results at its own pace.
#[derive(Clone, Copy, Debug, Default)]
struct ObservedCycles {
    /// Number of the last cycle; 0 before the first one.
    number: u64,
    /// Cycles up to the last state, and up to the one before.
    last: u64,
    before: u64,
    /// Cycles that were counted or left out.
    done: u64,
    settled: u64,
    /// Cycles up to here are left out.
    barrier: u64,
    /// Own frames without result, and the cycles at the first of them.
    waiting: usize,
    waiting_since: u64,
}

/// Cycles without a result after which time passes again: no node acknowledges the frames.
const LONGEST_WAIT: u64 = 1000;

impl ObservedCycles {
    /// Takes the number of a cycle from a state. Numbers begin again with the cycle.
    fn observe(&mut self, number: u64) {
        let is_first = self.number == 0;
        let passed = if is_first { 0 } else { number.saturating_sub(self.number) };
        self.number = number;
        self.pass(passed);
    }

    /// Adds cycles; also those that a service without a cycle would have run.
    fn pass(&mut self, cycles: u64) {
        self.before = self.last;
        self.last += cycles;
    }

    fn on_sent(&mut self) {
        if self.waiting == 0 {
            self.waiting_since = self.before;
        }
        self.waiting += 1;
    }

    fn on_result(&mut self) {
        self.waiting = self.waiting.saturating_sub(1);
        self.barrier = self.last;
    }

    /// Counts what passed, after all events that had arrived were read.
    fn settle(&mut self) {
        let begin = self.done.max(self.barrier);
        let is_waiting = self.waiting > 0 && self.before - self.waiting_since <= LONGEST_WAIT;
        if !is_waiting {
            self.settled += self.before.saturating_sub(begin);
        }
        self.done = self.before;
    }
}

#[derive(Debug)]
pub struct ServiceLink {
    connection: ServiceConnection,
    adapter: AdapterConfig,
    config: PortConfig,
    gateways: Vec<LinkedGateway>,
    since_1970_ns: u64,
    state_at_ns: u64,
    cycles: ObservedCycles,
    sent_at_ns: Option<u64>,
    images: Vec<ReceivedImage>,
    lost: u64,
    lost_reported_ns: u64,
    /// Channels and, if they are subscribed, images, for a new connection.
    subscribed: (Channels, bool),
    /// The command goes on when the service is there again.
    reconnects: bool,
    /// Time since which there is no connection.
    disconnected_ns: Option<u64>,
    next_attempt_ns: u64,
    /// Error that ends the command.
    failure: Option<Failure>,
}

impl ServiceLink {
    /// Subscribes to the frames of channels of gateways: index in the service and position of each, in
    /// the order of the configuration.
    pub fn start(
        connection: ServiceConnection,
        (adapter, config): (AdapterConfig, PortConfig),
        gateways: &[(u16, u16)],
        subscribed: (Channels, bool),
    ) -> Result<Self> {
        let since_1970 = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
        let since_1970_ns = u64::try_from(since_1970.unwrap_or_default().as_nanos()).unwrap_or(0);
        let now_ns = MonotonicClock.now_ns();
        let mut link = Self {
            connection,
            adapter,
            config,
            gateways: gateways.iter().copied().map(LinkedGateway::new).collect(),
            since_1970_ns: since_1970_ns.wrapping_sub(now_ns),
            state_at_ns: now_ns,
            cycles: ObservedCycles::default(),
            sent_at_ns: None,
            images: Vec::new(),
            lost: 0,
            lost_reported_ns: 0,
            subscribed,
            reconnects: false,
            disconnected_ns: None,
            next_attempt_ns: 0,
            failure: None,
        };
        link.subscribe().map_err(|error| link.error(&error))?;
        Ok(link)
    }

    /// Waits for a service that ends, instead of ending the command.
    pub fn reconnecting(mut self, reconnects: bool) -> Self {
        self.reconnects = reconnects;
        self
    }

    fn subscribe(&mut self) -> Result<(), ClientError> {
        self.read_state()?;
        let (channels, has_images) = self.subscribed;
        let indices: Vec<_> = self.gateways.iter().map(|gateway| gateway.index).collect();
        let subscription = Subscription {
            gateways: indices.clone(),
            channels: channels.iter().collect(),
            kinds: vec![EventKind::Received, EventKind::Transmitted, EventKind::Published],
            ..Subscription::default()
        };
        let client = self.connection.client();
        client.subscribe(&subscription)?;
        if has_images {
            let images = ImageSubscription { gateways: indices, ..ImageSubscription::default() };
            client.subscribe_images(&images)?;
        }
        Ok(())
    }

    /// Takes note of an error of the connection. The gateways are not ready until there is another one.
    fn take_error(&mut self, error: &ClientError) {
        if !error.is_disconnection() || !self.reconnects {
            self.failure = Some(self.error(error));
            return;
        }
        if self.disconnected_ns.is_none() {
            note(format_args!("# {}; waiting for it", self.error(error)));
            self.disconnected_ns = Some(self.now_ns());
        }
        self.forget_state();
    }

    /// Frames of the former cycle have no result, and the counters begin again.
    fn forget_state(&mut self) {
        self.cycles.waiting = 0;
        for gateway in &mut self.gateways {
            gateway.forget_session();
            gateway.start = Value::Null;
        }
    }

    /// Connects to the service again, if there is one; waits for one cycle.
    fn reconnect(&mut self, since_ns: u64) {
        MonotonicClock.sleep_until_ns(self.now_ns() + u64::from(self.adapter.cycle_ns()));
        let now_ns = self.now_ns();
        if now_ns < self.next_attempt_ns {
            return;
        }
        self.next_attempt_ns = now_ns + RECONNECT_NS;
        let address = self.connection.address().clone();
        let Ok(client) = address.connect("ecan") else { return };
        if client.hello().gateways.is_empty() {
            // The service has no cycle yet.
            return;
        }
        let connection = ServiceConnection::new(client, address);
        let before = std::mem::replace(&mut self.connection, connection);
        let known = &before.hello().gateways;
        if self.has_channels_of(known, &self.connection.hello().gateways) {
            note(format_args!("# {} is there again", self.connection.program()));
            let missed =
                now_ns.saturating_sub(since_ns) / u64::from(self.adapter.cycle_ns()).max(1);
            self.gateways.iter_mut().for_each(|gateway| gateway.missed += missed);
            self.disconnected_ns = None;
            if let Err(error) = self.subscribe() {
                self.take_error(&error);
            }
        } else {
            self.failure = Some(self.other_channels());
        }
    }

    /// Returns whether the gateways of the command are the same. Whether they report results is known later.
    fn has_channels_of(&self, known: &[Gateway], new: &[Gateway]) -> bool {
        let part = |gateway: &Gateway| (gateway.alias, gateway.position, gateway.channels.clone());
        self.gateways.iter().all(|linked| {
            let index = usize::from(linked.index);
            known.get(index).map(part) == new.get(index).map(part)
        })
    }

    fn other_channels(&self) -> Failure {
        let program = self.connection.program();
        let reason =
            format!("{program} has configured the bus again, with other channels; start again");
        Failure::Device(ecan_host::Error::Disconnected { reason })
    }

    pub fn connection(&self) -> &ServiceConnection {
        &self.connection
    }

    fn error(&self, error: &ClientError) -> Failure {
        Failure::Device(self.connection.error("service", error))
    }

    /// Continues if the gateways of the command have the channels that they had.
    fn take_gateways(&mut self, new: &[Gateway]) {
        self.forget_state();
        let program = self.connection.program();
        if new.is_empty() {
            note(format_args!("# {program} has stopped its cycle; waiting for it"));
        } else if self.has_channels_of(&self.connection.hello().gateways, new) {
            note(format_args!("# {program} has configured the bus again, with the same channels"));
        } else {
            self.failure = Some(self.other_channels());
        }
    }

    fn read_state(&mut self) -> Result<(), ClientError> {
        let state = match self.connection.client().state() {
            // Without a cycle the gateways are not ready.
            Err(error) if error.rpc().is_some_and(|rpc| rpc.code == NOT_AVAILABLE) => {
                let (before_ns, now_ns) = (self.state_at_ns, MonotonicClock.now_ns());
                self.state_at_ns = now_ns;
                self.gateways.iter_mut().for_each(LinkedGateway::forget_session);
                self.cycles
                    .pass(now_ns.saturating_sub(before_ns) / u64::from(self.adapter.cycle_ns()));
                return Ok(());
            }
            state => state?,
        };
        self.state_at_ns = MonotonicClock.now_ns();
        self.cycles.observe(state.cycle.cycle);
        for gateway in &mut self.gateways {
            if let Some(state) = state.gateways.get(usize::from(gateway.index)) {
                gateway.update(state);
            }
        }
        Ok(())
    }

    /// Reads what has arrived; waits for up to one cycle if nothing has.
    fn read_events(&mut self, arrivals: &mut Vec<Arrival>) -> Result<(), ClientError> {
        let mut timeout = Duration::from_nanos(self.adapter.cycle_ns().into());
        let connection = self.connection.clone();
        for _ in 0..MAX_EVENTS {
            let Some(event) = connection.client().poll(timeout)? else { break };
            timeout = Duration::ZERO;
            match event {
                ServiceEvent::Frame(report) => {
                    if report.tag != 0 {
                        self.cycles.on_result();
                    }
                    arrivals.extend(self.arrival(&report));
                }
                ServiceEvent::Image(image) => self.images.push(image),
                ServiceEvent::Lost(lost) => self.lost += lost.frames + lost.frames_in_client,
                ServiceEvent::Gateways(changed) => self.take_gateways(&changed.gateways),
                _ => {}
            }
        }
        self.cycles.settle();
        let is_sending = |sent_at: u64| self.state_at_ns.saturating_sub(sent_at) < SENDING_NS;
        let is_old = self.now_ns().saturating_sub(self.state_at_ns) >= STATE_NS;
        if is_old || self.sent_at_ns.is_some_and(is_sending) {
            self.read_state()?;
        }
        Ok(())
    }

    fn arrival(&self, report: &FrameReport) -> Option<Arrival> {
        let gateway = self.gateways.iter().position(|gateway| gateway.index == report.gateway)?;
        let event = match report.tag {
            0 => Event::Frame(BusFrame {
                gateway,
                channel: report.channel,
                frame: report.frame,
                timestamp: Timestamp::None,
                is_sent: report.event != FrameEvent::Received,
            }),
            tag => Event::Result {
                ticket: Some(Ticket::of_service(tag)),
                outcome: match report.event {
                    FrameEvent::Failed(code) => Outcome::Result(code),
                    FrameEvent::Unknown => Outcome::Unknown,
                    FrameEvent::Rejected(reason) => Outcome::Rejected(reason),
                    _ => Outcome::Sent,
                },
            },
        };
        let time_ns = match report.time_ns {
            0 => self.now_ns(),
            time_ns => time_ns.wrapping_sub(self.since_1970_ns),
        };
        Some(Arrival { time_ns, event })
    }

    fn report_losses(&mut self) {
        let now_ns = self.now_ns();
        if self.lost > 0 && now_ns.saturating_sub(self.lost_reported_ns) >= LOSS_REPORT_NS {
            note(format_args!("# {} frames lost: this program reads too slowly", self.lost));
            (self.lost, self.lost_reported_ns) = (0, now_ns);
        }
    }
}

impl LinkedGateway {
    fn new((index, position): (u16, u16)) -> Self {
        Self {
            index,
            position,
            condition: GatewayCondition::default(),
            last_channels: [None; CHANNELS],
            start: Value::Null,
            missed: 0,
        }
    }

    fn forget_session(&mut self) {
        let GatewayCondition { channels, statistics, .. } = self.condition;
        self.condition = GatewayCondition { channels, statistics, ..GatewayCondition::default() };
    }

    /// Begins a cycle.
    fn begin(&mut self) {
        self.condition.channels = self.last_channels;
    }

    fn update(&mut self, state: &GatewayState) {
        let before = self.condition.statistics.channels;
        self.condition = condition(state);
        self.last_channels = self.condition.channels;
        let counters = Value::Object(state.statistics.clone());
        if self.start.is_null() {
            self.start = counters.clone();
        }
        let since = difference(&counters, &self.start);
        let GatewayCondition { channels, statistics, .. } = &mut self.condition;
        *statistics = serde_json::from_value(since).unwrap_or_default();
        statistics.txpdo_unknown += self.missed;
        let counts = before.iter().zip(&statistics.channels);
        for (status, (before, now)) in channels.iter_mut().zip(counts) {
            if let (Some(status), true) = (status, now.bus_off_images > before.bus_off_images) {
                *status = status.with_state(ChannelState::BusOff).with_bus_off(true);
            }
        }
    }
}

/// Subtracts the numbers of `start`.
fn difference(now: &Value, start: &Value) -> Value {
    match (now, start) {
        (Value::Object(now), Value::Object(start)) => {
            let entry = |(name, value): (&String, &Value)| {
                let since = start
                    .get(name)
                    .map_or_else(|| value.clone(), |before| difference(value, before));
                (name.clone(), since)
            };
            Value::Object(now.iter().map(entry).collect())
        }
        (Value::Array(now), Value::Array(start)) => {
            now.iter().zip(start).map(|(now, start)| difference(now, start)).collect()
        }
        (now, start) => match (now.as_u64(), start.as_u64()) {
            (Some(now), Some(start)) => now.saturating_sub(start).into(),
            _ => now.clone(),
        },
    }
}

impl FrameLink for ServiceLink {
    fn adapter_config(&self) -> &AdapterConfig {
        &self.adapter
    }

    fn port_config(&self) -> &PortConfig {
        &self.config
    }

    fn now_ns(&self) -> u64 {
        MonotonicClock.now_ns()
    }

    fn since_1970_ns(&self) -> u64 {
        self.since_1970_ns
    }

    fn is_real_time(&self) -> bool {
        true
    }

    fn cycles(&self) -> Option<u64> {
        Some(self.cycles.settled)
    }

    fn begin(&mut self, arrivals: &mut Vec<Arrival>) -> u64 {
        self.images.clear();
        self.gateways.iter_mut().for_each(LinkedGateway::begin);
        if let Some(since_ns) = self.disconnected_ns {
            self.reconnect(since_ns);
        } else if let Err(error) = self.read_events(arrivals) {
            self.take_error(&error);
        }
        self.now_ns()
    }

    fn send(&mut self, gateway: usize, channel: u8, frame: &CanFrame) -> Result<Option<Ticket>> {
        let Some(gateway) = self.gateways.get(gateway) else { return Ok(None) };
        match self.connection.client().send(gateway.index, channel, frame) {
            Ok(tag) => {
                self.cycles.on_sent();
                self.sent_at_ns = Some(self.now_ns());
                Ok(Some(Ticket::of_service(tag)))
            }
            Err(SendError::WindowFull { .. }) => Ok(None),
            Err(SendError::Client(error)) => {
                self.take_error(&error);
                self.failure.take().map_or(Ok(None), Err)
            }
            Err(error) => {
                let reason = error.to_string();
                Err(Failure::Device(ecan_host::Error::NotPermitted { reason }))
            }
        }
    }

    fn end(&mut self) -> Result {
        self.report_losses();
        self.failure.take().map_or(Ok(()), Err)
    }

    fn condition(&self, gateway: usize) -> GatewayCondition {
        self.gateways.get(gateway).map(|gateway| gateway.condition).unwrap_or_default()
    }

    fn images(&self, direction: Direction, visit: &mut dyn FnMut(usize, u64, &[u8])) {
        for image in self.images.iter().filter(|image| image.direction == direction) {
            if let Some(gateway) =
                self.gateways.iter().position(|gateway| gateway.index == image.gateway)
            {
                let time_ns = image.time_ns.wrapping_sub(self.since_1970_ns);
                visit(gateway, time_ns, &image.image);
            }
        }
    }

    fn upload(&mut self, gateway: usize, index: u16, subindex: u8) -> Result<u32> {
        let position = self.gateways.get(gateway).map_or(0, |gateway| gateway.position);
        let mut data = [0; 4];
        match self.connection.sdo_upload(position, index, subindex, &mut data)? {
            0 => {
                let (call, slave) = ("ecrt_master_sdo_upload", Some(usize::from(position)));
                Err(Failure::Device(ecan_host::Error::Library { call, slave, errno: Errno::EIO }))
            }
            _ => Ok(u32::from_le_bytes(data)),
        }
    }
}

#[cfg(test)]
mod tests {
    use ecan_mcan_port::{ChannelStatistics, SlaveStatistics};
    use serde_json::json;

    use super::*;

    /// Reads a state after the events; returns the settled cycles.
    fn next(cycles: &mut ObservedCycles, number: u64) -> u64 {
        cycles.settle();
        cycles.observe(number);
        cycles.settled
    }

    #[test]
    fn cycles_are_settled_after_the_events_of_a_later_state() {
        let cycles = &mut ObservedCycles::default();
        let numbers = [500, 510, 510, 900, 901, 902];
        assert_eq!(numbers.map(|number| next(cycles, number)), [0, 0, 0, 10, 10, 400]);
        // The service has begun a new cycle.
        assert_eq!([3, 5, 7, 7].map(|number| next(cycles, number)), [401, 402, 402, 404]);
    }

    #[test]
    fn cycles_before_the_result_of_a_frame_are_not_counted() {
        let cycles = &mut ObservedCycles::default();
        assert_eq!([500, 501, 502].map(|number| next(cycles, number)), [0, 0, 0]);
        cycles.on_sent();
        // The service did not read the frame for a long time.
        assert_eq!([503, 900, 901].map(|number| next(cycles, number)), [0, 0, 0]);
        cycles.on_result();
        assert_eq!([902, 903, 904].map(|number| next(cycles, number)), [0, 0, 1]);
        // No node acknowledges: time passes after the longest wait.
        cycles.on_sent();
        assert_eq!([1_500, 1_900, 2_500, 2_600].map(|number| next(cycles, number)), [1, 1, 1, 1]);
        assert!(next(cycles, 2_700) > 500);
    }

    #[test]
    fn bus_off_between_two_states_shows_for_one_cycle() {
        let run = ChannelStatus::default().with_state(ChannelState::Run);
        let state = |bus_off_images: u64| {
            let channels = [0, bus_off_images, 0, 0]
                .map(|bus_off_images| ChannelStatistics { bus_off_images, ..Default::default() });
            let statistics = json!(SlaveStatistics { channels, ..Default::default() });
            GatewayState {
                session: ecan_service::protocol::SessionState::Ready,
                waiting_for: None,
                waiting_code: 0,
                working_counter: 3,
                expected_working_counter: 3,
                channel_status: [Some(run.raw()); CHANNELS],
                statistics: statistics.as_object().unwrap().clone(),
            }
        };
        let mut gateway = LinkedGateway::new((0, 0));
        let mut bus_off = |bus_off_images: Option<u64>| {
            gateway.begin();
            bus_off_images.into_iter().for_each(|images| gateway.update(&state(images)));
            gateway.condition.channels.map(|status| status.unwrap().bus_off())
        };
        assert_eq!(bus_off(Some(7)), [false; CHANNELS], "before the command");
        assert_eq!(bus_off(Some(9)), [false, true, false, false]);
        assert_eq!(bus_off(None), [false; CHANNELS]);
        assert_eq!(bus_off(Some(9)), [false; CHANNELS]);
    }
}
