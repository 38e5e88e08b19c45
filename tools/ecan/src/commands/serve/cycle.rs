//! The cycle of the gateways that `ecan serve` keeps ready.

use std::sync::mpsc::Receiver;

use ecan_host::OpWait;
use ecan_mcan_port::{Config, Port, PortConfig, PortError, Session};
use ecan_service::server::Service;
use ecan_sim::Backend;
use ecan_tool_support::command_line::interrupt::Interrupt;

use crate::context::{Failure, Result, note};
use crate::frames::Planned;

use super::arguments::ServeArguments;
use super::command::{Command, NotConfigured};
use super::notification::{Event, Notifier};

#[derive(Debug)]
pub struct GatewayCycle {
    port: Port,
    planned: Planned,
    notifier: Notifier,
    /// Gateways that were ready in the last cycle.
    were_ready: Vec<bool>,
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
        let (were_ready, notifier) = (Vec::new(), notifier.clone());
        let mut cycle = Self { port, planned, notifier, were_ready, has_been_ready: false };
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
        self.wait_ready()
    }

    pub fn wait_ready(&mut self) -> Result<(), PortError> {
        self.port.wait_ready()
    }

    fn report_start(&mut self) {
        let positions = self.planned.positions.clone();
        self.were_ready = vec![false; positions.len()];
        self.notifier.send(Event::Start(positions, self.port.startup_timeout()));
    }

    fn report_changes(&mut self) {
        self.has_been_ready |= self.port.is_ready();
        for (gateway, was_ready) in self.port.gateways().zip(&mut self.were_ready) {
            let session = self.port.session(gateway);
            let is_ready = session == Session::Ready;
            if std::mem::replace(was_ready, is_ready) != is_ready {
                self.notifier.send(Event::Gateway { index: gateway.slave(), is_ready });
            }
        }
    }
}
