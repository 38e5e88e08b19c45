//! One axis under the motion guard, with a cycle of this program, and the motion of its target in CSP.

use std::time::Duration;

use ecan_canopen::{DriveState, OperatingMode};
use ecan_cia402::{
    AxisCommand, AxisError, AxisPhase, AxisRef, Blocking, Cia402, Cia402Config, Cia402Error,
    Decision, HomingState, InputObject, Takeover, TargetRejection, WaitReason,
};
use ecan_mcan_port::{BusChange, BusWatch, Port};
use ecan_protocol::mapping::Direction;
use ecan_sim::ClockKind;
use serde::Serialize;

use super::axis_choice::ChosenAxis;
use super::envelope::{Envelope, PositionProfile, ProfileLimits, velocity_factor};
use super::motion_watch::MotionWatch;
use super::operator::{Operator, StopRequest};
use super::unit::{AxisUnits, LiveOutput, LivePosition};
use crate::context::{Context, Failure, Result, note};
use crate::frames::{Channels, GatewayOptions, GatewayRequirements, Planned, Settings, wait_ready};

/// The only axis of a session.
const AXIS: usize = 0;
/// Time for the first contact and a stop, with the repetitions to a drive that does not answer.
const STOP: Duration = Duration::from_secs(10);
const SHUTDOWN: Duration = Duration::from_secs(15);

/// Settings of a session.
#[derive(Clone, Copy, Debug)]
pub struct SessionSettings<'a> {
    pub options: &'a GatewayOptions,
    /// Mode of the axis; `None` configures nothing.
    pub mode: Option<OperatingMode>,
    /// Limits of the motion; without them nothing moves by a target.
    pub envelope: Option<Envelope>,
    /// Default clock of a simulation.
    pub clock: ClockKind,
    pub accepts_risk: bool,
}

/// End of a cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CycleEnd {
    pub now_ns: u64,
    pub decision: Decision,
}

/// The axis after a command, at rest.
#[derive(Debug, Serialize)]
pub struct AxisEnd {
    axis: String,
    /// State of the drive.
    state: Option<String>,
    unit: String,
    /// `None` if the drive was not configured, so that it sent no position.
    position: Option<f64>,
}

impl AxisEnd {
    /// Prints it as JSON; without `--json` the messages of the session have stated it.
    pub fn print(&self, context: &Context) -> Result {
        context.output.data(self, |_| Ok(()))
    }
}

fn change_text(position: usize, change: &BusChange) -> String {
    format!("slave {position}: {}", change.event)
}

/// A gateway in operation, and the axis.
#[derive(Debug)]
pub struct AxisSession {
    port: Port,
    /// Position of the gateway on the bus.
    position: usize,
    bus_watch: BusWatch,
    cia402: Cia402,
    pub operator: Option<Operator>,
    label: String,
    units: AxisUnits,
    watch: Option<MotionWatch>,
    accepts_risk: bool,
    output: LiveOutput,
    shown: Option<AxisPhase>,
}

impl AxisSession {
    /// Starts the gateway of the axis; nothing is sent to the drive yet.
    pub fn start(
        chosen: &ChosenAxis,
        settings: SessionSettings<'_>,
        operator: Option<Operator>,
        context: &Context,
    ) -> Result<Self> {
        let context = &chosen.context(context);
        let file = Settings::of(settings.options)?;
        let bus = file.open_bus(context, settings.clock)?;
        if let Some(service) = bus.service() {
            return Err(Failure::Master(format!(
                "only the owner of the master moves an axis, since its motion guard checks each target; {} \
                 holds master {}: end that program, or let it move the axis",
                service.program(),
                bus.master()
            )));
        }
        let channel = chosen.target.channel;
        let requirements = GatewayRequirements {
            directions: &[Direction::RxPdo, Direction::TxPdo],
            has_results: true,
            ..GatewayRequirements::on(Channels::only(channel))
        };
        let planned = file.for_one(&bus, requirements, context.global)?;
        let mut config = chosen.config.clone();
        // Limits of the drive narrow those of the command.
        config.drive.use_limits = true;
        let cycle = Duration::from_nanos(planned.adapter.cycle_ns().into());
        let table = Cia402Config {
            motion_div: settings.envelope.map_or(1, |envelope| envelope.motion_div(cycle)),
            // An adopted drive would stay enabled without the operator's command.
            takeover: Takeover::Stop,
            ..chosen.network.cia402.clone()
        };
        let target_period = cycle * table.target_cycles();
        if let (Some(envelope), Some(mode)) = (settings.envelope, settings.mode) {
            match mode {
                OperatingMode::ProfilePosition => envelope.apply_pp(&mut config),
                OperatingMode::CyclicVelocity => envelope.apply_csv(&mut config, target_period),
                _ => envelope.apply_csp(&mut config, target_period),
            }
            if mode == OperatingMode::CyclicVelocity {
                config.pdos.inputs = vec![InputObject::Velocity];
            }
        }
        let output = LiveOutput::start(chosen.units, !context.output.has_progress())?;
        settings.options.real_time.apply(|line| note(line))?;
        let is_stopped =
            || operator.as_ref().is_some_and(|operator| operator.stop_request().is_some());
        let Planned { adapter, config: port_config, .. } = planned.clone();
        let mut port = Port::open(bus.ecrt()?, (adapter, port_config))
            .map_err(|error| planned.failure(error))?;
        port.profile_warnings().iter().for_each(|warning| note(format_args!("warning: {warning}")));
        let is_ready = wait_ready(&mut port, is_stopped, |_| ());
        if !is_ready.map_err(|error| planned.failure(error))? {
            return Err(Failure::Incomplete("stopped before the gateway was ready".to_owned()));
        }
        settings.options.real_time.set_timing(port.adapter_mut());
        let mut cia402 = Cia402::new(&port, vec![config], table)
            .map_err(|error| Failure::Usage(error.to_string()))?;
        let time = chosen.network.time(port.adapter().clock().now_ns());
        let set = cia402.network_mut().set_time(time);
        set.map_err(|error| Failure::Usage(error.to_string()))?;
        Ok(Self {
            position: planned.positions.first().copied().unwrap_or_default(),
            bus_watch: BusWatch::new(&port),
            port,
            cia402,
            operator,
            label: chosen.label.clone(),
            units: chosen.units,
            watch: settings.envelope.map(MotionWatch::new),
            accepts_risk: settings.accepts_risk,
            output,
            shown: None,
        })
    }

    /// The axis, which always exists.
    pub fn axis(&self) -> Option<AxisRef<'_>> {
        self.cia402.axis(AXIS)
    }

    /// Gives a command to the axis.
    pub fn command(&mut self, command: AxisCommand) -> Result {
        let commanded = self.cia402.axis_mut(AXIS).and_then(|mut axis| axis.command(command));
        commanded.map_err(|error| Failure::Rejected(error.to_string()))
    }

    pub fn accepts_risk(&self) -> bool {
        self.accepts_risk
    }

    pub fn label(&self) -> &str {
        &self.label
    }

    pub fn units(&self) -> AxisUnits {
        self.units
    }

    pub fn is_simulated(&self) -> bool {
        self.port.adapter().ecrt().is_simulated()
    }

    /// Time of the cycle clock.
    pub fn now_ns(&self) -> u64 {
        self.port.adapter().clock().now_ns()
    }

    /// Time from target to target, in seconds.
    pub fn target_period_s(&self) -> f64 {
        self.cia402.target_period().as_secs_f64()
    }

    /// The actual position in steps.
    pub fn actual(&self) -> Result<f64> {
        let unknown = || Failure::Rejected(format!("{}: no actual position", self.label));
        self.axis().and_then(AxisRef::actual).map(f64::from).ok_or_else(unknown)
    }

    /// Prints an event on standard error.
    pub fn report(&self, text: impl std::fmt::Display) {
        self.output.text(format!("{}: {text}", self.label));
    }

    /// Fails if the operator pressed a key, or released the one that has to be held.
    pub fn check_key(&self) -> Result {
        let request = self.operator.as_ref().and_then(Operator::motion_request);
        request.map_or(Ok(()), |request| Err(stop_failure(request)))
    }

    /// Returns whether the operator ended the command by a signal, and is not lost.
    pub fn is_commanded_end(&self) -> bool {
        let request = self.operator.as_ref().and_then(Operator::stop_request);
        request.is_some_and(|request| !request.is_lost())
    }

    /// The limits of a motion within those of the drive, which are read by the configuration.
    pub fn narrow(&self, envelope: &Envelope) -> Envelope {
        self.axis().map_or(*envelope, |axis| {
            let period = self.cia402.target_period();
            envelope.within(axis.guard().limits(), period, velocity_factor(axis.config()))
        })
    }

    /// Replaces the envelope of the watch, for travel relative to a position.
    pub fn watch_envelope(&mut self, envelope: Envelope) {
        self.watch = Some(MotionWatch::new(envelope));
    }

    /// Runs a cycle with the target of `target`, without any checks.
    fn run_cycle(&mut self, target: Option<i32>) -> Result<CycleEnd> {
        let mut cycle = self.port.next_cycle();
        let now_ns = cycle.adapter().clock().now_ns();
        self.cia402.process_rx(&mut cycle);
        if let Some(target) = target {
            // infallible: the axis exists
            let _ = self.cia402.axis_mut(AXIS).and_then(|mut axis| axis.set_target(target));
        }
        self.cia402.send_targets_all(&mut cycle);
        cycle.end().map_err(Failure::master)?;
        for change in self.bus_watch.changes(&self.port) {
            self.output.text(change_text(self.position, &change));
        }
        let decision = self.axis().map_or(Decision::Closed, AxisRef::decision);
        Ok(CycleEnd { now_ns, decision })
    }

    /// Runs a cycle. Fails if the operator stops, the axis cannot follow, its target is rejected, or its motion
    /// exceeds the limits.
    pub fn cycle(&mut self, target: Option<i32>) -> Result<CycleEnd> {
        let end = self.run_cycle(target)?;
        self.show(end.now_ns);
        if let Some(request) = self.operator.as_ref().and_then(Operator::stop_request) {
            return Err(stop_failure(request));
        }
        if let Decision::Reject(rejection) = end.decision {
            return Err(self.rejection(rejection));
        }
        self.check_motion(end.now_ns)?;
        Ok(end)
    }

    fn rejection(&self, rejection: TargetRejection) -> Failure {
        Failure::Rejected(format!(
            "{}: the motion guard rejected a target: {rejection}",
            self.label
        ))
    }

    fn check_motion(&mut self, now_ns: u64) -> Result {
        let Some(axis) = self.axis().filter(|axis| axis.actual_age() == 0) else { return Ok(()) };
        let (phase, actual) = (axis.phase(), axis.actual());
        let (Some(watch), Some(actual)) = (&mut self.watch, actual) else { return Ok(()) };
        let may_move = matches!(
            phase,
            AxisPhase::Running
                | AxisPhase::Halted
                | AxisPhase::Homing(_)
                | AxisPhase::PreparingHoming
        );
        if !may_move {
            return Ok(());
        }
        let may_recount = matches!(
            phase,
            AxisPhase::PreparingHoming
                | AxisPhase::Homing(HomingState::Found | HomingState::Attained)
        );
        let observed = watch.observe(now_ns as f64 / 1e9, actual, may_recount);
        let units = self.units;
        observed.map_err(|exceeded| {
            Failure::Rejected(format!("{}: {}", self.label, exceeded.text(&units)))
        })
    }

    /// Shows a changed phase, and on a terminal the positions.
    fn show(&mut self, now_ns: u64) {
        let phase = self.axis().map(AxisRef::phase);
        if phase != self.shown {
            // Reasons of a delay change in every cycle.
            let kind = |phase: Option<AxisPhase>| phase.map(|phase| std::mem::discriminant(&phase));
            let is_news = kind(phase) != kind(self.shown)
                && !matches!(phase, Some(AxisPhase::Reading(..) | AxisPhase::Inspecting));
            self.shown = phase;
            match phase.filter(|_| is_news) {
                // Its first state is that before the start.
                Some(AxisPhase::Homing(_)) => self.report("homing"),
                Some(phase) => self.report(phase),
                None => {}
            }
        }
        let Some(axis) = self.axis() else { return };
        let has_positions =
            matches!(axis.mode(), OperatingMode::CyclicPosition | OperatingMode::ProfilePosition);
        let position = LivePosition {
            actual: axis.actual(),
            target: axis.target().filter(|_| has_positions),
            following_error: axis.following_error().filter(|_| has_positions),
        };
        if position.actual.is_some() {
            self.output.position(now_ns, position);
        }
    }

    /// Runs cycles until `is_done` returns a result, at most for a time.
    pub fn wait(
        &mut self,
        what: &str,
        time: Duration,
        mut is_done: impl FnMut(AxisRef<'_>) -> Option<Result>,
    ) -> Result {
        let end_ns = self.now_ns().saturating_add(time.as_nanos() as u64);
        loop {
            let end = self.cycle(None)?;
            if let Some(result) = self.axis().and_then(&mut is_done) {
                return result;
            }
            if end.now_ns > end_ns {
                let phase = self.phase_text();
                return Err(Failure::Rejected(format!(
                    "{}: not {what} after {} s: {phase}",
                    self.label,
                    time.as_secs()
                )));
            }
        }
    }

    /// Phase and error of the axis as text.
    pub fn phase_text(&self) -> String {
        let Some(axis) = self.axis() else { return String::new() };
        let phase = axis.phase().to_string();
        match axis.error() {
            Some(error) if !matches!(error, AxisError::Held(_)) => format!("{phase} ({error})"),
            _ => phase,
        }
    }

    fn failure(&self, what: &str) -> Failure {
        // The command switches the drive off.
        let next = match self.axis().map(AxisRef::phase) {
            Some(AxisPhase::Holding(reason)) => match reason.remedy() {
                Some(remedy) => format!("; next: {remedy}, then run the command again"),
                None => "; next: run the command again".to_owned(),
            },
            _ => String::new(),
        };
        Failure::Rejected(format!("{}: {what}: {}{next}", self.label, self.phase_text()))
    }

    /// Returns whether the axis follows targets; fails if it left that state.
    pub fn check_running(&self) -> Result {
        match self.axis().map(AxisRef::phase) {
            Some(AxisPhase::Running | AxisPhase::Halted) => Ok(()),
            _ => Err(self.failure("the motion ended")),
        }
    }

    /// Uploads a number of the axis from the drive, by its index for the first axis; `None` without it.
    pub fn number(&mut self, index: u16, subindex: u8) -> Option<u64> {
        let axis = self.axis()?;
        let (node, index) = (axis.node(), axis.config().object_index(index));
        let read = self.blocking(Duration::from_millis(500)).upload(node, (index, subindex));
        read.ok().map(|data| crate::commands::node::node_client::decode_unsigned(&data))
    }

    /// Calls that run the cycle; they report what changes on the bus.
    fn blocking(&mut self, timeout: Duration) -> Blocking<'_> {
        let Self { port, cia402, bus_watch, output, position, .. } = self;
        let report = |change: &BusChange| output.text(change_text(*position, change));
        cia402.blocking(port, timeout).on_bus_change(bus_watch, report)
    }

    /// Stops the drive by quick stop, and waits until it is off.
    pub fn stop(&mut self) -> Result {
        let stopped = self.blocking(STOP).stop();
        // The drop does not wait once more.
        self.cia402.set_stop_time(Duration::ZERO);
        stopped.map_err(|error| self.still_moving(&error))?;
        self.report(format_args!("{}{}", self.state_text(), self.position_suffix()));
        Ok(())
    }

    fn still_moving(&self, error: &Cia402Error) -> Failure {
        Failure::Rejected(format!("{}: {error}; remove its power if it moves", self.label))
    }

    /// Stops a drive that is not configured.
    pub fn stop_only(mut self) -> Result<AxisEnd> {
        self.stop()?;
        match self.axis().and_then(AxisRef::drive_state) {
            Some(_) => Ok(self.end()),
            None => Err(Failure::Rejected(format!(
                "{}: no answer; check the node-ID, and remove the power of a motor that moves",
                self.label
            ))),
        }
    }

    fn is_energised(&self) -> bool {
        matches!(
            self.axis().and_then(AxisRef::drive_state),
            Some(
                DriveState::OperationEnabled
                    | DriveState::QuickStopActive
                    | DriveState::FaultReactionActive
            )
        )
    }

    fn state_text(&self) -> String {
        match self.axis().and_then(AxisRef::drive_state) {
            Some(state) => format!("stopped, {state}"),
            None => "no drive has answered".to_owned(),
        }
    }

    fn position_suffix(&self) -> String {
        let actual = self.axis().and_then(AxisRef::actual);
        actual.map_or_else(String::new, |actual| {
            format!(", at {}", self.units.position_text(f64::from(actual)))
        })
    }

    /// Does the work of a command, then brings the axis to rest and switches it off: after an error or the loss
    /// of the operator by quick stop, otherwise by its ramp.
    pub fn run<T>(mut self, work: impl FnOnce(&mut Self) -> Result<T>) -> Result<T> {
        self.run_and_stop(work)
    }

    /// As [`run`](Self::run), for a command whose result is the axis at its end.
    pub fn run_to_end(mut self, work: impl FnOnce(&mut Self) -> Result) -> Result<AxisEnd> {
        self.run_and_stop(work)?;
        Ok(self.end())
    }

    fn end(&self) -> AxisEnd {
        let actual = self.axis().and_then(AxisRef::actual);
        AxisEnd {
            axis: self.label.clone(),
            state: self.axis().and_then(AxisRef::drive_state).map(|state| state.to_string()),
            unit: self.units.unit.to_string(),
            position: actual.map(|steps| self.units.position(steps.into())),
        }
    }

    fn run_and_stop<T>(&mut self, work: impl FnOnce(&mut Self) -> Result<T>) -> Result<T> {
        let result = work(self);
        let stopped = match &result {
            Ok(_) => Ok(()),
            Err(failure) => {
                if self.is_energised() {
                    self.report(format_args!("quick stop: {failure}"));
                }
                self.stop()
            }
        };
        // After a stop that was not confirmed, a shutdown would wait for the same drive once more.
        let shutdown = match &stopped {
            Ok(()) => self.blocking(SHUTDOWN).shut_down(),
            Err(_) => Ok(()),
        };
        let shutdown = shutdown.map_err(|error| self.still_moving(&error));
        self.cia402.set_stop_time(Duration::ZERO);
        if result.is_ok() && shutdown.is_ok() {
            self.report(format_args!("off{}", self.position_suffix()));
        }
        match (result, stopped.and(shutdown)) {
            (_, Err(failure)) | (Err(failure), _) => Err(failure),
            (Ok(value), Ok(())) => Ok(value),
        }
    }
}

/// A session that ends by an error outside [`AxisSession::run`] stops its axis, too.
impl Drop for AxisSession {
    fn drop(&mut self) {
        if std::thread::panicking() {
            return;
        }
        if let Err(error) = self.cia402.stop_before_end(&mut self.port) {
            self.report(self.still_moving(&error));
        }
    }
}

/// End of a motion by the operator.
pub fn stop_failure(request: StopRequest) -> Failure {
    Failure::Incomplete(format!("stopped: {}", request.text()))
}

/// Target periods without a target after which the motion starts again from rest.
const PAUSE: u32 = 4;

/// A profile whose targets are sent: it advances only with the targets that the guard accepts.
#[derive(Clone, Copy, Debug)]
pub struct Motion {
    profile: PositionProfile,
    /// Periods without a target in a row.
    missed: u32,
}

impl Motion {
    /// A motion at rest at the target of the axis, which is running.
    pub fn begin(session: &AxisSession) -> Result<Self> {
        let target = session.axis().and_then(AxisRef::target).map(f64::from);
        let position = target.map_or_else(|| session.actual(), Ok)?;
        Ok(Self { profile: PositionProfile::at_rest(position), missed: 0 })
    }

    pub fn profile(&self) -> &PositionProfile {
        &self.profile
    }

    /// Runs a cycle with the next target toward a goal.
    pub fn toward(
        &mut self,
        session: &mut AxisSession,
        goal: f64,
        limits: ProfileLimits,
    ) -> Result<CycleEnd> {
        let next = self.profile.toward(goal, limits, session.target_period_s());
        self.cycle(session, next)
    }

    /// Runs a cycle with a target.
    pub fn cycle(&mut self, session: &mut AxisSession, next: PositionProfile) -> Result<CycleEnd> {
        let end = session.cycle(Some(next.position().round() as i32))?;
        match end.decision {
            Decision::Target(_) => {
                self.profile = next;
                self.missed = 0;
            }
            Decision::Wait(WaitReason::NotDue) => {}
            _ => {
                self.missed += 1;
                if self.missed > PAUSE {
                    // Without targets the drive is at rest.
                    self.profile = self.profile.at_standstill();
                }
            }
        }
        Ok(end)
    }
}
