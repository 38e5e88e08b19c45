//! The gateways of `ecan serve` with their cycle, through attempts to start them, reconfigurations and failures.

use std::sync::PoisonError;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use ecan_host::OpWait;
use ecan_mcan_port::{BusWatch, Config, Port, PortConfig, PortError};
use ecan_protocol::text::Printable;
use ecan_service::server::Service;
use ecan_sim::Backend;
use ecan_tool_support::command_line::interrupt::Interrupt;

use super::arguments::ServeArguments;
use super::methods::{Command, NotConfigured, Request};
use super::notification::{ActiveConfig, Event, Notifier};
use crate::context::{Bus, Context, Failure, Result, note};
use crate::frames::{GatewayRequirements, Planned, Settings};

/// Interval of looking for signals without a cycle.
pub const POLL: Duration = Duration::from_millis(50);
/// Pauses before further attempts to start the gateways.
const PAUSES_S: [u64; 4] = [1, 2, 5, 10];

pub struct Daemon<'a> {
    pub backend: &'a Backend,
    /// Of the command, or of the last reconfiguration.
    pub settings: Settings<'a>,
    pub arguments: &'a ServeArguments,
    pub context: &'a Context<'a>,
    pub service: &'a Service,
    pub interrupt: &'a Interrupt,
    pub commands: Receiver<Command>,
    pub notifier: &'a Notifier,
    pub active: ActiveConfig,
}

impl Daemon<'_> {
    /// Keeps the gateways ready until the user stops the command, or a failure that will not pass.
    pub fn run(mut self) -> Result {
        let mut attempts = 0;
        let mut request = None;
        while !self.interrupt.is_set() {
            self.notifier.no_cycle();
            let ended = self.hold(request.take(), &mut attempts);
            self.service.detach();
            self.notifier.no_cycle();
            match ended {
                Ok(()) => {}
                Err(_) if self.interrupt.is_set() => {}
                Err(error) if is_lasting(&error) => return Err(error),
                Err(error) => {
                    let pause_s = PAUSES_S.get(attempts).or(PAUSES_S.last()).copied().unwrap_or(1);
                    attempts += 1;
                    let state = format!("{error}; next attempt in {pause_s} s");
                    note(format_args!("serve: {state}"));
                    self.notifier.send(Event::State(state));
                    request = self.wait(Duration::from_secs(pause_s));
                }
            }
        }
        Ok(())
    }

    /// Starts the gateways and holds them until a failure.
    fn hold(&mut self, request: Option<Box<Request>>, attempts: &mut usize) -> Result {
        let mut cycle = match request {
            Some(request) => self.start_requested(request)?,
            None => {
                let global = self.context.global;
                let (master, is_stopped) =
                    (self.settings.master(global), || self.interrupt.is_set());
                let bus = Bus::of_until(self.backend, master, None, &is_stopped)?;
                let planned =
                    self.settings.for_all(&bus, GatewayRequirements::of_service(), global)?;
                self.start(planned)?
            }
        };
        self.set_active(&cycle);
        loop {
            let ended = cycle.run(self.interrupt, &self.commands);
            if cycle.has_been_ready() {
                *attempts = 0;
            }
            match ended? {
                None => return Ok(()),
                Some(Command::Limits(config)) => {
                    cycle.set_limits(&config);
                    self.settings.set_limits(&config);
                }
                Some(Command::Reconfigure(request)) => {
                    self.notifier.no_cycle();
                    let result = cycle.reconfigure(request.planned.clone(), self.service);
                    self.finish(request, &cycle, result)?;
                }
            }
        }
    }

    /// Not between cycles: the reloader may hold the lock.
    fn set_active(&self, cycle: &GatewayCycle) -> Option<Config> {
        let mut active = self.active.lock().unwrap_or_else(PoisonError::into_inner);
        active.replace(cycle.config())
    }

    fn start(&self, planned: Planned) -> Result<GatewayCycle> {
        let Self { backend, arguments, service, interrupt, notifier, .. } = self;
        GatewayCycle::start(backend, planned, arguments, service, interrupt, notifier)
    }

    /// Starts the gateways with the configuration of a client. If that fails, the next attempt uses the
    /// former one.
    fn start_requested(&mut self, request: Box<Request>) -> Result<GatewayCycle> {
        let started = self.start(request.planned.clone()).and_then(|mut cycle| {
            let ready = cycle.wait_ready();
            ready.map_err(|error| cycle.planned().failure(error)).map(|()| cycle)
        });
        match started {
            Ok(cycle) => {
                self.finish(request, &cycle, Ok(()))?;
                Ok(cycle)
            }
            Err(cause) => {
                let reason = "the gateways were not ready before either".to_owned();
                let restored = Err(Failure::Rejected(reason));
                request.reply(Err(&NotConfigured { cause, restored }));
                Err(Failure::Rejected("the requested configuration failed".to_owned()))
            }
        }
    }

    /// Responds to a request, and keeps its configuration if it is active.
    fn finish(
        &mut self,
        request: Box<Request>,
        cycle: &GatewayCycle,
        result: Result<(), Box<NotConfigured>>,
    ) -> Result {
        let name = Printable(request.path.display());
        match result {
            Ok(()) => {
                note(format_args!("configuration {name}: active, by request of a client"));
                self.settings.set_file(request.path.clone(), request.file);
                let former = self.set_active(cycle).unwrap_or_else(|| cycle.config());
                let report = request.planned.report(&former, cycle.warnings());
                request.reply(Ok(report));
                Ok(())
            }
            Err(error) => {
                note(format_args!("configuration {name}: failed: {}", error.cause));
                request.reply(Err(&error));
                error.restored
            }
        }
    }

    /// Waits for a time, the end of the command or a request.
    fn wait(&mut self, duration: Duration) -> Option<Box<Request>> {
        let end = Instant::now() + duration;
        while !self.interrupt.is_set() {
            let left = end.saturating_duration_since(Instant::now());
            self.notifier.no_cycle();
            match self.commands.recv_timeout(left.min(POLL)) {
                Ok(Command::Reconfigure(request)) => return Some(request),
                Ok(Command::Limits(config)) => self.settings.set_limits(&config),
                Err(RecvTimeoutError::Disconnected) => std::thread::sleep(left.min(POLL)),
                Err(RecvTimeoutError::Timeout) => {}
            }
            if left.is_zero() {
                break;
            }
        }
        None
    }
}

/// Returns whether another attempt would end with the same error.
fn is_lasting(error: &Failure) -> bool {
    !matches!(
        error,
        Failure::Master(_)
            | Failure::Slave(_)
            | Failure::Device(_)
            | Failure::Rejected(_)
            | Failure::NotReady { .. }
    )
}

#[derive(Debug)]
pub struct GatewayCycle {
    port: Port,
    planned: Planned,
    notifier: Notifier,
    watch: BusWatch,
    has_been_ready: bool,
}

impl GatewayCycle {
    /// Configures the gateways, activates the master and serves the cycle.
    pub fn start(
        backend: &Backend,
        planned: Planned,
        arguments: &ServeArguments,
        service: &Service,
        interrupt: &Interrupt,
        notifier: &Notifier,
    ) -> Result<Self> {
        let (adapter, config) = (planned.adapter, planned.config);
        if let Some(warning) = config.sync0_warning(&adapter) {
            note(format_args!("warning: {warning}"));
        }
        let is_stopped = interrupt.clone();
        let stop: Box<dyn Fn() -> bool + Send> = Box::new(move || is_stopped.is_set());
        let port = Port::open_with_stop(&backend.ecrt, (adapter, config), Some(stop));
        let mut port = port.map_err(|error| planned.failure(error))?;
        port.profile_warnings().iter().for_each(|warning| note(format_args!("warning: {warning}")));
        let real_time = &arguments.options.real_time;
        real_time.apply(|line| note(line))?;
        real_time.set_timing(port.adapter_mut());
        let timeout = port.startup_timeout();
        OpWait::begin(port.adapter_mut(), timeout).map_err(Failure::master)?;
        service.attach(&mut port);
        let (watch, notifier) = (BusWatch::new(&port), notifier.clone());
        let cycle = Self { port, planned, notifier, watch, has_been_ready: false };
        cycle.report_start();
        Ok(cycle)
    }

    /// Returns whether all gateways were ready at one time.
    pub fn has_been_ready(&self) -> bool {
        self.has_been_ready
    }

    pub fn config(&self) -> Config {
        (self.planned.adapter, self.planned.config).into()
    }

    pub fn planned(&self) -> &Planned {
        &self.planned
    }

    pub fn warnings(&self) -> Vec<String> {
        let sync0 = self.planned.config.sync0_warning(&self.planned.adapter);
        sync0.iter().map(ToString::to_string).chain(self.port.profile_warnings()).collect()
    }

    pub fn set_limits(&mut self, config: &PortConfig) {
        self.port.set_limits(config);
        self.planned.config = *self.port.config();
    }

    /// Runs the cycle until the user stops the command, `None`, or a command arrives. The Port makes
    /// lost gateways ready again.
    ///
    /// Fails if the master does not work any more, or a channel that must only listen does not.
    pub fn run(
        &mut self,
        interrupt: &Interrupt,
        commands: &Receiver<Command>,
    ) -> Result<Option<Command>> {
        while !interrupt.is_set() {
            let mut cycle = self.port.next_cycle();
            // The service has its copy.
            cycle.received().for_each(drop);
            cycle.end().map_err(Failure::master)?;
            if let Some(error) = self.port.stop_channels_not_listening() {
                return Err(Failure::Rejected(error.to_string()));
            }
            self.report_changes();
            self.notifier.cycle();
            if let Ok(command) = commands.try_recv() {
                return Ok(Some(command));
            }
        }
        Ok(None)
    }

    /// Configures the gateways again and waits until they are ready. If that fails, it returns to the
    /// former configuration.
    pub fn reconfigure(
        &mut self,
        planned: Planned,
        service: &Service,
    ) -> Result<(), Box<NotConfigured>> {
        let former = std::mem::replace(&mut self.planned, planned);
        let Err(error) = self.configure(service) else { return Ok(()) };
        let cause = self.planned.failure(error);
        self.planned = former;
        let restored = self.configure(service).map_err(|error| self.planned.failure(error));
        Err(Box::new(NotConfigured { cause, restored }))
    }

    fn configure(&mut self, service: &Service) -> Result<(), PortError> {
        self.report_start();
        self.port.reconfigure((self.planned.adapter, self.planned.config))?;
        service.attach(&mut self.port);
        self.watch = BusWatch::new(&self.port);
        self.wait_ready()
    }

    pub fn wait_ready(&mut self) -> Result<(), PortError> {
        self.port.wait_ready()
    }

    fn report_start(&self) {
        let positions = self.planned.positions.clone();
        self.notifier.send(Event::Start(positions, self.port.startup_timeout()));
    }

    fn report_changes(&mut self) {
        self.has_been_ready |= self.port.is_ready();
        for change in self.watch.changes(&self.port) {
            self.notifier.send(Event::Change(change));
        }
    }
}
