//! Runs a plan.

use ecan_sim::{
    AttachedNode, Backend, ClockKind, Fault, GatewayCounters, IoSpec, SimOptions, Simulation,
};
use fastrand::Rng;

use crate::account::Account;
use crate::application::Application;
use crate::c_application::CApplication;
use crate::channel::Partner;
use crate::draw::chance;
use crate::drives::Axes;
use crate::event::Action;
use crate::finding::{Finding, Outcome, Rule};
use crate::firmware_update::Firmware;
use crate::machine::Machine;
use crate::master_owner::Connection;
use crate::plan::Plan;
use crate::service_clients::ServiceClients;
use crate::side::Side;
use crate::talker::Talker;

mod checks;
mod clients;
mod cycle;
mod firmware;

const MS: u64 = 1_000_000;
/// Longest time until all gateways are ready after the last fault.
const RECOVERY_NS: u64 = 300_000 * MS;
/// The same, in addition for each gateway of a master like IgH: at a cycle of 10 ms it reads the SDO dictionary of a
/// gateway that has restarted for 140 s, and executes no requests of others.
const DICTIONARY_NS: u64 = 150_000 * MS;
/// Longest fault.
const LONGEST_FAULT_NS: u64 = 800 * MS;
/// Time for which all gateways must be ready.
const STEADY_NS: u64 = 200 * MS;
/// Time between two looks of the operator at the axes.
const OPERATE_NS: u64 = 100 * MS;
/// Longest time until drives are stopped that can be reached.
const STOP_NS: u64 = 2_000 * MS;
/// Time between two attempts of a gateway's startup.
const RETRY_NS: u64 = 2_000 * MS;
/// Time in which what waits for a bus or an image has passed.
const QUIET_NS: u64 = 400 * MS;

/// Longest time until the delivery of a frame is known: while a master reads the SDO dictionary of a slave
/// it executes no requests.
const PENDING_NS: u64 = 200_000 * MS;

type Check = Result<(), (Rule, String)>;

pub struct Trial {
    plan: Plan,
    random: Rng,
    backend: Backend,
    simulation: Simulation,
    io: Option<IoSpec>,
    application: Option<Application>,
    _talkers: Vec<AttachedNode>,
    accounts: Vec<Side>,
    axes: Axes,
    gateways: Vec<Images>,
    firmware: Firmware,
    clients: ServiceClients,
    cycle: u64,
    leave_until: u64,
    retry_at: u64,
    operate_at: u64,
    /// Nothing has happened that loses frames.
    is_undisturbed: bool,
    outcome: Outcome,
}

/// Images of a gateway that may have lost frames on their way, of all Ports.
#[derive(Default)]
struct Images {
    ended: u64,
    now: u64,
    /// Frames in images before the gateways were ready for the first time, and shortly before the end.
    before: u64,
    at_end: u64,
}

impl Trial {
    /// Runs a plan to its end or to the first violation.
    pub fn run(plan: &Plan) -> Outcome {
        let mut trial = match Self::start(plan) {
            Ok(trial) => trial,
            Err(text) if plan.machine.explains(&text) => return Outcome::default(),
            Err(text) => {
                let finding = Finding { rule: Rule::Start, cycle: 0, text };
                return Outcome { finding: Some(finding), ..Outcome::default() };
            }
        };
        let begin = trial.now_ns();
        let check = trial.all_phases();
        let (cycles, faults) =
            trial.simulation.with_world(|world| (world.cycles(), world.faults().count()));
        let sum = |of: fn(&Account) -> u64| {
            trial.accounts.iter().map(|account| of(&account.account)).sum()
        };
        let finding = check.err().map(|(rule, text)| Finding { rule, cycle: trial.cycle, text });
        Outcome {
            finding,
            cycles,
            simulated_ns: trial.now_ns() - begin,
            accepted: sum(Account::accepted_so_far),
            on_bus: sum(Account::on_bus),
            received: sum(Account::taken_by_application),
            faults: faults as u64,
            gateways: plan.machine.gateway.len() as u64,
            ..trial.outcome
        }
    }

    fn start(plan: &Plan) -> Result<Self, String> {
        let scenario = plan.machine.scenario(plan.seed).map_err(|error| error.to_string())?;
        let io = scenario.ios.first().cloned();
        let options = SimOptions { clock: Some(ClockKind::Stepped), ..SimOptions::default() };
        let backend =
            ecan_sim::open_scenario(scenario, &options).map_err(|error| error.to_string())?;
        let simulation = backend.simulation.clone().ok_or("no simulation")?;
        simulation.with_world(ecan_sim::World::record_all_buses);
        let mut accounts = Vec::new();
        let mut talkers = Vec::new();
        for (slave, gateway) in plan.machine.gateway.iter().enumerate() {
            for channel in &gateway.channel {
                let bus = Machine::bus(slave, channel);
                let number = (slave * 4) as u8 + channel.number;
                let kinds = channel.kinds();
                if let Partner::Talker { period_us, burst } = channel.partner {
                    let period_ns = u64::from(period_us) * 1_000;
                    let talker = Talker::new(number, kinds, period_ns, burst);
                    let node = simulation.attach_node(&bus, "talker", Box::new(talker));
                    talkers.push(node.map_err(|error| error.to_string())?);
                }
                accounts.push(Side {
                    slave,
                    channel: channel.number,
                    bus,
                    frames: channel.frames,
                    sends: channel.sends,
                    rejects: channel.rejects,
                    has_partner: channel.partner != Partner::Nobody
                        || plan.machine.sharing(slave, channel).next().is_some(),
                    discarded_images: 0,
                    account: Account::new(number, kinds),
                    handle: None,
                });
            }
        }
        let mut trial = Self {
            random: Rng::with_seed(plan.seed),
            gateways: plan.machine.gateway.iter().map(|_| Images::default()).collect(),
            clients: ServiceClients::new(plan.machine.service.clone())?,
            firmware: Firmware::of(&simulation, plan.machine.gateway.len()),
            plan: plan.clone(),
            backend,
            simulation,
            io,
            application: None,
            axes: Axes::new(&plan.machine),
            _talkers: talkers,
            accounts,
            cycle: 0,
            leave_until: 0,
            retry_at: 0,
            operate_at: 0,
            is_undisturbed: true,
            outcome: Outcome::default(),
        };
        trial.open()?;
        Ok(trial)
    }

    fn open(&mut self) -> Result<(), String> {
        // The master has one owner.
        self.close();
        let machine = &self.plan.machine;
        let (backend, config) = (&self.backend, machine.config());
        let application = match machine {
            Machine { uses_c: true, .. } => Application::C(CApplication::open(backend, &config)?),
            Machine { is_attached: true, .. } => {
                Application::Rust(Connection::attach(backend, config, self.io.as_ref())?.into())
            }
            _ => Application::Rust(Connection::open(backend, config)?.into()),
        };
        let application = self.application.insert(application);
        application.wait_ready()?;
        if let Some(port) = application.port() {
            self.axes.open(port)?;
        }
        self.use_port()
    }

    /// The application ends, without a stop.
    fn close(&mut self) {
        self.axes.close();
        // Its parts end in any order.
        if self.cycle.is_multiple_of(2) {
            self.clients.end_service(&mut self.accounts);
        }
        self.application = None;
        self.clients.end_service(&mut self.accounts);
    }

    /// After it was opened or configured again.
    fn use_port(&mut self) -> Result<(), String> {
        let port = self.application.as_mut().and_then(Application::port);
        let Some(port) = port else { return Ok(()) };
        self.clients.attach(port);
        for side in &mut self.accounts {
            let handle = port.channel(side.slave, side.channel);
            side.handle = Some(handle.map_err(|error| error.to_string())?);
        }
        Ok(())
    }

    fn longest_recovery_ns(&self) -> u64 {
        let Machine { like, gateway, .. } = &self.plan.machine;
        RECOVERY_NS + if like == "igh" { DICTIONARY_NS * gateway.len() as u64 } else { 0 }
    }

    fn now_ns(&self) -> u64 {
        self.simulation.with_world(|world| world.now_ns())
    }

    fn all_phases(&mut self) -> Check {
        self.drain_buses()?;
        for (slave, images) in self.gateways.iter_mut().enumerate() {
            images.before = counters(&self.simulation, slave).frames_to_master;
        }
        self.start_axes()?;
        let mut events = self.plan.event.clone().into_iter().peekable();
        while self.cycle < self.plan.cycles {
            while let Some(event) = events.next_if(|event| event.cycle <= self.cycle) {
                self.act(&event.action)?;
            }
            if self.application.is_some() {
                self.cycle(true)?;
            }
            self.cycle += 1;
        }
        self.recover()?;
        self.stop_axes()?;
        self.quiet()?;
        self.check_sums()
    }

    fn act(&mut self, action: &Action) -> Check {
        self.is_undisturbed = false;
        match action {
            Action::Fault(fault) => {
                let effect = self.simulation.execute(fault);
                effect.map_err(|error| (Rule::Call, format!("{fault:?}: {error}")))?;
            }
            Action::Discard(slave) => {
                let Some(application) = &mut self.application else { return Ok(()) };
                application.discard_pending(*slave).map_err(call)?;
            }
            // The owner of a master does not reconfigure it for one of its users.
            Action::Reconfigure if self.plan.machine.is_attached => self.restart(0)?,
            Action::Reconfigure => self.reconfigure()?,
            Action::Pause(ms) => self.simulation.pass_ns(u64::from(*ms) * MS),
            Action::Restart(ms) => self.restart(*ms)?,
            Action::LeaveFrames(cycles) => self.leave_until = self.cycle + u64::from(*cycles),
            Action::Upkeep { slave, command } => {
                self.close();
                self.end_statistics();
                command.execute(&self.backend, &self.plan.machine.config(), *slave);
                self.repeat(Self::open)?;
            }
            Action::Firmware { slave, update } => self.update_firmware(*slave, update)?,
            Action::Axis { axis, command } => {
                self.axes.command(*axis, *command, &mut self.random);
            }
        }
        Ok(())
    }

    fn restart(&mut self, after_ms: u32) -> Check {
        self.close();
        self.end_statistics();
        self.simulation.pass_ns(u64::from(after_ms) * MS);
        self.repeat(Self::open)
    }

    fn reconfigure(&mut self) -> Check {
        self.end_statistics();
        self.repeat(|trial| {
            let config = trial.plan.machine.config();
            let Some(application) = &mut trial.application else { return trial.open() };
            application.reconfigure(config)?;
            trial.use_port()
        })
    }

    /// The statistics of the Port start again.
    fn end_statistics(&mut self) {
        self.accounts.iter_mut().for_each(|side| side.account.end_statistics());
        for images in &mut self.gateways {
            images.ended += std::mem::take(&mut images.now) + 1;
        }
    }

    /// Calls until it succeeds: gateways may be away. Those that were switched off return.
    fn repeat(&mut self, step: impl Fn(&mut Self) -> Result<(), String>) -> Check {
        let begin = self.now_ns();
        loop {
            let result = step(self);
            self.drain_buses()?;
            let Err(text) = result else { return Ok(()) };
            if self.now_ns() - begin > self.longest_recovery_ns() {
                return Err((Rule::Recovery, text));
            }
            self.switch_on();
            self.simulation.pass_ns(500 * MS);
        }
    }

    fn switch_on(&self) {
        for gateway in 0..self.plan.machine.gateway.len() {
            self.simulation.inject(Fault::PowerOn { gateway });
        }
    }

    /// Runs until every axis follows targets.
    fn start_axes(&mut self) -> Check {
        let begin = self.now_ns();
        while !self.axes.all_running() {
            self.cycle(true)?;
            self.cycle += 1;
            if self.now_ns() - begin > self.longest_recovery_ns() {
                return Err((Rule::Start, self.axes.status()));
            }
        }
        Ok(())
    }

    /// Stops the axes, then ends them.
    fn stop_axes(&mut self) -> Check {
        self.operate_at = u64::MAX;
        self.axes.quick_stop();
        let begin = self.now_ns();
        while !self.axes.all_stopped(&self.simulation) {
            self.cycle(true)?;
            self.cycle += 1;
            if self.now_ns() - begin > STOP_NS {
                return Err((Rule::Stop, self.axes.status()));
            }
        }
        self.axes.close();
        Ok(())
    }

    fn operate(&mut self) {
        let now = self.now_ns();
        if now >= self.operate_at && !self.axes.is_empty() {
            self.operate_at = now + OPERATE_NS;
            self.axes.operate();
        }
    }

    /// Runs on until the last fault is over and all gateways stay ready.
    fn recover(&mut self) -> Check {
        self.switch_on();
        let (begin, longest) = (self.now_ns(), self.longest_recovery_ns());
        let mut ready_since = None;
        loop {
            let sends = chance(&mut self.random, 50);
            self.cycle(sends)?;
            self.cycle += 1;
            let now = self.now_ns();
            let Some(application) = &mut self.application else { return Ok(()) };
            let is_ready =
                application.is_ready() && self.axes.all_running() && now - begin > LONGEST_FAULT_NS;
            let since = if is_ready { *ready_since.get_or_insert(now) } else { now };
            ready_since = ready_since.filter(|_| is_ready);
            if now - since > STEADY_NS {
                self.outcome.recovery_ns = since - begin;
                return Ok(());
            }
            if now - begin > longest {
                return Err((Rule::Recovery, application.status() + &self.axes.status()));
            }
            // As an operator does who reads what a gateway waits for.
            if application.waits_for_startup() && now >= self.retry_at {
                self.retry_at = now + RETRY_NS;
                application.retry_startup();
            }
        }
    }

    /// Cycles without sending, until what waits has passed.
    fn quiet(&mut self) -> Check {
        let begin = self.now_ns();
        // A master that serves requests in turn reads an AL status slowly.
        let has_pending =
            |trial: &Self| trial.accounts.iter().any(|account| account.account.pending() > 0);
        while self.now_ns() - begin < QUIET_NS
            || (has_pending(self) || self.awaits_bus()) && self.now_ns() - begin < PENDING_NS
        {
            self.cycle(false)?;
            self.cycle += 1;
        }
        self.settle_clients()?;
        for (slave, images) in self.gateways.iter_mut().enumerate() {
            images.at_end = counters(&self.simulation, slave).frames_to_master;
        }
        for _ in 0..20 {
            self.cycle(false)?;
            self.cycle += 1;
        }
        Ok(())
    }
}

fn counters(simulation: &Simulation, slave: usize) -> GatewayCounters {
    simulation.with_world(|world| world.counters(slave)).unwrap_or_default()
}

fn call(error: impl std::fmt::Display) -> (Rule, String) {
    (Rule::Call, error.to_string())
}
