//! Result of an experiment with the assumption that it concerns.

use serde::Serialize;

use crate::probe::experiment::Experiment;
use crate::probe::outcome::{Outcome, Verdict};
use crate::probe::stage::Stage;

/// Decision about one assumption.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// Rows of docs/ASSUMPTIONS.md.
    pub rows: &'static [&'static str],
    /// Switch of the simulator for these rows; empty without one.
    pub key: &'static str,
    /// Stage of the experiment; `None` if no experiment exists.
    pub stage: Option<Stage>,
    /// The assumption.
    pub assumption: &'static str,
    /// The decision.
    pub verdict: Verdict,
    /// What was measured, or why nothing was decided.
    pub detail: String,
    /// The behaviour found, in the form of a scenario file, if it differs.
    pub alternative: Option<String>,
}

impl Finding {
    pub(crate) fn new(experiment: &Experiment, outcome: Outcome) -> Self {
        let Experiment { rows, key, stage, assumption, .. } = *experiment;
        let Outcome { verdict, detail, alternative } = outcome;
        let stage = Some(stage);
        Self { rows, key, stage, assumption, verdict, detail, alternative }
    }
}
