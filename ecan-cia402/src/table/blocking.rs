//! Calls that exchange process data until they are complete, and the owner that stops all drives.

use std::io::Write;
use std::time::Duration;

use ecan_canopen::{
    BootPhase, BootProgress, BootState, Configurator, Configuring, Lss, LssCommand, LssFailure,
    LssResult, Network, NodeHandle, Sdo, SdoStartError, Step, WaitError, run_cycle_uninterrupted,
    run_cycle_until,
};
use ecan_mcan_port::{Cycle, Port};

use super::cia402::Cia402;
use super::error::{AxisTimeout, BootTimeout, Cia402Error};
use super::shutdown::{Shutdown, ShutdownDeadline};
use crate::axis::axis::Axis;
use crate::axis::error::CommandError;
use crate::axis::setup::SetupState;
use crate::axis::status::AxisProgress;
use crate::axis::task::AxisState;
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
        self.wait(port, timeout, "configured", progress, |axis| match axis.setup.state() {
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
        self.wait(port, timeout, "at a known position", progress, |axis| {
            match axis.path.guard().state() {
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
    /// drive and the cause. Enabled drives remain enabled.
    pub fn enable_all_timeout(
        &mut self,
        port: &mut Port,
        timeout: Duration,
        progress: impl FnMut(&AxisProgress),
    ) -> Result<(), Cia402Error> {
        self.enable_all()?;
        self.wait(port, timeout, "enabled", progress, |axis| {
            let is_enabling = axis.task.is_enabling();
            if axis.path.is_running() {
                WaitStatus::Reached
            } else if is_enabling || *axis.task.state() == AxisState::Resuming {
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
            if axis.task.recovery.is_some() {
                WaitStatus::Waiting
            } else if axis.path.follows_application() {
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
            if axis.task.procedure.is_some() || axis.task.is_enabling() {
                WaitStatus::Waiting
            } else if axis.report.error.is_none() {
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

    /// Waits until all mandatory nodes are booted ([`Network::boot`](ecan_canopen::Network::boot)). If one
    /// fails, it waits for the end of the other boot-ups of mandatory nodes. `progress` is called for every
    /// node in every cycle. The axes remain at their last targets. Blocks.
    ///
    /// # Errors
    /// [`Cia402Error::BootTimeout`] names the mandatory nodes that are not booted, with the cause of each;
    /// [`Cia402Error::Wait`].
    pub fn wait_booted_timeout(
        &mut self,
        port: &mut Port,
        timeout: Duration,
        mut progress: impl FnMut(&BootProgress),
    ) -> Result<(), Cia402Error> {
        let start_ns = self.now_ns;
        let ended = run_cycle_until(port, timeout, |cycle, now_ns| {
            self.serve(cycle);
            let mut is_booting = false;
            for node in self.network.boot_progress(now_ns) {
                let has_begun = node.phase != BootPhase::Waiting;
                is_booting |= node.is_mandatory && has_begun && !has_ended(node.phase);
                progress(&node);
            }
            match self.network.boot_state() {
                BootState::Booted => Some(()),
                BootState::Failed if !is_booting => Some(()),
                BootState::Failed | BootState::Running => None,
            }
        });
        match ended {
            Ok(()) | Err(WaitError::TimedOut { .. }) => {}
            Err(error) => return Err(error.into()),
        }
        let is_missing = |node: &BootProgress| node.is_mandatory && node.phase != BootPhase::Booted;
        let nodes: Vec<_> = self.network.boot_progress(self.now_ns).filter(is_missing).collect();
        if nodes.is_empty() {
            return Ok(());
        }
        let waited = Duration::from_nanos(self.now_ns.saturating_sub(start_ns));
        Err(BootTimeout { waited, nodes }.into())
    }

    /// Executes an LSS command on a channel of the network and waits, see
    /// [`Blocking::lss`](ecan_canopen::Blocking::lss). The axes remain at their last targets.
    /// Blocks.
    ///
    /// # Errors
    /// [`Cia402Error::Wait`] names channel, command and cause, or the timeout, with the command cancelled.
    pub fn lss_timeout(
        &mut self,
        port: &mut Port,
        (slave, channel): (usize, u8),
        command: LssCommand,
        timeout: Duration,
    ) -> Result<LssResult, Cia402Error> {
        self.network.start_lss(slave, channel, command).map_err(WaitError::from)?;
        let ended = run_cycle_until(port, timeout, |cycle, _| {
            self.serve(cycle);
            match self.network.lss_state(slave, channel) {
                Lss::Idle | Lss::Busy => None,
                Lss::Done(result) => Some(Ok(result)),
                Lss::Failed(fault) => Some(Err(LssFailure { slave, channel, command, fault })),
            }
        });
        match ended {
            Ok(result) => Ok(result.map_err(WaitError::from)?),
            Err(error) => {
                self.network.cancel_lss(slave, channel);
                Err(error.into())
            }
        }
    }

    /// Executes steps on a node and waits, for example those of a
    /// [`ParameterGroup`](ecan_canopen::ParameterGroup). The axes remain at their last targets; transfers of
    /// the axis itself come first. Returns the configurator with the values that the steps have read. Blocks.
    ///
    /// # Errors
    /// [`Cia402Error::Wait`] names the step that failed and its cause, or the timeout, with the steps cancelled.
    pub fn execute_timeout(
        &mut self,
        port: &mut Port,
        node: NodeHandle,
        steps: impl IntoIterator<Item = Step>,
        timeout: Duration,
    ) -> Result<Configurator, Cia402Error> {
        let mut configurator = Configurator::new();
        configurator.add(&self.network, node, steps);
        let ended = run_cycle_until(port, timeout, |cycle, now_ns| {
            self.serve(cycle);
            match configurator.step(&mut self.network, now_ns) {
                Configuring::Running => None,
                Configuring::Done => Some(Ok(())),
                Configuring::Failed(failure) => Some(Err(WaitError::from(failure))),
            }
        });
        if ended.is_err() {
            configurator.clear(&mut self.network);
        }
        ended??;
        Ok(configurator)
    }
}

/// Returns whether the drive of an axis reported something, and not that it has stopped.
fn may_move(axis: &Axis, now_ns: u64) -> bool {
    axis.link.has_reported() && !axis.is_stopped(now_ns)
}

/// Returns whether a boot-up does not continue.
fn has_ended(phase: BootPhase) -> bool {
    matches!(phase, BootPhase::Booted | BootPhase::Failed)
}

impl Cia402 {
    /// The node of an axis in [`network`](Self::network).
    pub fn node(&self, axis: usize) -> Option<NodeHandle> {
        self.axes.get(axis).map(|axis| axis.plan.node)
    }

    /// Uploads an object of a drive, given by index and subindex, and waits; the axes remain at
    /// their last targets. Transfers of the axis itself come first. Blocks.
    ///
    /// # Errors
    /// [`Cia402Error::Wait`] names node, object and cause, or the timeout;
    /// [`CommandError::NoSuchAxis`].
    pub fn upload_timeout(
        &mut self,
        port: &mut Port,
        axis: usize,
        (index, subindex): (u16, u8),
        timeout: Duration,
    ) -> Result<Vec<u8>, Cia402Error> {
        let node = self.node(axis).ok_or(CommandError::NoSuchAxis { axis })?;
        self.upload_node_timeout(port, node, (index, subindex), timeout)
    }

    /// Downloads an object of a drive and waits, as [`upload_timeout`](Self::upload_timeout).
    ///
    /// # Errors
    /// As there.
    pub fn download_timeout(
        &mut self,
        port: &mut Port,
        axis: usize,
        (index, subindex): (u16, u8),
        data: &[u8],
        timeout: Duration,
    ) -> Result<(), Cia402Error> {
        let node = self.node(axis).ok_or(CommandError::NoSuchAxis { axis })?;
        self.download_node_timeout(port, node, (index, subindex), data, timeout)
    }

    /// As [`upload_timeout`](Self::upload_timeout), of any node of the network.
    ///
    /// # Errors
    /// [`Cia402Error::Wait`].
    pub fn upload_node_timeout(
        &mut self,
        port: &mut Port,
        node: NodeHandle,
        (index, subindex): (u16, u8),
        timeout: Duration,
    ) -> Result<Vec<u8>, Cia402Error> {
        self.transfer_timeout(port, node, timeout, |network| {
            network.start_upload(node, index, subindex)
        })
    }

    /// As [`download_timeout`](Self::download_timeout), to any node of the network.
    ///
    /// # Errors
    /// [`Cia402Error::Wait`].
    pub fn download_node_timeout(
        &mut self,
        port: &mut Port,
        node: NodeHandle,
        (index, subindex): (u16, u8),
        data: &[u8],
        timeout: Duration,
    ) -> Result<(), Cia402Error> {
        self.transfer_timeout(port, node, timeout, |network| {
            network.start_download(node, index, subindex, data)
        })?;
        Ok(())
    }

    fn transfer_timeout(
        &mut self,
        port: &mut Port,
        node: NodeHandle,
        timeout: Duration,
        start: impl Fn(&mut Network) -> Result<(), SdoStartError>,
    ) -> Result<Vec<u8>, Cia402Error> {
        let mut own = None;
        let ended = run_cycle_until(port, timeout, |cycle, _| {
            self.serve(cycle);
            let network = &mut self.network;
            // An axis may use the client in the cycle in which a transfer ends. The result is
            // lost then, and the transfer starts again.
            if own == Some(network.sdo_generation(node)) {
                return match network.sdo_state(node) {
                    Sdo::Busy => None,
                    _ => Some(match network.sdo_failure(node) {
                        None => Ok(network.sdo_data(node).to_vec()),
                        Some(failure) => Err(WaitError::from(failure)),
                    }),
                };
            }
            match start(network) {
                Ok(()) => own = Some(network.sdo_generation(node)),
                Err(SdoStartError::Busy) => {}
                Err(error) => return Some(Err(error.into())),
            }
            None
        });
        if ended.is_err() && own == Some(self.network.sdo_generation(node)) {
            self.network.cancel_sdo(node);
        }
        Ok(ended??)
    }

    /// Longest time for which the end of a program waits until the axes have stopped
    /// ([`stop_before_end`](Self::stop_before_end), [`AxisOwner`], the deinit functions of C); 10 s.
    pub fn stop_time(&self) -> Duration {
        self.stop_time
    }

    /// Sets the time for which the end of a program waits. Zero leaves the axes as they are, for a program
    /// whose successor adopts them ([`Takeover::Adopt`](crate::Takeover::Adopt)).
    pub fn set_stop_time(&mut self, stop_time: Duration) {
        self.stop_time = stop_time;
    }

    /// Returns whether the drive of an axis may be moving or may begin to: it reported something, and not
    /// that it has stopped.
    pub fn may_move(&self, axis: usize) -> bool {
        self.axis(axis).is_some_and(|axis| may_move(axis, self.now_ns))
    }

    /// Stops the axes that may move, as [`stop_all_timeout`](Self::stop_all_timeout), at most for the
    /// [`stop_time`](Self::stop_time). Returns at once if no axis may move. Blocks. For the end of a program; in order
    /// it ends by [`shutdown_timeout`](Self::shutdown_timeout).
    ///
    /// # Errors
    /// [`Cia402Error::AxisTimeout`] names the axes that may still move. On a master of another owner
    /// this call cannot run the cycle, and names them at once.
    pub fn stop_before_end(&mut self, port: &mut Port) -> Result<(), Cia402Error> {
        if self.stop_time.is_zero() || !self.axes.iter().any(|axis| may_move(axis, self.now_ns)) {
            return Ok(());
        }
        if port.adapter().is_attached() {
            let axes = self.progress_of(|axis| may_move(axis, self.now_ns));
            let (what, waited) = (AxisTimeout::STOPPED, Duration::ZERO);
            return Err(AxisTimeout { what, waited, axes, cycle_error: None }.into());
        }
        self.stop_all_timeout(port, self.stop_time, |_| {})
    }
}

/// A Port and the axes on it, which are stopped when this value is dropped: also by an error that leaves the
/// function with `?`. A [`Cia402`] alone has no Port, so that its end sends nothing.
///
/// The drop waits until the axes have stopped, at most for the [`stop_time`](Cia402::stop_time), and
/// then names those that may still move on standard error and in the log. It does not wait during a panic, which
/// may have left the application in any state: then the watch of the host by the drives stops them
/// ([`Cia402::host_loss`]). Nor does it after `std::process::exit` or a signal that ends the process.
///
/// ```no_run
/// # use ecan_cia402::{AxisOwner, Cia402};
/// # fn machine(port: ecan_mcan_port::Port, cia402: Cia402) -> Result<(), Box<dyn std::error::Error>> {
/// let mut owner = AxisOwner::new(port, cia402);
/// let (port, axes) = owner.parts();
/// let mut cycle = port.next_cycle();
/// axes.process_rx(&mut cycle);
/// axes.send_targets_all(&mut cycle);
/// cycle.end()?; // an error stops the axes
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct AxisOwner {
    port: Port,
    cia402: Cia402,
}

impl AxisOwner {
    /// Owns a Port and the axes that were created on it.
    pub fn new(port: Port, cia402: Cia402) -> Self {
        Self { port, cia402 }
    }

    /// The Port and the axes, for a cycle or a call that waits.
    pub fn parts(&mut self) -> (&mut Port, &mut Cia402) {
        (&mut self.port, &mut self.cia402)
    }

    /// The Port.
    pub fn port(&self) -> &Port {
        &self.port
    }

    /// The axes.
    pub fn cia402(&self) -> &Cia402 {
        &self.cia402
    }
}

impl Drop for AxisOwner {
    fn drop(&mut self) {
        if std::thread::panicking() {
            return;
        }
        if let Err(error) = self.cia402.stop_before_end(&mut self.port) {
            tracing::error!("{error}");
            // A closed standard error has no effect.
            let _ = writeln!(std::io::stderr(), "{error}; remove the power of a motor that moves");
        }
    }
}
