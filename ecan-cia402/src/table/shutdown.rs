//! Orderly end: the axes come to rest, are switched off, and continue without the host.

use std::fmt;
use std::time::Duration;

use ecan_canopen::{Network, NmtCommand};

use crate::axis::axis::Axis;
use crate::axis::power::StopCause;
use crate::axis::task::AxisState;

/// Default of [`Cia402::stop_time`](super::Cia402::stop_time).
const STOP_TIME: Duration = Duration::from_secs(10);

/// Longest time of a stage; then the next one begins.
const REST_NS: u64 = 5_000_000_000;
const DISABLE_NS: u64 = 5_000_000_000;
const RELEASE_NS: u64 = 1_000_000_000;

/// Ends of the first two stages, for a call that waits: bus clock, in nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct ShutdownDeadline {
    rest_ns: u64,
    disable_ns: u64,
}

impl ShutdownDeadline {
    /// Half of the time for the ramps, and the rest for the drives, but for the time of their release.
    fn after(now_ns: u64, timeout: Duration) -> Self {
        let timeout_ns = u64::try_from(timeout.as_nanos()).unwrap_or(u64::MAX);
        let release_ns = RELEASE_NS.min(timeout_ns / 4);
        Self {
            rest_ns: now_ns.saturating_add(REST_NS.min(timeout_ns / 2)),
            disable_ns: now_ns.saturating_add(timeout_ns - release_ns),
        }
    }
}

/// State of the orderly end, see [`Cia402::begin_shutdown`](super::Cia402::begin_shutdown). Times
/// are those of the bus clock, in nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Shutdown {
    /// No shutdown was requested.
    #[default]
    None,
    /// The axes come to rest by their ramps.
    Decelerating {
        /// Start of this stage.
        since_ns: u64,
    },
    /// The drives are switched off.
    Disabling {
        /// Start of this stage.
        since_ns: u64,
    },
    /// The drives stop watching the host's heartbeat and go to Pre-operational.
    Releasing {
        /// Start of this stage.
        since_ns: u64,
    },
    /// Complete; the host may end.
    Done,
}

impl fmt::Display for Shutdown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::None => "in operation",
            Self::Decelerating { .. } => "decelerating",
            Self::Disabling { .. } => "disabling",
            Self::Releasing { .. } => "releasing",
            Self::Done => "released",
        })
    }
}

impl Shutdown {
    fn begin(axes: &mut [Axis], network: &mut Network, since_ns: u64) -> Self {
        for axis in axes {
            axis.cancel_procedure(network);
            axis.task.recovery = None;
            if axis.path.is_running() {
                axis.halt();
            }
        }
        Self::Decelerating { since_ns }
    }

    fn step(
        self,
        axes: &mut [Axis],
        network: &mut Network,
        has_host_heartbeat: bool,
        deadline: Option<ShutdownDeadline>,
        now_ns: u64,
    ) -> Self {
        let is_over = |since_ns: u64, limit, end: Option<u64>| match end {
            Some(end_ns) => now_ns > end_ns,
            None => now_ns.saturating_sub(since_ns) > limit,
        };
        let rest_end = deadline.map(|deadline| deadline.rest_ns);
        let disable_end = deadline.map(|deadline| deadline.disable_ns);
        match self {
            Self::Decelerating { since_ns }
                if axes.iter().all(Axis::is_at_rest) || is_over(since_ns, REST_NS, rest_end) =>
            {
                axes.iter_mut().for_each(|axis| axis.stop(StopCause::Shutdown, now_ns));
                Self::Disabling { since_ns: now_ns }
            }
            Self::Disabling { since_ns }
                if axes.iter().all(|axis| axis.is_stopped(now_ns))
                    || is_over(since_ns, DISABLE_NS, disable_end) =>
            {
                for index in 0..axes.len() {
                    if node_is_stopped(axes, index, now_ns)
                        && let Some(axis) = axes.get_mut(index)
                    {
                        axis.begin_release(has_host_heartbeat, now_ns);
                    }
                }
                Self::Releasing { since_ns: now_ns }
            }
            Self::Releasing { since_ns }
                if axes.iter().all(is_released) || is_over(since_ns, RELEASE_NS, None) =>
            {
                axes.iter_mut().for_each(|axis| axis.cancel_release(network, now_ns));
                for (index, axis) in axes.iter().enumerate() {
                    // A drive that has not stopped keeps the state in which it watches the host.
                    if axis.setup.node_share.is_first && node_is_stopped(axes, index, now_ns) {
                        // A full queue is not sent any more, either.
                        let _ = network.nmt(axis.plan.node, NmtCommand::EnterPreOperational);
                    }
                }
                Self::Done
            }
            waiting => waiting,
        }
    }
}

/// End of the axes: the state of the orderly end, and the time for which the end of a program waits.
#[derive(Debug)]
pub(super) struct Ending {
    state: Shutdown,
    /// Deadline of a call that waits for the orderly end.
    deadline: Option<ShutdownDeadline>,
    pub(super) stop_time: Duration,
}

impl Ending {
    pub(super) fn new() -> Self {
        Self { state: Shutdown::None, deadline: None, stop_time: STOP_TIME }
    }

    pub(super) fn state(&self) -> Shutdown {
        self.state
    }

    pub(super) fn set_deadline(&mut self, now_ns: u64, timeout: Duration) {
        self.deadline = Some(ShutdownDeadline::after(now_ns, timeout));
    }

    pub(super) fn begin(&mut self, axes: &mut [Axis], network: &mut Network, now_ns: u64) {
        if self.state == Shutdown::None {
            self.state = Shutdown::begin(axes, network, now_ns);
        }
    }

    pub(super) fn step(
        &mut self,
        axes: &mut [Axis],
        network: &mut Network,
        has_host_heartbeat: bool,
        now_ns: u64,
    ) {
        self.state = self.state.step(axes, network, has_host_heartbeat, self.deadline, now_ns);
    }
}

/// Returns whether all axes of the node of an axis have stopped.
fn node_is_stopped(axes: &[Axis], index: usize, now_ns: u64) -> bool {
    let Some(node) = axes.get(index).map(|axis| axis.plan.node) else { return false };
    axes.iter().filter(|axis| axis.plan.node == node).all(|axis| axis.is_stopped(now_ns))
}

fn is_released(axis: &Axis) -> bool {
    !matches!(axis.task.state(), AxisState::Releasing(_))
}
