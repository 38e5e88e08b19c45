//! Leaving the axes in order: to rest, power off, and on their own.

use std::fmt;

use ecan_canopen::NmtCommand;

use super::axis::Axis;
use super::axis_state::AxisState;
use super::context::Cia402;

/// How long a stage may take before the next begins all the same.
const REST_NS: u64 = 5_000_000_000;
const DISABLE_NS: u64 = 5_000_000_000;
const RELEASE_NS: u64 = 1_000_000_000;

/// Where an orderly end stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Shutdown {
    /// None was asked for.
    #[default]
    None,
    /// The axes are brought to rest by their ramps.
    Decelerating {
        /// Since when.
        since_ns: u64,
    },
    /// The drives' power is switched off.
    Disabling {
        /// Since when.
        since_ns: u64,
    },
    /// The drives are told not to wait for the host any more, and go to Pre-operational.
    Releasing {
        /// Since when.
        since_ns: u64,
    },
    /// Nothing is left to do; the host may leave.
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

impl Cia402 {
    /// Begins an orderly end: every axis comes to rest by its ramp, is disabled, and released: its
    /// watch over the host's heartbeat is switched off and it goes to Pre-operational, so that no
    /// drive reports a fault when the host leaves. [`shutdown_state`](Self::shutdown_state) tells
    /// when it is done. A stage that an axis cannot finish ends after five seconds.
    ///
    /// Commands under way are given up. The cycle goes on as before meanwhile.
    pub fn begin_shutdown(&mut self) {
        if self.shutdown != Shutdown::None {
            return;
        }
        for axis in &mut self.axes {
            axis.cancel_procedure(&mut self.network);
            if axis.is_running() {
                axis.targets.halt();
            }
        }
        self.shutdown = Shutdown::Decelerating { since_ns: self.now_ns };
    }

    /// Where the orderly end stands.
    pub fn shutdown_state(&self) -> Shutdown {
        self.shutdown
    }

    pub(super) fn step_shutdown(&mut self) {
        let now_ns = self.now_ns;
        let is_over = |since_ns: u64, limit| now_ns.saturating_sub(since_ns) > limit;
        match self.shutdown {
            Shutdown::None | Shutdown::Done => {}
            Shutdown::Decelerating { since_ns } => {
                let at_rest = self.axes.iter().all(|axis| axis.is_at_rest());
                if at_rest || is_over(since_ns, REST_NS) {
                    self.axes.iter_mut().for_each(|axis| axis.disable());
                    self.shutdown = Shutdown::Disabling { since_ns: now_ns };
                }
            }
            Shutdown::Disabling { since_ns } => {
                // A drive that is not configured, or not heard, is not waited for.
                let are_off = self.axes.iter().all(|axis| {
                    !axis.state.is_configured() || axis.drive.state.is_none() || axis.drive.is_off()
                });
                if are_off || is_over(since_ns, DISABLE_NS) {
                    let has_host = self.bus.host.is_some();
                    self.axes.iter_mut().for_each(|axis| axis.begin_release(has_host));
                    self.shutdown = Shutdown::Releasing { since_ns: now_ns };
                }
            }
            Shutdown::Releasing { since_ns } => {
                let is_released = |axis: &Axis| !matches!(axis.state, AxisState::Releasing(_));
                let are_released = self.axes.iter().all(is_released);
                if are_released || is_over(since_ns, RELEASE_NS) {
                    self.finish_release();
                }
            }
        }
    }

    fn finish_release(&mut self) {
        self.axes.iter_mut().for_each(|axis| axis.cancel_release(&mut self.network));
        // A queue that is full of commands is not sent any more, either.
        let _ = self.network.nmt_all(NmtCommand::EnterPreOperational);
        self.shutdown = Shutdown::Done;
    }
}
