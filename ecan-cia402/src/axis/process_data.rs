//! Process data of an axis beyond controlword, target, statusword and actual position.

use ecan_canopen::{Probe, ProbeStatus, ProbeTrigger};
use ecan_protocol::can::CanId;

use super::config::AxisConfig;
use super::limits::DriveLimits;
use super::pdo_layout::{AxisInputs, InputObject, OutputValues, PdoLayout};
use super::units::{DriveUnits, ScaleFinding};
use crate::guard::feed_forward::FeedForwardGuard;

/// Further process data of an axis, apart from what every axis needs in every cycle.
#[derive(Debug)]
pub(crate) struct FurtherData {
    pub(crate) layout: PdoLayout,
    /// CAN IDs of the RPDOs after the first.
    pub(crate) auxiliary: Vec<CanId>,
    /// Values of the further objects of the TPDOs.
    pub(crate) inputs: AxisInputs,
    /// Values of the RPDOs after the first.
    pub(crate) outputs: OutputValues,
    pub(crate) feed_forward: FeedForwardGuard,
    /// The drive may have a feed-forward that was sent.
    pub(crate) offsets_in_force: bool,
    /// The drive was in Operation Enabled by its last status.
    pub(crate) was_enabled: bool,
    /// Cycles with a clear path since a frame without feed-forward was sent, that one included.
    pub(crate) cleared_cycles: u32,
    /// The path has no known fault in this cycle. Only with RPDOs after the first.
    pub(crate) is_path_clear: bool,
    pub(crate) probes: TouchProbes,
    /// Limits and units of the drive, as they were read.
    pub(crate) limits: Option<DriveLimits>,
    pub(crate) units: Option<DriveUnits>,
    pub(crate) scale_finding: Option<ScaleFinding>,
    /// The TPDO with the status of the touch probes.
    pub(crate) probe_tpdo: Option<usize>,
}

impl FurtherData {
    pub(crate) fn new(config: &AxisConfig) -> Self {
        let layout = config.layout();
        Self {
            auxiliary: (1..layout.rpdo_count()).map(|nth| config.rpdo_id(nth)).collect(),
            probe_tpdo: layout.tpdo_of(InputObject::ProbeStatus),
            layout,
            inputs: AxisInputs::default(),
            outputs: OutputValues::default(),
            feed_forward: FeedForwardGuard::new(config.feed_forward),
            offsets_in_force: false,
            was_enabled: false,
            cleared_cycles: 0,
            is_path_clear: false,
            probes: TouchProbes::default(),
            limits: None,
            units: None,
            scale_finding: None,
        }
    }
}

/// State of a touch probe, see [`Cia402::probe`](crate::Cia402::probe).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ProbeState {
    /// The drive reports the probe as enabled, after the last command.
    pub is_armed: bool,
    /// Position at a positive edge since the probe was armed, in steps; `None` if none was stored, or
    /// its object is not in the [inputs](crate::AxisConfig::inputs).
    pub positive: Option<i32>,
    /// Position at a negative edge, likewise.
    pub negative: Option<i32>,
}

/// Touch probes of an axis.
///
/// A probe that is enabled already is disabled first, until the drive reports it, so that a position of
/// the last time is never taken for a new one. A position counts after two reports of the drive
/// in a row that it is stored: it may be in another TPDO than the status.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct TouchProbes {
    /// Functions to enable when the drive reports the probe as disabled.
    pending: [Option<u8>; 2],
    /// Functions that are sent.
    functions: [u8; 2],
    /// Status bits of the last two reports.
    confirmed: u16,
    last: u16,
}

impl TouchProbes {
    pub(crate) fn arm(&mut self, probe: Probe, trigger: ProbeTrigger) {
        self.disarm(probe);
        if let Some(pending) = self.pending.get_mut(probe.byte()) {
            *pending = Some(trigger.byte());
        }
    }

    pub(crate) fn disarm(&mut self, probe: Probe) {
        if let (Some(pending), Some(function)) =
            (self.pending.get_mut(probe.byte()), self.functions.get_mut(probe.byte()))
        {
            *pending = None;
            *function = 0;
        }
    }

    /// Takes a status that the drive reported.
    pub(crate) fn take(&mut self, status: u16) {
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
    pub(crate) fn function(&self) -> u16 {
        u16::from_le_bytes(self.functions)
    }

    pub(crate) fn state(&self, probe: Probe, inputs: &AxisInputs) -> ProbeState {
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
        probes.take(0);
        assert_eq!(probes.function(), 0x11);
        for (status, is_armed, position) in
            [(1, false, None), (1, true, None), (3, true, None), (3, true, Some(7))]
        {
            probes.take(status);
            let state = probes.state(Probe::One, &inputs(7));
            assert_eq!((state.is_armed, state.positive), (is_armed, position));
        }
    }

    #[test]
    fn armed_probe_is_disabled_before_it_is_armed_again() {
        let mut probes = TouchProbes::default();
        probes.arm(Probe::One, TRIGGER);
        for status in [0, 3, 3] {
            probes.take(status);
        }
        assert_eq!(probes.state(Probe::One, &inputs(7)).positive, Some(7));
        probes.arm(Probe::One, TRIGGER);
        assert_eq!(probes.function(), 0);
        for status in [3, 3] {
            probes.take(status);
            assert_eq!(probes.state(Probe::One, &inputs(7)), ProbeState::default(), "old");
        }
        probes.take(0);
        assert_eq!(probes.function(), 0x11);
        assert_eq!(probes.state(Probe::Two, &inputs(7)), ProbeState::default());
    }
}
