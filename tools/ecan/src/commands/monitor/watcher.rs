//! The cycle: keeps the gateways ready and records their state.

use ecan_command_line::interrupt::Interrupt;
use ecan_host::Diagnostics;
use ecan_mcan_port::{Port, PortError};
use ecan_protocol::mapping::CHANNELS;

use crate::context::{Bus, Failure, GlobalOptions, Result, note};
use crate::frames::{GatewayRequirements, Planned, Settings, failure};

use super::MonitorArguments;
use super::collector::{Collector, GatewayErrors};
use super::observation::{BusTime, Mark, Observation};
use super::snapshot::Errors;

#[derive(Debug)]
pub struct Watcher {
    port: Port,
    positions: Vec<usize>,
    busy: BusTime,
}

impl Watcher {
    /// Configures the selected gateway, or all. No cycle runs yet.
    pub fn open(
        bus: &Bus,
        settings: &Settings<'_>,
        arguments: &MonitorArguments,
        global: &GlobalOptions,
    ) -> Result<Self> {
        let requirements = GatewayRequirements {
            is_listening: arguments.listen_only,
            ..GatewayRequirements::on(arguments.channel)
        };
        let planned = settings.for_all(bus, requirements, global)?;
        let Planned { adapter, config, .. } = planned;
        let failed = |error| planned.failure(error);
        config.check(&adapter).map_err(|faults| failed(faults.into()))?;
        if let Some(warning) = config.sync0_warning(&adapter) {
            note(format_args!("warning: {warning}"));
        }
        let busy = BusTime::new(&config);
        let port = Port::open(bus.ecrt()?, (adapter, config)).map_err(failed)?;
        port.profile_warnings().iter().for_each(|warning| note(format_args!("warning: {warning}")));
        Ok(Self { port, positions: planned.positions, busy })
    }

    /// Activates the master; from now on [`cycle`](Self::cycle) must be called.
    pub fn activate(&mut self, options: &crate::frames::GatewayOptions) -> Result {
        options.real_time.set_timing(self.port.adapter_mut());
        let timeout = self.port.startup_timeout();
        let begun = self.port.adapter_mut().begin_op_wait(timeout);
        begun.map(|_| ()).map_err(Failure::master)
    }

    /// Waits for a cycle and runs it. Does not allocate without errors.
    pub fn cycle(&mut self, observation: &mut Observation) -> Result {
        let mut cycle = self.port.next_cycle();
        for received in cycle.received() {
            self.busy.count(&received.to_owned());
        }
        let ended = cycle.end();
        observation.look_for_bus_off(&self.port);
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

    pub fn look(&self, observation: &mut Observation) {
        observation.look(&self.port, &self.busy, self.now_ns());
    }

    /// Positions of the gateways, in the order of all observations.
    pub fn positions(&self) -> &[usize] {
        &self.positions
    }

    pub fn now_ns(&self) -> u64 {
        self.port.adapter().clock().now_ns()
    }

    /// Collector with rates over the last `window_ns`.
    pub fn collector(&self, window_ns: u64) -> Collector {
        let adapter = self.port.adapter();
        let (cycle_ns, is_simulated) = (adapter.config().cycle_ns(), adapter.is_simulated());
        Collector::new(&self.positions, cycle_ns, window_ns, is_simulated)
    }

    /// Handle for the mailbox, for another thread.
    pub fn open_diagnostics(&self) -> Result<Diagnostics> {
        let opened = self.port.adapter().open_diagnostics();
        opened.map_err(Failure::master)
    }

    /// Reads the error counters of all gateways while the cycle runs.
    pub fn read_errors(&mut self) -> Vec<GatewayErrors> {
        let count = self.positions.len();
        let read = self
            .port
            .diagnose(|diagnostics| (0..count).map(|at| read_errors(diagnostics, at)).collect());
        read.unwrap_or_default()
    }

    /// Runs the cycle until all gateways are ready, or the time limit is reached.
    pub fn wait_ready(
        &mut self,
        interrupt: &Interrupt,
        mut take: impl FnMut(&Self, &mut Observation),
        observation: &mut Observation,
    ) -> Result {
        let deadline_ns =
            self.now_ns().saturating_add(self.port.startup_timeout().as_nanos() as u64);
        while !self.port.is_ready() && self.now_ns() < deadline_ns && !interrupt.is_set() {
            self.cycle(observation)?;
            take(self, observation);
        }
        Ok(())
    }
}

/// Objects of a channel (manual 13.5).
const INFORMATION: u16 = 0x9000;
const ERROR_COUNTERS: u8 = 1;
const DROPPED: u8 = 13;
const BUS_OFFS: u8 = 15;

/// Reads the error counters of a gateway's channels; `None` without a response. Blocks.
pub fn read_errors(diagnostics: &Diagnostics, at: usize) -> GatewayErrors {
    let mut errors = [Errors::default(); CHANNELS];
    for (channel, index) in errors.iter_mut().zip(INFORMATION..) {
        let read = |subindex| diagnostics.sdo_upload_u32(at, index, subindex).ok();
        let counters = ecan_diagnosis::registers::ErrorCounters::from_raw(read(ERROR_COUNTERS)?);
        *channel = Errors {
            transmit: counters.transmit,
            receive: if counters.is_receive_passive { 128 } else { counters.receive },
            dropped: read(DROPPED)?.into(),
            bus_offs: read(BUS_OFFS)?.into(),
        };
    }
    Some(errors)
}
