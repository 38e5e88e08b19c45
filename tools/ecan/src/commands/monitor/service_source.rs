//! Observations of the bus of another program, through its service.

use std::time::Duration;

use ecan_host::{Clock as _, Diagnostics, MonotonicClock};
use ecan_service::client::{Client, ClientError, Event};
use ecan_service::protocol::{
    AxisState, CycleState, FrameEvent, FrameReport, GatewayState, NOT_AVAILABLE, State,
    Subscription,
};

use super::observation::{
    ChannelRates, ErrorReader, GatewayErrors, GatewayObservation, Layout, LayoutGateway,
    Observation, ObservedFrame, Origin, SampledCycle, Source,
};
use super::snapshot::Direction;
use crate::context::{Bus, Failure, Result};
use crate::frames::{GatewayRequirements, ServiceEvents, SetupOptions, of_service};
use crate::service_access::{ServiceConnection, condition, statistics};

/// Longest wait for an event, and between two attempts to read the gateways.
const POLL: Duration = Duration::from_millis(10);
const RETRY_NS: u64 = 1_000_000_000;
/// Most events of one call.
const MAX_EVENTS: usize = 4096;
/// Time for a response, and without a new cycle.
const RESPONSE: Duration = Duration::from_secs(2);
const STALLED_NS: u64 = 2_000_000_000;

const NO_CYCLE: &str = "NO CYCLE";
const NO_RESPONSE: &str = "NO RESPONSE";
const NO_SERVICE: &str = "NO SERVICE";

pub struct ServiceSource {
    bus: Bus,
    connection: ServiceConnection,
    client: Client,
    requirements: GatewayRequirements,
    setup: SetupOptions,
    /// Index in the service and position of each gateway.
    gateways: Vec<(u16, u16)>,
    /// For the next observation.
    layout: Option<Layout>,
    /// Time of the next attempt to read the gateways, after a change.
    read_at_ns: Option<u64>,
    /// A service that ends is waited for.
    reconnects: bool,
    is_disconnected: bool,
    time: FrameTime,
}

/// Time of the frames: since 1970, or of a stepped simulation.
#[derive(Debug, Default)]
struct FrameTime {
    is_free_running: bool,
    /// Offset from the monotonic clock.
    offset_ns: u64,
    /// The last cycle, and the time at which it was seen first.
    cycle: CycleState,
    seen_at_ns: u64,
}

impl FrameTime {
    fn update(&mut self, cycle: &CycleState) {
        let now_ns = MonotonicClock.now_ns();
        if cycle.cycle != self.cycle.cycle {
            self.seen_at_ns = now_ns;
        }
        // The response with the shortest delay has the best offset.
        let offset_ns = cycle.time_ns.wrapping_sub(now_ns);
        self.offset_ns = match self.cycle.cycle {
            0 => offset_ns,
            _ => self.offset_ns.max(offset_ns),
        };
        self.cycle = *cycle;
    }

    fn now_ns(&self) -> u64 {
        match self.is_free_running {
            true => MonotonicClock.now_ns().wrapping_add(self.offset_ns),
            false => self.cycle.time_ns,
        }
    }

    fn is_stalled(&self) -> bool {
        let limit_ns = STALLED_NS.max(self.cycle.cycle_ns.saturating_mul(3));
        self.cycle.is_closed || MonotonicClock.now_ns().saturating_sub(self.seen_at_ns) > limit_ns
    }
}

impl ServiceSource {
    /// Selects the selected gateway of a service, or all. `reconnects`: a service that ends is waited for.
    pub fn open(
        bus: Bus,
        connection: ServiceConnection,
        (requirements, setup): (GatewayRequirements, &SetupOptions),
        reconnects: bool,
    ) -> Result<Self> {
        let client = connect(&connection)?;
        let is_free_running = connection.hello().is_free_running;
        let mut source = Self {
            bus,
            connection,
            client,
            requirements,
            setup: setup.clone(),
            gateways: Vec::new(),
            layout: None,
            read_at_ns: None,
            reconnects,
            is_disconnected: false,
            time: FrameTime { is_free_running, ..FrameTime::default() },
        };
        source.read_layout(None)?;
        Ok(source)
    }

    /// Reads the gateways and the counters from which the view counts, and subscribes to the frames.
    fn read_layout(&mut self, event: Option<String>) -> Result {
        let (requirements, setup) = (self.requirements, &self.setup);
        let (found, planned) = of_service(&self.connection, &self.bus, requirements, setup, true)?;
        let state = self.client.state().map_err(|error| failure(&self.connection, &error))?;
        self.time = FrameTime { is_free_running: self.time.is_free_running, ..Default::default() };
        self.time.update(&state.cycle);
        let gateways = found.gateways.iter().zip(planned.config.gateways.iter());
        let gateway = |((index, position), config): (&(u16, u16), _)| {
            let base = state.gateways.get(usize::from(*index)).and_then(statistics);
            Some(LayoutGateway {
                position: usize::from(*position),
                base: base?,
                rates: ChannelRates::of(config),
            })
        };
        let gateways: Option<Vec<_>> = gateways.map(gateway).collect();
        let gateways = gateways.ok_or_else(|| {
            let program = self.connection.program();
            Failure::Master(format!("{program}: unknown counters; use ecan of the same version"))
        })?;
        self.layout = Some(Layout {
            cycle_ns: planned.adapter.cycle_ns(),
            base: state.cycle,
            gateways,
            event,
        });
        self.gateways = found.gateways;
        let gateways = self.gateways.iter().map(|gateway| gateway.0).collect();
        let subscription = Subscription { gateways, ..Subscription::default() };
        let subscribed = self.client.subscribe(&subscription);
        subscribed.map_err(|error| failure(&self.connection, &error))
    }

    /// Reads the gateways again, after the service has configured the bus.
    fn read_layout_again(&mut self) -> Result {
        // The events so far are those of the gateways before.
        while self.client.poll(Duration::ZERO).is_ok_and(|event| event.is_some()) {}
        self.bus = self.bus.again()?;
        self.read_layout(Some("the service has configured the bus again".to_owned()))
    }

    /// Connects to the service that is there now, and reads its gateways.
    fn reconnect(&mut self) -> Result {
        let address = self.connection.address().clone();
        let client = address.connect("ecan").map_err(|error| failure(&self.connection, &error))?;
        let connection = ServiceConnection::new(client, address);
        self.bus = self.bus.through(connection.clone())?;
        self.client = connect(&connection)?;
        self.connection = connection;
        self.read_layout(Some("the service is there again".to_owned()))
    }

    /// Takes note of a connection that has ended; returns whether to go on.
    fn waits_after(&mut self, error: &ClientError) -> bool {
        let waits = self.reconnects && error.is_disconnection();
        if waits {
            (self.is_disconnected, self.read_at_ns) = (true, Some(0));
        }
        waits
    }

    fn take_frame(&self, report: &FrameReport, observation: &mut Observation) {
        let gateway = self.gateways.iter().position(|gateway| gateway.0 == report.gateway);
        let direction = match report.event {
            FrameEvent::Received => Direction::Received,
            FrameEvent::Transmitted | FrameEvent::Published => Direction::Sent,
            FrameEvent::Failed(_) | FrameEvent::Unknown => Direction::Failed,
            FrameEvent::Rejected(_) => return,
        };
        let Some(gateway) = gateway else { return };
        observation.frames.push(ObservedFrame {
            time_ns: report.time_ns,
            gateway,
            channel: report.channel,
            direction,
            frame: report.frame,
        });
    }

    fn take_state(&mut self, state: State, observation: &mut Observation) {
        self.time.update(&state.cycle);
        observation.gateways.clear();
        for (index, _) in &self.gateways {
            let gateway = state.gateways.get(usize::from(*index));
            observation.gateways.push(gateway.map(gateway_observation).unwrap_or_default());
        }
        let State { cycle, run_time, late, .. } = state;
        observation.sampled = Some(SampledCycle { cycle, run_time, late });
    }

    /// Reads the state; returns the reason why it is old.
    fn read(&mut self, observation: &mut Observation) -> Result<Option<&'static str>, ClientError> {
        let state = self.client.state()?;
        self.take_state(state, observation);
        let axes = self.client.axes()?.axes.into_iter();
        observation.axes = axes.filter_map(|axis| self.axis(axis)).collect();
        observation.service = Some(self.client.service_stats()?);
        Ok(self.time.is_stalled().then_some(NO_CYCLE))
    }

    /// The axis with the position of its gateway.
    fn axis(&self, axis: AxisState) -> Option<AxisState> {
        let (_, gateway) = *self.gateways.iter().find(|gateway| gateway.0 == axis.gateway)?;
        Some(AxisState { gateway, ..axis })
    }
}

impl Source for ServiceSource {
    fn origin(&self) -> Origin {
        let program = self.connection.program();
        Origin {
            is_simulated: self.connection.hello().is_simulated,
            without_axes: format!("no axes: {program} moves none on these gateways"),
            program: Some(program),
        }
    }

    fn observation(&self) -> Observation {
        Observation::new(self.gateways.len())
    }

    fn error_reader(&self) -> Result<ErrorReader> {
        let access = Box::new(self.connection.clone());
        let diagnostics = Diagnostics::of_access(access).map_err(Failure::master)?;
        let slaves =
            self.gateways.iter().map(|gateway| (gateway.1.into(), gateway.1.into())).collect();
        Ok(ErrorReader { diagnostics, slaves })
    }

    fn enter_thread(&mut self) -> Result {
        Ok(())
    }

    fn start(&mut self) -> Result {
        Ok(())
    }

    fn is_starting(&self) -> bool {
        false
    }

    fn observe(&mut self, observation: &mut Observation) -> Result {
        if self.read_at_ns.is_some() {
            // The frames that follow are those of other gateways.
            std::thread::sleep(POLL);
            return Ok(());
        }
        let mut timeout = POLL;
        for _ in 0..MAX_EVENTS {
            let event = match self.client.poll(timeout) {
                Err(error) if self.waits_after(&error) => break,
                event => event.map_err(|error| failure(&self.connection, &error))?,
            };
            timeout = Duration::ZERO;
            match event {
                None => break,
                Some(Event::Frame(report)) => self.take_frame(&report, observation),
                Some(Event::Lost(lost)) => {
                    observation.frames.lose(lost.frames + lost.frames_in_client);
                }
                Some(Event::Gateways(_)) => {
                    self.read_at_ns = Some(0);
                    break;
                }
                Some(_) => {}
            }
        }
        Ok(())
    }

    fn look(&mut self, observation: &mut Observation) -> Result {
        let now_ns = self.now_ns();
        if self.read_at_ns.is_some_and(|at| now_ns >= at) {
            let read =
                if self.is_disconnected { self.reconnect() } else { self.read_layout_again() };
            let is_read = read.is_ok();
            self.is_disconnected &= !is_read;
            self.read_at_ns = (!is_read).then(|| now_ns.saturating_add(RETRY_NS));
        }
        let read = match self.read_at_ns {
            Some(_) if self.is_disconnected => Ok(Some(NO_SERVICE)),
            // Shows an ended service.
            Some(_) => self.client.service_stats().map(|_| Some(NO_CYCLE)),
            None => {
                observation.layout = self.layout.take();
                self.read(observation)
            }
        };
        observation.interruption = match read {
            Ok(interruption) => interruption,
            Err(ClientError::Timeout { .. }) => Some(NO_RESPONSE),
            Err(error) if error.rpc().is_some_and(|error| error.code == NOT_AVAILABLE) => {
                Some(NO_CYCLE)
            }
            Err(error) if self.waits_after(&error) => Some(NO_SERVICE),
            Err(error) => return Err(failure(&self.connection, &error)),
        };
        observation.now_ns = self.time.now_ns();
        Ok(())
    }

    fn now_ns(&self) -> u64 {
        MonotonicClock.now_ns()
    }

    fn service_events(&self) -> Option<ServiceEvents> {
        ServiceEvents::read(&self.connection)
    }

    fn read_errors(&mut self) -> Result<Vec<(usize, GatewayErrors)>> {
        Ok(self.error_reader()?.read().collect())
    }
}

/// A connection for the states and frames: the SDO transfers of the other one may take long.
fn connect(connection: &ServiceConnection) -> Result<Client> {
    let client = connection.address().connect("ecan monitor");
    let mut client = client.map_err(|error| failure(connection, &error))?;
    client.set_request_timeout(RESPONSE);
    Ok(client)
}

fn failure(connection: &ServiceConnection, error: &ClientError) -> Failure {
    Failure::Device(connection.error("service", error))
}

fn gateway_observation(state: &GatewayState) -> GatewayObservation {
    GatewayObservation {
        condition: condition(state),
        working_counter: state.working_counter,
        expected_working_counter: state.expected_working_counter,
    }
}
