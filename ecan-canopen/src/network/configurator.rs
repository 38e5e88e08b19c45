//! Runs lists of steps on many nodes at once.

use std::fmt;

use super::address::{NodeAddress, NodeHandle};
use super::heartbeat::NS_PER_MS;
use super::network::Network;
use super::step::Step;
use super::step_failure::StepFailure;
use super::step_runner::{StepRunner, Turn};

/// How a configuration stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Configuring {
    /// Steps are to be done.
    Running,
    /// All steps of all nodes are done.
    Done,
    /// No node goes on, and this is the first that failed.
    Failed(StepFailure),
}

/// How far one node is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// The node.
    pub address: NodeAddress,
    /// Steps done.
    pub done: usize,
    /// Steps in all.
    pub of: usize,
    /// The step under way; `None` when all are done.
    pub step: Option<Step>,
    /// How long this step has been going on, in milliseconds.
    pub for_ms: u64,
    /// Why it goes no further.
    pub failure: Option<StepFailure>,
}

/// `node 5 (slave 0, channel 1): step 3 of 17, mapping off (write 0x1600:00 = 0x00), for 12 ms`
impl fmt::Display for Progress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { address, done, of, .. } = self;
        match (&self.failure, &self.step) {
            (Some(failure), _) => write!(f, "failed: {failure}"),
            (None, Some(step)) => {
                write!(f, "{address}: step {} of {of}, {step}, for {} ms", done + 1, self.for_ms)
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
    steps: Vec<Step>,
    next: usize,
    runner: StepRunner,
    /// Values uploaded by `Read` steps, in the order of the steps.
    uploaded: Vec<(u16, u8, u64)>,
    failure: Option<StepFailure>,
}

impl Task {
    fn is_over(&self) -> bool {
        self.failure.is_some() || self.next >= self.steps.len()
    }

    /// Goes on as far as it can in this cycle.
    fn run(&mut self, network: &mut Network, now_ns: u64) {
        while self.failure.is_none() {
            let Some(step) = self.steps.get(self.next) else { return };
            match self.runner.turn(step, network, self.handle, now_ns) {
                Turn::Busy => return,
                Turn::Done => self.next += 1,
                Turn::Uploaded(index, subindex, value) => {
                    self.uploaded.push((index, subindex, value));
                    self.next += 1;
                }
                Turn::Failed(fault) => {
                    self.failure = Some(StepFailure {
                        address: self.address,
                        nth: self.next,
                        of: self.steps.len(),
                        step: *step,
                        fault,
                    });
                }
            }
        }
    }
}

/// Runs a list of steps per node, all nodes in parallel.
///
/// Add the lists, then call [`step`](Self::step) once per cycle between
/// [`Network::receive`] and [`Network::send`]. Only adding allocates. While a list runs, its node's
/// SDO client belongs to it: a transfer that the application starts in between makes it wait.
///
/// A node that fails stops at its step; the others go on.
#[derive(Debug, Default)]
pub struct Configurator {
    tasks: Vec<Task>,
}

impl Configurator {
    /// Nothing to do yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds steps for a node, behind those that it has already. A handle that the network does not
    /// know adds nothing.
    pub fn add(
        &mut self,
        network: &Network,
        handle: NodeHandle,
        steps: impl IntoIterator<Item = Step>,
    ) {
        let Some(address) = network.address(handle) else { return };
        let place = self.tasks.iter().position(|task| task.handle == handle);
        let place = place.unwrap_or_else(|| {
            self.tasks.push(Task {
                handle,
                address,
                steps: Vec::new(),
                next: 0,
                runner: StepRunner::default(),
                uploaded: Vec::new(),
                failure: None,
            });
            self.tasks.len() - 1
        });
        if let Some(task) = self.tasks.get_mut(place) {
            task.steps.extend(steps);
            let uploads = task.steps.len() - task.uploaded.len();
            task.uploaded.reserve(uploads);
        }
    }

    /// Forgets all lists and results; running transfers are given up.
    pub fn clear(&mut self, network: &mut Network) {
        for task in &self.tasks {
            if task.runner.is_transferring() {
                network.cancel_sdo(task.handle);
            }
        }
        self.tasks.clear();
    }

    /// One cycle. Real-time safe.
    pub fn step(&mut self, network: &mut Network, now_ns: u64) -> Configuring {
        for task in &mut self.tasks {
            task.run(network, now_ns);
        }
        self.outcome()
    }

    /// How it stands; real-time safe.
    pub fn outcome(&self) -> Configuring {
        if !self.tasks.iter().all(Task::is_over) {
            return Configuring::Running;
        }
        match self.tasks.iter().find_map(|task| task.failure) {
            Some(failure) => Configuring::Failed(failure),
            None => Configuring::Done,
        }
    }

    /// Every node that failed.
    pub fn failures(&self) -> impl Iterator<Item = StepFailure> + '_ {
        self.tasks.iter().filter_map(|task| task.failure)
    }

    /// How far each node is, in the order in which they were added; real-time safe.
    pub fn progress(&self, now_ns: u64) -> impl Iterator<Item = Progress> + '_ {
        self.tasks.iter().map(move |task| Progress {
            address: task.address,
            done: task.next,
            of: task.steps.len(),
            step: task.steps.get(task.next).copied(),
            for_ms: task.runner.elapsed_ns(now_ns) / NS_PER_MS,
            failure: task.failure,
        })
    }

    /// How far one node is; real-time safe.
    pub fn progress_of(&self, handle: NodeHandle, now_ns: u64) -> Option<Progress> {
        let place = self.tasks.iter().position(|task| task.handle == handle)?;
        self.progress(now_ns).nth(place)
    }

    /// The value that a [`Step::read`] brought last, little-endian without sign; `None` where no
    /// such step has been done, or the node did not have the object and the step forgave it.
    /// Real-time safe.
    pub fn uploaded(&self, handle: NodeHandle, index: u16, subindex: u8) -> Option<u64> {
        let task = self.tasks.iter().find(|task| task.handle == handle)?;
        let found = task.uploaded.iter().rev().find(|(i, s, _)| (*i, *s) == (index, subindex));
        found.map(|(_, _, value)| *value)
    }
}
