//! Runs one trial: the application, what happens to it, and the operator who brings it back.

use std::fmt::Write as _;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};

use ecan_canopen::{NmtState, NodeAddress, OperatingMode, object};
use ecan_cia402::{AxisCommand, AxisPhase, AxisRef, Cia402, StopKind as Stop};
use ecan_mcan_port::{Port, Session};
use ecan_protocol::device::AlState;
use ecan_protocol::image::ChannelState;
use ecan_sim::{Backend, ClockKind, Drive, SimOptions, Simulation};

use crate::log::{Level, Log};
use crate::monitor::{AxisMonitor, Path, RELEASED, StopKind, View};
use crate::plan::{Action, End, MS, Plan, Style};
use crate::random::Random;
use crate::report::{Finding, Kind, Outcome};
use crate::sdk::Class;
use crate::variants;

mod application;
mod disturbance;
mod machine;

/// Longest recovery.
const RECOVERY_NS: u64 = 60_000 * MS;
/// All axes must run for this time to count as recovered.
const STEADY_NS: u64 = 150 * MS;
pub struct Trial {
    plan: Plan,
    random: Random,
    backend: Backend,
    simulation: Simulation,
    port: Option<Port>,
    cia402: Option<Cia402>,
    monitors: Vec<AxisMonitor>,
    /// The SDK reports the drive as configured.
    configured: Vec<bool>,
    /// Path faults: the path counts as disturbed until then, ns.
    slave_blocked: Vec<u64>,
    /// After the host lost time, the path counts as disturbed until then, ns; nothing waits on it.
    resumed_until: u64,
    /// Time to lose inside the next cycle, ns.
    stall_ns: u64,
    /// Images that each gateway has missed around a pulse of Sync0.
    outputs_missed: Vec<u64>,
    channel_blocked: Vec<(usize, u8, u64)>,
    /// Channels that are bus-off, and gateways whose images are damaged, until then, ns.
    bus_offs: Vec<(usize, u8, u64)>,
    images_damaged: Vec<(usize, u64)>,
    silent: Vec<u64>,
    /// End of a blocked motor.
    motor_blocked: Vec<u64>,
    /// Time of the next attempt of a gateway's startup.
    retry_at: u64,
    /// Startups without the reference clock until the operator configured the bus last.
    clock_failures: usize,
    /// Frames that the queue of the channel of each axis rejected.
    queue_rejected: Vec<u64>,
    /// Start of the own trajectory of an axis, ns, and its centre.
    own: Vec<Option<(u64, i32)>>,
    classes: Vec<Class>,
    paths: Vec<Path>,
    /// Lines of the kernel log in the log.
    kernel_lines: usize,
    gateway_texts: Vec<String>,
    now: u64,
    outcome: Outcome,
    log: Log,
}

#[derive(Clone, Copy, Default)]
struct Skips {
    rx: bool,
    send: bool,
    /// The calls are made twice instead.
    twice: bool,
}

impl Trial {
    pub fn run(plan: Plan, level: Level) -> (Outcome, String) {
        let header = plan.to_string();
        let variants = plan.variants.clone();
        let mut trial = match Self::start(plan, level) {
            Ok(trial) => trial,
            Err(text) if variants::explains(&variants, &text) => {
                return (Outcome::default(), header);
            }
            Err(text) => {
                let finding = Finding { kind: Kind::NoStart, axis: 0, at_ns: 0, text };
                return (Outcome { findings: vec![finding], ..Outcome::default() }, header);
            }
        };
        trial.note(&header);
        let begin = trial.now;
        trial.all_phases();
        trial.check_feed_forward();
        for monitor in &mut trial.monitors {
            trial.outcome.findings.append(&mut monitor.findings);
            trial.outcome.stops.append(&mut monitor.samples);
            trial.outcome.fastest = trial.outcome.fastest.max(monitor.fastest);
        }
        trial.outcome.simulated_ns = trial.now - begin;
        trial.outcome.cycles = trial.outcome.simulated_ns / trial.plan.cycle_ns;
        for finding in trial.outcome.findings.clone() {
            trial.note(&format!(
                "VIOLATION {:?}, axis {}, at {} ms: {}",
                finding.kind,
                finding.axis,
                finding.at_ns / MS,
                finding.text
            ));
        }
        (trial.outcome, trial.log.text)
    }

    fn start(plan: Plan, level: Level) -> Result<Self, String> {
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let backend = ecan_sim::open_scenario(machine::scenario(&plan), &options)
            .map_err(|error| error.to_string())?;
        let simulation = backend.simulation.clone().ok_or("no simulation")?;
        let axes = plan.axes.len();
        let mut trial = Self {
            random: Random::new(plan.seed ^ 0x5EED),
            port: None,
            cia402: None,
            monitors: (0..axes).map(|axis| AxisMonitor::new(axis, &plan)).collect(),
            configured: vec![false; axes],
            slave_blocked: vec![0; plan.gateways],
            resumed_until: 0,
            stall_ns: 0,
            outputs_missed: vec![0; plan.gateways],
            channel_blocked: Vec::new(),
            bus_offs: Vec::new(),
            images_damaged: Vec::new(),
            silent: vec![0; axes],
            motor_blocked: vec![0; axes],
            retry_at: 0,
            clock_failures: 0,
            queue_rejected: vec![0; axes],
            own: vec![None; axes],
            classes: vec![Class::NotConfigured; axes],
            paths: vec![Path::Blocked; axes],
            kernel_lines: 0,
            gateway_texts: vec![String::new(); plan.gateways],
            now: 0,
            outcome: Outcome::default(),
            log: Log::new(level),
            plan,
            backend,
            simulation,
        };
        trial.open()?;
        trial.now = trial.world_ns();
        Ok(trial)
    }

    fn open(&mut self) -> Result<(), String> {
        let mut port = Port::open(&self.backend.ecrt, machine::config(&self.plan))
            .map_err(|e| e.to_string())?;
        port.wait_ready().map_err(|e| e.to_string())?;
        self.port = Some(port);
        self.make_table()
    }

    fn make_table(&mut self) -> Result<(), String> {
        let Some(port) = &self.port else { return Ok(()) };
        let axes = self.plan.axes.iter().map(|axis| axis.config.clone()).collect();
        let table = Cia402::new(port, axes, self.plan.table.clone()).map_err(|e| e.to_string())?;
        let mut table = table;
        if let Some((target, sync)) = self.plan.clock {
            table.set_scheduled_tx(port, target, sync).map_err(|error| error.to_string())?;
        }
        self.cia402 = Some(table);
        self.configured.fill(false);
        self.own.fill(None);
        Ok(())
    }

    fn world_ns(&self) -> u64 {
        self.simulation.with_world(|world| world.now_ns())
    }

    fn note(&mut self, text: &str) {
        self.log.line(self.now, text);
    }

    fn find(&mut self, kind: Kind, axis: usize, text: String) {
        self.outcome.findings.push(Finding { kind, axis, at_ns: self.now, text });
    }

    // Phases

    fn all_phases(&mut self) {
        // The operator starts the machine; sometimes it is disturbed while it starts.
        let starts_undisturbed = self.random.chance(75) || self.plan.app.starts_undisturbed;
        if starts_undisturbed && !self.operate_until_running(20 * MS, false) {
            return;
        }
        self.disturb();
        if self.operate_until_running(40 * MS, true) {
            self.check_alive();
        }
        self.end();
    }

    fn disturb(&mut self) {
        let begin = self.now;
        let events = std::mem::take(&mut self.plan.events);
        let mut due = events.iter().peekable();
        let mut skip = Skips::default();
        let mut skip_cycles = 0;
        let mut twice = false;
        let mut operated = self.now;
        while self.now - begin < self.plan.duration_ns || due.peek().is_some() {
            let mut now_due = Vec::new();
            while let Some(event) = due.next_if(|event| begin + event.at_ns <= self.now) {
                now_due.push(event.action.clone());
            }
            let mut commands = Vec::new();
            for action in now_due {
                match action {
                    Action::Command(..) | Action::CommandAll(_) => commands.push(action),
                    Action::Skip { cycles, rx, send } => {
                        self.note(&format!("{action:?}"));
                        skip = Skips { rx, send, twice: false };
                        skip_cycles = cycles;
                    }
                    Action::Twice => {
                        self.note("Twice");
                        twice = true;
                    }
                    action => self.act(action),
                }
            }
            let (rx, send) = (self.plan.app.skips_rx, self.plan.app.skips_send);
            let mut skips = if skip_cycles > 0 { skip } else { Skips::default() };
            skips.twice = std::mem::take(&mut twice);
            skip_cycles = skip_cycles.saturating_sub(1);
            skips.rx |= rx > 0 && self.random.range(0, 999) < i64::from(rx);
            skips.send |= send > 0 && self.random.range(0, 999) < i64::from(send);
            if let Some(period) = self.plan.app.operator_ns
                && self.now - operated > period
            {
                operated = self.now;
                self.operate();
            }
            self.cycle(skips, &commands);
            if self.port.is_none() {
                return;
            }
        }
    }

    /// A patient operator, until all axes run; false if one does not within the bound.
    fn operate_until_running(&mut self, period: u64, is_recovery: bool) -> bool {
        let (begin, mut operated, mut steady_since) = (self.now, 0, None);
        while self.now - begin < RECOVERY_NS {
            if self.now - operated >= period {
                operated = self.now;
                self.operate();
            }
            let before = self.now;
            self.cycle(Skips::default(), &[]);
            let ns = self.now - before;
            let last = (0..self.classes.len()).find(|n| self.classes[*n] != Class::Running);
            match last {
                None => {
                    if self.now - *steady_since.get_or_insert(self.now) >= STEADY_NS {
                        if is_recovery {
                            self.outcome.recovery_ns = Some(self.now - begin - STEADY_NS);
                        }
                        return true;
                    }
                }
                Some(n) => {
                    steady_since = None;
                    if is_recovery {
                        let share = self.share(n);
                        *self.outcome.shares.entry(share).or_default() += ns;
                    }
                }
            }
        }
        let text = self.status();
        self.find(Kind::NoRecovery, 0, text);
        false
    }

    fn share(&self, axis: usize) -> &'static str {
        let slave = self.plan.axes[axis].config.address.slave;
        let ready = self.port.as_ref().is_some_and(|port| {
            port.gateway(slave).is_ok_and(|gateway| port.gateway_is_ready(gateway))
        });
        if !ready { "gateway returning" } else { self.classes[axis].share() }
    }

    fn status(&self) -> String {
        let mut text = String::new();
        if let Some(port) = &self.port {
            for gateway in port.gateways() {
                let _ = write!(text, "gateway {}", port.session(gateway));
                if let Some(step) = port.waiting_for(gateway) {
                    let _ = write!(text, " (waits for {step})");
                }
                text.push_str("; ");
            }
        }
        if let Some(cia402) = &self.cia402 {
            for (n, axis) in cia402.axes().map(AxisRef::progress).enumerate() {
                let state = self.monitors[n].state;
                let _ = write!(text, "{axis} [drive {state}]; ");
            }
        }
        text
    }

    /// Every drive follows, and CSP axes move on command.
    fn check_alive(&mut self) {
        for n in 0..self.monitors.len() {
            if !self.monitors[n].follows {
                let text = format!("the drive is in {}", self.monitors[n].state);
                self.find(Kind::NotFollowing, n, text);
            }
        }
        let positions: Vec<f64> = self.monitors.iter().map(|monitor| monitor.position).collect();
        let begin = self.now;
        for axis in &mut self.plan.axes {
            axis.style = Style::Climb;
        }
        self.plan.app.steps = false;
        self.own.fill(None);
        // Twelve target periods or more; two of them are the delay to the drive.
        let time = (150 * MS).max(12 * self.plan.target_ns());
        while self.now - begin < time {
            self.cycle(Skips::default(), &[]);
        }
        for (n, before) in positions.into_iter().enumerate() {
            let axis = &self.plan.axes[n];
            let is_free = matches!(
                self.monitors[n].mode,
                Some(OperatingMode::CyclicPosition | OperatingMode::InterpolatedPosition)
            ) && axis.config.bounds.is_none()
                && self.classes[n] == Class::Running;
            let moved = (self.monitors[n].position - before).abs();
            if is_free && moved < 3.0 * f64::from(axis.config.step_limit) {
                let text = format!(
                    "moved {moved:.0}, limit {}: {:?}",
                    axis.config.step_limit,
                    self.axis(n).map(|axis| (axis.decision(), axis.target(), axis.actual())),
                );
                self.find(Kind::NotFollowing, n, text);
            }
        }
    }

    fn check_feed_forward(&mut self) {
        for n in 0..self.monitors.len() {
            let number = usize::from(self.plan.axes[n].config.node_axis);
            let sums = self.on_drive(n, |drive| {
                *drive.axis(number).expect("an axis of the drive").targets().sums()
            });
            let limits = self.plan.axes[n].config.feed_forward;
            self.monitors[n].check_feed_forward(self.now, &sums, &limits);
            self.outcome.feed_forwards += u64::from(sums.largest_offsets != (0, 0));
        }
    }

    fn end(&mut self) {
        let classes = self.classes.clone();
        let Some(cia402) = &mut self.cia402 else { return };
        let kind = match self.plan.app.end {
            End::QuickStop => {
                cia402.command_all(AxisCommand::Stop(Stop::QuickStop)).unwrap();
                StopKind::QuickStop
            }
            End::Disable => {
                cia402.command_all(AxisCommand::Stop(Stop::Disable)).unwrap();
                StopKind::Disable
            }
            End::StopAll => {
                cia402.command_all(AxisCommand::Stop(Stop::QuickStopThenDisable)).unwrap();
                StopKind::StopAll
            }
            End::Shutdown => {
                cia402.begin_shutdown();
                StopKind::Shutdown
            }
        };
        self.note(&format!("end: {kind:?}"));
        if kind != StopKind::Shutdown {
            for (monitor, class) in self.monitors.iter_mut().zip(classes) {
                monitor.stopping(self.now, kind, class);
            }
        }
        let begin = self.now;
        while self.now - begin < 700 * MS {
            self.cycle(Skips::default(), &[]);
        }
    }

    // One cycle

    fn cycle(&mut self, skips: Skips, commands: &[Action]) {
        if self.port.is_none() {
            self.now = self.now.saturating_add(RECOVERY_NS);
            return;
        }
        let before = self.now;
        let commands_first = self.plan.app.commands_first;
        if let (Some(port), Some(cia402)) = (&mut self.port, &mut self.cia402) {
            let mut cycle = port.next_cycle();
            if skips.rx {
                application::note_lost_responses(
                    &mut cycle,
                    &self.plan,
                    &self.classes,
                    &mut self.monitors,
                );
            } else if !commands_first {
                (0..=u8::from(skips.twice)).for_each(|_| cia402.process_rx(&mut cycle));
            }
            // The calls of the application take place here; see `check_commands`.
            cycle.keep_open();
        }
        self.now = self.world_ns();
        self.observe();
        for action in commands {
            match *action {
                Action::Command(axis, command) => self.command(axis, command),
                Action::CommandAll(command) => {
                    (0..self.monitors.len()).for_each(|axis| self.command(axis, command));
                }
                _ => {}
            }
        }
        self.set_targets();
        let lost_ns = std::mem::take(&mut self.stall_ns);
        if lost_ns > 0 {
            self.lose_time(lost_ns);
        }
        if let (Some(port), Some(cia402)) = (&mut self.port, &mut self.cia402)
            && let Some(mut cycle) = port.open_cycle()
        {
            if !skips.rx && commands_first {
                cia402.process_rx(&mut cycle);
            }
            if !skips.send {
                for _ in 0..=u8::from(skips.twice) {
                    if self.plan.app.steps {
                        cia402.send_target_step(&mut cycle);
                    } else {
                        cia402.send_targets_all(&mut cycle);
                    }
                }
            }
            // An error of the cycle is what a bus with faults has.
            let _ = cycle.end();
        }
        self.now = self.world_ns();
        // In the time that it lost the host could notice nothing.
        self.check((self.now - before).saturating_sub(lost_ns), skips);
    }

    fn on_drive<T>(&self, axis: usize, look: impl FnOnce(&Drive) -> T) -> T {
        let NodeAddress { slave, channel, node } = self.plan.axes[axis].config.address;
        self.simulation.with_world(|world| {
            look(world.drive_at(slave, usize::from(channel), node).expect("a drive at every axis"))
        })
    }

    /// Takes the traces of the drives.
    fn observe(&mut self) {
        let Self { plan, simulation, monitors, log, .. } = self;
        simulation.with_world(|world| {
            for (n, monitor) in monitors.iter_mut().enumerate() {
                let NodeAddress { slave, channel, node } = plan.axes[n].config.address;
                let Some(drive) = world.drive_at(slave, usize::from(channel), node) else {
                    continue;
                };
                let number = usize::from(plan.axes[n].config.node_axis);
                let Some(axis) = drive.axis(number) else { continue };
                let trace = axis.trace();
                let records = trace.since(monitor.read_so_far());
                monitor.observe(records, trace.recorded(), &mut log.drive(n));
            }
        });
    }

    fn check(&mut self, ns: u64, skips: Skips) {
        self.observe();
        self.note_gateways();
        self.note_missed_outputs();
        for n in 0..self.monitors.len() {
            let class = match &self.cia402 {
                Some(cia402) => Class::of(cia402, n),
                None => Class::NotConfigured,
            };
            if class != self.classes[n] {
                self.classes[n] = class;
                if self.log.is_on()
                    && let Some(progress) = self.axis(n).map(AxisRef::progress)
                {
                    self.note(&progress.to_string());
                }
            }
            self.configured[n] = self.axis(n).is_some_and(AxisRef::is_configured);
            self.monitors[n].is_unknown |= self.now < self.silent[n] && !self.configured[n];
            let path = self.path(n, skips);
            self.note_lost_sync(n, path);
            if self.paths[n] != path {
                self.paths[n] = path;
                self.note(&format!("path to axis {n}: {path:?}"));
            }
            let sdk = self.axis(n);
            let view = View {
                class,
                is_recovering: sdk.is_some_and(AxisRef::is_recovering),
                is_stopped: sdk.is_some_and(AxisRef::is_stopped),
                is_cut: (!skips.rx && !skips.send).then(|| self.is_cut(n)),
            };
            self.monitors[n].check(self.now, ns, path, view);
            if self.plan.app.starts_undisturbed {
                self.note_state(n);
            }
        }
    }

    /// The state of SDK and drive, in the words of the SDK.
    fn note_state(&mut self, n: usize) {
        let Some(axis) = self.axis(n) else { return };
        let mut hasher = DefaultHasher::new();
        format!("{:?} {:?}", axis.phase(), axis.decision()).hash(&mut hasher);
        (self.monitors[n].state.to_string(), format!("{:?}", self.paths[n])).hash(&mut hasher);
        self.outcome.states.insert(hasher.finish());
    }

    /// Targets that are in flight take effect together if the SYNC between them was rejected, or scheduled frames
    /// have no SYNC since the application skipped a cycle.
    fn note_lost_sync(&mut self, n: usize, path: Path) {
        let NodeAddress { slave, channel, .. } = self.plan.axes[n].config.address;
        let statistics = self.port.as_ref().and_then(|port| {
            Some(port.statistics(port.gateway(slave).ok()?).channels[usize::from(channel)])
        });
        let rejected = statistics.map_or(0, |channel| channel.rejected_queue_full);
        let is_rejected = std::mem::replace(&mut self.queue_rejected[n], rejected) != rejected;
        if is_rejected || path == Path::Paused && self.plan.schedules_frames() {
            self.monitors[n].releasing(self.now, RELEASED);
        }
    }

    /// No TPDO of the drive can arrive.
    fn is_cut(&self, n: usize) -> bool {
        let slave = self.plan.axes[n].config.address.slave;
        let is_silent = self.now < self.silent[n].saturating_sub(20 * MS);
        let is_off = self.simulation.with_world(|world| {
            world.gateway(slave).is_none_or(|gateway| !gateway.is_responding())
        });
        is_silent || is_off
    }

    fn note_gateways(&mut self) {
        if !self.log.is_on() {
            return;
        }
        let lines = self.simulation.kernel_log();
        for line in lines.get(self.kernel_lines..).unwrap_or_default() {
            self.note(&format!("kernel: {line}"));
        }
        self.kernel_lines = lines.len();
        for slave in 0..self.plan.gateways {
            let al_state = self.simulation.with_world(|world| {
                let gateway = world.gateway(slave)?;
                gateway.is_responding().then(|| gateway.al_state())
            });
            let port = self.port.as_ref();
            let session = port.and_then(|port| Some(port.session(port.gateway(slave).ok()?)));
            let unconfirmed = port
                .and_then(|port| Some(port.cycle_report(port.gateway(slave).ok()?).is_unconfirmed));
            let text =
                format!("gateway {slave}: {al_state:?}, {session:?}, unconfirmed {unconfirmed:?}");
            if self.gateway_texts[slave] != text {
                self.note(&text);
                self.gateway_texts[slave] = text;
            }
        }
    }

    /// A missed image is read after the next write, which is rejected.
    fn note_missed_outputs(&mut self) {
        let until = self.now + 2 * self.plan.cycle_ns;
        for (slave, known) in self.outputs_missed.iter_mut().enumerate() {
            let counters = self.simulation.with_world(|world| world.counters(slave));
            let missed = counters.map_or(0, |counters| counters.outputs_missed);
            if std::mem::replace(known, missed) != missed {
                self.slave_blocked[slave] = self.slave_blocked[slave].max(until);
            }
        }
    }

    fn path(&self, n: usize, skips: Skips) -> Path {
        let NodeAddress { slave, channel, .. } = self.plan.axes[n].config.address;
        let Some(port) = &self.port else { return Path::Blocked };
        let (Ok(gateway), Ok(to)) = (port.gateway(slave), port.channel(slave, channel)) else {
            return Path::Blocked;
        };
        let channel_blocked = self
            .channel_blocked
            .iter()
            .any(|(s, c, until)| (*s, *c) == (slave, channel) && self.now < *until);
        let state = port.channel_status(to).state();
        // The Port detects a lost OP only when the master has polled the slave.
        let is_in_op = self.simulation.with_world(|world| {
            world
                .gateway(slave)
                .is_some_and(|gateway| gateway.is_responding() && gateway.al_state() == AlState::Op)
        });
        if !is_in_op
            || self.now < self.slave_blocked[slave]
            || channel_blocked
            || port.session(gateway) != Session::Ready
            || state != ChannelState::Run
        {
            return Path::Blocked;
        }
        let (powered, nmt, valid) = self.on_drive(n, |drive| {
            let number = self.plan.axes[n].config.pdos.number - 1;
            let id = drive.object(object::RPDO_COMMUNICATION + number, 1).unwrap_or(0);
            (drive.is_powered(), drive.nmt_state(), id & 0x8000_0000 == 0)
        });
        if !powered || matches!(nmt, NmtState::Initialising | NmtState::Stopped) {
            return Path::Blocked;
        }
        let is_process_data = nmt == NmtState::Operational
            && valid
            && self.configured[n]
            && !self.is_in_first_contact(slave, channel);
        // A stronger command than the quick stop needs a drive that reports that it ignores it.
        let ignores = self.plan.axes[n].drive.quirks.ignores_quick_stop;
        if (!is_process_data || ignores) && self.now < self.silent[n] {
            return Path::Blocked;
        }
        if self.now < self.resumed_until {
            return Path::Resumed;
        }
        if skips.rx || skips.send || port.cycle_report(gateway).is_unconfirmed {
            return Path::Paused;
        }
        if is_process_data { Path::ProcessData } else { Path::Services }
    }

    fn axis(&self, index: usize) -> Option<AxisRef<'_>> {
        self.cia402.as_ref()?.axis(index)
    }

    /// A channel gets no SYNC before all its drives that were enabled are stopped or adopted.
    fn is_in_first_contact(&self, slave: usize, channel: u8) -> bool {
        let Some(cia402) = &self.cia402 else { return true };
        let axes = self.plan.axes.iter().map(|axis| axis.config.address).enumerate();
        axes.filter(|(_, address)| (address.slave, address.channel) == (slave, channel)).any(
            |(axis, _)| {
                let phase = cia402.axis(axis).unwrap().phase();
                let is_stopping =
                    matches!(phase, AxisPhase::Stopping(_) | AxisPhase::Uncontrolled(_));
                phase == AxisPhase::Inspecting || is_stopping && !self.configured[axis]
            },
        )
    }
}
