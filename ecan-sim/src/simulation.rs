//! The handle with which a program or a test looks into a simulation and interferes with it.

use std::fmt;
use std::sync::Arc;

use ecrt_sys::Clock as _;

use crate::backend::BackendError;
use crate::bridge::{Bridge, BridgeConfig, BridgeError, BridgeInfo};
use crate::clock::SimClock;
use crate::ecrt::Shared;
use crate::fault::{Fault, ScriptedFault, When};
use crate::runner::{RealTimeRunner, RunnerError};
use crate::scenario::{ClockKind, EcrtVersion, Scenario};
use crate::world::World;

/// A running simulation. Cloning gives another handle to the same one.
#[derive(Clone)]
pub struct Simulation {
    shared: Arc<Shared>,
    description: Arc<Description>,
}

struct Description {
    scenario: String,
    seed: u64,
    gateways: usize,
    nodes: usize,
}

impl Simulation {
    pub(crate) fn new(scenario: &Scenario, clock: ClockKind) -> Result<Self, BackendError> {
        Ok(Self {
            shared: Arc::new(Shared::new(scenario, clock)?),
            description: Arc::new(Description {
                scenario: scenario.name.clone(),
                seed: scenario.seed,
                gateways: scenario.gateways.len(),
                nodes: scenario.nodes.len(),
            }),
        })
    }

    pub(crate) fn shared(&self) -> &Arc<Shared> {
        &self.shared
    }

    /// Name of the scenario.
    pub fn scenario_name(&self) -> &str {
        &self.description.scenario
    }

    /// Seed of everything random.
    pub fn seed(&self) -> u64 {
        self.description.seed
    }

    /// How time passes.
    pub fn clock_kind(&self) -> ClockKind {
        self.shared.clock_kind()
    }

    /// The simulation's clock.
    pub fn clock(&self) -> SimClock {
        SimClock::new(self.shared.clone())
    }

    /// One line that says that nothing here is real, for programs to print first.
    pub fn banner(&self) -> String {
        let Description { scenario, seed, gateways, nodes } = &*self.description;
        let clock = match self.clock_kind() {
            ClockKind::Real => "real time",
            ClockKind::Stepped => "stepped time",
        };
        let version = match self.shared.version() {
            EcrtVersion::V1_5 => "1.5",
            EcrtVersion::V1_6 => "1.6",
        };
        let plural = |count: usize| if count == 1 { "" } else { "s" };
        let bridges: String =
            self.bridges().iter().map(|(bus, bridge)| format!(", {bridge} on bus {bus}")).collect();
        format!(
            "SIMULATED: no EtherCAT master, no hardware. Scenario {scenario}: {gateways} \
             gateway{}, {nodes} node{}, libethercat {version}, {clock}, seed {seed}{bridges}",
            plural(*gateways),
            plural(*nodes),
        )
    }

    /// Looks into the world, or changes it. Holds up everyone else meanwhile; must not call the
    /// simulated library or the simulation's clock.
    pub fn with_world<R>(&self, action: impl FnOnce(&mut World) -> R) -> R {
        self.shared.with(|state| action(&mut state.world))
    }

    /// Lets a fault strike now.
    pub fn inject(&self, fault: Fault) {
        self.with_world(|world| world.inject(fault));
    }

    /// Adds a fault to the script; see [`When`] for what its time counts from.
    pub fn schedule(&self, when: When, fault: Fault) {
        self.with_world(|world| world.schedule(ScriptedFault { when, fault }));
    }

    /// What the master wrote to the kernel log, oldest line first: there, and only there, stands
    /// which startup SDO failed and why.
    pub fn kernel_log(&self) -> Vec<String> {
        self.shared.with(|state| state.master.log_lines().map(str::to_owned).collect())
    }

    /// Lines that calls of the clocks in the cycle would have written to stderr with a real
    /// library, which does so whenever one fails.
    pub fn stderr_lines(&self) -> u64 {
        self.shared.with(|state| state.master.stderr_lines)
    }

    /// Puts a bridge on a bus (see [`World::bus_names`]), with the bit rates of the gateway channel
    /// there: other programs join the bus through it until the handle is dropped.
    ///
    /// A bridge in a scenario (`kind = "bridge"`) may have bit rates of its own and needs no
    /// gateway channel that is switched on.
    ///
    /// # Errors
    /// A [`BridgeError`].
    pub fn attach_bridge(&self, bus: &str, settings: BridgeConfig) -> Result<Bridge, BridgeError> {
        let (node, info) = self.with_world(|world| {
            if world.bus(bus).is_none() {
                let known = world.bus_names().collect::<Vec<_>>().join(", ");
                return Err(BridgeError::UnknownBus { bus: bus.to_owned(), known });
            }
            world.attach_bridge(bus, &settings).map_err(BridgeError::Server)
        })?;
        Ok(Bridge::new(self.clone(), node, info))
    }

    /// The bridges that there are, with the names of their buses, the scenario's first.
    pub fn bridges(&self) -> Vec<(String, BridgeInfo)> {
        self.with_world(|world| {
            world.bridges().map(|(bus, info)| (bus.to_owned(), info.clone())).collect()
        })
    }

    /// Keeps a simulation on the real clock going, on a thread of its own, until the runner is
    /// dropped: for uses without a master's cycle, when bridges and nodes have to live
    /// nevertheless.
    ///
    /// # Errors
    /// A [`RunnerError`].
    pub fn keep_running(&self) -> Result<RealTimeRunner, RunnerError> {
        RealTimeRunner::start(self.clone())
    }

    /// Lets so many nanoseconds pass without the program exchanging anything.
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
