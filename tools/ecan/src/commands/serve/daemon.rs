//! The gateways of `ecan serve` through attempts to start them, reconfigurations and failures.

use std::sync::PoisonError;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use ecan_mcan_port::Config;
use ecan_protocol::text::Printable;
use ecan_service::server::Service;
use ecan_sim::Backend;
use ecan_tool_support::command_line::interrupt::Interrupt;

use crate::context::{Bus, Context, Failure, Result, note};
use crate::frames::{GatewayRequirements, Planned, Settings};

use super::arguments::ServeArguments;
use super::command::{Command, NotConfigured, Request};
use super::cycle::GatewayCycle;
use super::notification::{Event, Notifier};
use super::reload::ActiveConfig;

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
