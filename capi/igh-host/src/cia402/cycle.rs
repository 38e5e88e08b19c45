//! Functions of axes in the cycle: targets, further process data, touch probes.

use std::ffi::c_int;

use ecan_c_boundary::frames::igh_mcan_rx_frame_t;
use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, mirror, pointers};
use ecan_c_export::export;
use ecan_canopen::{Probe, ProbeSource, ProbeTrigger};
use ecan_cia402::{
    Cia402, FeedForward, InputObject, Output, OutputObject, ProbeState, SendSummary, Target,
};
use ecan_mcan_port::Cycle;

use super::context::{igh_cia402_context_t, need_axis};
use crate::bus;
use crate::bus::Bus;
use crate::errors::OrCode as _;
use crate::handle::Entered;
use crate::mcan_port::cycle::owned_rx_frame;

// Section: The cycle
//
// igh_mcan_port_wait_next_cycle(&mcan);
// igh_mcan_port_cycle_begin(&mcan);
// igh_cia402_process_rx(&motors);
// igh_cia402_set_target(&motors, 0, target);
// igh_cia402_send_targets_all(&motors);
// igh_mcan_port_cycle_end(&mcan);
//
// An axis gets a target only if nothing prevents it: an incomplete working counter, a repeated
// image, a step beyond the limit, a drive that is not enabled. If the reason is not temporary, the
// axis holds; igh_cia402_enable() activates it again.

/// Offset of igh_cia402_set_scheduled_tx() for sending at once.
pub const IGH_CIA402_AT_ONCE: u32 = 0xFFFF_FFFF;

mirror! {
    /// Targets and SYNC messages of one cycle.
    #[derive(Default, PartialEq, Eq)]
    pub struct igh_cia402_send_summary_t from rust: SendSummary {
        /// Axes that got a target of the application, or their step.
        targets: u32 = rust.targets as u32,
        /// Axes that got their actual position as target, while they are enabled or activated.
        positions: u32 = rust.positions as u32,
        /// Active axes that got nothing in this cycle: their motion must not continue.
        waiting: u32 = rust.waiting as u32,
        /// Axes whose target was rejected.
        rejected: u32 = rust.rejected as u32,
        /// Axes that are not active, hold, or have no target due in this cycle.
        closed: u32 = rust.closed as u32,
        /// SYNC messages.
        syncs: u32 = rust.syncs as u32,
        /// 1 if every axis got a target of the application.
        all_moved: u8 = rust.all_moved().into(),
        /// Zero; for fields of later versions.
        reserved: [u8; 23] = [0; 23],
    }
}

/// Processes TPDOs, SDO responses, heartbeats and emergencies, and runs the next step of every
/// axis. First in the open cycle, in place of igh_mcan_port_receive(). Frames that do not belong to
/// the axes are dropped; igh_cia402_process_rx_ex() returns them. A further call in the same cycle does nothing.
///
/// @usage   rt, the cycle's thread, in an open cycle
/// @return  ECAN_OK; ECAN_ERR_ORDER if no cycle is open.
#[export(call, layer(cia402, port))]
pub fn igh_cia402_process_rx(context: *mut igh_cia402_context_t) {
    cia402.process_rx(&mut bus::open_cycle(call, port)?);
}

/// As igh_cia402_process_rx(); returns everything that belongs neither to the axes nor to their
/// network: frames of other nodes, other PDOs, transmit results (kind).
///
/// @param rx        Gets the items.
/// @param capacity  Items that fit.
/// @param rx_count  Gets the number of items.
///
/// @usage   rt, the cycle's thread, in an open cycle
/// @return  As igh_cia402_process_rx(); ECAN_ERR_BUFFER if not all items fit: the others are lost,
///          everything else is done.
#[export(call, layer(cia402, port))]
pub fn igh_cia402_process_rx_ex(
    context: *mut igh_cia402_context_t,
    rx: *mut igh_mcan_rx_frame_t,
    capacity: usize,
    rx_count: *mut usize,
) {
    pointers!(call, room(rx, capacity), out(rx_count));
    rx_count.set(0);
    let mut lost = 0_usize;
    let mut cycle = bus::open_cycle(call, port)?;
    cia402.process_rx_with(&mut cycle, |item| {
        lost += usize::from(!rx.push(owned_rx_frame(&item)));
    });
    rx_count.set(rx.count());
    if lost > 0 {
        let text = format_args!("{lost} more frames were received than the {capacity} that fit");
        return Err(call.fail(ecan_result_t::ECAN_ERR_BUFFER, text));
    }
}

fn send(
    call: Call,
    bus: &mut Entered<Bus>,
    send: impl FnOnce(&mut Cia402, &mut Cycle<'_>) -> SendSummary,
) -> Result<(), ecan_result_t> {
    let (cia402, port) = bus.need_axes(call)?;
    let summary = send(cia402, &mut bus::open_cycle(call, port)?);
    if let Some(axes) = bus.axes_mut() {
        axes.summary = summary;
    }
    Ok(())
}

/// Sends targets and commands of all axes, then SYNC, then pending NMT, SDO and heartbeat frames.
/// Last in the open cycle. A further call in the same cycle, of this function or of
/// igh_cia402_send_target_step(), sends nothing, and its summary counts every axis as closed: targets and
/// commands since the first call are those of the next cycle.
///
/// @usage   rt, the cycle's thread, in an open cycle after igh_cia402_process_rx
/// @return  ECAN_OK; ECAN_ERR_ORDER if no cycle is open. igh_cia402_get_send_summary() reports the
///          targets.
#[export(call, bus bus)]
pub fn igh_cia402_send_targets_all(context: *mut igh_cia402_context_t) {
    send(call, bus, Cia402::send_targets_all)
}

/// As igh_cia402_send_targets_all(); moves every CSP axis by its own target step, which it reaches
/// by its ramp. An axis does not move in a cycle in which its target is not sent.
///
/// @usage   rt, the cycle's thread, in an open cycle after igh_cia402_process_rx
/// @return  As igh_cia402_send_targets_all().
#[export(call, bus bus)]
pub fn igh_cia402_send_target_step(context: *mut igh_cia402_context_t) {
    send(call, bus, Cia402::send_target_step)
}

/// Gets the summary of the last igh_cia402_send_targets_all() or igh_cia402_send_target_step().
///
/// @usage   rt, the cycle's thread, after init
#[export(call, bus bus)]
pub fn igh_cia402_get_send_summary(
    context: *mut igh_cia402_context_t,
    summary: *mut igh_cia402_send_summary_t,
) {
    pointers!(call, out(summary));
    summary.set(bus.axes_mut().map(|axes| axes.summary).unwrap_or_default().into());
}

/// Sends targets only in every n-th cycle (--motion-div); more if SYNC is sent less often, since a
/// target takes effect with a SYNC. Step limit, ramp and target step apply per target. Only while no
/// axis is configured: the configuration writes the target period to the drives (0x60C2).
///
/// @param motion_div  Fewest cycles from target to target; 0 counts as 1.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_AXIS_STATE if an axis is configured or being configured;
///          ECAN_ERR_CONFIG for a period that 0x60C2 cannot have (CSP).
#[export(call, layer(cia402, _))]
pub fn igh_cia402_set_motion_div(context: *mut igh_cia402_context_t, motion_div: u32) {
    cia402.set_motion_div(motion_div).or_code(call)
}

/// Sends targets and SYNC at phases of the Sync0 period instead of at once (manual 8.4, 13.8),
/// independently. Needs distributed clocks with Sync0. Only while no axis is active.
///
/// A gateway drops a scheduled frame that arrives after its phase, and the drive keeps the previous
/// target: leave a margin.
///
/// @param enable          0 sends both at once, for any offsets; else they are scheduled.
/// @param rpdo_offset_ns  Nanoseconds after Sync0 at which targets are sent, or IGH_CIA402_AT_ONCE.
/// @param sync_offset_ns  The same for SYNC. Before the targets, it applies those of the SYNC period
///                        before, which take effect one SYNC period later.
///
/// @usage   not rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_SCHEDULE without Sync0, beyond its period, or on a gateway that
///          cannot; ECAN_ERR_AXIS_STATE while an axis is active. After an error everything is as it
///          was.
#[export(call, layer(cia402, port))]
pub fn igh_cia402_set_scheduled_tx(
    context: *mut igh_cia402_context_t,
    enable: c_int,
    rpdo_offset_ns: u32,
    sync_offset_ns: u32,
) {
    let offset = |ns: u32| (enable != 0 && ns != IGH_CIA402_AT_ONCE).then_some(ns);
    cia402.set_scheduled_tx(port, offset(rpdo_offset_ns), offset(sync_offset_ns)).or_code(call)
}

// Section: Targets
//
// A target stays until the next one. A hold drops it; after activation the axis stays at its
// position until it gets a new target.

/// Sets the target of an axis. igh_cia402_get_axis_state() reports the decision on it after the
/// targets were sent.
///
/// @param target  Raw units of the mode: steps, velocity or torque.
///
/// @usage   rt, the cycle's thread, after init
#[export(call, layer(cia402, _))]
pub fn igh_cia402_set_target(context: *mut igh_cia402_context_t, axis: usize, target: i32) {
    cia402.axis_mut(axis).or_code(call)?.set_target(target).or_code(call)
}

/// As igh_cia402_set_target(), with an angle by the axis' steps_per_turn and origin.
///
/// @param radians  Radians of the axis.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_cia402_set_target(); ECAN_ERR_ARGUMENT for an angle without a position.
#[export(call, layer(cia402, _))]
pub fn igh_cia402_set_target_radians(
    context: *mut igh_cia402_context_t,
    axis: usize,
    radians: f64,
) {
    cia402.axis_mut(axis).or_code(call)?.set_target(Target::radians(radians)).or_code(call)
}

/// Sets the step of igh_cia402_send_target_step(); the axis reaches it by its ramp.
///
/// @param step  Steps per target. A step beyond the step limit is rejected when the ramp reaches it.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_cia402_set_target().
#[export(call, layer(cia402, _))]
pub fn igh_cia402_set_target_step(context: *mut igh_cia402_context_t, axis: usize, step: i32) {
    cia402.axis_mut(axis).or_code(call)?.set_target_step(step);
}

// Section: Further process data
//
// The RPDOs of an axis carry controlword and target, its TPDOs statusword and actual position.
// igh_cia402_axis_t.outputs and inputs add objects, also in further PDOs, which the configuration maps.
//
// axes[0].outputs = IGH_CIA402_OUTPUT_VELOCITY_OFFSET | IGH_CIA402_OUTPUT_DIGITAL_OUTPUTS;
// axes[0].inputs = IGH_CIA402_INPUT_VELOCITY | IGH_CIA402_INPUT_DIGITAL_INPUTS;
// axes[0].feed_forward_velocity = 100000;
// axes[0].feed_forward_velocity_change = 1000;

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
    let target = Target::from(target).with_feed_forward(feed_forward);
    cia402.axis_mut(axis).or_code(call)?.set_target(target).or_code(call)
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
    cia402.axis_mut(axis).or_code(call)?.set_output(Output::Digital(outputs)).or_code(call)
}

// Section: Touch probes
//
// A touch probe samples the actual position at edges of a signal. The axis needs
// IGH_CIA402_OUTPUT_PROBE_FUNCTION, IGH_CIA402_INPUT_PROBE_STATUS, and the positions in its inputs.

/// Trigger of a touch probe; a sum.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum igh_cia402_probe_trigger_t {
    /// Samples positive edges.
    IGH_CIA402_PROBE_POSITIVE = 1,
    /// Samples negative edges.
    IGH_CIA402_PROBE_NEGATIVE = 2,
    /// Samples every edge; otherwise the first one only.
    IGH_CIA402_PROBE_CONTINUOUS = 4,
    /// The index pulse of the encoder, in place of the input of the probe.
    IGH_CIA402_PROBE_INDEX_PULSE = 8,
}

mirror! {
    /// State of a touch probe.
    pub struct igh_cia402_probe_t from rust: ProbeState {
        /// Position at a positive edge since the probe was armed, in steps, if has_positive is 1.
        positive: i32 = rust.positive.unwrap_or(0),
        /// Position at a negative edge, likewise.
        negative: i32 = rust.negative.unwrap_or(0),
        /// 1 if the drive reports the probe as enabled, after the last command.
        is_armed: u8,
        /// 1 if a position at a positive edge is stored.
        has_positive: u8 = rust.positive.is_some().into(),
        /// 1 if a position at a negative edge is stored.
        has_negative: u8 = rust.negative.is_some().into(),
        /// Zero; for fields of later versions.
        reserved: [u8; 21] = [0; 21],
    }
}

fn parse_probe(call: Call, number: u8) -> Result<Probe, ecan_result_t> {
    match number {
        1 => Ok(Probe::One),
        2 => Ok(Probe::Two),
        _ => Err(call.argument("probe", format_args!("{number} is out of range; allowed: 1, 2"))),
    }
}

fn parse_trigger(call: Call, sum: u8) -> Result<ProbeTrigger, ecan_result_t> {
    use igh_cia402_probe_trigger_t::*;
    let has = |part: igh_cia402_probe_trigger_t| sum & part as u8 != 0;
    let trigger = ProbeTrigger {
        source: if has(IGH_CIA402_PROBE_INDEX_PULSE) {
            ProbeSource::IndexPulse
        } else {
            ProbeSource::Input
        },
        positive: has(IGH_CIA402_PROBE_POSITIVE),
        negative: has(IGH_CIA402_PROBE_NEGATIVE),
        is_continuous: has(IGH_CIA402_PROBE_CONTINUOUS),
    };
    if sum > 15 || !(trigger.positive || trigger.negative) {
        let text = format_args!(
            "{sum} is invalid; allowed: a sum of igh_cia402_probe_trigger_t with at least one edge"
        );
        return Err(call.argument("trigger", text));
    }
    Ok(trigger)
}

/// Arms a touch probe. One that is armed already is disabled first, so that a position of the last time is
/// never taken for a new one. igh_cia402_get_probe() returns the positions.
///
/// @param probe    1 or 2.
/// @param trigger  Sum of igh_cia402_probe_trigger_t.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_AXIS_STATE without IGH_CIA402_OUTPUT_PROBE_FUNCTION in `outputs` of the
///          axis; ECAN_ERR_ARGUMENT, ECAN_ERR_AXIS.
#[export(call, layer(cia402, _))]
pub fn igh_cia402_arm_probe(
    context: *mut igh_cia402_context_t,
    axis: usize,
    probe: u8,
    trigger: u8,
) {
    let (probe, trigger) = (parse_probe(call, probe)?, parse_trigger(call, trigger)?);
    let output = Output::Probe(probe, Some(trigger));
    cia402.axis_mut(axis).or_code(call)?.set_output(output).or_code(call)
}

/// Disables a touch probe.
///
/// @param probe  1 or 2.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_cia402_arm_probe().
#[export(call, layer(cia402, _))]
pub fn igh_cia402_disarm_probe(context: *mut igh_cia402_context_t, axis: usize, probe: u8) {
    let output = Output::Probe(parse_probe(call, probe)?, None);
    cia402.axis_mut(axis).or_code(call)?.set_output(output).or_code(call)
}

/// Gets the state of a touch probe.
///
/// @param probe        1 or 2.
/// @param probe_state  Gets the state.
///
/// @usage   rt, the cycle's thread, after init
/// @return  ECAN_OK; ECAN_ERR_ARGUMENT, ECAN_ERR_AXIS.
#[export(call, layer(cia402, _), into probe_state)]
pub fn igh_cia402_get_probe(
    context: *mut igh_cia402_context_t,
    axis: usize,
    probe: u8,
    probe_state: *mut igh_cia402_probe_t,
) {
    let probe = parse_probe(call, probe)?;
    Ok(need_axis(call, cia402, axis)?.probe(probe).into())
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

    #[test]
    fn trigger_is_a_sum_with_an_edge() {
        use igh_cia402_probe_trigger_t::*;
        let (positive, negative) =
            (IGH_CIA402_PROBE_POSITIVE as u8, IGH_CIA402_PROBE_NEGATIVE as u8);
        let continuous = IGH_CIA402_PROBE_CONTINUOUS as u8;
        let of = |sum| {
            let mut trigger = None;
            ecan_c_boundary::call("test", |call| {
                trigger = Some(parse_trigger(call, sum)?);
                Ok(())
            });
            trigger
        };
        let both = of(positive | negative | continuous).unwrap();
        assert!(both.positive && both.negative && both.is_continuous);
        assert_eq!(both.source, ProbeSource::Input);
        let pulse = of(positive | IGH_CIA402_PROBE_INDEX_PULSE as u8).unwrap();
        assert!(pulse.positive && !pulse.negative && !pulse.is_continuous);
        assert_eq!(pulse.source, ProbeSource::IndexPulse);
        for wrong in [0, continuous, 16 | positive, u8::MAX] {
            assert_eq!(of(wrong), None, "{wrong}");
        }
    }
}
