//! Faults of a simulation as the service reports them.

use std::io::{self, Write};

use ecan_sim::{FaultEffect, FaultRecord, ScriptedFault, Simulation, When};
use serde::{Deserialize, Serialize};

/// What has become of a fault, or will.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultState {
    Injected,
    Pending,
    NoEffect,
}

/// A fault with its time.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FaultReport {
    pub state: FaultState,
    /// Time since the start of the simulation, in ns.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub time_ns: Option<u64>,
    /// Number of sends with process data.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub cycle: Option<u64>,
    /// Time after all gateways are in OP for the first time, in ns.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub after_op_ns: Option<u64>,
    /// Time after the program has all gateways ready for the first time, in ns.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub after_ready_ns: Option<u64>,
    /// The fault.
    pub fault: String,
    /// The fault with its time, as a line for users.
    pub text: String,
}

impl FaultReport {
    fn new(state: FaultState, fault: String, text: String) -> Self {
        Self {
            state,
            time_ns: None,
            cycle: None,
            after_op_ns: None,
            after_ready_ns: None,
            fault,
            text,
        }
    }

    pub fn print(&self, out: &mut dyn Write) -> io::Result<()> {
        writeln!(out, "{}", self.text)
    }
}

impl From<&FaultRecord> for FaultReport {
    fn from(record: &FaultRecord) -> Self {
        let (time_ns, cycle) = (Some(record.time_ns), Some(record.cycle));
        let new = Self::new(FaultState::Injected, record.fault.to_string(), record.to_string());
        Self { time_ns, cycle, ..new }
    }
}

impl From<&ScriptedFault> for FaultReport {
    fn from(scripted: &ScriptedFault) -> Self {
        let text = format!("pending {scripted}");
        let new = Self::new(FaultState::Pending, scripted.fault.to_string(), text);
        match scripted.when {
            When::At(ns) => Self { time_ns: Some(ns), ..new },
            When::Cycle(cycle) => Self { cycle: Some(cycle), ..new },
            When::AfterOp(ns) => Self { after_op_ns: Some(ns), ..new },
            When::AfterReady(ns) => Self { after_ready_ns: Some(ns), ..new },
        }
    }
}

impl From<&FaultEffect> for FaultReport {
    fn from(effect: &FaultEffect) -> Self {
        match effect {
            FaultEffect::Injected(record) => record.into(),
            FaultEffect::Scheduled(scripted) => scripted.into(),
            FaultEffect::Nothing(fault) => {
                Self::new(FaultState::NoEffect, fault.to_string(), effect.to_string())
            }
        }
    }
}

/// The last faults that took effect, oldest first, and the pending ones.
#[derive(Debug, Serialize, Deserialize)]
pub struct FaultList {
    pub injected: Vec<FaultReport>,
    pub pending: Vec<FaultReport>,
}

impl FaultList {
    pub fn of(simulation: &Simulation) -> Self {
        // Copied only: the cycle waits for the world.
        let (injected, pending): (Vec<_>, Vec<_>) = simulation.with_world(|world| {
            (world.faults().cloned().collect(), world.pending_faults().collect())
        });
        let injected = injected.iter().map(FaultReport::from).collect();
        Self { injected, pending: pending.iter().map(FaultReport::from).collect() }
    }

    pub fn print(&self, out: &mut dyn Write) -> io::Result<()> {
        if self.injected.is_empty() && self.pending.is_empty() {
            return writeln!(out, "no faults");
        }
        let mut all = self.injected.iter().chain(&self.pending);
        all.try_for_each(|fault| fault.print(out))
    }
}
