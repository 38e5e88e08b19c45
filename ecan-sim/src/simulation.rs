//! A running simulation, its clock, and the thread that runs it on the real clock.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;
use std::{fmt, io, thread};

use ecan_protocol::text::Printable;
use ecrt_sys::Clock;

use crate::backend_error::BackendError;
use crate::ecrt::Shared;
use crate::fault::{
    Fault, FaultDescription, FaultEffect, FaultError, FaultRecord, ScriptedFault, When,
};
use crate::node::{BridgeFactory, Node};
use crate::scenario::{ClockKind, EcrtVersion, Scenario};
use crate::world::World;

/// A running simulation. A clone is another handle to it.
#[derive(Clone)]
pub struct Simulation {
    shared: Arc<Shared>,
    scenario: Arc<Scenario>,
}

impl Simulation {
    pub(crate) fn new(
        scenario: &Scenario,
        clock: ClockKind,
        bridges: Option<BridgeFactory>,
    ) -> Result<Self, BackendError> {
        Ok(Self {
            shared: Arc::new(Shared::new(scenario, clock, bridges)?),
            scenario: Arc::new(scenario.clone()),
        })
    }

    pub(crate) fn shared(&self) -> &Arc<Shared> {
        &self.shared
    }

    /// Name of the scenario.
    pub fn scenario_name(&self) -> &str {
        &self.scenario.name
    }

    /// The scenario.
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// Seed of all random values.
    pub fn seed(&self) -> u64 {
        self.scenario.seed
    }

    /// Clock of the simulation.
    pub fn clock_kind(&self) -> ClockKind {
        self.shared.kind
    }

    /// The simulation's clock.
    pub fn clock(&self) -> SimClock {
        SimClock { shared: self.shared.clone() }
    }

    /// One line for programs to print first; states that the run is simulated.
    pub fn banner(&self) -> String {
        let Scenario { name, seed, gateways, ios, nodes, .. } = &*self.scenario;
        let (gateways, nodes) = (gateways.len(), nodes.len());
        let others = match ios.len() {
            0 => String::new(),
            1 => ", 1 I/O slave".to_owned(),
            count => format!(", {count} I/O slaves"),
        };
        let clock = match self.clock_kind() {
            ClockKind::Real => "real time",
            ClockKind::Stepped => "stepped time",
        };
        let version = match self.shared.version {
            EcrtVersion::V1_5 => "1.5",
            EcrtVersion::V1_6 => "1.6",
        };
        let plural = |count: usize| if count == 1 { "" } else { "s" };
        let bridges = self.with_world(|world| world.node_descriptions());
        format!(
            "SIMULATED: no EtherCAT master, no hardware. Scenario {}: {gateways} \
             gateway{}{others}, {nodes} node{}, libethercat {version}, {clock}, seed {seed}{bridges}",
            Printable(name),
            plural(gateways),
            plural(nodes),
        )
    }

    /// Reads or changes the world. Blocks everyone else for the duration of `action`, which must
    /// not call the simulated library or the simulation's clock.
    pub fn with_world<R>(&self, action: impl FnOnce(&mut World) -> R) -> R {
        self.shared.with(|state| action(&mut state.world))
    }

    /// Injects a fault now.
    pub fn inject(&self, fault: Fault) {
        self.with_world(|world| world.inject(fault));
    }

    /// Schedules a fault.
    pub fn schedule(&self, when: When, fault: Fault) {
        self.with_world(|world| world.schedule(ScriptedFault { when, fault }));
    }

    /// Injects the fault of a description, or schedules it if the description has a time.
    ///
    /// # Errors
    /// The description does not fit the scenario.
    pub fn execute(&self, description: &FaultDescription) -> Result<FaultEffect, FaultError> {
        let fault = description.fault(&self.scenario)?;
        self.with_world(|world| {
            let now_ns = world.now_ns().saturating_sub(world.start_ns());
            Ok(match description.when(now_ns)? {
                Some(when) => {
                    let scripted = ScriptedFault { when, fault };
                    world.schedule(scripted.clone());
                    FaultEffect::Scheduled(scripted)
                }
                None => {
                    let has_effect = world.inject(fault.clone());
                    let record = world.faults().last().filter(|_| has_effect).cloned();
                    record.map_or(FaultEffect::Nothing(fault), FaultEffect::Injected)
                }
            })
        })
    }

    /// Writes the alias of a slave into its SII, as IgH's tool `ethercat alias` does: the master knows it at once.
    /// Returns whether there is such a slave.
    pub fn write_alias(&self, slave: usize, alias: u16) -> bool {
        self.shared.with(|state| {
            let Some(view) = state.master.slaves.get_mut(slave) else { return false };
            view.description.alias = alias;
            state.world.line_mut().set_alias(view.slot, alias);
            true
        })
    }

    /// Calls `observer` with each fault at the time it takes effect; see
    /// [`World::observe_faults`].
    pub fn observe_faults(&self, observer: impl Fn(&FaultRecord) + Send + 'static) {
        self.with_world(|world| world.observe_faults(observer));
    }

    /// The kernel log of the master, oldest line first. Only it states which startup SDO failed and
    /// why.
    pub fn kernel_log(&self) -> Vec<String> {
        self.shared.with(|state| state.master.log.lines().map(str::to_owned).collect())
    }

    /// Number of lines that failed clock calls in the cycle would have written to stderr with a
    /// real library.
    pub fn stderr_lines(&self) -> u64 {
        self.shared.with(|state| state.master.clocks.stderr_lines())
    }

    /// Puts a node on a bus (see [`World::bus_names`]) until the handle is dropped. The node has the
    /// bit rates of the gateway channel on the bus.
    ///
    /// # Errors
    /// The bus does not exist.
    pub fn attach_node(
        &self,
        bus: &str,
        name: &str,
        node: Box<dyn Node>,
    ) -> Result<AttachedNode, UnknownBus> {
        let index = self.with_world(|world| {
            if world.bus(bus).is_none() {
                let known = world.bus_names().collect::<Vec<_>>().join(", ");
                return Err(UnknownBus { bus: bus.to_owned(), known });
            }
            Ok(world.attach_node(bus, name, node))
        })?;
        Ok(AttachedNode { simulation: self.clone(), index })
    }

    /// Runs a simulation on the real clock on a separate thread until the runner is dropped, for
    /// use without a master's cycle.
    ///
    /// # Errors
    /// A [`RunnerError`].
    pub fn keep_running(&self) -> Result<RealTimeRunner, RunnerError> {
        RealTimeRunner::start(self.shared.clone())
    }

    /// Lets time pass without process data exchange, in ns.
    pub fn pass_ns(&self, ns: u64) {
        self.shared.sleep_until(self.shared.now_ns().saturating_add(ns));
    }
}

impl fmt::Debug for Simulation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Simulation")
            .field("scenario", &self.scenario_name())
            .field("clock", &self.clock_kind())
            .field("now_ns", &self.clock().now_ns())
            .finish_non_exhaustive()
    }
}

/// No bus has this name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("bus \"{bus}\" does not exist; there are: {known}")]
pub struct UnknownBus {
    /// The name.
    pub bus: String,
    /// The existing names.
    pub known: String,
}

/// A node that was put on a bus with [`Simulation::attach_node`]. Dropping it takes the node off
/// its bus.
#[derive(Debug)]
pub struct AttachedNode {
    simulation: Simulation,
    index: usize,
}

impl Drop for AttachedNode {
    fn drop(&mut self) {
        let node = self.simulation.with_world(|world| world.detach_node(self.index));
        // Outside the world's lock: a bridge takes a moment to end its threads.
        drop(node);
    }
}

/// Clock of a simulated world: the system's monotonic clock, or the stepped clock, which advances
/// while a thread sleeps on it.
#[derive(Clone)]
pub struct SimClock {
    pub(crate) shared: Arc<Shared>,
}

impl Clock for SimClock {
    fn now_ns(&self) -> u64 {
        self.shared.now_ns()
    }

    fn sleep_until_ns(&self, deadline_ns: u64) {
        self.shared.sleep_as_application(deadline_ns, 0);
    }

    /// In stepped time the spin is simulated: it hides an equal part of the scenario's
    /// [`WakeUpDelay`](crate::WakeUpDelay).
    fn sleep_and_spin_until_ns(&self, deadline_ns: u64, spin_ns: u64) {
        self.shared.sleep_as_application(deadline_ns, spin_ns);
    }

    fn is_free_running(&self) -> bool {
        self.shared.kind == ClockKind::Real
    }

    fn gateways_ready(&self) {
        self.shared.with(|state| state.world.begin_ready());
    }
}

const STEP: Duration = Duration::from_millis(1);

/// Reason why a simulation cannot run on a thread.
#[derive(Debug, thiserror::Error)]
pub enum RunnerError {
    /// Stepped time is advanced by the program itself.
    #[error("the simulation runs in stepped time, which only the cycle of the program advances")]
    SteppedClock,
    /// The thread cannot be started.
    #[error("cannot start the thread of the simulation: {0}")]
    Thread(#[from] io::Error),
}

/// Keeps a simulation on the real clock running until it is dropped; see
/// [`Simulation::keep_running`](crate::Simulation::keep_running).
#[derive(Debug)]
pub struct RealTimeRunner {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl RealTimeRunner {
    pub(crate) fn start(shared: Arc<Shared>) -> Result<Self, RunnerError> {
        if shared.kind == ClockKind::Stepped {
            return Err(RunnerError::SteppedClock);
        }
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = stop.clone();
        let run = move || {
            while !stopped.load(Ordering::Acquire) {
                // Access advances the world to the present.
                shared.with(|_| ());
                thread::park_timeout(STEP);
            }
        };
        let thread = thread::Builder::new().name("simulation".to_owned()).spawn(run)?;
        Ok(Self { stop, thread: Some(thread) })
    }
}

impl Drop for RealTimeRunner {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // A panic in it has been reported on stderr already.
            let _ = thread.join();
        }
    }
}
