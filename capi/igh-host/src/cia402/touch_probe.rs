//! Touch probes
//!
//! A touch probe samples the actual position at edges of a signal. The axis needs
//! IGH_CIA402_OUTPUT_PROBE_FUNCTION, IGH_CIA402_INPUT_PROBE_STATUS, and the positions in its inputs.

use ecan_c_boundary::result::ecan_result_t;
use ecan_c_boundary::{Call, mirror};
use ecan_c_export::export;
use ecan_canopen::{Probe, ProbeSource, ProbeTrigger};
use ecan_cia402::ProbeState;

use super::context::{igh_cia402_context_t, need_axis};
use crate::errors::OrCode as _;

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

fn probe(call: Call, number: u8) -> Result<Probe, ecan_result_t> {
    match number {
        1 => Ok(Probe::One),
        2 => Ok(Probe::Two),
        _ => Err(call.argument("probe", format_args!("{number} is out of range; allowed: 1, 2"))),
    }
}

fn trigger(call: Call, sum: u8) -> Result<ProbeTrigger, ecan_result_t> {
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
    let (probe, trigger) = (self::probe(call, probe)?, self::trigger(call, trigger)?);
    cia402.arm_probe(axis, probe, trigger).or_code(call)
}

/// Disables a touch probe.
///
/// @param probe  1 or 2.
///
/// @usage   rt, the cycle's thread, after init
/// @return  As igh_cia402_arm_probe().
#[export(call, layer(cia402, _))]
pub fn igh_cia402_disarm_probe(context: *mut igh_cia402_context_t, axis: usize, probe: u8) {
    cia402.disarm_probe(axis, self::probe(call, probe)?).or_code(call)
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
    let probe = self::probe(call, probe)?;
    need_axis(call, cia402, axis)?;
    cia402.probe(axis, probe).map(Into::into).ok_or(ecan_result_t::ECAN_ERR_INTERNAL)
}
