//! A step of the list and its result.

use serde::Serialize;

use crate::bench::Bench;
use crate::need::Need;
use crate::stop::Stop;

/// Steps about one subject.
#[derive(Debug)]
pub struct Group {
    pub name: &'static str,
    pub steps: &'static [Step],
}

/// Executes a step.
pub type Run = fn(&mut Bench) -> Result<(), Stop>;

/// One step of the list.
#[derive(Debug)]
pub struct Step {
    pub name: &'static str,
    /// One sentence about the behaviour that a passed step shows.
    pub proves: &'static str,
    pub needs: &'static [Need],
    pub run: Run,
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
