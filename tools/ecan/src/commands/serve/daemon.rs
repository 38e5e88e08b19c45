//! The gateways of `ecan serve` through attempts to start them, reconfigurations and failures.

use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use ecan_command_line::interrupt::Interrupt;
use ecan_mcan_port::Config;
use ecan_service::Service;
use ecan_sim::Backend;

use crate::context::{Bus, Context, Failure, Result, note};
use crate::frames::Settings;

use super::cycle::{GatewayCycle, requirements};
use super::reconfigure::{NotConfigured, Request};
use super::{POLL, ServeArguments};

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
    pub requests: Receiver<Request>,
    /// Configuration that the gateways had last.
    pub last: Option<Config>,
}

impl Daemon<'_> {
    /// Keeps the gateways ready until the user stops the command, or a failure that will not pass.
    pub fn run(mut self) -> Result {
        let mut attempts = 0;
        let mut request = None;
        while !self.interrupt.is_set() {
            let ended = self.hold(request.take(), &mut attempts);
            self.service.detach();
            match ended {
                Ok(()) => {}
                Err(_) if self.interrupt.is_set() => {}
                Err(error) if is_lasting(&error) => return Err(error),
                Err(error) => {
                    let pause_s = PAUSES_S.get(attempts).or(PAUSES_S.last()).copied().unwrap_or(1);
                    attempts += 1;
                    note(format_args!("serve: {error}; next attempt in {pause_s} s"));
                    request = self.wait(Duration::from_secs(pause_s));
                }
            }
        }
        Ok(())
    }

    /// Starts the gateways and holds them until a failure.
    fn hold(&mut self, request: Option<Request>, attempts: &mut usize) -> Result {
        let mut cycle = match request {
            Some(request) => self.start_requested(request)?,
            None => {
                let global = self.context.global;
                let bus = Bus::of(self.backend, self.settings.master(global), None)?;
                let planned = self.settings.for_all(&bus, requirements(), global)?;
                self.start(planned)?
            }
        };
        loop {
            self.last = Some(cycle.config());
            let ended = cycle.run(self.interrupt, &self.requests);
            if cycle.has_been_ready() {
                *attempts = 0;
            }
            match ended? {
                None => return Ok(()),
                Some(request) => {
                    let result = cycle.reconfigure(request.planned.clone(), self.service);
                    self.finish(request, &cycle, result)?;
                }
            }
        }
    }

    fn start(&self, planned: crate::frames::Planned) -> Result<GatewayCycle> {
        let Self { backend, arguments, service, interrupt, .. } = self;
        GatewayCycle::start(backend, planned, arguments, service, interrupt)
    }

    /// Starts the gateways with the configuration of a client. If that fails, the next attempt uses the
    /// former one.
    fn start_requested(&mut self, request: Request) -> Result<GatewayCycle> {
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
        request: Request,
        cycle: &GatewayCycle,
        result: Result<(), Box<NotConfigured>>,
    ) -> Result {
        let name = request.path.display();
        match result {
            Ok(()) => {
                note(format_args!("configuration {name}: active, by request of a client"));
                self.settings.set_file(request.path.clone(), request.file);
                let active = cycle.config();
                let former = self.last.as_ref().unwrap_or(&active);
                let report = request.planned.report(former, cycle.warnings());
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
    fn wait(&self, duration: Duration) -> Option<Request> {
        let end = Instant::now() + duration;
        while !self.interrupt.is_set() {
            let left = end.saturating_duration_since(Instant::now());
            match self.requests.recv_timeout(left.min(POLL)) {
                Ok(request) => return Some(request),
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
