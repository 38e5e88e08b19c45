//! Further process data
//!
//! The RPDOs of an axis carry controlword and target, its TPDOs statusword and actual position.
//! igh_cia402_axis_t.outputs and inputs add objects, also in further PDOs, which the configuration maps.
//!
//! ```c
//! axes[0].outputs = IGH_CIA402_OUTPUT_VELOCITY_OFFSET | IGH_CIA402_OUTPUT_DIGITAL_OUTPUTS;
//! axes[0].inputs = IGH_CIA402_INPUT_VELOCITY | IGH_CIA402_INPUT_DIGITAL_INPUTS;
//! axes[0].feed_forward_velocity = 100000;
//! axes[0].feed_forward_velocity_change = 1000;
//! ```

use ecan_c_boundary::mirror;
use ecan_c_export::export;
use ecan_cia402::{FeedForward, InputObject, OutputObject};

use super::context::igh_cia402_context_t;
use crate::errors::OrCode as _;

mirror! {
    /// Object of the RPDOs of an axis beyond controlword and target.
    pub enum igh_cia402_output_t as OutputObject {
        /// Velocity offset 0x60B1: feed-forward in CSP.
        IGH_CIA402_OUTPUT_VELOCITY_OFFSET = 0x01 => OutputObject::VelocityOffset,
        /// Torque offset 0x60B2: feed-forward in CSP and CSV.
        IGH_CIA402_OUTPUT_TORQUE_OFFSET = 0x02 => OutputObject::TorqueOffset,
        /// Touch probe function 0x60B8; needs IGH_CIA402_INPUT_PROBE_STATUS.
        IGH_CIA402_OUTPUT_PROBE_FUNCTION = 0x04 => OutputObject::ProbeFunction,
        /// Digital outputs 0x60FE:01.
        IGH_CIA402_OUTPUT_DIGITAL_OUTPUTS = 0x08 => OutputObject::DigitalOutputs,
        /// Mode of operation 0x6060: the mode of the axis.
        IGH_CIA402_OUTPUT_MODE = 0x10 => OutputObject::Mode,
    }
}

mirror! {
    /// Object of the TPDOs of an axis beyond statusword and actual position.
    pub enum igh_cia402_input_t as InputObject {
        /// Actual velocity 0x606C, in units of the drive's velocity.
        IGH_CIA402_INPUT_VELOCITY = 0x0001 => InputObject::Velocity,
        /// Actual torque 0x6077, in thousandths of the rated torque.
        IGH_CIA402_INPUT_TORQUE = 0x0002 => InputObject::Torque,
        /// Error code 0x603F.
        IGH_CIA402_INPUT_ERROR_CODE = 0x0004 => InputObject::ErrorCode,
        /// Digital inputs 0x60FD.
        IGH_CIA402_INPUT_DIGITAL_INPUTS = 0x0008 => InputObject::DigitalInputs,
        /// Mode display 0x6061.
        IGH_CIA402_INPUT_MODE_DISPLAY = 0x0010 => InputObject::ModeDisplay,
        /// Following error 0x60F4 by the drive, in steps.
        IGH_CIA402_INPUT_FOLLOWING_ERROR = 0x0020 => InputObject::FollowingError,
        /// Touch probe status 0x60B9.
        IGH_CIA402_INPUT_PROBE_STATUS = 0x0040 => InputObject::ProbeStatus,
        /// Position at the positive edge of touch probe 1, 0x60BA.
        IGH_CIA402_INPUT_PROBE_1_POSITIVE = 0x0080 => InputObject::Probe1Positive,
        /// Position at the negative edge of touch probe 1, 0x60BB.
        IGH_CIA402_INPUT_PROBE_1_NEGATIVE = 0x0100 => InputObject::Probe1Negative,
        /// Position at the positive edge of touch probe 2, 0x60BC.
        IGH_CIA402_INPUT_PROBE_2_POSITIVE = 0x0200 => InputObject::Probe2Positive,
        /// Position at the negative edge of touch probe 2, 0x60BD.
        IGH_CIA402_INPUT_PROBE_2_NEGATIVE = 0x0400 => InputObject::Probe2Negative,
        /// Actual velocity 0x6044 of VL.
        IGH_CIA402_INPUT_VL_VELOCITY = 0x0800 => InputObject::VlVelocity,
    }
}

/// As igh_cia402_set_target(), with a feed-forward for this target, which the drive adds to the demand of
/// its controllers. An offset whose object is not in `outputs` of the axis has no effect.
///
/// The offsets are limited by the feed_forward fields of igh_cia402_axis_t and change by at most their
/// limit per target; igh_cia402_get_axis_state() has those that were sent. They belong to this target:
/// give them in every cycle. For a target without them they return to 0 by their changes; when the axis
/// holds or is stopped they end at once.
///
/// @param target           Raw units of the mode.
/// @param velocity_offset  0x60B1, in units of the drive's velocity.
/// @param torque_offset    0x60B2, in thousandths of the rated torque.
///
/// @usage   rt, the cycle's thread, after init
#[export(call, layer(cia402, _))]
pub fn igh_cia402_set_target_with(
    context: *mut igh_cia402_context_t,
    axis: usize,
    target: i32,
    velocity_offset: i32,
    torque_offset: i16,
) {
    let feed_forward = FeedForward { velocity: velocity_offset, torque: torque_offset };
    cia402.set_target_with(axis, target, feed_forward).or_code(call)
}

/// Sets the digital outputs 0x60FE:01 of a drive, in every state of the axis. They are sent in every
/// target period, so that they also arrive after a fault of the communication path.
///
/// @param outputs  The outputs; output_mask of igh_cia402_axis_t lets the host set them.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_AXIS_STATE without IGH_CIA402_OUTPUT_DIGITAL_OUTPUTS in `outputs` of the
///          axis; ECAN_ERR_AXIS.
#[export(call, layer(cia402, _))]
pub fn igh_cia402_set_digital_outputs(
    context: *mut igh_cia402_context_t,
    axis: usize,
    outputs: u32,
) {
    cia402.set_digital_outputs(axis, outputs).or_code(call)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_are_the_bits_of_the_objects() {
        let outputs = igh_cia402_output_t::PAIRS;
        assert!(outputs.iter().map(|(.., object)| *object).eq(OutputObject::ALL.iter().copied()));
        assert!(outputs.iter().all(|(mask, _, object)| *mask as u32 == 1 << object.raw()));
        let inputs = igh_cia402_input_t::PAIRS;
        assert!(inputs.iter().map(|(.., object)| *object).eq(InputObject::ALL.iter().copied()));
        assert!(inputs.iter().all(|(mask, _, object)| *mask as u32 == 1 << object.raw()));
    }
}
