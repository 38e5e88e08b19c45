//! The cycle of the gateways that `ecan serve` keeps ready.

use ecan_command_line::interrupt::Interrupt;
use ecan_mcan_port::{Port, Session};
use ecan_sim::Backend;

use crate::context::{Bus, Context, Failure, Result, note};
use crate::frames::{Channels, GatewayRequirements, Planned, Settings};

use super::ServeArguments;

#[derive(Debug)]
pub struct GatewayCycle {
    port: Port,
    positions: Vec<usize>,
    /// Gateways that were ready in the last cycle.
    were_ready: Vec<bool>,
    has_been_ready: bool,
}

impl GatewayCycle {
    /// Configures the gateways of the file or of the bus and activates the master.
    pub fn start(
        backend: &Backend,
        settings: &Settings<'_>,
        arguments: &ServeArguments,
        context: &Context,
    ) -> Result<Self> {
        let bus = Bus::of(backend, settings.master(context.global), None)?;
        let requirements = GatewayRequirements {
            has_results: true,
            has_end: false,
            ..GatewayRequirements::on(Channels::ALL)
        };
        let planned = settings.for_all(&bus, requirements, context.global)?;
        let Planned { adapter, config, .. } = planned;
        let failed = |error| planned.failure(error);
        if let Some(warning) = config.sync0_warning(&adapter) {
            note(format_args!("warning: {warning}"));
        }
        let mut port = Port::open(&backend.ecrt, (adapter, config)).map_err(failed)?;
        port.profile_warnings().iter().for_each(|warning| note(format_args!("warning: {warning}")));
        let real_time = &arguments.options.real_time;
        real_time.apply(|line| note(line))?;
        real_time.set_timing(port.adapter_mut());
        let timeout = port.startup_timeout();
        port.adapter_mut().begin_op_wait(timeout).map_err(Failure::master)?;
        let were_ready = vec![false; planned.positions.len()];
        Ok(Self { port, positions: planned.positions, were_ready, has_been_ready: false })
    }

    pub fn port_mut(&mut self) -> &mut Port {
        &mut self.port
    }

    /// Returns whether all gateways were ready at one time.
    pub fn has_been_ready(&self) -> bool {
        self.has_been_ready
    }

    /// Runs the cycle until the user stops the command. The Port makes lost gateways ready again.
    ///
    /// Fails if the master does not work any more, or a channel that must only listen does not.
    pub fn run(&mut self, interrupt: &Interrupt) -> Result {
        while !interrupt.is_set() {
            let mut cycle = self.port.next_cycle();
            // The service has its copy.
            cycle.received().for_each(drop);
            cycle.end().map_err(Failure::master)?;
            if let Some(error) = self.port.stop_channels_not_listening() {
                return Err(Failure::Rejected(error.to_string()));
            }
            self.report_changes();
        }
        Ok(())
    }

    fn report_changes(&mut self) {
        self.has_been_ready |= self.port.is_ready();
        for (gateway, was_ready) in self.port.gateways().zip(&mut self.were_ready) {
            let session = self.port.session(gateway);
            let is_ready = session == Session::Ready;
            if std::mem::replace(was_ready, is_ready) != is_ready {
                let position = self.positions.get(gateway.slave()).copied().unwrap_or_default();
                let state = if is_ready { "ready" } else { "lost" };
                note(format_args!("slave {position}: {state}"));
            }
        }
    }
}
