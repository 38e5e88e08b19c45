//! One experiment.

use super::run::Probe;
use crate::probe::interruption::Result;
use crate::probe::outcome::Outcome;
use crate::probe::stage::Stage;

/// Experiment that decides one assumption.
#[derive(Clone, Copy)]
pub struct Experiment {
    /// Rows of docs/ASSUMPTIONS.md.
    pub rows: &'static [&'static str],
    /// Switch of the simulator that the rows name; empty without one.
    pub key: &'static str,
    /// Stage.
    pub stage: Stage,
    /// The assumption.
    pub assumption: &'static str,
    pub(crate) run: fn(&mut Probe) -> Result<Outcome>,
}

impl std::fmt::Debug for Experiment {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Experiment").field("rows", &self.rows).field("key", &self.key).finish()
    }
}
