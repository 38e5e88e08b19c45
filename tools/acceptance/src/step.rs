//! A step of the list: what it proves, what it needs, and its result.

use serde::Serialize;

use crate::bench::Bench;

/// Steps about one subject.
#[derive(Debug)]
pub struct Group {
    pub name: &'static str,
    pub steps: &'static [Step],
}

/// One step of the list.
#[derive(Debug)]
pub struct Step {
    pub name: &'static str,
    /// One sentence about the behaviour that a passed step shows.
    pub proves: &'static str,
    pub needs: &'static [Need],
    pub run: fn(&mut Bench) -> Result<(), Stop>,
}

/// Condition without which a step does not apply.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Need {
    /// A bus that outlives a program: a real master.
    LastingBus,
    /// Simulated gateways on the other end of the master's cable.
    Wire,
    /// Simulated gateways, on the wire or in the library.
    Simulated,
    /// A node on each channel that returns every frame.
    EchoNodes,
    /// Permission to write and erase the Flash of a gateway.
    WriteFlash,
    /// IgH's tool.
    EthercatTool,
    /// The rights of root.
    Root,
    /// At least this number of gateways.
    Gateways(u16),
    /// A program of the SDK, or a C program built from it.
    Program(&'static str),
    /// A program of the system.
    System(&'static str),
    /// Not in the short list.
    Full,
}

/// Early end of a step.
#[derive(Debug, thiserror::Error)]
pub enum Stop {
    /// The behaviour differs from the expected one.
    #[error("{0}")]
    Failed(String),
    /// The step does not apply.
    #[error("skipped: {0}")]
    Skipped(String),
    /// By the user.
    #[error("interrupted")]
    Interrupted,
}

impl Stop {
    pub fn failed(message: impl Into<String>) -> Self {
        Self::Failed(message.into())
    }
}

/// Fails with the message unless the condition holds.
pub fn check(condition: bool, message: impl FnOnce() -> String) -> Result<(), Stop> {
    if condition { Ok(()) } else { Err(Stop::Failed(message())) }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    Passed,
    Failed,
    Skipped,
    Interrupted,
}

impl Status {
    pub fn text(self) -> &'static str {
        match self {
            Self::Passed => "passed",
            Self::Failed => "FAILED",
            Self::Skipped => "skipped",
            Self::Interrupted => "interrupted",
        }
    }
}
