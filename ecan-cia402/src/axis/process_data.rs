//! Process data of an axis beyond controlword, target, statusword and actual position.

use ecan_canopen::{Probe, ProbeStatus, ProbeTrigger};
use ecan_protocol::can::CanId;

use super::pdo_layout::{AxisInputs, InputObject, OutputObject, OutputValues, RpdoBytes};
use super::plan::AxisPlan;
use super::target_path::{FeedForwardStep, TargetTurn};
use crate::guard::feed_forward::{FeedForward, FeedForwardGuard};

/// Cycles with a clear path after a frame without feed-forward until the drive certainly has it, with SYNC in every
/// cycle and frames that are sent at once.
const CLEARED_CYCLES: u32 = 4;

/// Output of a drive, see [`AxisHandle::set_output`](crate::AxisHandle::set_output).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Output {
    /// Digital outputs 0x60FE:01. Needs
    /// [`OutputObject::DigitalOutputs`](crate::OutputObject::DigitalOutputs) in the
    /// [outputs](crate::PdoConfig::outputs), and the mask
    /// [`DriveConfig::output_mask`](crate::DriveConfig::output_mask).
    Digital(u32),
    /// Touch probe, armed or (`None`) disabled: it samples the actual position at edges of a signal. A probe
    /// that is armed already is disabled first. [`AxisRef::probe`](crate::AxisRef::probe) returns the positions.
    /// Needs [`OutputObject::ProbeFunction`](crate::OutputObject::ProbeFunction) in the
    /// [outputs](crate::PdoConfig::outputs); status and positions in the [inputs](crate::PdoConfig::inputs).
    Probe(Probe, Option<ProbeTrigger>),
}

impl Output {
    /// Object that must be mapped.
    pub(super) fn object(self) -> OutputObject {
        match self {
            Self::Digital(_) => OutputObject::DigitalOutputs,
            Self::Probe(..) => OutputObject::ProbeFunction,
        }
    }
}

/// Further process data of an axis, apart from what every axis needs in every cycle: the further objects of its
/// TPDOs, and the RPDOs after the first, with feed-forward and outputs.
#[derive(Debug)]
pub(crate) struct ProcessData {
    /// CAN IDs of the RPDOs after the first.
    auxiliary: Vec<CanId>,
    /// Values of the further objects of the TPDOs.
    inputs: AxisInputs,
    /// Values of the RPDOs after the first.
    outputs: OutputValues,
    feed_forward: FeedForwardGuard,
    /// The drive may have a feed-forward that was sent.
    has_offsets: bool,
    /// The drive was in Operation Enabled by its last status.
    was_enabled: bool,
    /// Cycles with a clear path since a frame without feed-forward was sent, that one included.
    cleared_cycles: u32,
    /// The path has no known fault in this cycle. Only with RPDOs after the first.
    is_path_clear: bool,
    probes: TouchProbes,
    /// The TPDO with the status of the touch probes.
    probe_tpdo: Option<usize>,
}

impl ProcessData {
    pub(crate) fn new(plan: &AxisPlan) -> Self {
        let rpdos = 1..plan.layout.rpdo_count();
        Self {
            auxiliary: rpdos.map(|nth| plan.config.rpdo_id(nth)).collect(),
            inputs: AxisInputs::default(),
            outputs: OutputValues::default(),
            feed_forward: FeedForwardGuard::new(plan.config.feed_forward),
            has_offsets: false,
            was_enabled: false,
            cleared_cycles: 0,
            is_path_clear: false,
            probes: TouchProbes::default(),
            probe_tpdo: plan.layout.tpdo_of(InputObject::ProbeStatus),
        }
    }

    pub(crate) fn inputs(&self) -> &AxisInputs {
        &self.inputs
    }

    /// The feed-forward that was sent last.
    pub(crate) fn feed_forward(&self) -> FeedForward {
        self.feed_forward.last()
    }

    /// Applies the limits of the feed-forward again.
    pub(crate) fn restart_feed_forward(&mut self, plan: &AxisPlan) {
        self.feed_forward = FeedForwardGuard::new(plan.config.feed_forward);
    }

    pub(crate) fn set_output(&mut self, output: Output) {
        match output {
            Output::Digital(outputs) => self.outputs.digital_outputs = outputs,
            Output::Probe(probe, Some(trigger)) => self.probes.arm(probe, trigger),
            Output::Probe(probe, None) => self.probes.disarm(probe),
        }
    }

    pub(crate) fn probe(&self, probe: Probe) -> ProbeState {
        self.probes.state(probe, &self.inputs)
    }

    /// Stores the further objects of a TPDO. `nth` counts the TPDOs of the axis from 0. Returns whether the
    /// TPDO is long enough for them.
    pub(crate) fn store_tpdo(&mut self, plan: &AxisPlan, nth: usize, data: &[u8]) -> bool {
        if !plan.layout.decode_inputs(nth, data, &mut self.inputs) {
            return false;
        }
        if self.probe_tpdo == Some(nth)
            && let Some(status) = self.inputs.probe_status()
        {
            self.probes.update(status);
        }
        true
    }

    pub(crate) fn set_path_clear(&mut self, is_clear: bool) {
        self.is_path_clear = is_clear;
    }

    pub(crate) fn is_path_clear(&self) -> bool {
        self.is_path_clear
    }

    /// Forgets what belongs to another configuration of the drive.
    pub(crate) fn forget_drive(&mut self) {
        self.inputs = AxisInputs::default();
        self.feed_forward.end();
        self.has_offsets = false;
        self.cleared_cycles = 0;
    }

    /// Notes that an adopted drive may have a feed-forward of an earlier owner.
    pub(crate) fn adopt(&mut self, plan: &AxisPlan) {
        self.has_offsets = plan.has_auxiliary;
    }

    /// Returns whether the drive may have a feed-forward.
    pub(crate) fn has_offsets(&self) -> bool {
        self.has_offsets
    }

    /// Returns whether the drive left Operation Enabled while it may have had a feed-forward. A drive that stops drops
    /// it: the motor, which may have been at rest without being at its target, moves there.
    pub(crate) fn drops_offsets(&mut self, is_enabled: bool) -> bool {
        let has_left = std::mem::replace(&mut self.was_enabled, is_enabled) && !is_enabled;
        has_left && self.has_offsets
    }

    /// Returns whether the drive certainly has no feed-forward any more, once after its end.
    ///
    /// A motor with a feed-forward is not where its position controller leads it: the position of the
    /// first target is read after the end of the feed-forward, and only later positions show standstill.
    pub(crate) fn step_offsets(&mut self, plan: &AxisPlan, turn: TargetTurn) -> bool {
        // The drive takes a frame over with a SYNC, which these cycles do not have.
        let has_no_sync = matches!(turn, TargetTurn::NotReceived | TargetTurn::NoSync);
        if !self.is_path_clear {
            self.cleared_cycles = 0;
        } else if self.cleared_cycles > 0 && !has_no_sync {
            self.cleared_cycles += 1;
            let until_sync = plan.cycles_per_sync.saturating_sub(1);
            let in_schedule = u32::from(plan.schedule_images);
            if self.cleared_cycles > CLEARED_CYCLES + until_sync + in_schedule {
                self.has_offsets = false;
                self.cleared_cycles = 0;
                return true;
            }
        }
        false
    }

    /// Takes the next step of the feed-forward. Returns whether a limit changed it.
    pub(crate) fn step_feed_forward(&mut self, step: FeedForwardStep) -> bool {
        match step {
            FeedForwardStep::Follow(requested) => self.feed_forward.follow(requested),
            FeedForwardStep::Return => self.feed_forward.follow(None),
            FeedForwardStep::Wait => false,
            FeedForwardStep::End => {
                self.feed_forward.end();
                false
            }
        }
    }

    /// Sets the values of the RPDOs after the first.
    pub(crate) fn update_outputs(&mut self) {
        let FeedForward { velocity, torque } = self.feed_forward.last();
        self.outputs.velocity_offset = velocity;
        self.outputs.torque_offset = torque;
        self.outputs.probe_function = self.probes.function();
    }

    /// RPDOs after the first.
    pub(crate) fn frames(&self, plan: &AxisPlan) -> impl Iterator<Item = (CanId, RpdoBytes)> {
        self.auxiliary.iter().copied().zip(plan.layout.encode_auxiliary(&self.outputs))
    }

    /// Notes that the RPDOs after the first were sent; the last ones were not unless `is_complete`.
    pub(crate) fn on_sent(&mut self, is_complete: bool) {
        if self.feed_forward.last() != FeedForward::NONE {
            self.has_offsets = true;
            self.cleared_cycles = 0;
        } else if self.has_offsets && is_complete && self.cleared_cycles == 0 {
            self.cleared_cycles = 1;
        }
    }
}

/// State of a touch probe, see [`AxisRef::probe`](crate::AxisRef::probe).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ProbeState {
    /// The drive reports the probe as enabled, after the last command.
    pub is_armed: bool,
    /// Position at a positive edge since the probe was armed, in steps; `None` if none was stored, or
    /// its object is not in the [inputs](crate::PdoConfig::inputs).
    pub positive: Option<i32>,
    /// Position at a negative edge since the probe was armed, in steps; `None` if none was stored, or
    /// its object is not in the [inputs](crate::PdoConfig::inputs).
    pub negative: Option<i32>,
}

/// Touch probes of an axis.
///
/// A probe that is enabled already is disabled first, until the drive reports it, so that a position of
/// the last time is never taken for a new one. A position counts after two reports of the drive
/// in a row that it is stored: it may be in another TPDO than the status.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct TouchProbes {
    /// Functions to enable when the drive reports the probe as disabled.
    pending: [Option<u8>; 2],
    /// Functions that are sent.
    functions: [u8; 2],
    /// Status bits of the last two reports.
    confirmed: u16,
    last: u16,
}

impl TouchProbes {
    fn arm(&mut self, probe: Probe, trigger: ProbeTrigger) {
        self.disarm(probe);
        if let Some(pending) = self.pending.get_mut(probe.byte()) {
            *pending = Some(trigger.byte());
        }
    }

    fn disarm(&mut self, probe: Probe) {
        if let (Some(pending), Some(function)) =
            (self.pending.get_mut(probe.byte()), self.functions.get_mut(probe.byte()))
        {
            *pending = None;
            *function = 0;
        }
    }

    /// Evaluates a status that the drive reported.
    fn update(&mut self, status: u16) {
        self.confirmed = status & self.last;
        self.last = status;
        for probe in Probe::ALL {
            let is_enabled = ProbeStatus(status).is_enabled(probe);
            if let (false, Some(pending), Some(function)) = (
                is_enabled,
                self.pending.get_mut(probe.byte()),
                self.functions.get_mut(probe.byte()),
            ) && let Some(next) = pending.take()
            {
                *function = next;
            }
        }
    }

    /// The value of 0x60B8.
    fn function(&self) -> u16 {
        u16::from_le_bytes(self.functions)
    }

    fn state(&self, probe: Probe, inputs: &AxisInputs) -> ProbeState {
        let is_wanted = self.functions.get(probe.byte()).is_some_and(|function| *function != 0);
        let status = ProbeStatus(self.confirmed);
        if !is_wanted || !status.is_enabled(probe) {
            return ProbeState::default();
        }
        let (positive, negative) = match probe {
            Probe::One => (InputObject::Probe1Positive, InputObject::Probe1Negative),
            Probe::Two => (InputObject::Probe2Positive, InputObject::Probe2Negative),
        };
        let stored = |is_stored: bool, object| inputs.get(object).filter(|_| is_stored);
        ProbeState {
            is_armed: true,
            positive: stored(status.has_positive(probe), positive),
            negative: stored(status.has_negative(probe), negative),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ecan_canopen::ProbeSource;

    const TRIGGER: ProbeTrigger = ProbeTrigger::first_positive(ProbeSource::Input);

    fn inputs(position: i32) -> AxisInputs {
        let mut inputs = AxisInputs::default();
        inputs.set(InputObject::Probe1Positive, position.cast_unsigned());
        inputs
    }

    #[test]
    fn position_counts_after_two_reports() {
        let mut probes = TouchProbes::default();
        probes.arm(Probe::One, TRIGGER);
        assert_eq!(probes.function(), 0, "the drive has not reported that it is disabled");
        probes.update(0);
        assert_eq!(probes.function(), 0x11);
        for (status, is_armed, position) in
            [(1, false, None), (1, true, None), (3, true, None), (3, true, Some(7))]
        {
            probes.update(status);
            let state = probes.state(Probe::One, &inputs(7));
            assert_eq!((state.is_armed, state.positive), (is_armed, position));
        }
    }

    #[test]
    fn armed_probe_is_disabled_before_it_is_armed_again() {
        let mut probes = TouchProbes::default();
        probes.arm(Probe::One, TRIGGER);
        for status in [0, 3, 3] {
            probes.update(status);
        }
        assert_eq!(probes.state(Probe::One, &inputs(7)).positive, Some(7));
        probes.arm(Probe::One, TRIGGER);
        assert_eq!(probes.function(), 0);
        for status in [3, 3] {
            probes.update(status);
            assert_eq!(probes.state(Probe::One, &inputs(7)), ProbeState::default(), "old");
        }
        probes.update(0);
        assert_eq!(probes.function(), 0x11);
        assert_eq!(probes.state(Probe::Two, &inputs(7)), ProbeState::default());
    }
}
