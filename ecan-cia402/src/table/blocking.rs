//! Calls that exchange process data until they are complete, and the owner that stops all drives.

use std::fmt;
use std::io::Write;
use std::time::Duration;

use ecan_canopen::{
    BootPhase, BootProgress, BootState, Changes, Configurator, Configuring, Lss, LssCommand,
    LssFailure, LssResult, Network, NodeHandle, Sdo, SdoStartError, Step, WaitError,
    run_cycle_uninterrupted, run_cycle_until,
};
use ecan_mcan_port::{BusChange, BusWatch, Port};

use super::cia402::Cia402;
use super::shutdown::Shutdown;
use super::table_config::{AxisTimeout, BootTimeout, Cia402Error};
use crate::axis::axis::{Axis, AxisCommand, StopKind};
use crate::axis::setup::SetupState;
use crate::axis::status::{AxisError, AxisPhase, AxisProgress};
use crate::axis::task::AxisState;
use crate::guard::terms::GuardState;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum WaitStatus {
    Waiting,
    Reached,
    /// Waiting will not reach it.
    Stuck,
}

/// Calls that run the cycle until they are complete, by [`Cia402::blocking`]. The axes get no targets of the
/// application meanwhile: they remain at their last ones. Each call blocks, at most for the timeout.
///
/// ```no_run
/// # use ecan_cia402::{Cia402, Cia402Error};
/// # fn start(cia402: &mut Cia402, port: &mut ecan_mcan_port::Port) -> Result<(), Cia402Error> {
/// let timeout = std::time::Duration::from_secs(20);
/// cia402.blocking(port, timeout).on_progress(|axis| println!("{axis}")).start_up()
/// # }
/// ```
pub struct Blocking<'a> {
    table: &'a mut Cia402,
    port: &'a mut Port,
    timeout: Duration,
    reports: Reports<'a>,
}

impl fmt::Debug for Blocking<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Blocking").field("timeout", &self.timeout).finish_non_exhaustive()
    }
}

type OnProgress<'a> = Box<dyn FnMut(&AxisProgress) + 'a>;
type BusReports<'a> = (&'a mut BusWatch, Box<dyn FnMut(&BusChange) + 'a>);

/// What the application is told while it waits.
#[derive(Default)]
struct Reports<'a> {
    progress: Option<OnProgress<'a>>,
    reported: Changes<(AxisPhase, Option<AxisError>)>,
    bus: Option<BusReports<'a>>,
}

impl Reports<'_> {
    /// Reports the axes whose phase or error is new, and the changes of the bus.
    fn report(&mut self, table: &Cia402, port: &Port) {
        if let Some(progress) = &mut self.progress {
            for axis in table.axes() {
                let axis = axis.progress();
                if self.reported.is_new(axis.axis, (axis.phase, axis.error)) {
                    progress(&axis);
                }
            }
        }
        if let Some((watch, on_change)) = &mut self.bus {
            watch.changes(port).for_each(|change| on_change(&change));
        }
    }
}

impl<'a> Blocking<'a> {
    pub(super) fn new(table: &'a mut Cia402, port: &'a mut Port, timeout: Duration) -> Self {
        Self { table, port, timeout, reports: Reports::default() }
    }

    /// Calls `progress` for each axis at the start, and when its phase or its error changes.
    #[must_use]
    pub fn on_progress(mut self, progress: impl FnMut(&AxisProgress) + 'a) -> Self {
        self.reports.progress = Some(Box::new(progress));
        self
    }

    /// Calls `on_change` for each change that a watch of the bus tells, until the axes are configured, enabled or
    /// stopped.
    #[must_use]
    pub fn on_bus_change(
        mut self,
        watch: &'a mut BusWatch,
        on_change: impl FnMut(&BusChange) + 'a,
    ) -> Self {
        self.reports.bus = Some((watch, Box::new(on_change)));
        self
    }

    /// [`configure`](Self::configure), [`read_positions`](Self::read_positions) and [`enable`](Self::enable) in
    /// a row: from drives in any state to axes that follow targets. The timeout applies to each.
    ///
    /// # Errors
    /// As those calls.
    pub fn start_up(&mut self) -> Result<(), Cia402Error> {
        self.configure()?;
        self.read_positions()?;
        self.enable()
    }

    /// Configures every drive that is not configured.
    ///
    /// # Errors
    /// [`Cia402Error::AxisTimeout`] names the axes that are not configured after all others have
    /// ended, or after the timeout, with the step and the answer of each.
    pub fn configure(&mut self) -> Result<(), Cia402Error> {
        self.table.command_all(AxisCommand::Configure)?;
        self.wait("configured", |axis| match axis.setup.state() {
            SetupState::Requested { .. } | SetupState::Configuring | SetupState::SettingMode(_) => {
                WaitStatus::Waiting
            }
            SetupState::Unconfigured | SetupState::Failed => WaitStatus::Stuck,
            SetupState::Complete => WaitStatus::Reached,
        })
    }

    /// Establishes the positions of all axes from fresh TPDOs.
    ///
    /// # Errors
    /// [`Cia402Error::AxisTimeout`] names the axes whose position is unknown, and the cause.
    pub fn read_positions(&mut self) -> Result<(), Cia402Error> {
        self.table.command_all(AxisCommand::ReadPosition)?;
        self.wait("at a known position", |axis| match axis.path.guard().state() {
            GuardState::Armed { .. } | GuardState::Running { .. } => WaitStatus::Reached,
            GuardState::Draining | GuardState::Reading => WaitStatus::Waiting,
            GuardState::Idle | GuardState::Holding { .. } => WaitStatus::Stuck,
        })
    }

    /// Enables all drives and waits until every axis follows targets.
    ///
    /// # Errors
    /// [`Cia402Error::AxisTimeout`] names the axes that are not enabled, with the state of each
    /// drive and the cause. Enabled drives remain enabled.
    pub fn enable(&mut self) -> Result<(), Cia402Error> {
        self.table.command_all(AxisCommand::Enable)?;
        self.wait("enabled", |axis| {
            if axis.path.is_running() {
                WaitStatus::Reached
            } else if axis.task.is_enabling() || *axis.task.state() == AxisState::Resuming {
                WaitStatus::Waiting
            } else {
                WaitStatus::Stuck
            }
        })
    }

    /// Brings all axes back to their targets, see [`AxisHandle::recover`](crate::AxisHandle::recover).
    ///
    /// # Errors
    /// [`Cia402Error::AxisTimeout`] names the axes that do not follow targets, and the cause.
    pub fn recover(&mut self) -> Result<(), Cia402Error> {
        self.table.command_all(AxisCommand::Recover)?;
        self.wait("recovered", |axis| {
            if axis.task.recovery.is_some() {
                WaitStatus::Waiting
            } else if axis.path.follows_application() {
                WaitStatus::Reached
            } else {
                WaitStatus::Stuck
            }
        })
    }

    /// Waits until mode changes and homings of all axes are complete.
    ///
    /// # Errors
    /// [`Cia402Error::AxisTimeout`] names the axes whose last command failed, and the cause.
    pub fn finish(&mut self) -> Result<(), Cia402Error> {
        self.wait("done", |axis| {
            if axis.task.procedure.is_some() || axis.task.is_enabling() {
                WaitStatus::Waiting
            } else if axis.report.error.is_none() {
                WaitStatus::Reached
            } else {
                WaitStatus::Stuck
            }
        })
    }

    /// Starts an orderly end, see [`Cia402::begin_shutdown`], and waits until every axis
    /// has reported that it is off. While the gateway or the path is away, the whole timeout is used: at
    /// most half of it, and five seconds, for the ramps, the rest for switching off. Ignores the
    /// application's request to stop waiting.
    ///
    /// # Errors
    /// [`Cia402Error::AxisTimeout`] names the axes that did not report that they are off, and may still
    /// move; all other parts of the shutdown are complete nevertheless.
    pub fn shut_down(&mut self) -> Result<(), Cia402Error> {
        self.table.begin_shutdown();
        self.table.ending.set_deadline(self.port.adapter().clock().now_ns(), self.timeout);
        self.wait_stopped(AxisTimeout::SWITCHED_OFF, |table| {
            // The last commands must be sent before the host ends.
            table.shutdown_state() == Shutdown::Done && !table.network.nmt_is_pending()
        })
    }

    /// Stops all axes by [`StopKind::QuickStopThenDisable`], and waits until every one has reported that it has
    /// stopped, also while the gateway or the path is away. Ignores the application's request to stop
    /// waiting.
    ///
    /// # Errors
    /// [`Cia402Error::AxisTimeout`] names the axes that did not report that they have stopped, and may
    /// still move. Their stop continues in later cycles.
    pub fn stop(&mut self) -> Result<(), Cia402Error> {
        self.table.command_all(AxisCommand::Stop(StopKind::QuickStopThenDisable))?;
        self.wait_stopped(AxisTimeout::STOPPED, |_| true)
    }

    /// Runs the cycle until all axes have stopped and `is_complete` returns true.
    fn wait_stopped(
        &mut self,
        what: &'static str,
        is_complete: impl Fn(&Cia402) -> bool,
    ) -> Result<(), Cia402Error> {
        let Self { table, port, timeout, reports } = self;
        let ended = run_cycle_uninterrupted(port, *timeout, |cycle, _| {
            table.serve(cycle);
            reports.report(table, cycle);
            (table.all_stopped() && is_complete(table)).then_some(())
        });
        let Err(error) = ended else { return Ok(()) };
        let axes = table.progress_of(|axis| !axis.is_stopped(table.now_ns));
        let cycle_error = match error {
            WaitError::TimedOut { .. } if axes.is_empty() => return Ok(()),
            error if axes.is_empty() => return Err(error.into()),
            WaitError::Cycle(error) => Some(error),
            _ => None,
        };
        Err(AxisTimeout { what, waited: *timeout, axes, cycle_error }.into())
    }

    fn wait(
        &mut self,
        what: &'static str,
        status: impl Fn(&Axis) -> WaitStatus,
    ) -> Result<(), Cia402Error> {
        let Self { table, port, timeout, reports } = self;
        let start_ns = table.now_ns;
        let ended = run_cycle_until(port, *timeout, |cycle, _| {
            table.serve(cycle);
            reports.report(table, cycle);
            let is_waiting = |axis: &Axis| status(axis) == WaitStatus::Waiting;
            (!table.axes.iter().any(is_waiting)).then_some(())
        });
        match ended {
            Ok(()) | Err(WaitError::TimedOut { .. }) => {}
            Err(error) => return Err(error.into()),
        }
        let axes = table.progress_of(|axis| status(axis) != WaitStatus::Reached);
        if axes.is_empty() {
            return Ok(());
        }
        let waited = Duration::from_nanos(table.now_ns.saturating_sub(start_ns));
        Err(AxisTimeout { what, waited, axes, cycle_error: None }.into())
    }

    /// Waits until all mandatory nodes are booted ([`Network::boot`]). If one
    /// fails, it waits for the end of the other boot-ups of mandatory nodes. `progress` is called for each
    /// phase of a node, at its begin.
    ///
    /// # Errors
    /// [`Cia402Error::BootTimeout`] names the mandatory nodes that are not booted, with the cause of each;
    /// [`Cia402Error::Wait`].
    pub fn wait_booted(
        &mut self,
        mut progress: impl FnMut(&BootProgress),
    ) -> Result<(), Cia402Error> {
        let table = &mut *self.table;
        let start_ns = table.now_ns;
        let mut changes = Changes::default();
        let ended = run_cycle_until(self.port, self.timeout, |cycle, now_ns| {
            table.serve(cycle);
            let mut is_booting = false;
            for (nth, node) in table.network.boot_progress(now_ns).enumerate() {
                let has_begun = node.phase != BootPhase::Waiting;
                let has_ended = matches!(node.phase, BootPhase::Booted | BootPhase::Failed);
                is_booting |= node.is_mandatory && has_begun && !has_ended;
                if changes.is_new(nth, node.phase) {
                    progress(&node);
                }
            }
            match table.network.boot_state() {
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
        let nodes: Vec<_> = table.network.boot_progress(table.now_ns).filter(is_missing).collect();
        if nodes.is_empty() {
            return Ok(());
        }
        let waited = Duration::from_nanos(table.now_ns.saturating_sub(start_ns));
        Err(BootTimeout { waited, nodes }.into())
    }

    /// Executes an LSS command on a channel of the network, see
    /// [`Blocking::lss`](ecan_canopen::Blocking::lss).
    ///
    /// # Errors
    /// [`Cia402Error::Wait`] names channel, command and cause, or the timeout, with the command cancelled.
    pub fn lss(
        &mut self,
        (slave, channel): (usize, u8),
        command: LssCommand,
    ) -> Result<LssResult, Cia402Error> {
        let table = &mut *self.table;
        table.network.start_lss(slave, channel, command).map_err(WaitError::from)?;
        let ended = run_cycle_until(self.port, self.timeout, |cycle, _| {
            table.serve(cycle);
            match table.network.lss_state(slave, channel) {
                Lss::Idle | Lss::Busy => None,
                Lss::Done(result) => Some(Ok(result)),
                Lss::Failed(fault) => Some(Err(LssFailure { slave, channel, command, fault })),
            }
        });
        match ended {
            Ok(result) => Ok(result.map_err(WaitError::from)?),
            Err(error) => {
                table.network.cancel_lss(slave, channel);
                Err(error.into())
            }
        }
    }

    /// Executes steps on a node, for example those of a
    /// [`ParameterGroup`](ecan_canopen::ParameterGroup); transfers of
    /// the axis itself come first. Returns the configurator with the values that the steps have read.
    ///
    /// # Errors
    /// [`Cia402Error::Wait`] names the step that failed and its cause, or the timeout, with the steps cancelled.
    pub fn execute(
        &mut self,
        node: NodeHandle,
        steps: impl IntoIterator<Item = Step>,
    ) -> Result<Configurator, Cia402Error> {
        let table = &mut *self.table;
        let mut configurator = Configurator::new();
        configurator.add(&table.network, node, steps);
        let ended = run_cycle_until(self.port, self.timeout, |cycle, now_ns| {
            table.serve(cycle);
            match configurator.step(&mut table.network, now_ns) {
                Configuring::Running => None,
                Configuring::Done => Some(Ok(())),
                Configuring::Failed(failure) => Some(Err(WaitError::from(failure))),
            }
        });
        if ended.is_err() {
            configurator.clear(&mut table.network);
        }
        ended??;
        Ok(configurator)
    }

    /// Uploads an object of a [node](crate::AxisRef::node), given by index and subindex. Transfers of the axis itself
    /// come first.
    ///
    /// # Errors
    /// [`Cia402Error::Wait`] names node, object and cause, or the timeout.
    pub fn upload(
        &mut self,
        node: NodeHandle,
        (index, subindex): (u16, u8),
    ) -> Result<Vec<u8>, Cia402Error> {
        self.transfer(node, |network| network.start_upload(node, index, subindex))
    }

    /// Downloads an object of a node, as [`upload`](Self::upload).
    ///
    /// # Errors
    /// As there.
    pub fn download(
        &mut self,
        node: NodeHandle,
        (index, subindex): (u16, u8),
        data: &[u8],
    ) -> Result<(), Cia402Error> {
        self.transfer(node, |network| network.start_download(node, index, subindex, data))?;
        Ok(())
    }

    fn transfer(
        &mut self,
        node: NodeHandle,
        start: impl Fn(&mut Network) -> Result<(), SdoStartError>,
    ) -> Result<Vec<u8>, Cia402Error> {
        let table = &mut *self.table;
        let mut own = None;
        let ended = run_cycle_until(self.port, self.timeout, |cycle, _| {
            table.serve(cycle);
            let network = &mut table.network;
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
        if ended.is_err() && own == Some(table.network.sdo_generation(node)) {
            table.network.cancel_sdo(node);
        }
        Ok(ended??)
    }
}

/// A Port and the axes on it, which are stopped when this value is dropped: also by an error that leaves the
/// function with `?`. A [`Cia402`] alone has no Port, so that its end sends nothing.
///
/// The drop waits until the axes have stopped, at most for the [`stop_time`](Cia402::stop_time), and
/// then names those that may still move on standard error and in the log. It does not wait during a panic, which
/// may have left the application in any state: then the watch of the host by the drives stops them
/// ([`AxisRef::host_loss`](crate::AxisRef::host_loss)). Nor does it after `std::process::exit` or a signal that ends the process.
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
