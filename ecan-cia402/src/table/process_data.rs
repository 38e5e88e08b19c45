//! Feed-forward, outputs, inputs and touch probes of axes, and what their drives reported.

use ecan_canopen::{Probe, ProbeTrigger};

use super::cia402::Cia402;
use crate::axis::axis::Axis;
use crate::axis::command_error::CommandError;
use crate::axis::drive_limits::DriveLimits;
use crate::axis::drive_units::{DriveUnits, ScaleFinding};
use crate::axis::input_object::AxisInputs;
use crate::axis::output_object::OutputObject;
use crate::axis::touch_probe::ProbeState;
use crate::guard::feed_forward::FeedForward;

impl Cia402 {
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
        self.axis_mut(axis)?.targets.request(Some(target), Some(feed_forward));
        Ok(())
    }

    /// The feed-forward that was sent last.
    pub fn feed_forward(&self, axis: usize) -> FeedForward {
        self.axis(axis).map(|axis| axis.further.feed_forward.last()).unwrap_or_default()
    }

    /// Values of the further objects in the last TPDOs of a drive, see [`AxisConfig::inputs`](crate::AxisConfig::inputs).
    pub fn inputs(&self, axis: usize) -> Option<&AxisInputs> {
        self.axis(axis).map(|axis| &axis.further.inputs)
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
        self.mapped(axis, OutputObject::DigitalOutputs)?.further.outputs.digital_outputs = outputs;
        Ok(())
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
        self.mapped(axis, OutputObject::ProbeFunction)?.further.probes.arm(probe, trigger);
        Ok(())
    }

    /// Disables a touch probe.
    ///
    /// # Errors
    /// [`CommandError::NoSuchAxis`]; [`CommandError::NotMapped`] if the object is not mapped.
    pub fn disarm_probe(&mut self, axis: usize, probe: Probe) -> Result<(), CommandError> {
        self.mapped(axis, OutputObject::ProbeFunction)?.further.probes.disarm(probe);
        Ok(())
    }

    /// State of a touch probe, with the positions that it has sampled since it was armed.
    pub fn probe(&self, axis: usize, probe: Probe) -> Option<ProbeState> {
        self.axis(axis).map(|axis| axis.further.probes.state(probe, &axis.further.inputs))
    }

    fn mapped(&mut self, index: usize, output: OutputObject) -> Result<&mut Axis, CommandError> {
        let axis = self.axis_mut(index)?;
        if axis.further.layout.has_output(output) {
            Ok(axis)
        } else {
            Err(CommandError::NotMapped { axis: index, output })
        }
    }

    /// Limits of a drive, read at the end of its configuration if
    /// [`DriveConfig::use_limits`](crate::DriveConfig::use_limits) asks for it. The limits in force are
    /// those of its [`guard`](Self::guard).
    pub fn drive_limits(&self, axis: usize) -> Option<DriveLimits> {
        self.axis(axis).and_then(|axis| axis.further.limits)
    }

    /// Units of a drive, read at the end of its configuration if [`AxisConfig::scale_source`](crate::AxisConfig::scale_source) asks for it.
    pub fn drive_units(&self, axis: usize) -> Option<DriveUnits> {
        self.axis(axis).and_then(|axis| axis.further.units)
    }

    /// Difference between the scale of an axis and the units of its drive, see
    /// [`AxisConfig::scale_source`](crate::AxisConfig::scale_source); also logged as a warning at the end of the configuration.
    pub fn scale_finding(&self, axis: usize) -> Option<ScaleFinding> {
        self.axis(axis).and_then(|axis| axis.further.scale_finding)
    }
}
