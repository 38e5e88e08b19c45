//! Commands to axes, and their status.

use ecan_canopen::{DriveState, OperatingMode, Probe, ProbeTrigger, Statusword};

use super::cia402::Cia402;
use super::path_stop::PathStop;
use super::shutdown::Shutdown;
use crate::axis::axis::{Axis, AxisCommand};
use crate::axis::config::AxisConfig;
use crate::axis::error::CommandError;
use crate::axis::host_loss::{HostLoss, StopOptions};
use crate::axis::limits::DriveLimits;
use crate::axis::pdo_layout::AxisInputs;
use crate::axis::power::StopCause;
use crate::axis::procedure::HomingConfig;
use crate::axis::process_data::{OutputCommand, ProbeState};
use crate::axis::status::{AxisError, AxisPhase, AxisProgress, AxisStatistics, AxisStatus};
use crate::axis::targets::interpolation_time;
use crate::axis::units::{DriveUnits, Scale, ScaleFinding, UnitError};
use crate::guard::feed_forward::FeedForward;
use crate::guard::motion_guard::MotionGuard;
use crate::guard::terms::Decision;

impl Cia402 {
    pub(super) fn axis(&self, axis: usize) -> Option<&Axis> {
        self.axes.get(axis)
    }

    pub(super) fn axis_mut(&mut self, axis: usize) -> Result<&mut Axis, CommandError> {
        self.axes.get_mut(axis).ok_or(CommandError::NoSuchAxis { axis })
    }

    pub(super) fn execute(
        &mut self,
        axis: usize,
        command: AxisCommand,
    ) -> Result<(), CommandError> {
        let Self { axes, network, now_ns, .. } = self;
        let found = axes.get_mut(axis).ok_or(CommandError::NoSuchAxis { axis })?;
        found.execute(command, network, *now_ns)
    }

    /// Commands every axis, also after a rejection; returns the first rejection.
    fn command_all(
        &mut self,
        mut command: impl FnMut(&mut Self, usize) -> Result<(), CommandError>,
    ) -> Result<(), CommandError> {
        let mut result = Ok(());
        for axis in 0..self.axes.len() {
            result = result.and(command(self, axis));
        }
        result
    }

    // Start-up

    /// Starts the configuration of a drive: NMT, identity, heartbeats in both directions, PDO
    /// mapping, times, limits, Operational, mode with confirmation. An enabled drive is stopped and
    /// switched off first; if it does not answer, the configuration ends with
    /// [`AxisError::NotStopped`]. [`progress`](Self::progress) reports the steps. Real-time safe, as are
    /// all commands below.
    ///
    /// Optional objects are skipped if the drive does not have them. A drive that restarts loses its
    /// configuration and must be configured again. The axes of a node are configured together; those that
    /// are enabled are stopped, too.
    ///
    /// # Errors
    /// A [`CommandError`].
    pub fn configure(&mut self, axis: usize) -> Result<(), CommandError> {
        match self.shared_nodes.iter().find(|node| node.contains(axis)) {
            Some(node) => {
                let Self { axes, network, now_ns, .. } = self;
                node.for_each(axes, |axis| {
                    // infallible: any axis can be configured
                    let _ = axis.execute(AxisCommand::Configure, network, *now_ns);
                });
                Ok(())
            }
            None => self.execute(axis, AxisCommand::Configure),
        }
    }

    /// Starts the configuration of every drive that is not configured.
    ///
    /// # Errors
    /// The first [`CommandError`]; the other axes are configured nevertheless.
    pub fn configure_all(&mut self) -> Result<(), CommandError> {
        self.command_all(|table, axis| match table.axes.get(axis) {
            Some(found) if !found.setup.is_complete() && !found.setup.state().is_pending() => {
                table.configure(axis)
            }
            _ => Ok(()),
        })
    }

    /// Starts to establish the position of an axis: old targets drain, then fresh TPDOs must show
    /// it at rest. A node that is not Operational gets the NMT command to start.
    ///
    /// # Errors
    /// A [`CommandError`].
    pub fn read_position(&mut self, axis: usize) -> Result<(), CommandError> {
        self.execute(axis, AxisCommand::ReadPosition)
    }

    /// Starts to establish the positions of all axes.
    ///
    /// # Errors
    /// The first [`CommandError`]; the other axes are read nevertheless.
    pub fn read_position_all(&mut self) -> Result<(), CommandError> {
        self.command_all(Self::read_position)
    }

    // Power

    /// Starts to enable a drive, or to activate an axis that held: its actual position is
    /// established, the drive is brought to Operation Enabled if necessary, and the first target is
    /// the actual position of that cycle. Then the axis follows the application's targets.
    ///
    /// During a stop, the command waits for its end. A drive in fault is not enabled; call
    /// [`reset_fault`](Self::reset_fault) first. After
    /// [`AxisConfig::enable_timeout`] it ends with [`AxisError::EnableTimedOut`], and the drive is
    /// switched off.
    ///
    /// # Errors
    /// A [`CommandError`].
    pub fn enable(&mut self, axis: usize) -> Result<(), CommandError> {
        self.execute(axis, AxisCommand::Enable)
    }

    /// Starts to enable all drives; active axes continue.
    ///
    /// # Errors
    /// The first [`CommandError`]; the other axes are enabled nevertheless.
    pub fn enable_all(&mut self) -> Result<(), CommandError> {
        self.command_all(Self::enable)
    }

    /// Ends targets at once and switches a drive off, through Switched On; it stops by its 0x605C.
    /// Call [`halt`](Self::halt) first to bring it to rest by the ramp. A drive that process data do not
    /// reach, or that does not stop within 30 s, is quick-stopped first. Acts on an axis in every state.
    ///
    /// # Errors
    /// [`CommandError::NoSuchAxis`].
    pub fn disable(&mut self, axis: usize) -> Result<(), CommandError> {
        self.execute(axis, AxisCommand::Stop(StopCause::Disable))
    }

    /// Switches all drives off.
    pub fn disable_all(&mut self) {
        self.stop_every_axis(StopCause::Disable);
    }

    /// Ends targets at once and commands a quick stop; the drive stops by its 0x605A. A drive that
    /// remains in Operation Enabled for 250 ms gets the command to stop by its 0x605C; one that remains
    /// there for two seconds loses its voltage.
    /// Acts on an axis in every state; the drive of an axis that is not configured is switched off at
    /// rest. [`enable`](Self::enable) activates the axis again, after the stop.
    ///
    /// # Errors
    /// [`CommandError::NoSuchAxis`].
    pub fn quick_stop(&mut self, axis: usize) -> Result<(), CommandError> {
        self.execute(axis, AxisCommand::Stop(StopCause::QuickStop))
    }

    /// Commands a quick stop to all drives.
    pub fn quick_stop_all(&mut self) {
        self.stop_every_axis(StopCause::QuickStop);
    }

    /// Stops all axes as fast as their drives can, by quick stop, and switches the drives off when
    /// they are at rest. Acts on axes in every state. [`all_stopped`](Self::all_stopped) reports the
    /// result.
    pub fn stop_all(&mut self) {
        self.stop_every_axis(StopCause::StopAll);
    }

    fn stop_every_axis(&mut self, cause: StopCause) {
        let command = AxisCommand::Stop(cause);
        // infallible: the indices are those of axes
        let _ = self.command_all(|table, axis| table.execute(axis, command));
    }

    /// Returns whether the drive of an axis is configured.
    pub fn is_configured(&self, axis: usize) -> bool {
        self.axis(axis).is_some_and(|axis| axis.setup.is_complete())
    }

    /// Cause of the stop that is pending or complete.
    pub fn stop_cause(&self, axis: usize) -> Option<StopCause> {
        self.axis(axis)?.task.state().stop().map(|stop| stop.cause)
    }

    /// Whether an axis has stopped: its drive reported that it is off or at rest in Quick Stop Active,
    /// or has never reported anything. False while the axis is active, is being stopped or is uncontrolled, and while a
    /// drive that never reported anything is being configured.
    pub fn is_stopped(&self, axis: usize) -> bool {
        self.axis(axis).is_none_or(|axis| axis.is_stopped(self.now_ns))
    }

    /// Returns whether all axes have stopped, see [`is_stopped`](Self::is_stopped).
    pub fn all_stopped(&self) -> bool {
        self.axes.iter().all(|axis| axis.is_stopped(self.now_ns))
    }

    /// Resets the fault of a drive with a real edge: the bit is sent low, then high, each in several
    /// frames. It does not enable the drive, and does nothing if the drive has no fault. If the drive
    /// stays in fault, it ends with [`AxisError::ResetFailed`].
    ///
    /// # Errors
    /// A [`CommandError`].
    pub fn reset_fault(&mut self, axis: usize) -> Result<(), CommandError> {
        self.execute(axis, AxisCommand::ResetFault)
    }

    /// Starts to bring an axis back to its targets, from a hold, a stop, a fault or a lost
    /// configuration, and from the very beginning: it waits for a pending stop, configures a drive
    /// that is not configured, resets a fault, enables, and resumes a halted axis.
    /// [`progress`](Self::progress) reports the steps, [`is_recovering`](Self::is_recovering) whether it
    /// continues. Any other command to the axis ends it. The configuration is that of all axes of the node,
    /// which stops the others.
    ///
    /// It ends without success, with the cause in [`error`](Self::error), if
    /// - a fault persists after one reset, or another one follows,
    /// - the configuration fails, or the drive restarts again after two configurations,
    /// - the drive does not answer and may be moving ([`AxisError::NotStopped`]),
    /// - enabling times out, or the axis holds again after three attempts.
    ///
    /// # Errors
    /// [`CommandError::Busy`] during a mode change or homing, [`CommandError::ShuttingDown`] after
    /// [`begin_shutdown`](Self::begin_shutdown), [`CommandError::NoSuchAxis`].
    pub fn recover(&mut self, axis: usize) -> Result<(), CommandError> {
        if self.shutdown != Shutdown::None {
            return Err(CommandError::ShuttingDown { axis });
        }
        self.execute(axis, AxisCommand::Recover)
    }

    /// Starts to bring all axes back to their targets; axes that follow them continue.
    ///
    /// # Errors
    /// The first [`CommandError`]; the other axes are recovered nevertheless.
    pub fn recover_all(&mut self) -> Result<(), CommandError> {
        self.command_all(Self::recover)
    }

    /// Returns whether the recovery of an axis continues.
    pub fn is_recovering(&self, axis: usize) -> bool {
        self.axis(axis).is_some_and(|axis| axis.task.recovery.is_some())
    }

    /// Starts an orderly end: every axis comes to rest by its ramp, is switched off and released:
    /// it stops watching the host's heartbeat and goes to Pre-operational, so that no drive
    /// reports a fault when the host ends. Axes in every state are switched off; a drive that does not
    /// report this is not released, so that its own watch stops it.
    /// [`shutdown_state`](Self::shutdown_state) reports when it is complete. A stage that an axis
    /// cannot finish ends after five seconds: [`all_stopped`](Self::all_stopped) states whether the
    /// drives are off.
    ///
    /// Mode changes and homings are cancelled. The cycle continues as before.
    pub fn begin_shutdown(&mut self) {
        if self.shutdown == Shutdown::None {
            self.shutdown = Shutdown::begin(&mut self.axes, &mut self.network, self.now_ns);
        }
    }

    /// State of the orderly end.
    pub fn shutdown_state(&self) -> Shutdown {
        self.shutdown
    }

    // Motion

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
    ///
    /// # Errors
    /// [`CommandError::NoSuchAxis`].
    pub fn halt(&mut self, axis: usize) -> Result<(), CommandError> {
        self.execute(axis, AxisCommand::Halt)
    }

    /// Lets a halted axis follow the application's targets again.
    ///
    /// # Errors
    /// [`CommandError::NoSuchAxis`].
    pub fn resume(&mut self, axis: usize) -> Result<(), CommandError> {
        self.execute(axis, AxisCommand::Resume)
    }

    /// Brings all axes to rest and keeps them enabled, the CSP axes together on their path; targets
    /// of the application are ignored until [`resume`](Self::resume). Real-time safe.
    ///
    /// The running CSP axes continue straight in the direction of their last targets, also from a
    /// curve, and decelerate by one common profile: it has the acceleration and jerk at which no
    /// axis exceeds its [`ramp`](crate::AxisConfig::ramp) or its
    /// [`limits`](crate::AxisConfig::limits), and so takes as long as the axis that needs longest. It
    /// begins with the acceleration of that axis in the direction of the motion; acceleration across
    /// the direction ends at once. Each target is within an increment of the straight line.
    ///
    /// A target is only sent if every one of these axes can get one in the cycle; otherwise none
    /// moves. After more than two target periods without targets the drives are at rest, and the axes
    /// stay where they are on the path. A lost EtherCAT frame or an occupied bus can delay targets that
    /// were sent: an axis is then up to three steps behind, on the same line, until they arrive. If an
    /// axis holds, leaves Operation Enabled, is resumed or cannot move on (a bound, the end of its
    /// counter, a motor that does not follow), or if the frame of one is rejected, the others stop by
    /// their own ramps from their motion of that moment.
    ///
    /// All other axes stop as by [`halt`](Self::halt). [`path_stop`](Self::path_stop) reports the
    /// state, [`is_at_rest`](Self::is_at_rest) when an axis is at rest. A call during the stop changes
    /// nothing for axes that are part of it.
    pub fn stop_together(&mut self) {
        self.path_group.stop(&mut self.axes);
    }

    /// State of the last [`stop_together`](Self::stop_together).
    pub fn path_stop(&self) -> PathStop {
        self.path_group.state()
    }

    /// Returns whether a halted axis is at rest; true for an axis that is not running.
    pub fn is_at_rest(&self, axis: usize) -> bool {
        self.axis(axis).is_none_or(Axis::is_at_rest)
    }

    /// Sets the application's target, in raw units of the mode: steps, velocity or torque. After the
    /// targets are sent, [`decision`](Self::decision) reports its result. It is dropped when the
    /// axis holds.
    ///
    /// # Errors
    /// [`CommandError::NoSuchAxis`].
    pub fn set_target(&mut self, axis: usize, target: i32) -> Result<(), CommandError> {
        self.axis_mut(axis)?.path.targets.request(Some(target), None);
        Ok(())
    }

    /// As [`set_target`](Self::set_target), with an angle in degrees by the axis's scale.
    ///
    /// # Errors
    /// [`CommandError::Unit`] for an angle that is not a valid position.
    pub fn set_target_degrees(&mut self, axis: usize, degrees: f64) -> Result<(), CommandError> {
        self.set_angle(axis, |config| config.scale.from_degrees(degrees, config.range))
    }

    /// As [`set_target`](Self::set_target), with an angle in radians by the axis's scale.
    ///
    /// # Errors
    /// [`CommandError::Unit`] for an angle that is not a valid position.
    pub fn set_target_radians(&mut self, axis: usize, radians: f64) -> Result<(), CommandError> {
        self.set_angle(axis, |config| config.scale.from_radians(radians, config.range))
    }

    fn set_angle(
        &mut self,
        index: usize,
        angle: impl FnOnce(&AxisConfig) -> Result<i32, UnitError>,
    ) -> Result<(), CommandError> {
        let axis = self.axis_mut(index)?;
        let target =
            angle(&axis.plan.config).map_err(|error| CommandError::Unit { axis: index, error })?;
        axis.path.targets.request(Some(target), None);
        Ok(())
    }

    /// Sets the step of [`send_target_step`](Self::send_target_step).
    ///
    /// # Errors
    /// [`CommandError::NoSuchAxis`]. The motion guard rejects a step beyond the limit when the
    /// ramp reaches it.
    pub fn set_target_step(&mut self, axis: usize, step: i32) -> Result<(), CommandError> {
        self.execute(axis, AxisCommand::TargetStep(step))
    }

    // Modes

    /// Starts to change the mode of a drive, with the mode display as confirmation. A running axis is
    /// brought to rest and disabled first, and enabled again afterwards. If the drive rejects the
    /// mode, the previous one stays in force, and the drive stays disabled. A hold while the axis comes
    /// to rest ends the change ([`AxisError::Held`](crate::AxisError::Held)).
    ///
    /// # Errors
    /// [`CommandError::ModeNotMapped`] for a mode whose target is not in the process data, and for
    /// homing; or another [`CommandError`].
    pub fn change_mode(&mut self, axis: usize, mode: OperatingMode) -> Result<(), CommandError> {
        let period_ns = self.bus.target_period_ns;
        self.axis_mut(axis)?;
        let has_period =
            matches!(mode, OperatingMode::CyclicPosition | OperatingMode::InterpolatedPosition);
        if has_period && interpolation_time(period_ns).is_none() {
            return Err(CommandError::TargetPeriod { axis, period_ns });
        }
        self.execute(axis, AxisCommand::ChangeMode(mode))
    }

    /// Starts homing: rest, power off, parameters and mode, power on, homing, power off, previous
    /// mode, and power on again if the axis was running. The axis is activated at the new value of
    /// the position counter. A hold before the drive is off ends the homing
    /// ([`AxisError::Held`](crate::AxisError::Held)).
    ///
    /// # Errors
    /// A [`CommandError`].
    pub fn home(&mut self, axis: usize, homing: HomingConfig) -> Result<(), CommandError> {
        self.execute(axis, AxisCommand::Home(homing))
    }

    /// Mode that the drive has confirmed; before that, the configured one.
    pub fn mode(&self, axis: usize) -> Option<OperatingMode> {
        self.axis(axis).map(|axis| axis.path.mode())
    }

    // Status

    /// Configuration of an axis.
    pub fn config(&self, axis: usize) -> Option<&AxisConfig> {
        self.axis(axis).map(|axis| &axis.plan.config)
    }

    /// Progress of an axis: phase, time in it, and error.
    pub fn progress(&self, axis: usize) -> Option<AxisProgress> {
        self.axis(axis).map(|axis| axis.progress(self.now_ns))
    }

    /// Progress of every axis.
    pub fn progress_all(&self) -> impl Iterator<Item = AxisProgress> + '_ {
        self.axes.iter().map(|axis| axis.progress(self.now_ns))
    }

    /// Phase of an axis.
    pub fn phase(&self, axis: usize) -> Option<AxisPhase> {
        self.axis(axis).map(|axis| axis.report.phase())
    }

    /// Stop behaviour of a drive, read back at the end of its configuration; `None` before that, and
    /// after the drive restarted.
    pub fn stop_options(&self, axis: usize) -> Option<StopOptions> {
        self.axis(axis).and_then(|axis| axis.setup.values().stop_options)
    }

    /// Reaction of a drive to the loss of the host (its end, `kill`, or the link), in the present
    /// mode, by the options that it reported.
    pub fn host_loss(&self, axis: usize) -> Option<HostLoss> {
        self.axis(axis).map(|axis| axis.host_loss(&self.network))
    }

    /// The axes whose drives would run on or coast if the host were lost, or whose reaction is
    /// unknown; for the startup report of an application. Each is also logged once, as a warning, at
    /// the end of its configuration.
    pub fn host_loss_risks(&self) -> impl Iterator<Item = HostLoss> + '_ {
        let all = self.axes.iter().map(|axis| axis.host_loss(&self.network));
        all.filter(|loss| !loss.reaction.is_controlled_stop())
    }

    /// Failure of the last command to an axis.
    pub fn error(&self, axis: usize) -> Option<AxisError> {
        self.axis(axis).and_then(|axis| axis.report.error)
    }

    /// The last statusword, however old; `None` before the first.
    pub fn statusword(&self, axis: usize) -> Option<Statusword> {
        self.axis(axis).and_then(|axis| axis.link.drive().statusword)
    }

    /// The state in the last statusword.
    pub fn drive_state(&self, axis: usize) -> Option<DriveState> {
        self.axis(axis).and_then(|axis| axis.link.drive().state)
    }

    /// Returns whether an axis follows the application's targets; false while it is halted.
    pub fn is_running(&self, axis: usize) -> bool {
        self.axis(axis).is_some_and(|axis| axis.path.follows_application())
    }

    /// Returns whether all axes follow the application's targets; false without axes.
    pub fn all_running(&self) -> bool {
        !self.axes.is_empty() && (0..self.axes.len()).all(|axis| self.is_running(axis))
    }

    /// The last target sent to an axis that follows targets; the next is compared with it.
    pub fn target(&self, axis: usize) -> Option<i32> {
        self.axis(axis).and_then(|axis| axis.path.target())
    }

    /// The last usable actual position, in steps; `None` before the first.
    /// [`actual_age`](Self::actual_age) is its age.
    pub fn actual(&self, axis: usize) -> Option<i32> {
        self.axis(axis).and_then(|axis| axis.path.guard().actual())
    }

    /// Age of the actual position in cycles; 0 is this cycle, 65535 is more or never.
    pub fn actual_age(&self, axis: usize) -> u16 {
        self.axis(axis).map_or(u16::MAX, |axis| axis.path.guard().actual_age())
    }

    /// The actual position in degrees by the axis's scale.
    pub fn actual_degrees(&self, axis: usize) -> Option<f64> {
        self.scaled(axis, Scale::degrees)
    }

    /// The actual position in radians by the axis's scale.
    pub fn actual_radians(&self, axis: usize) -> Option<f64> {
        self.scaled(axis, Scale::radians)
    }

    fn scaled(&self, axis: usize, scale: impl Fn(Scale, i32) -> f64) -> Option<f64> {
        let axis = self.axis(axis)?;
        Some(scale(axis.plan.config.scale, axis.path.guard().actual()?))
    }

    /// Following error of a running axis in steps: target minus actual position, the shorter
    /// distance if the counter wraps. It includes the delay of the communication, two cycles or more;
    /// the drive's own value is 0x60F4.
    pub fn following_error(&self, axis: usize) -> Option<i64> {
        let axis = self.axis(axis)?;
        Some(axis.plan.config.range.distance(axis.path.guard().actual()?, axis.path.target()?))
    }

    /// Returns whether a drive has reached its target: in PP it has accepted the target in force and reports
    /// it as reached, in PV and PT it reports its speed or torque as reached (statusword bit 10).
    /// False in the cyclic modes, and while a new target is not sent yet.
    pub fn is_target_reached(&self, axis: usize) -> bool {
        self.axis(axis).is_some_and(|axis| axis.path.is_target_reached(axis.link.drive()))
    }

    /// Status of an axis, complete. Real-time safe.
    pub fn axis_status(&self, axis: usize) -> Option<AxisStatus> {
        self.axis(axis).map(|axis| axis.status(&self.network, self.now_ns))
    }

    /// Decision about the target in the last [`send_targets_all`](Self::send_targets_all).
    pub fn decision(&self, axis: usize) -> Decision {
        self.axis(axis).map_or(Decision::Closed, |axis| axis.path.decision())
    }

    /// The motion guard of an axis.
    pub fn guard(&self, axis: usize) -> Option<&MotionGuard> {
        self.axis(axis).map(|axis| axis.path.guard())
    }

    /// Counters of an axis.
    pub fn statistics(&self, axis: usize) -> AxisStatistics {
        self.axis(axis).map(|axis| axis.report.statistics).unwrap_or_default()
    }

    /// As [`set_target`](Self::set_target), with a feed-forward for this target, which the drive adds
    /// to the demand of its controllers. Needs
    /// [`OutputObject::VelocityOffset`](crate::OutputObject::VelocityOffset) or
    /// [`TorqueOffset`](crate::OutputObject::TorqueOffset) in the
    /// [outputs](crate::AxisConfig::outputs); the value of an object that is not mapped has no effect.
    ///
    /// The feed-forward is limited, and changes by at most its limit per target
    /// ([`AxisConfig::feed_forward`](crate::AxisConfig::feed_forward)); [`feed_forward`](Self::feed_forward) returns the one in force.
    /// It belongs to this target: give it in every cycle. For a target without one, a repeated or
    /// rejected one, and while the host moves the axis, it returns to 0 by its changes; when the axis
    /// holds or is stopped it ends at once.
    ///
    /// # Errors
    /// [`CommandError::NoSuchAxis`].
    pub fn set_target_with(
        &mut self,
        axis: usize,
        target: i32,
        feed_forward: FeedForward,
    ) -> Result<(), CommandError> {
        self.axis_mut(axis)?.path.targets.request(Some(target), Some(feed_forward));
        Ok(())
    }

    /// The feed-forward that was sent last.
    pub fn feed_forward(&self, axis: usize) -> FeedForward {
        self.axis(axis).map(|axis| axis.data.feed_forward()).unwrap_or_default()
    }

    /// Values of the further objects in the last TPDOs of a drive, see [`AxisConfig::inputs`](crate::AxisConfig::inputs).
    pub fn inputs(&self, axis: usize) -> Option<&AxisInputs> {
        self.axis(axis).map(|axis| axis.data.inputs())
    }

    /// Sets the digital outputs 0x60FE:01 of a drive, in every state of the axis. They are sent in
    /// every target period, so that they also arrive after a fault of the path. Needs
    /// [`OutputObject::DigitalOutputs`](crate::OutputObject::DigitalOutputs) in the
    /// [outputs](crate::AxisConfig::outputs), and the mask
    /// [`DriveConfig::output_mask`](crate::DriveConfig::output_mask).
    ///
    /// # Errors
    /// [`CommandError::NoSuchAxis`]; [`CommandError::NotMapped`] if the object is not mapped.
    pub fn set_digital_outputs(&mut self, axis: usize, outputs: u32) -> Result<(), CommandError> {
        self.execute(axis, AxisCommand::Output(OutputCommand::DigitalOutputs(outputs)))
    }

    /// Arms a touch probe of a drive: it samples the actual position at edges of a signal. A probe that
    /// is armed already is disabled first. [`probe`](Self::probe) returns the positions. Needs
    /// [`OutputObject::ProbeFunction`](crate::OutputObject::ProbeFunction) in the
    /// [outputs](crate::AxisConfig::outputs); status and positions in the [inputs](crate::AxisConfig::inputs).
    ///
    /// # Errors
    /// [`CommandError::NoSuchAxis`]; [`CommandError::NotMapped`] if the object is not mapped.
    pub fn arm_probe(
        &mut self,
        axis: usize,
        probe: Probe,
        trigger: ProbeTrigger,
    ) -> Result<(), CommandError> {
        self.execute(axis, AxisCommand::Output(OutputCommand::ArmProbe(probe, trigger)))
    }

    /// Disables a touch probe.
    ///
    /// # Errors
    /// [`CommandError::NoSuchAxis`]; [`CommandError::NotMapped`] if the object is not mapped.
    pub fn disarm_probe(&mut self, axis: usize, probe: Probe) -> Result<(), CommandError> {
        self.execute(axis, AxisCommand::Output(OutputCommand::DisarmProbe(probe)))
    }

    /// State of a touch probe, with the positions that it has sampled since it was armed.
    pub fn probe(&self, axis: usize, probe: Probe) -> Option<ProbeState> {
        self.axis(axis).map(|axis| axis.data.probe(probe))
    }

    /// Limits of a drive, read at the end of its configuration if
    /// [`DriveConfig::use_limits`](crate::DriveConfig::use_limits) asks for it. The limits in force are
    /// those of its [`guard`](Self::guard).
    pub fn drive_limits(&self, axis: usize) -> Option<DriveLimits> {
        self.axis(axis).and_then(|axis| axis.setup.values().limits)
    }

    /// Units of a drive, read at the end of its configuration if [`AxisConfig::scale_source`](crate::AxisConfig::scale_source) asks for it.
    pub fn drive_units(&self, axis: usize) -> Option<DriveUnits> {
        self.axis(axis).and_then(|axis| axis.setup.values().units)
    }

    /// Difference between the scale of an axis and the units of its drive, see
    /// [`AxisConfig::scale_source`](crate::AxisConfig::scale_source); also logged as a warning at the end of the configuration.
    pub fn scale_finding(&self, axis: usize) -> Option<ScaleFinding> {
        self.axis(axis).and_then(|axis| axis.setup.values().scale_finding)
    }
}
