//! State of a simulated machine as the service reports it.

use std::io;
use std::io::Write;

use ecan_protocol::device::AlStatusCode;
use ecan_sim::{Gateway, Simulation, World};
use serde::{Deserialize, Serialize};

use crate::table;

#[derive(Debug, Serialize, Deserialize)]
pub struct SimulationStatus {
    pub scenario: String,
    pub seed: u64,
    /// Time since the start of the simulation, in ns.
    pub time_ns: u64,
    /// Number of sends with process data.
    pub cycle: u64,
    /// Time at which all gateways were in OP for the first time, in ns.
    pub op_ns: Option<u64>,
    /// Time at which the program had all gateways ready for the first time, in ns.
    pub ready_ns: Option<u64>,
    pub gateways: Vec<GatewayStatus>,
    pub nodes: Vec<NodeStatus>,
}

#[derive(Debug, Serialize, Deserialize)]
pub struct GatewayStatus {
    /// Index in the scenario.
    pub gateway: usize,
    /// Position on the line; that on the bus if all slaves before it respond.
    pub position: Option<usize>,
    pub is_powered: bool,
    /// False while it boots.
    pub is_running: bool,
    pub is_cable_open: bool,
    /// Returns whether frames of the master reach it and return.
    pub is_reachable: bool,
    /// `None` unless it runs.
    pub al_state: Option<String>,
    /// AL status code; `None` without an error.
    pub al_error: Option<u16>,
}

#[derive(Debug, Serialize, Deserialize)]
pub struct NodeStatus {
    pub name: String,
    pub kind: String,
    pub bus: String,
}

impl SimulationStatus {
    pub fn of(simulation: &Simulation) -> Self {
        let scenario = simulation.scenario();
        let nodes = scenario.nodes.iter().map(|node| NodeStatus {
            name: node.name.clone(),
            kind: node.kind.name().to_owned(),
            bus: node.bus.clone(),
        });
        let nodes = nodes.collect();
        simulation.with_world(|world| Self {
            scenario: scenario.name.clone(),
            seed: scenario.seed,
            time_ns: world.now_ns().saturating_sub(world.start_ns()),
            cycle: world.cycles(),
            op_ns: world.op_ns(),
            ready_ns: world.ready_ns(),
            gateways: (0..world.gateway_count())
                .filter_map(|index| Some(GatewayStatus::of(world, index, world.gateway(index)?)))
                .collect(),
            nodes,
        })
    }

    pub fn print(&self, out: &mut dyn Write) -> io::Result<()> {
        let Self { scenario, seed, time_ns, cycle, op_ns, ready_ns, gateways, nodes } = self;
        let seconds = |ns: u64| ns as f64 / 1e9;
        let at = |ns: &Option<u64>| {
            ns.map_or("not yet".to_owned(), |ns| format!("at {:.3} s", seconds(ns)))
        };
        let op = format!("all gateways in OP {}, ready {}", at(op_ns), at(ready_ns));
        let time = seconds(*time_ns);
        writeln!(out, "scenario {scenario}, seed {seed}: {time:.3} s, {cycle} cycles, {op}")?;
        let titles = ["GATEWAY", "POS", "SUPPLY", "CABLE", "REACHED", "STATE"];
        table::print_with_titles(out, titles, gateways, |gateway| {
            [
                gateway.gateway.to_string(),
                table::or_dash(gateway.position),
                if gateway.is_powered { "on" } else { "off" }.to_owned(),
                if gateway.is_cable_open { "open" } else { "closed" }.to_owned(),
                if gateway.is_reachable { "yes" } else { "no" }.to_owned(),
                gateway.state(),
            ]
        })?;
        if nodes.is_empty() {
            return Ok(());
        }
        writeln!(out)?;
        table::print_with_titles(out, ["NODE", "KIND", "BUS"], nodes, |node| {
            [node.name.clone(), node.kind.clone(), node.bus.clone()]
        })
    }
}

impl GatewayStatus {
    fn of(world: &World, index: usize, gateway: &Gateway) -> Self {
        let is_running = gateway.is_responding();
        Self {
            gateway: index,
            position: world.position_of(index),
            is_powered: gateway.is_powered(),
            is_running,
            is_cable_open: world.is_cable_open(index),
            is_reachable: world.is_reachable(index),
            al_state: is_running.then(|| gateway.al_state().to_string()),
            al_error: gateway.al_error().then(|| gateway.al_status_code()),
        }
    }

    /// Returns whether the master has identified it, and has brought it to OP if a cycle runs.
    pub fn is_started(&self, has_cycle: bool) -> bool {
        let is_in_state = match self.al_state.as_deref() {
            Some("OP") => true,
            Some("PREOP" | "SAFEOP") => !has_cycle,
            _ => false,
        };
        is_in_state && self.is_reachable && self.al_error.is_none()
    }

    pub fn state(&self) -> String {
        let state = match &self.al_state {
            Some(state) => state.as_str(),
            None if self.is_powered => "booting",
            None => "-",
        };
        match self.al_error {
            Some(code) => format!("{state}, AL status code {}", AlStatusCode(code)),
            None => state.to_owned(),
        }
    }
}
