//! Calls that wait: they run the cycle themselves until all axes have reached a state.

use std::time::Duration;

use ecan_canopen::{WaitError, run_cycle_uninterrupted, run_cycle_until};
use ecan_mcan_port::{Cycle, Port};

use super::cia402::Cia402;
use super::error::{AxisTimeout, Cia402Error};
use super::shutdown::{Shutdown, ShutdownDeadline};
use crate::axis::axis::Axis;
use crate::axis::axis_state::AxisState;
use crate::axis::phase::AxisProgress;
use crate::axis::setup::SetupState;
use crate::guard::terms::GuardState;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum WaitStatus {
    Waiting,
    Reached,
    /// Waiting will not reach it.
    Stuck,
}

impl Cia402 {
    /// Executes one cycle for a loop that has no targets of its own: receives, keeps the axes at
    /// their last targets, sends. Real-time safe.
    pub fn serve(&mut self, cycle: &mut Cycle<'_>) {
        self.process_rx(cycle);
        self.send_targets_all(cycle);
    }

    /// Configures every drive that is not configured, and waits. `progress` is called for every
    /// axis in every cycle. Blocks.
    ///
    /// # Errors
    /// [`Cia402Error::AxisTimeout`] names the axes that are not configured after all others have
    /// ended, or after `timeout`, with the step and the answer of each.
    pub fn configure_all_timeout(
        &mut self,
        port: &mut Port,
        timeout: Duration,
        progress: impl FnMut(&AxisProgress),
    ) -> Result<(), Cia402Error> {
        self.configure_all()?;
        self.wait(port, timeout, "configured", progress, |axis| match axis.setup {
            SetupState::Requested { .. } | SetupState::Configuring | SetupState::SettingMode(_) => {
                WaitStatus::Waiting
            }
            SetupState::Unconfigured | SetupState::Failed => WaitStatus::Stuck,
            SetupState::Complete => WaitStatus::Reached,
        })
    }

    /// Establishes the positions of all axes from fresh TPDOs, and waits. Blocks.
    ///
    /// # Errors
    /// [`Cia402Error::AxisTimeout`] names the axes whose position is unknown, and the cause.
    pub fn request_actual_position_all_timeout(
        &mut self,
        port: &mut Port,
        timeout: Duration,
        progress: impl FnMut(&AxisProgress),
    ) -> Result<(), Cia402Error> {
        self.read_position_all()?;
        self.wait(port, timeout, "at a known position", progress, |axis| match axis.guard.state() {
            GuardState::Armed { .. } | GuardState::Running { .. } => WaitStatus::Reached,
            GuardState::Draining | GuardState::Reading => WaitStatus::Waiting,
            GuardState::Idle | GuardState::Holding { .. } => WaitStatus::Stuck,
        })
    }

    /// Enables all drives and waits until every axis follows targets. Blocks.
    ///
    /// # Errors
    /// [`Cia402Error::AxisTimeout`] names the axes that are not enabled, with the state of each
    /// drive and the cause. Enabled drives remain enabled.
    pub fn enable_all_timeout(
        &mut self,
        port: &mut Port,
        timeout: Duration,
        progress: impl FnMut(&AxisProgress),
    ) -> Result<(), Cia402Error> {
        self.enable_all()?;
        self.wait(port, timeout, "enabled", progress, |axis| {
            let is_enabling = axis.state.enabling_since_ns().is_some();
            if axis.is_running() {
                WaitStatus::Reached
            } else if is_enabling || axis.state == AxisState::Resuming {
                WaitStatus::Waiting
            } else {
                WaitStatus::Stuck
            }
        })
    }

    /// The three calls above in a row: from drives in any state to axes that follow targets.
    /// `timeout` applies to each. Blocks.
    ///
    /// # Errors
    /// As those calls.
    pub fn start_up_timeout(
        &mut self,
        port: &mut Port,
        timeout: Duration,
        mut progress: impl FnMut(&AxisProgress),
    ) -> Result<(), Cia402Error> {
        self.configure_all_timeout(port, timeout, &mut progress)?;
        self.request_actual_position_all_timeout(port, timeout, &mut progress)?;
        self.enable_all_timeout(port, timeout, progress)
    }

    /// Brings all axes back to their targets, see [`recover`](Self::recover), and waits. Blocks.
    ///
    /// # Errors
    /// [`Cia402Error::AxisTimeout`] names the axes that do not follow targets, and the cause.
    pub fn recover_all_timeout(
        &mut self,
        port: &mut Port,
        timeout: Duration,
        progress: impl FnMut(&AxisProgress),
    ) -> Result<(), Cia402Error> {
        self.recover_all()?;
        self.wait(port, timeout, "recovered", progress, |axis| {
            if axis.recovery.is_some() {
                WaitStatus::Waiting
            } else if axis.follows_application() {
                WaitStatus::Reached
            } else {
                WaitStatus::Stuck
            }
        })
    }

    /// Waits until mode changes and homings of all axes are complete. Blocks.
    ///
    /// # Errors
    /// [`Cia402Error::AxisTimeout`] names the axes whose last command failed, and the cause.
    pub fn finish_all_timeout(
        &mut self,
        port: &mut Port,
        timeout: Duration,
        progress: impl FnMut(&AxisProgress),
    ) -> Result<(), Cia402Error> {
        self.wait(port, timeout, "done", progress, |axis| {
            if axis.procedure.is_some() || axis.state.enabling_since_ns().is_some() {
                WaitStatus::Waiting
            } else if axis.error.is_none() {
                WaitStatus::Reached
            } else {
                WaitStatus::Stuck
            }
        })
    }

    /// Starts an orderly end, see [`begin_shutdown`](Self::begin_shutdown), and waits until every axis
    /// has reported that it is off. While the gateway or the path is away, the whole `timeout` is used: at
    /// most half of it, and five seconds, for the ramps, the rest for switching off. Ignores the
    /// application's request to stop waiting. Blocks.
    ///
    /// # Errors
    /// [`Cia402Error::AxisTimeout`] names the axes that did not report that they are off, and may still
    /// move; all other parts of the shutdown are complete nevertheless.
    pub fn shutdown_timeout(
        &mut self,
        port: &mut Port,
        timeout: Duration,
        progress: impl FnMut(&AxisProgress),
    ) -> Result<(), Cia402Error> {
        self.begin_shutdown();
        let now_ns = port.adapter().clock().now_ns();
        self.shutdown_deadline = Some(ShutdownDeadline::after(now_ns, timeout));
        self.wait_stopped(port, timeout, AxisTimeout::SWITCHED_OFF, progress, |table| {
            // The last commands must be sent before the host ends.
            table.shutdown == Shutdown::Done && !table.network.nmt_is_pending()
        })
    }

    /// Stops all axes, see [`stop_all`](Self::stop_all), and waits until every one has reported that it has
    /// stopped, also while the gateway or the path is away. Ignores the application's request to stop
    /// waiting. Blocks.
    ///
    /// # Errors
    /// [`Cia402Error::AxisTimeout`] names the axes that did not report that they have stopped, and may
    /// still move. Their stop continues in later cycles.
    pub fn stop_all_timeout(
        &mut self,
        port: &mut Port,
        timeout: Duration,
        progress: impl FnMut(&AxisProgress),
    ) -> Result<(), Cia402Error> {
        self.stop_all();
        self.wait_stopped(port, timeout, AxisTimeout::STOPPED, progress, |_| true)
    }

    /// Runs the cycle until all axes have stopped and `is_complete` returns true.
    fn wait_stopped(
        &mut self,
        port: &mut Port,
        timeout: Duration,
        what: &'static str,
        mut progress: impl FnMut(&AxisProgress),
        is_complete: impl Fn(&Self) -> bool,
    ) -> Result<(), Cia402Error> {
        let ended = run_cycle_uninterrupted(port, timeout, |cycle, _| {
            self.serve(cycle);
            self.progress_all().for_each(|axis| progress(&axis));
            (self.all_stopped() && is_complete(self)).then_some(())
        });
        let Err(error) = ended else { return Ok(()) };
        let axes = self.progress_of(|axis| !axis.is_stopped(self.now_ns));
        let cycle_error = match error {
            WaitError::TimedOut { .. } if axes.is_empty() => return Ok(()),
            error if axes.is_empty() => return Err(error.into()),
            WaitError::Cycle(error) => Some(error),
            _ => None,
        };
        Err(AxisTimeout { what, waited: timeout, axes, cycle_error }.into())
    }

    fn wait(
        &mut self,
        port: &mut Port,
        timeout: Duration,
        what: &'static str,
        mut progress: impl FnMut(&AxisProgress),
        status: impl Fn(&Axis) -> WaitStatus,
    ) -> Result<(), Cia402Error> {
        let start_ns = self.now_ns;
        let ended = run_cycle_until(port, timeout, |cycle, _| {
            self.serve(cycle);
            self.progress_all().for_each(|axis| progress(&axis));
            let is_waiting = |axis: &Axis| status(axis) == WaitStatus::Waiting;
            (!self.axes.iter().any(is_waiting)).then_some(())
        });
        match ended {
            Ok(()) | Err(WaitError::TimedOut { .. }) => {}
            Err(error) => return Err(error.into()),
        }
        let axes = self.progress_of(|axis| status(axis) != WaitStatus::Reached);
        if axes.is_empty() {
            return Ok(());
        }
        let waited = Duration::from_nanos(self.now_ns.saturating_sub(start_ns));
        Err(AxisTimeout { what, waited, axes, cycle_error: None }.into())
    }

    pub(super) fn progress_of(&self, select: impl Fn(&Axis) -> bool) -> Vec<AxisProgress> {
        let selected = self.axes.iter().filter(|axis| select(axis));
        selected.map(|axis| axis.progress(self.now_ns)).collect()
    }
}
