//! Way to the observations: a cycle of this program, or the service of another one.

use super::mailbox::{ErrorReader, GatewayErrors};
use super::observation::Observation;
use crate::context::Result;

/// Origin of the observations.
#[derive(Clone, Debug, Default)]
pub struct Origin {
    pub is_simulated: bool,
    /// Program of the service, with version and process.
    pub program: Option<String>,
    /// Explanation for a bus without axes.
    pub without_axes: String,
}

/// Source of observations.
pub trait Source {
    fn origin(&self) -> Origin;

    /// Creates an observation for this source.
    fn observation(&self) -> Observation;

    /// Opens a reader of the error counters, for another thread.
    fn error_reader(&self) -> Result<ErrorReader>;

    /// Applies the settings of this thread, before the others have started.
    fn enter_thread(&mut self) -> Result;

    /// Starts; from now on [`observe`](Self::observe) must be called.
    fn start(&mut self) -> Result;

    /// Returns whether to wait longer for the gateways.
    fn is_starting(&self) -> bool;

    /// Waits for a short time and records what happens.
    fn observe(&mut self, observation: &mut Observation) -> Result;

    /// Records the state of the gateways.
    fn look(&mut self, observation: &mut Observation) -> Result;

    /// Clock for intervals.
    fn now_ns(&self) -> u64;

    /// Reads the error counters of all gateways, by position.
    fn read_errors(&mut self) -> Vec<(usize, GatewayErrors)>;
}
