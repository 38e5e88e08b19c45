//! Observations of a cycle of this program, which keeps the gateways ready.

use ecan_host::OpWait;
use ecan_mcan_port::{GatewayCondition, Port, PortError, Received};

use super::observation::{
    ChannelRates, ErrorReader, GatewayErrors, GatewayObservation, Layout, LayoutGateway, Mark,
    Observation, ObservedFrame, Origin, Source, read_errors,
};
use super::snapshot::Direction;
use crate::context::{Bus, Failure, GlobalOptions, Result, note};
use crate::frames::{GatewayOptions, GatewayRequirements, Planned, Settings, failure};

#[derive(Debug)]
pub struct PortSource<'a> {
    port: Port,
    positions: Vec<usize>,
    /// For the first observation.
    layout: Option<Layout>,
    options: &'a GatewayOptions,
    /// End of the time limit for the startup.
    startup_end_ns: u64,
}

impl<'a> PortSource<'a> {
    /// Configures the selected gateway, or all. No cycle runs yet.
    pub fn open(
        bus: &Bus,
        settings: &Settings<'_>,
        requirements: GatewayRequirements,
        options: &'a GatewayOptions,
        global: &GlobalOptions,
    ) -> Result<Self> {
        let planned = settings.for_all(bus, requirements, global)?;
        let Planned { adapter, config, .. } = planned;
        let failed = |error| planned.failure(error);
        config.check(&adapter).map_err(|faults| failed(faults.into()))?;
        if let Some(warning) = config.sync0_warning(&adapter) {
            note(format_args!("warning: {warning}"));
        }
        let gateway = |(position, config): (&usize, _)| LayoutGateway {
            position: *position,
            rates: ChannelRates::of(config),
            ..LayoutGateway::default()
        };
        let gateways = planned.positions.iter().zip(config.gateways.iter()).map(gateway).collect();
        let layout = Layout { cycle_ns: adapter.cycle_ns(), gateways, ..Layout::default() };
        let port = Port::open(bus.ecrt()?, (adapter, config)).map_err(failed)?;
        port.profile_warnings().iter().for_each(|warning| note(format_args!("warning: {warning}")));
        Ok(Self {
            port,
            positions: planned.positions,
            layout: Some(layout),
            options,
            startup_end_ns: 0,
        })
    }
}

impl Source for PortSource<'_> {
    fn origin(&self) -> Origin {
        Origin {
            is_simulated: self.port.adapter().ecrt().is_simulated(),
            program: None,
            without_axes: "no axes: this command runs the cycle itself and configures no drives; \
                           use --via with the service of the application that moves the axes"
                .to_owned(),
        }
    }

    fn observation(&self) -> Observation {
        Observation::new(self.positions.len())
    }

    fn error_reader(&self) -> Result<ErrorReader> {
        let diagnostics = self.port.adapter().open_diagnostics().map_err(Failure::master)?;
        let slaves = self.positions.iter().copied().enumerate().collect();
        Ok(ErrorReader { diagnostics, slaves })
    }

    fn enter_thread(&mut self) -> Result {
        Ok(self.options.real_time.apply(|line| note(line))?)
    }

    fn start(&mut self) -> Result {
        self.options.real_time.set_timing(self.port.adapter_mut());
        let timeout = self.port.startup_timeout();
        let begun = OpWait::begin(self.port.adapter_mut(), timeout);
        self.startup_end_ns = self.now_ns().saturating_add(timeout.as_nanos() as u64);
        begun.map(|_| ()).map_err(Failure::master)
    }

    fn is_starting(&self) -> bool {
        !self.port.is_ready() && self.now_ns() < self.startup_end_ns
    }

    /// Waits for a cycle and runs it. Does not allocate without errors.
    fn observe(&mut self, observation: &mut Observation) -> Result {
        let mut cycle = self.port.next_cycle();
        let time_ns = cycle.adapter().clock().now_ns();
        for received in cycle.received() {
            let Received::Frame(received) = received.to_owned() else { continue };
            observation.frames.push(ObservedFrame {
                time_ns,
                gateway: received.slave,
                channel: received.channel,
                direction: Direction::Received,
                frame: received.frame,
            });
        }
        let ended = cycle.end();
        let adapter = self.port.adapter();
        observation.mark(Mark { start: adapter.cycle_start(), end_ns: adapter.clock().now_ns() });
        ended.map(drop).map_err(Failure::master)?;
        if let Some(error) = self.port.stop_channels_not_listening() {
            let position = match &error {
                PortError::NotReady { slave, .. } => self.positions.get(*slave).copied(),
                _ => None,
            };
            return Err(failure(position.unwrap_or_default(), error));
        }
        Ok(())
    }

    /// Does not allocate.
    fn look(&mut self, observation: &mut Observation) -> Result {
        observation.now_ns = self.now_ns();
        observation.layout = observation.layout.take().or(self.layout.take());
        let port = &self.port;
        for (handle, gateway) in port.gateways().zip(&mut observation.gateways) {
            let domain = port.adapter().domain_report(handle.slave());
            *gateway = GatewayObservation {
                condition: GatewayCondition::of(port, handle),
                working_counter: domain.working_counter,
                expected_working_counter: domain.expected_working_counter,
            };
        }
        Ok(())
    }

    fn now_ns(&self) -> u64 {
        self.port.adapter().clock().now_ns()
    }

    /// The cycle continues.
    fn read_errors(&mut self) -> Result<Vec<(usize, GatewayErrors)>> {
        let positions = self.positions.clone();
        let read = self.port.diagnose(|diagnostics| {
            let read = |(at, position)| (position, read_errors(diagnostics, at));
            positions.into_iter().enumerate().map(read).collect()
        });
        read.map_err(Failure::of_diagnosis)
    }
}
