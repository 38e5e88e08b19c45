//! Commands to axes, and what is known of them.

use ecan_canopen::{DriveState, OperatingMode, Statusword};

use super::cia402::Cia402;
use super::shutdown::Shutdown;
use crate::axis::axis::Axis;
use crate::axis::command_error::CommandError;
use crate::axis::config::AxisConfig;
use crate::axis::homing::HomingConfig;
use crate::axis::phase::{AxisError, AxisPhase, AxisProgress};
use crate::axis::statistics::AxisStatistics;
use crate::axis::units::{Scale, UnitError};
use crate::guard::motion_guard::MotionGuard;
use crate::guard::terms::Decision;

impl Cia402 {
    fn axis(&self, axis: usize) -> Option<&Axis> {
        self.axes.get(axis)
    }

    pub(super) fn axis_mut(&mut self, axis: usize) -> Result<&mut Axis, CommandError> {
        self.axes.get_mut(axis).ok_or(CommandError::NoSuchAxis { axis })
    }

    /// Commands every axis, also behind one that refuses; gives the first refusal.
    fn command_all(
        &mut self,
        mut command: impl FnMut(&mut Axis) -> Result<(), CommandError>,
    ) -> Result<(), CommandError> {
        let mut result = Ok(());
        for axis in &mut self.axes {
            let taken = command(axis);
            result = result.and(taken);
        }
        result
    }

    // Start-up

    /// Begins the configuration of a drive: NMT, identity, heartbeats both ways, PDO mapping,
    /// times, limits, Operational, mode with confirmation. An enabled drive is switched off first.
    /// [`progress`](Self::progress) says how far it is. Allocates, so not for the cycle.
    ///
    /// Objects that a drive need not have are skipped where it has none. A drive that restarts has
    /// forgotten its configuration and needs this again.
    ///
    /// # Errors
    /// A [`CommandError`].
    pub fn configure(&mut self, axis: usize) -> Result<(), CommandError> {
        let Self { axes, network, bus, .. } = self;
        let axis = axes.get_mut(axis).ok_or(CommandError::NoSuchAxis { axis })?;
        axis.configure(network, bus)
    }

    /// Begins the configuration of every drive that is not configured. Allocates.
    ///
    /// # Errors
    /// The first [`CommandError`]; the other axes are configured all the same.
    pub fn configure_all(&mut self) -> Result<(), CommandError> {
        let mut result = Ok(());
        for index in 0..self.axes.len() {
            if self.axis(index).is_some_and(|axis| !axis.state.is_configured()) {
                let begun = self.configure(index);
                result = result.and(begun);
            }
        }
        result
    }

    /// Begins to establish where an axis is: what may still be under way is waited out, then two
    /// fresh TPDOs that show it at rest. A node that is not Operational is told to start. Real-time
    /// safe, as are all commands below.
    ///
    /// # Errors
    /// A [`CommandError`].
    pub fn read_position(&mut self, axis: usize) -> Result<(), CommandError> {
        self.axis_mut(axis)?.read_position()
    }

    /// Begins to establish where all axes are.
    ///
    /// # Errors
    /// The first [`CommandError`]; the other axes are read all the same.
    pub fn read_position_all(&mut self) -> Result<(), CommandError> {
        self.command_all(Axis::read_position)
    }

    // Power

    /// Begins to enable a drive, or takes an axis up again that held: its actual position is
    /// established, the drive is brought to Operation Enabled where it is not there, and the first
    /// target is the actual position just read. From then on it follows the application's targets.
    ///
    /// A drive in fault is not enabled: [`reset_fault`](Self::reset_fault) comes first. What cannot
    /// be done within the axis's time ends with [`AxisError::EnableTimedOut`] and the drive
    /// switched off.
    ///
    /// # Errors
    /// A [`CommandError`].
    pub fn enable(&mut self, axis: usize) -> Result<(), CommandError> {
        let now_ns = self.now_ns;
        self.axis_mut(axis)?.enable(now_ns)
    }

    /// Begins to enable all drives; those that run already go on.
    ///
    /// # Errors
    /// The first [`CommandError`]; the other axes are enabled all the same.
    pub fn enable_all(&mut self) -> Result<(), CommandError> {
        let now_ns = self.now_ns;
        self.command_all(|axis| axis.enable(now_ns))
    }

    /// Ends targets at once and switches a drive off, by way of Switched On: how it stops is the
    /// drive's own affair (0x605C). [`halt`](Self::halt) first brings it to rest by the ramp.
    ///
    /// # Errors
    /// [`CommandError::NoSuchAxis`].
    pub fn disable(&mut self, axis: usize) -> Result<(), CommandError> {
        let Self { axes, network, .. } = self;
        let axis = axes.get_mut(axis).ok_or(CommandError::NoSuchAxis { axis })?;
        axis.cancel_procedure(network);
        axis.disable();
        Ok(())
    }

    /// Switches all drives off.
    pub fn disable_all(&mut self) {
        for index in 0..self.axes.len() {
            // infallible: the index is that of an axis
            let _ = self.disable(index);
        }
    }

    /// Ends targets at once and commands a quick stop; the drive stops as its 0x605A says.
    /// [`enable`](Self::enable) takes the axis up again.
    ///
    /// # Errors
    /// [`CommandError::NoSuchAxis`].
    pub fn quick_stop(&mut self, axis: usize) -> Result<(), CommandError> {
        let Self { axes, network, .. } = self;
        let axis = axes.get_mut(axis).ok_or(CommandError::NoSuchAxis { axis })?;
        axis.cancel_procedure(network);
        axis.quick_stop();
        Ok(())
    }

    /// Commands a quick stop to all drives.
    pub fn quick_stop_all(&mut self) {
        for index in 0..self.axes.len() {
            // infallible: the index is that of an axis
            let _ = self.quick_stop(index);
        }
    }

    /// Resets the fault of a drive, with a real edge: the bit goes out low, then high, each in
    /// several frames. The drive is not enabled by it. A drive that stays in fault ends it with
    /// [`AxisError::ResetFailed`].
    ///
    /// # Errors
    /// A [`CommandError`].
    pub fn reset_fault(&mut self, axis: usize) -> Result<(), CommandError> {
        self.axis_mut(axis)?.reset_fault()
    }

    /// Starts an orderly end: every axis comes to rest by its ramp, is switched off and released:
    /// it stops watching the host's heartbeat and goes to Pre-operational, so that no drive
    /// reports a fault when the host ends. [`shutdown_state`](Self::shutdown_state) reports when
    /// it is complete. A stage that an axis cannot finish ends after five seconds.
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

    /// Brings a running axis to rest and keeps it enabled: in CSP by the axis's ramp from the
    /// motion that it has, in CSV and CST by taking the target back to 0 in steps of the limit, in
    /// PP, PV and PT by the halt bit, as the drive's 0x605D says. Targets of the application are
    /// ignored until [`resume`](Self::resume).
    ///
    /// # Errors
    /// [`CommandError::NoSuchAxis`].
    pub fn halt(&mut self, axis: usize) -> Result<(), CommandError> {
        self.axis_mut(axis)?.targets.halt();
        Ok(())
    }

    /// Lets a halted axis follow the application's targets again.
    ///
    /// # Errors
    /// [`CommandError::NoSuchAxis`].
    pub fn resume(&mut self, axis: usize) -> Result<(), CommandError> {
        self.axis_mut(axis)?.targets.is_halted = false;
        Ok(())
    }

    /// Whether an axis that was halted has come to rest; also true for one that does not run.
    pub fn is_at_rest(&self, axis: usize) -> bool {
        self.axis(axis).is_none_or(Axis::is_at_rest)
    }

    /// The application's target from now on, in raw units of the mode: steps, velocity or torque.
    /// What becomes of it is said by [`decision`](Self::decision) after the targets were sent. It
    /// is forgotten when the axis holds.
    ///
    /// # Errors
    /// [`CommandError::NoSuchAxis`].
    pub fn set_target(&mut self, axis: usize, target: i32) -> Result<(), CommandError> {
        self.axis_mut(axis)?.targets.wanted = Some(target);
        Ok(())
    }

    /// As [`set_target`](Self::set_target), with an angle in degrees by the axis's scale.
    ///
    /// # Errors
    /// [`CommandError::Unit`] for an angle that is no position.
    pub fn set_target_degrees(&mut self, axis: usize, degrees: f64) -> Result<(), CommandError> {
        self.set_angle(axis, |settings| settings.scale.from_degrees(degrees, settings.range))
    }

    /// As [`set_target`](Self::set_target), with an angle in radians by the axis's scale.
    ///
    /// # Errors
    /// [`CommandError::Unit`] for an angle that is no position.
    pub fn set_target_radians(&mut self, axis: usize, radians: f64) -> Result<(), CommandError> {
        self.set_angle(axis, |settings| settings.scale.from_radians(radians, settings.range))
    }

    fn set_angle(
        &mut self,
        index: usize,
        angle: impl FnOnce(&AxisConfig) -> Result<i32, UnitError>,
    ) -> Result<(), CommandError> {
        let axis = self.axis_mut(index)?;
        let target =
            angle(&axis.settings).map_err(|error| CommandError::Unit { axis: index, error })?;
        axis.targets.wanted = Some(target);
        Ok(())
    }

    /// The step that [`send_target_step`](Self::send_target_step) makes, from now on.
    ///
    /// # Errors
    /// [`CommandError::NoSuchAxis`]. A step beyond the limit is refused by the motion guard when
    /// the ramp gets there.
    pub fn set_target_step(&mut self, axis: usize, step: i32) -> Result<(), CommandError> {
        self.axis_mut(axis)?.settings.target_step = step;
        Ok(())
    }

    // Modes

    /// Begins to change the mode of a drive, with the mode display as confirmation. A running axis
    /// is brought to rest and disabled before, and enabled again after. A mode that is refused
    /// leaves the one before in force, and the drive disabled.
    ///
    /// # Errors
    /// [`CommandError::ModeNotMapped`] for a mode whose target is not in the process data, and for
    /// homing; or another [`CommandError`].
    pub fn change_mode(&mut self, axis: usize, mode: OperatingMode) -> Result<(), CommandError> {
        let now_ns = self.now_ns;
        self.axis_mut(axis)?.change_mode(mode, now_ns)
    }

    /// Begins homing: to rest, power off, parameters and mode, power on, homing, power off, the
    /// mode before, and power on again where it was. Since the position counter may be another one
    /// afterwards, the axis is taken up from what it says then.
    ///
    /// # Errors
    /// A [`CommandError`].
    pub fn home(&mut self, axis: usize, homing: HomingConfig) -> Result<(), CommandError> {
        let now_ns = self.now_ns;
        self.axis_mut(axis)?.home(homing, now_ns)
    }

    /// The mode that the drive has confirmed; that of the settings before.
    pub fn mode(&self, axis: usize) -> Option<OperatingMode> {
        self.axis(axis).map(|axis| axis.mode)
    }

    // What is known

    /// Settings of an axis.
    pub fn settings(&self, axis: usize) -> Option<&AxisConfig> {
        self.axis(axis).map(|axis| &axis.settings)
    }

    /// What an axis is doing, for how long, and what hinders it.
    pub fn progress(&self, axis: usize) -> Option<AxisProgress> {
        self.axis(axis).map(|axis| axis.progress(self.now_ns))
    }

    /// What every axis is doing.
    pub fn progress_all(&self) -> impl Iterator<Item = AxisProgress> + '_ {
        self.axes.iter().map(|axis| axis.progress(self.now_ns))
    }

    /// What an axis is doing.
    pub fn phase(&self, axis: usize) -> Option<AxisPhase> {
        self.axis(axis).map(|axis| axis.phase)
    }

    /// Failure of the last command to an axis.
    pub fn error(&self, axis: usize) -> Option<AxisError> {
        self.axis(axis).and_then(|axis| axis.error)
    }

    /// The last statusword, however old; `None` before the first.
    pub fn statusword(&self, axis: usize) -> Option<Statusword> {
        self.axis(axis).and_then(|axis| axis.drive.statusword)
    }

    /// The state in the last statusword.
    pub fn drive_state(&self, axis: usize) -> Option<DriveState> {
        self.axis(axis).and_then(|axis| axis.drive.state)
    }

    /// Whether an axis follows targets.
    pub fn is_running(&self, axis: usize) -> bool {
        self.axis(axis).is_some_and(Axis::is_running)
    }

    /// Whether all axes follow targets; false where there is none.
    pub fn all_running(&self) -> bool {
        !self.axes.is_empty() && (0..self.axes.len()).all(|axis| self.is_running(axis))
    }

    /// The last target sent to an axis that follows targets; the next is judged against it.
    pub fn target(&self, axis: usize) -> Option<i32> {
        self.axis(axis).and_then(Axis::target)
    }

    /// The last usable actual position, in steps; `None` before the first.
    /// [`actual_age`](Self::actual_age) says how old it is.
    pub fn actual(&self, axis: usize) -> Option<i32> {
        self.axis(axis).and_then(|axis| axis.guard.actual())
    }

    /// Cycles since the actual position came; 0 for this cycle, 65535 for many or never.
    pub fn actual_age(&self, axis: usize) -> u16 {
        self.axis(axis).map_or(u16::MAX, |axis| axis.guard.actual_age())
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
        Some(scale(axis.settings.scale, axis.guard.actual()?))
    }

    /// How far a running axis is behind its target, in steps: target minus actual position, by
    /// the shorter way where the counter wraps. It contains the way out and back, two cycles or
    /// more; the drive's own is in 0x60F4.
    pub fn following_error(&self, axis: usize) -> Option<i64> {
        let axis = self.axis(axis)?;
        Some(axis.settings.range.distance(axis.guard.actual()?, axis.target()?))
    }

    /// Whether a drive that makes its own way has arrived: in PP it has taken the target in force and
    /// reports it as reached, in PV and PT it reports its speed or torque as reached (statusword bit
    /// 10). False in the cyclic modes, which know no arrival.
    pub fn is_target_reached(&self, axis: usize) -> bool {
        self.axis(axis).is_some_and(|axis| {
            let has_taken = match axis.mode {
                OperatingMode::ProfilePosition => {
                    axis.target().is_some_and(|target| axis.set_point.has_taken(target))
                }
                mode => !mode.is_cyclic() && axis.target().is_some(),
            };
            has_taken && axis.drive.has(Statusword::TARGET_REACHED)
        })
    }

    /// What became of the target in the last [`send_targets_all`](Self::send_targets_all).
    pub fn decision(&self, axis: usize) -> Decision {
        self.axis(axis).map_or(Decision::Closed, |axis| axis.decision)
    }

    /// The motion guard of an axis.
    pub fn guard(&self, axis: usize) -> Option<&MotionGuard> {
        self.axis(axis).map(|axis| &axis.guard)
    }

    /// Counters of an axis.
    pub fn statistics(&self, axis: usize) -> AxisStatistics {
        self.axis(axis).map(|axis| axis.statistics).unwrap_or_default()
    }
}
