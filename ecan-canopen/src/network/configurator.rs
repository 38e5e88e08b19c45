//! Configuration of the nodes of a network by lists of steps: of one node, and of many at once.

use std::fmt;
use std::ops::Deref;
use std::time::Duration;

use super::config::{NodeAddress, NodeHandle, Step};
use super::error::StepFailure;
use super::master::Network;
use super::node_sequence::{Configuring, NodeSequence};

/// Progress of the configuration of one node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// The node.
    pub address: NodeAddress,
    /// Number of complete steps.
    pub done: usize,
    /// Number of steps.
    pub of: usize,
    /// The current step; `None` if all are complete.
    pub step: Option<Step>,
    /// Time since this step began.
    pub elapsed: Duration,
    /// Failure that ended the configuration.
    pub failure: Option<StepFailure>,
}

/// `node 5 (slave 0, channel 1): step 3 of 17, mapping off (write 0x1600:00 = 0x00), for 12 ms`
impl fmt::Display for Progress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { address, done, of, elapsed, .. } = self;
        match (&self.failure, &self.step) {
            (Some(failure), _) => write!(f, "failed: {failure}"),
            (None, Some(step)) => {
                let (nth, for_ms) = (done + 1, elapsed.as_millis());
                write!(f, "{address}: step {nth} of {of}, {step}")?;
                if for_ms > 0 { write!(f, ", for {for_ms} ms") } else { Ok(()) }
            }
            (None, None) => write!(f, "{address}: all {of} steps done"),
        }
    }
}

/// One node's list.
#[derive(Debug)]
struct Task {
    handle: NodeHandle,
    address: NodeAddress,
    sequence: NodeSequence<Vec<Step>>,
    /// Values of read steps: index, subindex, value, in the order of the steps.
    uploaded: Vec<(u16, u8, u64)>,
}

/// Executes a list of steps per node, all nodes in parallel.
///
/// Add the lists, then call [`step`](Self::step) once per cycle between
/// [`Network::receive`] and [`Network::send`]. Only adding allocates. While a list runs, its node's
/// SDO client belongs to it; if the application starts a transfer in between, the list waits.
///
/// A node that fails stops at its step; the others continue.
#[derive(Debug, Default)]
pub struct Configurator {
    tasks: Vec<Task>,
}

impl Configurator {
    /// Creates a configurator without lists.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds steps for a node, after those that it already has. Ignores a handle of another
    /// network. Allocates.
    pub fn add(
        &mut self,
        network: &Network,
        handle: NodeHandle,
        steps: impl IntoIterator<Item = Step>,
    ) {
        let Some(address) = network.address(handle) else { return };
        let nth = self.tasks.iter().position(|task| task.handle == handle).unwrap_or_else(|| {
            let sequence = NodeSequence::new(Vec::new());
            self.tasks.push(Task { handle, address, sequence, uploaded: Vec::new() });
            self.tasks.len() - 1
        });
        if let Some(task) = self.tasks.get_mut(nth) {
            let list = task.sequence.steps_mut();
            list.extend(steps);
            let uploads = list.len() - task.uploaded.len();
            task.uploaded.reserve(uploads);
        }
    }

    /// Removes all lists and results and cancels running transfers.
    pub fn clear(&mut self, network: &mut Network) {
        for task in &self.tasks {
            task.sequence.cancel(network, task.handle);
        }
        self.tasks.clear();
    }

    /// Cancels running transfers and starts all lists over, without their results. Real-time safe.
    pub fn restart(&mut self, network: &mut Network) {
        for task in &mut self.tasks {
            task.sequence.cancel(network, task.handle);
            task.sequence.restart();
            task.uploaded.clear();
        }
    }

    /// Executes steps of all nodes, once per cycle. Real-time safe.
    pub fn step(&mut self, network: &mut Network, now_ns: u64) -> Configuring {
        let mut outcome = Configuring::Done;
        for Task { handle, sequence, uploaded, .. } in &mut self.tasks {
            let read = |index, subindex, value| uploaded.push((index, subindex, value));
            match (sequence.advance(network, *handle, now_ns, read), outcome) {
                (Configuring::Running, _) => outcome = Configuring::Running,
                (failed @ Configuring::Failed(_), Configuring::Done) => outcome = failed,
                _ => {}
            }
        }
        outcome
    }

    /// All nodes that failed; real-time safe.
    pub fn failures(&self) -> impl Iterator<Item = StepFailure> + '_ {
        self.tasks.iter().filter_map(|task| task.sequence.failure())
    }

    /// Progress of each node, in the order in which they were added; real-time safe.
    pub fn progress(&self, now_ns: u64) -> impl Iterator<Item = Progress> + '_ {
        self.tasks.iter().map(move |task| {
            let sequence = task.sequence.sequence();
            Progress {
                address: task.address,
                done: sequence.position(),
                of: sequence.steps().len(),
                step: sequence.current(),
                elapsed: sequence.elapsed(now_ns),
                failure: task.sequence.failure(),
            }
        })
    }

    /// Progress of one node; real-time safe.
    pub fn progress_of(&self, handle: NodeHandle, now_ns: u64) -> Option<Progress> {
        let nth = self.tasks.iter().position(|task| task.handle == handle)?;
        self.progress(now_ns).nth(nth)
    }

    /// Value of the last [`Step::read`] of an object, little-endian without sign; `None` if no
    /// such step is complete, or if the step tolerated a missing object. Real-time safe.
    pub fn uploaded(&self, handle: NodeHandle, index: u16, subindex: u8) -> Option<u64> {
        let task = self.tasks.iter().find(|task| task.handle == handle)?;
        let found = task.uploaded.iter().rev().find(|(i, s, _)| (*i, *s) == (index, subindex));
        found.map(|(_, _, value)| *value)
    }
}

impl<S: Deref<Target = [Step]>> NodeSequence<S> {
    /// Cancels the running transfer. Real-time safe.
    pub fn cancel(&self, network: &mut Network, handle: NodeHandle) {
        if let Some(member) = network.member(handle) {
            self.cancel_transfer(&mut member.node.sdo);
        }
    }

    /// Executes steps until one must wait, all are complete, or one fails; after a failure it does
    /// nothing. `on_read` receives index, subindex and value of each read. Call once per cycle,
    /// between [`Network::receive`] and [`Network::send`]. Real-time safe.
    pub fn advance(
        &mut self,
        network: &mut Network,
        handle: NodeHandle,
        now_ns: u64,
        on_read: impl FnMut(u16, u8, u64),
    ) -> Configuring {
        match (network.member(handle), self.failure()) {
            (Some(mut member), _) => self.advance_member(&mut member, now_ns, on_read),
            (None, Some(failure)) => Configuring::Failed(failure),
            (None, None) => Configuring::Done,
        }
    }
}
