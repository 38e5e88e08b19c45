//! Handles of the table: state of an axis, commands to axes, and calls that wait.

use std::time::Duration;

use ecan_canopen::{DriveState, Network, NodeHandle, OperatingMode, Probe};
use ecan_mcan_port::Port;

use super::blocking::Blocking;
use super::cia402::Cia402;
use super::shutdown::Shutdown;
use super::table_config::{AxisTimeout, Cia402Error};
use crate::axis::axis::{Axis, AxisCommand, StopKind};
use crate::axis::config::AxisConfig;
use crate::axis::error::CommandError;
use crate::axis::host_loss::HostLoss;
use crate::axis::procedure::HomingConfig;
use crate::axis::process_data::{Output, ProbeState};
use crate::axis::setup::DriveValues;
use crate::axis::status::{AxisError, AxisPhase, AxisProgress, AxisStatistics};
use crate::axis::targets::interpolation_time;
use crate::axis::units::UnitError;
use crate::guard::feed_forward::FeedForward;
use crate::guard::motion_guard::MotionGuard;
use crate::guard::terms::Decision;
use crate::observation::AxisStatus;

impl Cia402 {
    /// Number of axes.
    pub fn axis_count(&self) -> usize {
        self.axes.len()
    }

    /// State of an axis; `None` for an index out of range.
    pub fn axis(&self, index: usize) -> Option<AxisRef<'_>> {
        let axis = self.axes.get(index)?;
        Some(AxisRef { axis, network: &self.network, now_ns: self.now_ns })
    }

    /// State of all axes, in the order of the table.
    pub fn axes(&self) -> impl Iterator<Item = AxisRef<'_>> {
        let (network, now_ns) = (&self.network, self.now_ns);
        self.axes.iter().map(move |axis| AxisRef { axis, network, now_ns })
    }

    /// Commands to an axis.
    ///
    /// # Errors
    /// [`CommandError::NoSuchAxis`].
    #[inline]
    pub fn axis_mut(&mut self, index: usize) -> Result<AxisHandle<'_>, CommandError> {
        if index >= self.axes.len() {
            return Err(CommandError::NoSuchAxis { axis: index });
        }
        Ok(AxisHandle { table: self, index })
    }

    /// Gives a command to every axis, also after a rejection. [`AxisCommand::Configure`] goes only to those that
    /// are not configured. Real-time safe.
    ///
    /// # Errors
    /// The first [`CommandError`].
    pub fn command_all(&mut self, command: AxisCommand) -> Result<(), CommandError> {
        let mut result = Ok(());
        for index in 0..self.axes.len() {
            let is_done = command == AxisCommand::Configure
                && self.axes.get(index).is_some_and(|axis| {
                    axis.setup.is_complete() || axis.setup.state().is_pending()
                });
            if !is_done {
                result = result.and(self.command(index, command));
            }
        }
        result
    }

    pub(super) fn command(
        &mut self,
        axis: usize,
        command: AxisCommand,
    ) -> Result<(), CommandError> {
        let Self { axes, network, shared_nodes, now_ns, .. } = self;
        match command {
            AxisCommand::Configure => {
                if let Some(node) = shared_nodes.iter().find(|node| node.contains(axis)) {
                    node.for_each(axes, |axis| {
                        // infallible: any axis can be configured
                        let _ = axis.execute(command, network, *now_ns);
                    });
                    return Ok(());
                }
            }
            AxisCommand::Recover if self.ending.state() != Shutdown::None => {
                return Err(CommandError::ShuttingDown { axis });
            }
            AxisCommand::ChangeMode(
                OperatingMode::CyclicPosition | OperatingMode::InterpolatedPosition,
            ) if interpolation_time(self.bus.target_period_ns).is_none() => {
                let period_ns = self.bus.target_period_ns;
                return Err(CommandError::TargetPeriod { axis, period_ns });
            }
            _ => {}
        }
        let found = axes.get_mut(axis).ok_or(CommandError::NoSuchAxis { axis })?;
        found.execute(command, network, *now_ns)
    }

    /// Returns whether all axes follow the application's targets; false without axes.
    pub fn all_running(&self) -> bool {
        !self.axes.is_empty() && self.axes().all(AxisRef::is_running)
    }

    /// Returns whether all axes have stopped, see [`AxisRef::is_stopped`].
    pub fn all_stopped(&self) -> bool {
        self.axes().all(AxisRef::is_stopped)
    }

    /// The axes whose drives would run on or coast if the host were lost, or whose reaction is
    /// unknown; for the startup report of an application. Each is also logged once, as a warning, at
    /// the end of its configuration.
    pub fn host_loss_risks(&self) -> impl Iterator<Item = HostLoss> + '_ {
        let all = self.axes().map(AxisRef::host_loss);
        all.filter(|loss| !loss.reaction.is_controlled_stop())
    }

    /// Calls that run the cycle of the Port until they are complete, each at most for `timeout`.
    pub fn blocking<'a>(&'a mut self, port: &'a mut Port, timeout: Duration) -> Blocking<'a> {
        Blocking::new(self, port, timeout)
    }

    /// Stops the axes that may move, as [`Blocking::stop`], at most for the
    /// [`stop_time`](Self::stop_time). Returns at once if no axis may move. Blocks. For the end of a program; in order
    /// it ends by [`Blocking::shut_down`].
    ///
    /// # Errors
    /// [`Cia402Error::AxisTimeout`] names the axes that may still move. On a master of another owner
    /// this call cannot run the cycle, and names them at once.
    pub fn stop_before_end(&mut self, port: &mut Port) -> Result<(), Cia402Error> {
        if self.stop_time().is_zero() || !self.axes().any(AxisRef::may_move) {
            return Ok(());
        }
        if port.adapter().is_attached() {
            let moving = self.axes().filter(|axis| axis.may_move());
            let axes = moving.map(AxisRef::progress).collect();
            let (what, waited) = (AxisTimeout::STOPPED, Duration::ZERO);
            return Err(AxisTimeout { what, waited, axes, cycle_error: None }.into());
        }
        let stop_time = self.stop_time();
        self.blocking(port, stop_time).stop()
    }
}

/// State of an axis, by [`Cia402::axis`] or [`Cia402::axes`]. All calls are real-time safe.
#[derive(Debug, Clone, Copy)]
pub struct AxisRef<'a> {
    pub(super) axis: &'a Axis,
    pub(super) network: &'a Network,
    pub(super) now_ns: u64,
}

impl<'a> AxisRef<'a> {
    /// Index in the axis table.
    pub fn index(self) -> usize {
        self.axis.plan.index
    }

    /// Configuration of the axis.
    pub fn config(self) -> &'a AxisConfig {
        &self.axis.plan.config
    }

    /// The node of the axis in [`Cia402::network`].
    pub fn node(self) -> NodeHandle {
        self.axis.plan.node
    }

    /// Status of the axis, complete.
    pub fn status(self) -> AxisStatus {
        AxisStatus::of(self.axis, self.network, self.now_ns)
    }

    /// Progress of the axis: phase, time in it, and error.
    pub fn progress(self) -> AxisProgress {
        self.axis.progress(self.now_ns)
    }

    /// Phase of the axis.
    pub fn phase(self) -> AxisPhase {
        self.axis.report.phase()
    }

    /// Failure of the last command to the axis.
    pub fn error(self) -> Option<AxisError> {
        self.axis.report.error
    }

    /// Counters of the axis.
    pub fn statistics(self) -> AxisStatistics {
        self.axis.report.statistics
    }

    /// Mode that the drive has confirmed; before that, the configured one.
    pub fn mode(self) -> OperatingMode {
        self.axis.path.mode()
    }

    /// The state in the last statusword.
    pub fn drive_state(self) -> Option<DriveState> {
        self.axis.link.drive().state
    }

    /// Values that the configuration read from the drive.
    pub fn drive(self) -> &'a DriveValues {
        self.axis.setup.values()
    }

    /// Returns whether the drive is configured.
    pub fn is_configured(self) -> bool {
        self.axis.setup.is_complete()
    }

    /// Returns whether the axis follows the application's targets; false while it is halted.
    pub fn is_running(self) -> bool {
        self.axis.path.follows_application()
    }

    /// Returns whether a halted axis is at rest; true for an axis that is not running.
    pub fn is_at_rest(self) -> bool {
        self.axis.is_at_rest()
    }

    /// Returns whether the axis has stopped: its drive reported that it is off or at rest in Quick Stop Active,
    /// or has never reported anything. False while the axis is active, is being stopped or is uncontrolled, and
    /// while a drive that never reported anything is being configured.
    pub fn is_stopped(self) -> bool {
        self.axis.is_stopped(self.now_ns)
    }

    /// Returns whether the drive may be moving or may begin to: it reported something, and not that it has
    /// stopped.
    pub fn may_move(self) -> bool {
        self.axis.link.has_reported() && !self.is_stopped()
    }

    /// Returns whether the drive has reached its target: in PP it has accepted the target in force and reports
    /// it as reached, in PV and PT it reports its speed or torque as reached (statusword bit 10).
    /// False in the cyclic modes, and while a new target is not sent yet.
    pub fn is_target_reached(self) -> bool {
        self.axis.path.is_target_reached(self.axis.link.drive())
    }

    /// Returns whether a recovery continues.
    pub fn is_recovering(self) -> bool {
        self.axis.task.recovery.is_some()
    }

    /// The last target sent to an axis that follows targets; the next is compared with it.
    pub fn target(self) -> Option<i32> {
        self.axis.path.target()
    }

    /// The last usable actual position, in steps; `None` before the first.
    /// [`actual_age`](Self::actual_age) is its age.
    pub fn actual(self) -> Option<i32> {
        self.axis.path.guard().actual()
    }

    /// Age of the actual position in cycles; 0 is this cycle, 65535 is more or never.
    pub fn actual_age(self) -> u16 {
        self.axis.path.guard().actual_age()
    }

    /// Following error of a running axis in steps, see [`AxisStatus::following_error`].
    pub fn following_error(self) -> Option<i64> {
        Some(self.config().range.distance(self.actual()?, self.target()?))
    }

    /// Decision about the target in the last [`Cia402::send_targets_all`].
    pub fn decision(self) -> Decision {
        self.axis.path.decision()
    }

    /// The motion guard of the axis.
    pub fn guard(self) -> &'a MotionGuard {
        self.axis.path.guard()
    }

    /// Reaction of the drive to the loss of the host (its end, `kill`, or the link), in the present
    /// mode, by the options that it reported.
    pub fn host_loss(self) -> HostLoss {
        self.axis.host_loss(self.network)
    }

    /// State of a touch probe, with the positions that it has sampled since it was armed.
    pub fn probe(self, probe: Probe) -> ProbeState {
        self.axis.data.probe(probe)
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Position {
    Raw(i32),
    Degrees(f64),
    Radians(f64),
}

/// Target of an axis: raw units of the mode (steps, velocity or torque), or an angle by the
/// [scale](AxisConfig::scale) of the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    position: Position,
    feed_forward: Option<FeedForward>,
}

impl From<i32> for Target {
    fn from(raw: i32) -> Self {
        Self { position: Position::Raw(raw), feed_forward: None }
    }
}

impl Target {
    /// An angle in degrees.
    pub fn degrees(degrees: f64) -> Self {
        Self { position: Position::Degrees(degrees), feed_forward: None }
    }

    /// An angle in radians.
    pub fn radians(radians: f64) -> Self {
        Self { position: Position::Radians(radians), feed_forward: None }
    }

    /// Adds a feed-forward for this target, which the drive adds to the demand of its controllers. Needs
    /// [`OutputObject::VelocityOffset`](crate::OutputObject::VelocityOffset) or
    /// [`TorqueOffset`](crate::OutputObject::TorqueOffset) in the [outputs](crate::PdoConfig::outputs); the value of
    /// an object that is not mapped has no effect.
    ///
    /// The feed-forward is limited, and changes by at most its limit per target
    /// ([`AxisConfig::feed_forward`]); [`AxisStatus::feed_forward`] is the one in force. It belongs to this
    /// target: give it in every cycle. For a target without one, a repeated or rejected one, and while the host
    /// moves the axis, it returns to 0 by its changes; when the axis holds or is stopped it ends at once.
    #[must_use]
    pub fn with_feed_forward(self, feed_forward: FeedForward) -> Self {
        Self { feed_forward: Some(feed_forward), ..self }
    }

    fn raw(self, config: &AxisConfig) -> Result<i32, UnitError> {
        match self.position {
            Position::Raw(raw) => Ok(raw),
            Position::Degrees(degrees) => config.scale.from_degrees(degrees, config.range),
            Position::Radians(radians) => config.scale.from_radians(radians, config.range),
        }
    }
}

/// Commands to an axis, by [`Cia402::axis_mut`]. Each starts an operation; [`AxisRef::progress`] reports its
/// phase, its time and its error. All calls are real-time safe.
#[derive(Debug)]
pub struct AxisHandle<'a> {
    pub(super) table: &'a mut Cia402,
    pub(super) index: usize,
}

impl AxisHandle<'_> {
    /// Starts the configuration of the drive: NMT, identity, heartbeats in both directions, PDO
    /// mapping, times, limits, Operational, mode with confirmation. An enabled drive is stopped and
    /// switched off first; if it does not answer, the configuration ends with
    /// [`AxisError::NotStopped`].
    ///
    /// Optional objects are skipped if the drive does not have them. A drive that restarts loses its
    /// configuration and must be configured again. The axes of a node are configured together; those that
    /// are enabled are stopped, too.
    ///
    /// # Errors
    /// A [`CommandError`].
    pub fn configure(&mut self) -> Result<(), CommandError> {
        self.command(AxisCommand::Configure)
    }

    /// Starts to establish the position of the axis: old targets drain, then fresh TPDOs must show
    /// it at rest. A node that is not Operational gets the NMT command to start.
    ///
    /// # Errors
    /// A [`CommandError`].
    pub fn read_position(&mut self) -> Result<(), CommandError> {
        self.command(AxisCommand::ReadPosition)
    }

    /// Starts to enable the drive, or to activate an axis that held: its actual position is
    /// established, the drive is brought to Operation Enabled if necessary, and the first target is
    /// the actual position of that cycle. Then the axis follows the application's targets; an active axis
    /// continues.
    ///
    /// During a stop, the command waits for its end. A drive in fault is not enabled; call
    /// [`reset_fault`](Self::reset_fault) first. After
    /// [`AxisConfig::enable_timeout`] it ends with [`AxisError::EnableTimedOut`], and the drive is
    /// switched off.
    ///
    /// # Errors
    /// A [`CommandError`].
    pub fn enable(&mut self) -> Result<(), CommandError> {
        self.command(AxisCommand::Enable)
    }

    /// Ends targets at once and stops the drive, in every state of the axis. A mode change or homing is
    /// cancelled. [`AxisRef::is_stopped`] reports the result.
    pub fn stop(&mut self, kind: StopKind) {
        // infallible: any axis can be stopped
        let _ = self.command(AxisCommand::Stop(kind));
    }

    /// Resets the fault of the drive with a real edge: the bit is sent low, then high, each in several
    /// frames. It does not enable the drive, and does nothing if the drive has no fault. If the drive
    /// stays in fault, it ends with [`AxisError::ResetFailed`].
    ///
    /// # Errors
    /// A [`CommandError`].
    pub fn reset_fault(&mut self) -> Result<(), CommandError> {
        self.command(AxisCommand::ResetFault)
    }

    /// Starts to bring the axis back to its targets, from a hold, a stop, a fault or a lost
    /// configuration, and from the very beginning: it waits for a pending stop, configures a drive
    /// that is not configured, resets a fault, enables, and resumes a halted axis.
    /// [`AxisRef::is_recovering`] reports whether it continues. Any other command to the axis ends it. The
    /// configuration is that of all axes of the node, which stops the others.
    ///
    /// It ends without success, with the cause in [`AxisRef::error`], if
    /// - a fault persists after one reset, or another one follows,
    /// - the configuration fails, or the drive restarts again after two configurations,
    /// - the drive does not answer and may be moving ([`AxisError::NotStopped`]),
    /// - enabling times out, or the axis holds again after three attempts.
    ///
    /// # Errors
    /// [`CommandError::Busy`] during a mode change or homing, [`CommandError::ShuttingDown`] after
    /// [`Cia402::begin_shutdown`].
    pub fn recover(&mut self) -> Result<(), CommandError> {
        self.command(AxisCommand::Recover)
    }

    /// Brings a running axis to rest and keeps it enabled: in CSP by the axis's ramp from its present
    /// motion, in CSV and CST by returning the target to 0 in steps of the limit, in PP, PV and PT
    /// by the halt bit, with the drive's 0x605D. Targets of the application are ignored until
    /// [`resume`](Self::resume).
    ///
    /// With a [jerk limit](crate::MotionLimits), the stop in CSP and CSV continues the velocity and the
    /// acceleration of the present motion: an axis that accelerates becomes faster by at most
    /// acceleration^2 / (2 jerk), and not faster than its step limit. It never reverses. An
    /// acceleration beyond the limit, and a deceleration that the jerk cannot end before standstill,
    /// are cut in the first cycle; only that exceeds the jerk limit.
    ///
    /// An axis in CSP that got no target in more than two target periods in a row is at rest, and stays
    /// there.
    pub fn halt(&mut self) {
        // infallible: any axis can be halted
        let _ = self.command(AxisCommand::Halt);
    }

    /// Lets a halted axis follow the application's targets again.
    pub fn resume(&mut self) {
        // infallible: any axis can be resumed
        let _ = self.command(AxisCommand::Resume);
    }

    /// Starts to change the mode of the drive, with the mode display as confirmation. A running axis is
    /// brought to rest and disabled first, and enabled again afterwards. If the drive rejects the
    /// mode, the previous one stays in force, and the drive stays disabled. A hold while the axis comes
    /// to rest ends the change ([`AxisError::Held`]).
    ///
    /// # Errors
    /// [`CommandError::ModeNotMapped`] for a mode whose target is not in the process data, and for
    /// homing; or another [`CommandError`].
    pub fn change_mode(&mut self, mode: OperatingMode) -> Result<(), CommandError> {
        self.command(AxisCommand::ChangeMode(mode))
    }

    /// Starts homing: rest, power off, parameters and mode, power on, homing, power off, previous
    /// mode, and power on again if the axis was running. The axis is activated at the new value of
    /// the position counter. A hold before the drive is off ends the homing ([`AxisError::Held`]).
    ///
    /// # Errors
    /// A [`CommandError`].
    pub fn home(&mut self, homing: HomingConfig) -> Result<(), CommandError> {
        self.command(AxisCommand::Home(homing))
    }

    /// Sets the application's target. After the targets are sent, [`AxisRef::decision`] reports its result. It
    /// is dropped when the axis holds.
    ///
    /// # Errors
    /// [`CommandError::Unit`] for an angle that is not a valid position.
    #[inline]
    pub fn set_target(&mut self, target: impl Into<Target>) -> Result<(), CommandError> {
        let target = target.into();
        let axis = self.index;
        let Some(found) = self.table.axes.get_mut(axis) else { return Ok(()) };
        let raw = target.raw(&found.plan.config);
        let raw = raw.map_err(|error| CommandError::Unit { axis, error })?;
        found.path.targets.request(Some(raw), target.feed_forward);
        Ok(())
    }

    /// Sets the step of [`Cia402::send_target_step`]. The motion guard rejects a step beyond the limit when
    /// the ramp reaches it.
    pub fn set_target_step(&mut self, step: i32) {
        // infallible: any axis has a step
        let _ = self.command(AxisCommand::TargetStep(step));
    }

    /// Sets an output of the drive, in every state of the axis. It is sent in every target period, so that it
    /// also arrives after a fault of the path.
    ///
    /// # Errors
    /// [`CommandError::NotMapped`] if the object of the output is not mapped.
    pub fn set_output(&mut self, output: Output) -> Result<(), CommandError> {
        self.command(AxisCommand::Output(output))
    }

    /// Gives a command to the axis.
    ///
    /// # Errors
    /// A [`CommandError`], see the call of the command.
    pub fn command(&mut self, command: AxisCommand) -> Result<(), CommandError> {
        self.table.command(self.index, command)
    }
}
