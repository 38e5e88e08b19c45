//! Calls that wait: they run the cycle themselves until all axes are where they are to be.

use ecan_mcan_port::{Cycle, Port};

use ecan_canopen::{WaitError, run_cycle_uninterrupted, run_cycle_until};

use super::axis::Axis;
use super::axis_state::AxisState;
use super::context::Cia402;
use super::error::{AxisTimeout, Cia402Error};
use super::guard_terms::GuardState;
use super::phase::AxisProgress;
use super::shutdown::Shutdown;

/// How an axis stands to what is waited for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum WaitStatus {
    Waiting,
    Reached,
    /// It will not get there by waiting.
    Stuck,
}

impl Cia402 {
    /// One cycle's work for a loop that has no targets of its own: everything in, the axes at
    /// their last targets, everything out.
    pub fn serve(&mut self, cycle: &mut Cycle<'_>) {
        self.process_rx(cycle);
        self.send_targets_all(cycle);
    }

    /// Configures every drive that is not configured, and waits. `progress` is called for every
    /// axis in every cycle. Blocks.
    ///
    /// # Errors
    /// [`Cia402Error::AxisTimeout`] names the axes that are not configured when all others are, or
    /// after `timeout_ms` milliseconds, with the step at which each stands and what it answered.
    pub fn configure_all_timeout(
        &mut self,
        port: &mut Port,
        timeout_ms: u32,
        progress: impl FnMut(&AxisProgress),
    ) -> Result<(), Cia402Error> {
        self.configure_all()?;
        self.wait(port, timeout_ms, "configured", progress, |axis| match axis.state {
            AxisState::Configuring | AxisState::SettingMode(_) => WaitStatus::Waiting,
            AxisState::Unconfigured | AxisState::SetupFailed => WaitStatus::Stuck,
            _ => WaitStatus::Reached,
        })
    }

    /// Establishes where all axes are, from fresh TPDOs, and waits. Blocks.
    ///
    /// # Errors
    /// [`Cia402Error::AxisTimeout`] names the axes whose position is not known, and what hinders it.
    pub fn request_actual_position_all_timeout(
        &mut self,
        port: &mut Port,
        timeout_ms: u32,
        progress: impl FnMut(&AxisProgress),
    ) -> Result<(), Cia402Error> {
        self.read_position_all()?;
        self.wait(port, timeout_ms, "at a known position", progress, |axis| {
            match axis.guard.state() {
                GuardState::Armed { .. } | GuardState::Running { .. } => WaitStatus::Reached,
                GuardState::Draining | GuardState::Reading => WaitStatus::Waiting,
                GuardState::Idle | GuardState::Holding { .. } => WaitStatus::Stuck,
            }
        })
    }

    /// Enables all drives and waits until every axis follows targets. Blocks.
    ///
    /// # Errors
    /// [`Cia402Error::AxisTimeout`] names the axes that are not enabled, with the state of each
    /// drive and what hinders it. Those that are enabled stay so.
    pub fn enable_all_timeout(
        &mut self,
        port: &mut Port,
        timeout_ms: u32,
        progress: impl FnMut(&AxisProgress),
    ) -> Result<(), Cia402Error> {
        self.enable_all()?;
        self.wait(port, timeout_ms, "enabled", progress, |axis| {
            if axis.is_running() {
                WaitStatus::Reached
            } else if axis.state.enabling_since_ns().is_none() && axis.state != AxisState::Resuming
            {
                WaitStatus::Stuck
            } else {
                WaitStatus::Waiting
            }
        })
    }

    /// The three calls above in a row: from drives in whatever state to axes that follow targets.
    /// Each may take `timeout_ms` milliseconds. Blocks.
    ///
    /// # Errors
    /// As those calls.
    pub fn start_up_timeout(
        &mut self,
        port: &mut Port,
        timeout_ms: u32,
        mut progress: impl FnMut(&AxisProgress),
    ) -> Result<(), Cia402Error> {
        self.configure_all_timeout(port, timeout_ms, &mut progress)?;
        self.request_actual_position_all_timeout(port, timeout_ms, &mut progress)?;
        self.enable_all_timeout(port, timeout_ms, progress)
    }

    /// Waits until changes of mode and homings of all axes are done. Blocks.
    ///
    /// # Errors
    /// [`Cia402Error::AxisTimeout`] names the axes whose last command failed, and why.
    pub fn finish_all_timeout(
        &mut self,
        port: &mut Port,
        timeout_ms: u32,
        progress: impl FnMut(&AxisProgress),
    ) -> Result<(), Cia402Error> {
        self.wait(port, timeout_ms, "done", progress, |axis| {
            if axis.procedure.is_some() || axis.state.enabling_since_ns().is_some() {
                WaitStatus::Waiting
            } else if axis.error.is_none() {
                WaitStatus::Reached
            } else {
                WaitStatus::Stuck
            }
        })
    }

    /// Ends in order, see [`begin_shutdown`](Self::begin_shutdown), and waits. Blocks.
    ///
    /// # Errors
    /// [`Cia402Error::AxisTimeout`] names the axes that could not be switched off; the end is
    /// complete all the same, as far as it goes.
    pub fn shutdown_timeout(
        &mut self,
        port: &mut Port,
        timeout_ms: u32,
        mut progress: impl FnMut(&AxisProgress),
    ) -> Result<(), Cia402Error> {
        self.begin_shutdown();
        let ended = run_cycle_uninterrupted(port, timeout_ms, |cycle, _| {
            self.serve(cycle);
            self.progress_all().for_each(|axis| progress(&axis));
            // The last commands must have left before the host does.
            let is_done = self.shutdown == Shutdown::Done && !self.network.nmt_is_pending();
            is_done.then_some(())
        });
        let is_on = |axis: &&Axis| axis.drive.is_enabled();
        let axes: Vec<AxisProgress> =
            self.axes.iter().filter(is_on).map(|axis| axis.progress(self.now_ns)).collect();
        match ended {
            Ok(()) if axes.is_empty() => Ok(()),
            Ok(()) | Err(WaitError::TimedOut { .. }) if !axes.is_empty() => {
                let waited_ms = timeout_ms.into();
                Err(AxisTimeout { what: "switched off", waited_ms, axes }.into())
            }
            Err(WaitError::TimedOut { .. }) | Ok(()) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }

    /// Runs the cycle until every axis is where it is to be, or cannot get there.
    fn wait(
        &mut self,
        port: &mut Port,
        timeout_ms: u32,
        what: &'static str,
        mut progress: impl FnMut(&AxisProgress),
        standing: impl Fn(&Axis) -> WaitStatus,
    ) -> Result<(), Cia402Error> {
        let start_ns = self.now_ns;
        let ended = run_cycle_until(port, timeout_ms, |cycle, _| {
            self.serve(cycle);
            self.progress_all().for_each(|axis| progress(&axis));
            let is_open = |axis: &Axis| standing(axis) == WaitStatus::Waiting;
            (!self.axes.iter().any(is_open)).then_some(())
        });
        match ended {
            Ok(()) | Err(WaitError::TimedOut { .. }) => {}
            Err(error) => return Err(error.into()),
        }
        let lacks = |axis: &&Axis| standing(axis) != WaitStatus::Reached;
        let axes: Vec<AxisProgress> =
            self.axes.iter().filter(lacks).map(|axis| axis.progress(self.now_ns)).collect();
        if axes.is_empty() {
            return Ok(());
        }
        let waited_ms = self.now_ns.saturating_sub(start_ns) / 1_000_000;
        Err(AxisTimeout { what, waited_ms, axes }.into())
    }
}
